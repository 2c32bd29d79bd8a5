"""The resultant of two fingers in a long valley of χ²: near the rim, fingers further out have about the same field."""

from __future__ import annotations

import numpy as np

from fmfts.several.count import resultant
from fmfts.several.resultant import deviation_of, resultant_deviation
from fmfts_lab.bench.several_world import BUILT, EXACT, Press, estimator_of, read_once, world

# On the 49th of the pads that `bench several --above` builds: wrong by more than five deviations of the parabola.
RIM = [Press(3.9, -5.6, 1.6), Press(-9.2, -10.4, 0.4)]


def test_a_finger_near_the_rim_widens_the_deviation_of_the_resultant_to_what_the_valley_leaves() -> None:
    one = world(4048, BUILT)
    estimator, worst, before = estimator_of(one), [], []
    for _ in range(40):
        reading = read_once(one, one.pressed(RIM), estimator)
        fit = reading.fit
        if reading.health != "ok" or fit is None or len(fit.fingers) != 2:
            continue
        off = np.abs(resultant(fit.fingers) - resultant(np.array([press[:3] for press in RIM])))
        worst.append(float((off / deviation_of(reading, fit)).max()))
        before.append(float((off / resultant_deviation(fit)).max()))
    assert len(worst) >= 20
    assert max(before) > 4.0  # the parabola alone
    assert max(worst) < 4.0


def test_two_fingers_that_are_well_known_keep_their_deviations() -> None:
    one = world(1, EXACT)
    estimator = estimator_of(one)
    for _ in range(10):
        reading = read_once(one, one.pressed([Press(-6.0, -1.0, 1.0), Press(7.0, 2.0, 0.8)]), estimator)
        assert reading.fit is not None
        np.testing.assert_array_equal(deviation_of(reading, reading.fit), resultant_deviation(reading.fit))
