"""A warning for contact models that do not know what another finger does."""

from __future__ import annotations

from fmfts.contact.model import ContactModel

FINGER_UNKNOWN = (
    "[pad.contact] finger_mm = [{smallest:g}, {largest:g}] has no effect: the contact model holds no response of its "
    "pad. It corrects no finger of another width than the probe that calibrated it, and its deviations count none: "
    "press with such a probe, or use a model of `fmfts-daemon calibrate`"
)


def unknown_finger(model: ContactModel) -> str | None:
    """The warning where fingers of another width than the probe's are configured and the model holds no response."""
    tolerance = model.tolerance
    if model.response is not None or (tolerance.finger_mm2 == 0.0 and tolerance.known_finger_mm2 == 0.0):
        return None
    smallest_m, largest_m = tolerance.finger_m
    return FINGER_UNKNOWN.format(smallest=smallest_m * 1e3, largest=largest_m * 1e3)
