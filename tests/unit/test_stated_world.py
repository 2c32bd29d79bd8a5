"""The pads of `bench as-built --counted stated`, against slabs of other thickness that the finite elements solve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fmfts.contact.tolerances import MODULUS
from fmfts_lab.bench.stated_world import StatedMechanics
from fmfts_lab.finite_elements.reciprocity import Influence
from fmfts_lab.finite_elements.slab import Slab
from fmfts_simulation.finger_shape import FingerShape

pytestmark = pytest.mark.needs(felupe="fem")
LIGHT_N = 0.2


def test_thicker_and_thinner_pads_sink_as_solved_slabs_do() -> None:
    """Three deviations of the default thickness. As a straight line, 0.6 mm more had sunk by 10 % too little."""
    slab = Slab()
    model = Influence.of(slab).mechanics()
    middle = np.zeros(1), np.zeros(1), np.full(1, LIGHT_N)
    for thicker_mm in (-0.4, 0.6):
        solved = Influence.of(replace(slab, thickness_m=slab.thickness_m + 1e-3 * thicker_mm))
        sunk_m = -LIGHT_N * solved.of_patch(0.0, 0.0)[2][2]
        drawn = StatedMechanics(model, 1.0, thicker_mm, FingerShape()).response(*middle)
        assert drawn[0, 2] == pytest.approx(sunk_m, rel=0.03)


def test_drawn_moduli_have_the_deviation_that_the_daemon_counts() -> None:
    """Its logarithm is normal, as tolerances.c says."""
    model = Influence.of(Slab(), 4e-3).mechanics()
    random = np.random.default_rng(1)
    logs = np.log([StatedMechanics.drawn(model, random).modulus for _ in range(2000)])
    assert np.std(logs) == pytest.approx(MODULUS, rel=0.06)
    assert abs(np.mean(logs)) < 0.013
