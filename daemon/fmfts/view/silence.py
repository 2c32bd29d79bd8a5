"""Finds out why a listener received nothing: asks the daemon, or, if it does not answer, examines the endpoint."""

from __future__ import annotations

from fmfts_client import ControlError, Endpoints, request
from fmfts_client.silence import why_silent

ANSWER_S = 0.5


def why_nothing_came(endpoints: Endpoints, pad: str | None) -> str:
    """The reason, as a sentence, why no message of `pad` (None: of any pad) arrived."""
    try:
        known = [each["pad"] for each in request("pads", endpoint=endpoints, timeout_s=ANSWER_S)["pads"]]
    except ControlError:
        return why_silent(endpoints.bus)
    return "no frame yet" if pad is None or pad in known else f"no pad {pad!r}; the daemon there has {', '.join(known)}"
