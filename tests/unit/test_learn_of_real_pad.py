"""Geometry from the fields of a real pad, without labels: github.com/TheEngineRoom-UniGe/Melexis_Tactile_Sensor.

One magnet in elastomer above four pixels of two axes (x and z). Session 1 is UNIGE/Data/Calib.csv of its history
(blob 1eef45ae), session 2 is UNIGE/Data/Calibration_init.csv (blob 42bc50e0). The repository has no licence: its files
are not here; FMFTS_RECORDED names a folder with a folder melexis that has them as session_1.csv and session_2.csv.
"""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest
from recorded_files import needs

from fmfts.config import PadConfig, SimulatedSource
from fmfts.learn.drawing import Drawing
from fmfts.learn.fit import Fields, misfits
from fmfts.learn.make import spread_out
from fmfts.learn.search import Learned, LearnError, learn, with_octupole
from fmfts.pad import Magnet, Pad, SensorArray, Tolerance, rotation_from_vector

PIXELS = ("00", "01", "10", "11")
# Where a value saturates depends on the other axis; up to here it never does.
CLIPPED_T = 32e-3
NOISE_T = 3e-5
LEFT_OUT_SHARE = 0.3
UNTOUCHED = 60  # this many of the weakest fields of a session belong to the untouched pad
BROKEN_ROW = 543  # of session 2: two pixels read zero
# A first look shows: signs tell which pixel is where, and fields of 12 mT, with their ratios, of a magnet some 3 mm
# above pixels some 2 mm apart. Nobody has measured it.
SKETCH = Tolerance(3e-4, 3e-4, np.radians(5.0), gain=0.05, remanence=0.15, sensor_rotation_rad=0.09, cross_axis=0.01)


def _sketch() -> Pad:
    standard = PadConfig(name="standard", source=SimulatedSource()).pad()
    places_m = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]]) * 1e-3
    return replace(
        standard,
        sensors=SensorArray.aligned(places_m),
        magnet=Magnet(1.8e-3, 0.9e-3, 1.3),
        rest_position_m=np.array([0.0, 0.0, 3e-3]),
        rest_axis=np.array([0.0, 0.0, 1.0]),
    )


def _session(number: int) -> np.ndarray:
    """(K, 4, 3) tesla; NaN where a pixel has no axis or a value is clipped."""
    with needs(f"melexis/session_{number}.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    if number == 2:
        del rows[BROKEN_ROW]
    fields = np.full((len(rows), len(PIXELS), 3), np.nan)
    for sensor, pixel in enumerate(PIXELS):
        for axis, name in ((0, "Bx"), (2, "Bz")):
            fields[:, sensor, axis] = [float(row[name + pixel]) * 1e-3 for row in rows]
    fields[np.abs(fields) > CLIPPED_T] = np.nan
    return fields


def _fields(session: np.ndarray) -> Fields:
    """Of presses that are far from each other; the untouched pad is taken for the weakest field."""
    whole = session[np.isfinite(session[:, :, [0, 2]]).all(axis=(1, 2))]
    size = np.linalg.norm(np.nan_to_num(whole).reshape(len(whole), -1), axis=1)
    rest = np.full((len(PIXELS), 3), np.nan)
    rest[:, [0, 2]] = np.median(whole[np.argsort(size)[:UNTOUCHED]][:, :, [0, 2]], axis=0)
    deviation = np.full(rest.shape, NOISE_T)
    return Fields(rest, spread_out(session, rest), deviation, deviation)


def _rms_t(learned: Learned, session: np.ndarray) -> float:
    """What is left of each value after the magnet's pose was found from its row."""
    deviation = np.full(session.shape[1:], NOISE_T)
    left, _ = misfits(learned.drawing, learned.fit.vector, Fields(session[0], session, deviation, deviation))
    return float(NOISE_T * np.sqrt(np.mean(left[np.isfinite(session).reshape(left.shape)] ** 2)))


def _split() -> tuple[Fields, np.ndarray]:
    """Session 1: the presses of its beginning, and its end."""
    session = _session(1)
    first = round((1.0 - LEFT_OUT_SHARE) * len(session))
    return _fields(session[:first]), session[first:]


def test_learned_geometry_explains_left_out_presses() -> None:
    """Fields of 5 to 33 mT, to 0.2 %; another day needs its own fields, and no labels."""
    fields, later = _split()
    learned = with_octupole(learn(Drawing(_sketch(), SKETCH), fields, starts=4), fields)
    assert learned.open == []
    assert _rms_t(learned, later) < 6e-5
    geometry, another_day = learned.drawing.geometry(learned.fit.vector), _session(2)
    known = replace(_sketch(), sensors=geometry.sensors)
    drawing = replace(learned.drawing, pad=known)
    refined = learn(drawing, _fields(another_day), starts=2)
    assert _rms_t(refined, another_day) < 5e-5


@pytest.mark.long
def test_rough_starts_end_right_or_say_that_they_are_ambiguous() -> None:
    """Sketches that are up to 0.4 mm and 8° off, which is much of the 2 mm between pixels."""
    fields, later = _split()
    right = told = 0
    for seed in range(20):
        random = np.random.default_rng(seed)
        sketch = _sketch()
        turns = [rotation_from_vector(one) for one in np.radians(random.uniform(-8.0, 8.0, (4, 3)))]
        rough = replace(
            sketch,
            sensors=SensorArray(sketch.sensors.position_m + random.uniform(-4e-4, 4e-4, (4, 3)), np.array(turns)),
            rest_position_m=sketch.rest_position_m + random.uniform(-4e-4, 4e-4, 3),
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
