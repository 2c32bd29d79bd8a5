"""Names the next step from a new pad to contacts: probe, selftest, baseline --bare, --rest, run, listen."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def after_probe(facts: Mapping[str, Any], config: str) -> str:
    """config: the words ` --config FILE` as they were given, or ""."""
    absent = [pad["pad"] for pad in facts["pads"] if not pad["connected"] and not pad["faults"]]
    faulty = [pad["pad"] for pad in facts["pads"] if pad["faults"]]
    mend = f"mend what is listed under faults of {_named(faulty)}"
    if absent:
        also = f"; {mend}" if faulty else ""
        answer = f"make the source of {_named(absent)} answer: the `reason` of each says how"
        return f"{answer}{also}; then `fmfts-daemon probe{config}`"
    if faulty:
        return f"{mend}, then `fmfts-daemon probe{config}` again"
    if any(pad.get("board", {}).get("self_test") is False for pad in facts["pads"]):
        return f"`fmfts-daemon baseline --bare{config}{_pad_option(facts)}` while the pad is not mounted"
    return f"`fmfts-daemon selftest{config}{_pad_option(facts)}` measures every axis"


def after_selftest(facts: Mapping[str, Any], config: str, pad: str) -> str:
    if not facts.get("passed"):
        return f"check supply and wires of the sensors that failed, then `fmfts-daemon selftest{config}{pad}` again"
    if facts.get("gain_factor_sd") is None:
        measures = ": it takes these zeros off, so that they do not matter" if _has_zeros(facts) else ""
        return f"`fmfts-daemon baseline --bare{config}{pad}` while the pad is not mounted{measures}"
    return (
        f"`fmfts-daemon baseline --bare{config}{pad}` while the pad is not mounted; if that is recorded already, "
        f"`fmfts-daemon baseline --rest{config}{pad}` uses the new gains"
    )


def after_baseline(facts: Mapping[str, Any], config: str, pad: str, *, is_running: bool) -> str:
    """is_running: a daemon recorded it, and already uses it."""
    kind = facts.get("kind")
    if kind == "bare":
        return f"mount the pad, then `fmfts-daemon baseline --rest{config}{pad}` while nothing touches it"
    if kind == "rest":
        run = f"`fmfts-daemon run{config}`, and `fmfts-daemon listen` in another terminal"
        if is_running:
            run = "`fmfts-daemon listen`: the running daemon uses this baseline"
        worth = next((step for step in ("--learn", "--turn", "--refine") if _is_worth(step, facts)), "")
        return f"{run}; for better accuracy first `fmfts-daemon baseline {worth}{config}{pad}`" if worth else run
    return ""


def after_weighing(config: str, pad: str, *, is_running: bool) -> str:
    if is_running:
        return "`fmfts-daemon listen`: it should now show the weight; the running daemon uses the result already"
    return f"`fmfts-daemon run{config}`, and `fmfts-daemon listen` in another terminal: it should show the weight"


def _has_zeros(facts: Mapping[str, Any]) -> bool:
    return any("zero_t" in sensor for sensor in facts.get("sensors", ()))


def _is_worth(step: str, facts: Mapping[str, Any]) -> bool:
    return any(sentence.startswith(step) for sentence in facts.get("could_gain", ()))


def _named(pads: list[str]) -> str:
    return ("pad " if len(pads) == 1 else "pads ") + ", ".join(f"'{pad}'" for pad in pads)


def _pad_option(facts: Mapping[str, Any]) -> str:
    pads = facts["pads"]
    return f" --pad {pads[0]['pad']}" if len(pads) > 1 else ""
