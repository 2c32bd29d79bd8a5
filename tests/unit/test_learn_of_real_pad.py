"""Geometry from the fields of a real pad, without labels: github.com/TheEngineRoom-UniGe/Melexis_Tactile_Sensor.

One magnet in elastomer above four pixels of two axes (x and z). The repository has no licence: its files are not here;
FMFTS_RECORDED names a folder with a folder melexis that has them (lab/results/real.md).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recorded_files import FOLDER, needs

from fmfts.pad import SensorArray, rotation_from_vector
from fmfts_calibrate.learn.drawing import Drawing
from fmfts_calibrate.learn.fit import Fields, misfits
from fmfts_calibrate.learn.search import Learned, LearnError, learn
from fmfts_lab.real.sold_sensor import SESSIONS
from fmfts_lab.real.unlabelled import FIRST_SHARE, NOISE_T, SKETCH, fields_of, learned_from, session_t, sketch


def _session(name: str) -> np.ndarray:
    needs(SESSIONS[name][0])
    return session_t(name, FOLDER)


def _rms_t(learned: Learned, session: np.ndarray) -> float:
    """The residual of each value after the magnet's pose was solved from its row."""
    deviation = np.full(session.shape[1:], NOISE_T)
    left, _ = misfits(learned.drawing, learned.fit.vector, Fields(session[0], session, deviation, deviation))
    return float(NOISE_T * np.sqrt(np.mean(left[np.isfinite(session).reshape(left.shape)] ** 2)))


def _split() -> tuple[np.ndarray, np.ndarray]:
    """Session 1: its beginning, and its end."""
    session = _session("first")
    first = round(FIRST_SHARE * len(session))
    return session[:first], session[first:]


def test_learned_geometry_explains_left_out_presses() -> None:
    """Fields of 5 to 33 mT, to 0.2 %; another day needs its own fields, and no labels."""
    beginning, later = _split()
    learned = learned_from(beginning)
    assert learned.open == []
    assert _rms_t(learned, later) < 6e-5
    geometry, another_day = learned.drawing.geometry(learned.fit.vector), _session("second")
    known = replace(sketch(), sensors=geometry.sensors)
    drawing = replace(learned.drawing, pad=known)
    refined = learn(drawing, fields_of(another_day), starts=2)
    assert _rms_t(refined, another_day) < 5e-5


@pytest.mark.long
def test_rough_starts_end_right_or_say_that_they_are_ambiguous() -> None:
    """Sketches that are up to 0.4 mm and 8° off, which is much of the 2 mm between pixels."""
    beginning, later = _split()
    fields, drawn = fields_of(beginning), sketch()
    right = told = 0
    for seed in range(20):
        random = np.random.default_rng(seed)
        turns = [rotation_from_vector(one) for one in np.radians(random.uniform(-8.0, 8.0, (4, 3)))]
        rough = replace(
            drawn,
            sensors=SensorArray(drawn.sensors.position_m + random.uniform(-4e-4, 4e-4, (4, 3)), np.array(turns)),
            rest_position_m=drawn.rest_position_m + random.uniform(-4e-4, 4e-4, 3),
        )
        try:
            learned = learn(Drawing(rough, SKETCH), fields, starts=4, seed=seed)
        except LearnError:
            told += 1
            continue
        told += bool(learned.open)
        right += not learned.open and _rms_t(learned, later) < 6e-5
    assert right + told == 20
    assert right >= 15
