"""The state of the daemon in one line, for `systemctl status`: actual rates, and faults with their durations."""

from __future__ import annotations

from collections.abc import Sequence

from fmfts.bus.messages import StatusMessage

LONGEST_LIST = 4  # at most this many faulty pads are named, because systemctl shows one line


def one_line(pads: Sequence[StatusMessage], now_ns: int) -> str:
    """The number of healthy pads with their rates, and every other pad with health, duration and reason."""
    healthy = [pad for pad in pads if pad.health == "ok" and not pad.sensor_faults]
    faulty = [pad for pad in pads if pad not in healthy]
    parts = [_fault(pad, now_ns) for pad in faulty[:LONGEST_LIST]]
    if len(faulty) > LONGEST_LIST:
        parts.append(f"and {len(faulty) - LONGEST_LIST} more with faults")
    return "; ".join([f"{len(healthy)} of {len(pads)} pads ok{_rates(healthy)}", *parts])


def _rates(pads: Sequence[StatusMessage]) -> str:
    rates = sorted(pad.rate_hz for pad in pads)
    if not rates:
        return ""
    return f" at {rates[0]:.0f} Hz" if len(rates) == 1 else f" at {rates[0]:.0f} to {rates[-1]:.0f} Hz"


def _fault(pad: StatusMessage, now_ns: int) -> str:
    lasting = f"{pad.pad}: {pad.health} for {max(0.0, (now_ns - pad.since_ns) * 1e-9):.0f} s, {pad.rate_hz:.0f} Hz"
    why = pad.reason or "; ".join(pad.sensor_faults)
    return f"{lasting}: {why}" if why else lasting
