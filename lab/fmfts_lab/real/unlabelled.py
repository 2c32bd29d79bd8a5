"""Poses of the magnet in a sensor that was sold, by a geometry that its unlabelled fields determine.

One magnet in elastomer above four pixels of two axes (x and z): real/sold_sensor.py. Nobody published where the pixels
are.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fmfts.config import PadConfig, SimulatedSource
from fmfts.pad import Array, Magnet, Pad, SensorArray, Tolerance, rotation_from_vector
from fmfts_calibrate.learn.drawing import Drawing
from fmfts_calibrate.learn.fit import Fields, misfits, solved_poses
from fmfts_calibrate.learn.make import spread_out
from fmfts_calibrate.learn.search import Learned, LearnError, learn, with_octupole
from fmfts_lab.real.sold_sensor import PIXELS, SESSIONS
from fmfts_skin.calibrate.force_fit import GAIN, ROTATION_RAD

# Where a value saturates depends on the other axis; up to here it never does.
CLIPPED_T = 32e-3
NOISE_T = 3e-5
# How far a rough sketch is off it, at most: much of the 2 mm between pixels.
ROUGH_M, ROUGH_DEG = 4e-4, 8.0
LATER_UT, SECOND_UT = 60.0, 50.0  # asked: at most this is left of a value, rms
FIRST_SHARE = 0.7  # of the session that the geometry is learned from
UNTOUCHED = 60  # this many of the weakest fields of a session belong to the untouched pad
# A first look shows: signs tell which pixel is where, and fields of 12 mT, with their ratios, of a magnet
# some 3 mm above pixels some 2 mm apart. Nobody has measured it.
SKETCH = Tolerance(3e-4, 3e-4, np.radians(5.0), gain=0.05, remanence=0.15, sensor_rotation_rad=0.09, cross_axis=0.01)

ANOTHER_DAY = Tolerance(
    magnet_position_m=1e-4,
    magnet_tilt_rad=np.radians(2.0),
    sensor_position_m=0.0,
    gain=GAIN,
    remanence=0.01,
    sensor_rotation_rad=ROTATION_RAD,
    cross_axis=SKETCH.cross_axis,
)


def sketch() -> Pad:
    standard = PadConfig(name="standard", source=SimulatedSource()).pad()
    places_m = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]]) * 1e-3
    return replace(
        standard,
        sensors=SensorArray.aligned(places_m),
        magnet=Magnet(1.8e-3, 0.9e-3, 1.3),
        rest_position_m=np.array([0.0, 0.0, 3e-3]),
        rest_axis=np.array([0.0, 0.0, 1.0]),
    )


def session_t(name: str, folder: Path) -> Array:
    """(K, 4, 3) tesla of a session of SESSIONS; NaN where a pixel has no axis or a value is clipped."""
    file, empty = SESSIONS[name]
    with (folder / file).open(newline="") as lines:
        rows = [row for number, row in enumerate(csv.DictReader(lines)) if number != empty]
    fields = np.full((len(rows), len(PIXELS), 3), np.nan)
    for sensor, pixel in enumerate(PIXELS):
        for axis, letter in ((0, "Bx"), (2, "Bz")):
            fields[:, sensor, axis] = [float(row[letter + pixel]) * 1e-3 for row in rows]
    fields[np.abs(fields) > CLIPPED_T] = np.nan
    return fields


def untouched(session: Array) -> NDArray[np.intp]:
    """The rows of the weakest fields, of those without a clipped value."""
    whole = np.flatnonzero(np.isfinite(session[:, :, [0, 2]]).all(axis=(1, 2)))
    size = np.linalg.norm(np.nan_to_num(session[whole]).reshape(len(whole), -1), axis=1)
    return whole[np.argsort(size)[:UNTOUCHED]]


def fields_of(session: Array) -> Fields:
    """The fields of presses that are far from each other."""
    rest = np.full((len(PIXELS), 3), np.nan)
    rest[:, [0, 2]] = np.median(session[untouched(session)][:, :, [0, 2]], axis=0)
    deviation = np.full(rest.shape, NOISE_T)
    return Fields(rest, spread_out(session, rest), deviation, deviation)


def learned_from(session: Array, starts: int = 4) -> Learned:
    fields = fields_of(session)
    return with_octupole(learn(Drawing(sketch(), SKETCH), fields, starts=starts), fields)


def poses_of(learned: Learned, session: Array) -> Array:
    """(K, 6) position and axis of the magnet in each row."""
    deviation = np.full(session.shape[1:], NOISE_T)
    geometry = learned.drawing.geometry(learned.fit.vector)
    poses = solved_poses(geometry, learned.drawing, Fields(session[0], session, deviation, deviation))
    return np.asarray(poses[:, :6])


def left_t(learned: Learned, session: Array) -> Array:
    """(K, 4, 3) what is left of each value after the magnet's pose was solved from its row; NaN where there is none."""
    deviation = np.full(session.shape[1:], NOISE_T)
    left, _ = misfits(learned.drawing, learned.fit.vector, Fields(session[0], session, deviation, deviation))
    return np.where(np.isfinite(session), NOISE_T * left.reshape(session.shape), np.nan)


