"""The published deviation of a force: what the detection limit adds, and what a force that is not certain may be."""

from __future__ import annotations

from math import sqrt

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import root_of_squares
from fmfts.contact import ContactEstimate, doubt
from fmfts.contact.touch import TouchMemory


def published_force_sd_n(contact: ContactEstimate, touch: TouchMemory, detection_limit_n: float) -> float:
    """Deviation (N) of the force that a message publishes: of the estimate in contact, of 0 without one.

    touch: of the same frame. If the magnet has moved and the force is not certain, 0 is wrong by up to all of the
    estimate.
    """
    if not touch.touched:
        return quiet_force_sd_n(contact.central_force_sd_n, detection_limit_n)
    deviation_n = touched_force_sd_n(contact.force_n, contact.force_sd_n, detection_limit_n)
    return deviation_n if touch.in_contact else float(root_of_squares(deviation_n, contact.force_n))


def quiet_force_sd_n(force_sd_n: float, detection_limit_n: float) -> float:
    """Deviation (N) of the force while no touch is felt: the force may be anything up to the detection limit.

    Counted as a uniform distribution. detection_limit_n: where on the pad a touch is felt least.
    """
    return float(root_of_squares(force_sd_n, detection_limit_n / sqrt(3.0)))


def touched_force_sd_n(force_n: float, force_sd_n: float, detection_limit_n: float) -> float:
    """Deviation (N) of a felt force. The less it exceeds its noise, the more the detection limit counts."""
    return quiet_force_sd_n(force_sd_n, doubt(force_n, square(force_sd_n)) * detection_limit_n)


def felt_force_sd_n(quiet_sd_n: float, detection_limit_n: float) -> float:
    """The inverse of `quiet_force_sd_n`: the deviation (N) without the detection limit."""
    return sqrt(max(square(quiet_sd_n) - square(detection_limit_n) / 3.0, 0.0))
