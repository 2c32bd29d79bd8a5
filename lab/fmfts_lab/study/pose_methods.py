"""All pose methods that the studies compare, in one table: the project's, and those that a user might otherwise use."""

from __future__ import annotations

from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from fmfts.config import PadConfig
from fmfts.pad import Array
from fmfts.pose import Batch, tangent_basis
from fmfts.pose.kernel import STATUS
from fmfts.sensor.chips import NOISE_T
from fmfts_lab.bench.rivals import POSITION_UNIT_M, moment_vector_solvers
from fmfts_lab.calibration.regressors import BackPropagation
from fmfts_lab.study.filters import ExtendedKalman, UnscentedKalman
from fmfts_lab.study.kernels import Kernel, Solved, Tracking, default
from fmfts_lab.study.learned import SEED, Nearest, Network, examples
from fmfts_lab.study.method import NOTHING, Answer, Maker, Method
from fmfts_lab.study.world import Sample, World, drawn_world

AT_LIMIT = 1
TRAINED_ON, STEPS = 2000, 30


class PoseMethod(NamedTuple):
    """settings: what a reader needs to know to repeat it. family: decides its colour on a chart."""

    name: str
    family: str
    make: Maker
    settings: str


def _scipy(name: str, world: World) -> Method:
    """Six unknowns as a user of SciPy writes them. Starts from the last answer, or from rest if that failed."""

    def told(raw: Any) -> Answer:
        found, success = (raw[0], raw[4] in (1, 2, 3, 4)) if isinstance(raw, tuple) else (raw.x, raw.success)
        length = float(np.linalg.norm(found[3:]))
        if not (success and length > 0.0):
            return NOTHING
        return Answer(found[:3] * POSITION_UNIT_M, found[3:] / length, None, False)

    return Solved(world, moment_vector_solvers(world.drawing)[name], told)


class Direct:
    """The nearest entry of a table of presses, and one Gauss–Newton step from it, without iteration."""

    def __init__(self, world: World, unknowns: int) -> None:
        known = known_of(world.config)
        starts = np.tile(world.rest.vector(), (len(known.pose), 1))
        starts[:, :6] = known.pose
        self._table = Nearest(known.inputs, starts, 1)
        self._kernel = Kernel(world, unknowns, cylinder=None, warm=False, iterations=1)
        self._sees = partial(seen, world)

    def ask(self, sample: Sample) -> Batch | None:
        inputs = self._sees(sample.field_t)
        if not np.isfinite(inputs).all():
            return None
        batch = self._kernel.batch
        batch.start[0] = self._table(inputs)
        return self._kernel.ask(sample)

    def told(self, raw: Batch | None) -> Answer:
        if raw is None or raw.summary[0, STATUS] > AT_LIMIT:
            return NOTHING
        return Answer(raw.state[0, :3].copy(), raw.state[0, 3:6].copy(), None, False)


class FromField:
    """A learned function from field to pose. It needs all sensors and gives no deviation."""

    def __init__(self, world: World, function: Any) -> None:
        self._function = function
        self._sees = partial(seen, world)

    def ask(self, sample: Sample) -> Array | None:
        inputs = self._sees(sample.field_t)
        return self._function(inputs) if np.isfinite(inputs).all() else None

    def told(self, raw: Array | None) -> Answer:
        if raw is None:
            return NOTHING
        axis = raw[3:] / np.linalg.norm(raw[3:])
        return Answer(np.asarray(raw[:3], dtype=float), axis, None, False)


class Known(NamedTuple):
    """inputs (K, 12) as `seen` makes them, pose (K, 6) in m and unit axis, press (K, 3) in mm and N."""

    inputs: Array
    pose: Array
    press: Array


def seen(world: World, field_t: Array) -> Array:
    """(12,) the input of a learned method; if the ambient field drifts, without the mean over all sensors."""
    if world.config.scene.ambient == "drifting":
        field_t = field_t - field_t.mean(axis=0)
    return field_t.ravel()


