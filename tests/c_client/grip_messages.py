"""Messages of the two pads between which the examples of grip hold."""

from __future__ import annotations

from c_client.built import CLIENT
from fmfts.bus.messages import ContactMessage, SlipMessage
from unit.bus_messages import contact_message

PYTHON_EXAMPLE = CLIENT.parent / "python/examples/grip.py"
NAMES = ("left", "right")


def held(pad: str, force_n: float = 2.0, sticks: float | None = 0.99, **changes: object) -> ContactMessage:
    slip = SlipMessage(slipping=None if sticks is None else sticks < 0.1, sticking_probability=sticks)
    return contact_message(**({"pad": pad, "force_n": force_n, "slip": slip} | changes))


def untouched(pad: str) -> ContactMessage:
    return held(pad, 0.0, None, contact=False, x_m=None, y_m=None, x_sd_m=None, y_sd_m=None)