def rms_of(left: Array) -> float:
    """Over all values that are there."""
    return float(np.sqrt(np.nanmean(left**2)))


def first_session(folder: Path) -> tuple[Array, Array]:
    """Its beginning, from which the geometry is learned, and its end."""
    session = session_t("first", folder)
    taught = round(FIRST_SHARE * len(session))
    return session[:taught], session[taught:]


def refined(learned: Learned, session: Array) -> tuple[Learned, Array]:
    """The geometry after unlabelled rows of another day, and the session by the gains of the first day.

    The chips stay where they are. Their gains and rotations may be others by what `calibrate` states of another day.
    """
    geometry = learned.drawing.geometry(learned.fit.vector)
    magnet, rest = learned.drawing.pad.magnet, geometry.rest
    known = replace(
        sketch(),
        sensors=geometry.sensors,
        magnet=replace(magnet, remanence_t=magnet.remanence_t * float(np.exp(rest.log_moment))),
        rest_position_m=rest.position_m,
        rest_axis=rest.axis,
    )
    own = session / np.einsum("naa->na", geometry.matrix)
    return learn(replace(learned.drawing, pad=known, tolerance=ANOTHER_DAY), fields_of(own), starts=2), own


@dataclass(frozen=True, slots=True)
class Left:
    """What a learned geometry leaves of a session's values. row_ut (K,): of each row; empty if no geometry explains
    them. most_ut: what was asked."""

    session: str
    rms_ut: float
    row_ut: Array
    most_ut: float | None

    @classmethod
    def of(cls, session: str, left: Array, most_ut: float | None) -> Left:
        return cls(session, 1e6 * rms_of(left), 1e6 * np.sqrt(np.nanmean(left**2, axis=(1, 2))), most_ut)

    @property
    def cells(self) -> tuple[str, str, str, str]:
        """A row of a table."""
        asked = "–" if self.most_ut is None else f"{self.most_ut:.0f}"
        if not len(self.row_ut):
            return self.session, "–", asked, "refused"
        verdict = "" if self.most_ut is None else "reached" if self.rms_ut <= self.most_ut else "missed"
        return self.session, f"{self.rms_ut:.0f}", asked, verdict


def left_of_sessions(folder: Path) -> list[Left]:
    (beginning, later), second = first_session(folder), session_t("second", folder)
    learned = learned_from(beginning)
    own = "second day refined, by 100 of its own unlabelled rows"
    left = [
        Left.of("first day, the 30 % that did not teach", left_t(learned, later), LATER_UT),
        Left.of("second day, with the first one's geometry", left_t(learned, second), None),
    ]
    try:
        return [*left, Left.of(own, left_t(*refined(learned, second)), SECOND_UT)]
    except LearnError:
        return [*left, Left(own, np.nan, np.empty(0), SECOND_UT)]


def sketches_line(left_ut: Array) -> str:
    """A row of a table. left_ut (K,): of each sketch, NaN where it says that the geometry is not determined."""
    told = left_ut[np.isfinite(left_ut)]
    most = f"{told.max():.0f}" if len(told) else "–"
    return f"| {len(left_ut)} | {np.sum(told <= LATER_UT)} | {most} | {len(left_ut) - len(told)} |"


def learned_from_rough(seed: int, session: Array) -> Learned | None:
    """From a sketch that is off by up to ROUGH_M and ROUGH_DEG. None: it says that the geometry is not determined."""
    random, drawn = np.random.default_rng(seed), sketch()
    turns = [rotation_from_vector(one) for one in np.radians(random.uniform(-ROUGH_DEG, ROUGH_DEG, (4, 3)))]
    rough = replace(
        drawn,
        sensors=SensorArray(drawn.sensors.position_m + random.uniform(-ROUGH_M, ROUGH_M, (4, 3)), np.array(turns)),
        rest_position_m=drawn.rest_position_m + random.uniform(-ROUGH_M, ROUGH_M, 3),
    )
    try:
        learned = learn(Drawing(rough, SKETCH), fields_of(session), starts=4, seed=seed)
    except LearnError:
        return None
    return None if learned.open else learned