@lru_cache(maxsize=8)
def known_of(config: PadConfig) -> Known:
    """Examples of the pad as drawn, in the form of a learned method's input."""
    world = drawn_world(config)
    known = examples(world)
    shape = (len(known.field_t), *world.drawing.sensors.position_m.shape)
    inputs = np.array([seen(world, field) for field in known.field_t.reshape(shape)])
    return Known(inputs, known.pose, known.press)


def _nearest(count: int, world: World) -> Method:
    known = known_of(world.config)
    return FromField(world, Nearest(known.inputs, known.pose, count))


def _network(hidden: tuple[int, ...], kind: type[np.floating[Any]], world: World) -> Method:
    return FromField(world, Network(_trained(hidden, world.config), kind))


@lru_cache(maxsize=64)
def _trained(hidden: tuple[int, ...], config: PadConfig) -> BackPropagation:
    """A network trained with the noise of the data sheet, also if the study's noise is another one."""
    known = known_of(config)
    noise = np.random.default_rng(SEED).normal(0.0, NOISE_T, known.inputs.shape)
    some = slice(None, None, len(known.pose) // TRAINED_ON)
    return BackPropagation(hidden, STEPS).fit((known.inputs + noise)[some], known.pose[some])


def _kernel(unknowns: int, world: World, **options: bool) -> Method:
    return Kernel(world, unknowns, **options)


KERNEL, NUMPY, SCIPY, KALMAN, LEARNED = "this project's kernel", "NumPy", "SciPy", "Kalman filters", "learned, direct"
DEFAULT = "kernel, the daemon's model"
WARM = "started from the last answer, at rest where it failed; flags what does not converge"


def pose_methods() -> list[PoseMethod]:
    """In the order of the tables."""
    return [
        PoseMethod(DEFAULT, KERNEL, default, "scene's unknowns, ambient field carried on; χ² gate at 1e-6"),
        PoseMethod("tracker (gates, faults)", KERNEL, Tracking, "the daemon's, told the pad exactly"),
        PoseMethod("kernel, 5 unknowns", KERNEL, partial(_kernel, 5), WARM),
        PoseMethod("kernel, 6 unknowns", KERNEL, partial(_kernel, 6), WARM),
        PoseMethod("kernel, 6, from rest (the paper)", KERNEL, partial(_kernel, 6, warm=False), "no memory"),
        PoseMethod("kernel, 8 unknowns", KERNEL, partial(_kernel, 8), WARM),
        PoseMethod("kernel, 8, χ² gate", KERNEL, partial(_kernel, 8, gated=True), f"{WARM}; χ² gate at 1e-6"),
        PoseMethod("kernel, 9 unknowns", KERNEL, partial(_kernel, 9), f"{WARM}; unobservable at rest"),
        PoseMethod("kernel, 5, cylinder", KERNEL, partial(_kernel, 5, cylinder=True), f"octupole; {WARM}"),
        PoseMethod("kernel, 6, cylinder", KERNEL, partial(_kernel, 6, cylinder=True), f"octupole; {WARM}"),
        PoseMethod("kernel, 8, cylinder", KERNEL, partial(_kernel, 8, cylinder=True), f"octupole; {WARM}"),
        PoseMethod(
            "the daemon's model, dipole", KERNEL, partial(default, cylinder=False), "no octupole; as the daemon's"
        ),
        PoseMethod("Gauss–Newton, NumPy, 8, float64", NUMPY, partial(_plain, np.float64), "two steps, warm"),
        PoseMethod("Gauss–Newton, NumPy, 8, float32", NUMPY, partial(_plain, np.float32), "two steps, warm"),
        *(
            PoseMethod(short, SCIPY, partial(_scipy, name), f"six unknowns; {WARM}")
            for short, name in SCIPY_NAMES.items()
        ),
        PoseMethod("extended Kalman", KALMAN, ExtendedKalman, "no iteration; χ² gate at 1e-6"),
        PoseMethod("unscented Kalman", KALMAN, UnscentedKalman, "no iteration; χ² gate at 1e-6"),
        PoseMethod("DIRECT: table + one step, 5", LEARNED, partial(Direct, unknowns=5), "6000 entries, one step"),
        PoseMethod("DIRECT: table + one step, 8", LEARNED, partial(Direct, unknowns=8), "6000 entries, one step"),
        PoseMethod("look-up table", LEARNED, partial(_nearest, 1), "6000 presses, k-d tree"),
        PoseMethod("4 nearest neighbours", LEARNED, partial(_nearest, 4), "6000 presses, k-d tree, 1/distance"),
        PoseMethod("network from field (20)", LEARNED, partial(_network, (20,), np.float32), "BP, ONNX, float32"),
        PoseMethod(
            "network from field (16, 16)", LEARNED, partial(_network, (16, 16), np.float32), "BP, ONNX, float32"
        ),
        PoseMethod("network from field (16, 16) f64", LEARNED, partial(_network, (16, 16), np.float64), "BP, ONNX"),
    ]


SCIPY_NAMES = {
    "leastsq, Jacobian": "scipy.optimize.leastsq with Jacobian",
    "least_squares lm, Jacobian": "scipy.optimize.least_squares with Jacobian",
    "least_squares lm": "scipy.optimize.least_squares without",
    "least_squares trf, Jacobian": "scipy.optimize.least_squares trf with Jacobian",
    "least_squares trf": "scipy.optimize.least_squares trf without",
}


class PlainGaussNewton:
    """Eight unknowns (position, moment's direction, ambient field) by two steps in one precision throughout.

    Its units are 10 mm and the dipole's field there, so that float32 has no disadvantage from scaling.
    """

    def __init__(self, world: World, kind: type[np.floating[Any]]) -> None:
        self._kind = kind
        pad = world.drawing
        self._unit_t = pad.magnet.strength_t_m3 / POSITION_UNIT_M**3
        self._place = (pad.sensors.position_m / POSITION_UNIT_M).astype(kind)
        self._rest = np.r_[pad.rest_position_m / POSITION_UNIT_M, pad.rest_axis, np.zeros(3)].astype(kind)
        self._state = self._rest
        self._ambient = np.tile(np.eye(3, dtype=kind), (len(pad.sensors), 1))
        self._to_pad = pad.sensors.to_pad

    def ask(self, sample: Sample) -> Array | None:
        field = (self._to_pad(sample.field_t) / self._unit_t).astype(self._kind)
        measured = np.isfinite(field).ravel()
        state = self._state
        for _ in range(2):
            misfit, slope, basis = self._linear(state, field)
            try:
                step = np.linalg.lstsq(slope[measured], misfit[measured], rcond=None)[0]
            except np.linalg.LinAlgError:
                self._state = self._rest
                return None
            state = state + np.concatenate([step[:3], basis @ step[3:5], step[5:]])
            state[3:6] /= np.sqrt(state[3:6] @ state[3:6])
        good = bool(np.isfinite(state).all() and np.abs(state[:3]).max() < 5.0)
        self._state = state if good else self._rest
        return state if good else None

    def told(self, raw: Array | None) -> Answer:
        if raw is None:
            return NOTHING
        return Answer(raw[:3].astype(float) * POSITION_UNIT_M, raw[3:6].astype(float), None, False)

    def _linear(self, state: Array, field: Array) -> tuple[Array, Array, Array]:
        """Misfit (12,), slope (12, 8), and the axis's tangent basis (3, 2)."""
        r, axis = self._place - state[:3], state[3:6]
        square = (r * r).sum(axis=1)
        fifth = (1.0 / (square * square * np.sqrt(square)))[:, None, None]
        dot, eye = r @ axis, np.eye(3, dtype=self._kind)
        outer, mixed = r[:, :, None] * r[:, None, :], r[:, :, None] * axis
        by_moment = fifth * (3 * outer - square[:, None, None] * eye)
        along = (dot / square)[:, None, None]
        by_place = 3 * fifth * (5 * along * outer - mixed - mixed.transpose(0, 2, 1) - dot[:, None, None] * eye)
        basis = tangent_basis(axis).astype(self._kind)
        own = np.concatenate([by_place, by_moment @ basis], axis=2).reshape(-1, 5)
        misfit = (field - by_moment @ axis - state[6:]).ravel()
        return misfit, np.concatenate([own, self._ambient], axis=1), basis


def _plain(kind: type[np.floating[Any]], world: World) -> Method:
    return PlainGaussNewton(world, kind)
