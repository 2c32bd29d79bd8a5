"""What thicker silicone does to an answer, by distance from the middle: the two tables of `fmfts.contact.tolerances`.

python -m fmfts_lab.finite_elements.thickness
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fmfts.contact import ContactModel
from fmfts.contact.tolerances import RING_MM, THICKER_MM
from fmfts.pad import Array
from fmfts_calibrate.bounds import answer_by_change
from fmfts_lab.bench.workspace import standard_pad
from fmfts_lab.finite_elements.reciprocity import Influence
from fmfts_lab.finite_elements.slab import Slab

STEP_MM = 0.2
LIGHT_N = 0.2  # small strains
UNIT = np.array([1e3, 1e3, 1e3, 1.0, 1.0])
# Of the pose of a lasting press: its deviations at rest are between those of six and of eight unknowns.
POSE_DEVIATION = np.array([0.012, 0.012, 0.005, 0.0027, 0.0027])


def thicker() -> Array:
    """(R, 2) for each ring: the place outwards (mm) and the force (a share), for each millimetre."""
    model = ContactModel.load("default", standard_pad())
    assert model.response is not None
    thickness_m = Slab().thickness_m
    thick, thin = (
        Influence.of(replace(Slab(), thickness_m=thickness_m + side * STEP_MM * 1e-3)) for side in (1.0, -1.0)
    )
    found = []
    for radius_mm in RING_MM * np.arange(len(THICKER_MM)):
        both = []
        for outwards in (np.array([1.0, 0.0]), np.sqrt(np.array([0.5, 0.5]))):
            place_mm = radius_mm * outwards
            press = np.array([[*place_mm, LIGHT_N]])
            _, slope = model.response.change_and_slope(press)
            by_change = answer_by_change(slope, np.diag(POSE_DEVIATION**2)[None])[0]
            one, other = (-influence.of_patch(*(place_mm * 1e-3).tolist())[2] for influence in (thick, thin))
            moved = LIGHT_N * UNIT * (one - other) / (2.0 * STEP_MM)
            x_mm, y_mm, force_n = by_change @ moved
            both.append([outwards @ [x_mm, y_mm], force_n / LIGHT_N])
        found.append(np.mean(both, axis=0))
    return np.array(found)


if __name__ == "__main__":
    for (mm, share), ring in zip(thicker().tolist(), range(len(THICKER_MM)), strict=True):
        print(f"{ring * RING_MM:4.0f} mm: place {mm:+.2f} mm, force {share:+.2f} for each mm of thickness")
