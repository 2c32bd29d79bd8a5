"""Every way to a contact that the studies compare: through the pose that the daemon's solver finds, or straight on."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any, NamedTuple, Protocol

import numpy as np

from fmfts.ambient import Mounting
from fmfts.bus.messages import ContactMessage
from fmfts.calibrate.likelihood import invert
from fmfts.calibrate.regressors import BackPropagation, RadialBasis
from fmfts.calibrate.samples import Samples, presses_within
from fmfts.calibrate.simulated import rest_field_of
from fmfts.calibrate.tracked import FrameSolver
from fmfts.config import PadConfig
from fmfts.contact import ContactModel
from fmfts.contact.response import Response
from fmfts.contact_message import PackedMessage
from fmfts.pad import Array
from fmfts.pose import State, as_drawn, tangent_basis
from fmfts.pose.model import predict
from fmfts.pose.problem import VALUE, magnet_rows, measurement_rows
from fmfts.pose.solver import estimate_of
from fmfts.scene import AMBIENT_WALK_T2_PER_S
from fmfts.simulate.chip import NOISE_T
from fmfts.study.kernels import KernelFilter, daemon
from fmfts.study.learned import SEED, Nearest, Network
from fmfts.study.pose_methods import TRAINED_ON, known_of, seen
from fmfts.study.world import Sample, World

TRAINING_STEPS = 60


@dataclass(frozen=True, slots=True)
class Bench:
    """A world with the baseline that was recorded of it, and the model that the pad's config names."""

    world: World
    mounting: Mounting
    model: ContactModel
    refining: ContactModel

    @classmethod
    def of(cls, world: World) -> Bench:
        """ModelError where the config's model is not this pad's."""
        mounting = world.baseline(np.random.default_rng(SEED)).mounting(world.drawing)
        path = world.config.contact.model
        plain, refining = (ContactModel.load(path, world.drawing, refine=refine) for refine in (False, True))
        return cls(world, mounting, plain, refining)

    @property
    def mounted(self) -> World:
        """The world as its baseline tells of it."""
        pad = self.mounting.mounted(self.world.drawing)
        magnet = pad.magnet.with_remanence(self.mounting.remanence_t(self.world.drawing))
        return replace(self.world, drawing=replace(pad, magnet=magnet))

    @property
    def response(self) -> Response:
        assert self.refining.refiner is not None
        return self.refining.refiner.response

    def field(self, sample: Sample) -> Array:
        """(N, 3) the magnet's, by the baseline."""
        return self.mounting.magnet_field(sample.frame.field_t)


class ContactFinder(Protocol):
    """`ask` is what is timed; `told` the press (3,) in mm and N, None where it says none."""

    def ask(self, sample: Sample) -> Any: ...

    def told(self, raw: Any) -> Array | None: ...


class Whole:
    """The daemon: frame → packed message."""

    def __init__(self, bench: Bench) -> None:
        self.ask_frame = daemon(bench.world).answer

    def ask(self, sample: Sample) -> ContactMessage | PackedMessage:
        return self.ask_frame(sample.frame)

    def told(self, raw: ContactMessage | PackedMessage) -> Array | None:
        message = raw.message if isinstance(raw, PackedMessage) else raw
        if message.x_m is None or message.y_m is None or message.force_n is None:
            return None
        return np.array([message.x_m * 1e3, message.y_m * 1e3, message.force_n])


class ThroughPose:
    """The daemon's solver and model of the scene, then a function from the pose (6,), mm and unit axis on the drawing's
    pad, and its covariance (5, 5) to the press."""

    def __init__(self, bench: Bench, contact: Callable[[Array, Array], Array]) -> None:
        self._bench, self._contact = bench, contact
        self._pose = KernelFilter(bench.mounted)
        self._spread = np.diag([1e3, 1e3, 1e3, 1.0, 1.0, 1.0])
        self._rest = State.at_rest(bench.mounted.drawing)

    def ask(self, sample: Sample) -> Array:
        raw = self._pose.ask(sample._replace(field_t=self._bench.field(sample)))
        estimate = estimate_of(raw.solution(0), self._bench.mounted.drawing.magnet)
        position, axis, covariance = as_drawn(estimate, self._rest, self._bench.world.drawing)
        pose = np.concatenate([position * 1e3, axis])
        return self._contact(pose, (self._spread @ covariance @ self._spread)[:5, :5])

    def told(self, raw: Array) -> Array | None:
        return np.asarray(raw, dtype=float)


def _shipped(refine: bool, bench: Bench) -> ContactFinder:
    """The config's model alone: no envelope, no deviations."""
    model = bench.refining if refine else bench.model

    def contact(pose: Array, covariance: Array) -> Array:
        model.inference.pose[:] = pose
        model.inference.run()
        found = model.inference.contact.astype(float)
        if model.refiner is not None:
            found, _ = model.refiner.refined(found, (pose - model.rest_pose)[:5], covariance)
        return found[:3]

    return ThroughPose(bench, contact)


def _inversion(bench: Bench) -> ContactFinder:
    def contact(pose: Array, covariance: Array) -> Array:
        change = (pose - bench.model.rest_pose)[:5]
        return np.asarray(invert(bench.response, change[None], covariance[None], across=2, steps=12)[0][:3])

    return ThroughPose(bench, contact)


def _by_regressor(kind: str, size: tuple[int, ...], precision: type[np.floating[Any]], bench: Bench) -> ContactFinder:
    network = Network(_trained_on_poses(kind, size, bench.world.config), precision)
    return ThroughPose(bench, lambda pose, covariance: network(pose[:5]))


@lru_cache(maxsize=64)
def _trained_on_poses(kind: str, size: tuple[int, ...], config: PadConfig) -> BackPropagation | RadialBasis:
    """On poses with the noise of single frames, each press weighted by what a frame can tell of it."""
    pad, random = config.pad(), np.random.default_rng(SEED)
    model = ContactModel.load(config.contact.model, pad, refine=True)
    assert model.refiner is not None
    solver = FrameSolver(pad, rest_field_of(pad), config.scene.ambient, NOISE_T)
    press = presses_within(model.refiner.response, TRAINED_ON, random)
    samples = Samples.expected(model.refiner.response, solver, press).noisy(1, random)
    regressor = _regressor(kind, size)
    return regressor.fit(samples.pose[:, :5], samples.press[:, :3], _weight(samples.bound))


def _weight(bound: Array) -> Array:
    """(K,) of each press, by the bound of its place; 0.2 mm is as good as any."""
    square: Array = np.mean(bound[:, :2] ** 2, axis=1)
    return 1.0 / (square + 0.2**2)


def _regressor(kind: str, size: tuple[int, ...]) -> BackPropagation | RadialBasis:
    return BackPropagation(size, TRAINING_STEPS) if kind == "BP" else RadialBasis(size[0], ridge=1e-6)


class FromField:
    """A learned function from field to press. What the baseline knows of the rest field is put right beforehand."""

    def __init__(self, bench: Bench, function: Callable[[Array], Array]) -> None:
        self._bench, self._function = bench, function
        drawn = rest_field_of(bench.world.drawing)
        # A magnet of another strength changes all fields in proportion, to first order.
        self._ratio = bench.world.drawing.magnet.remanence_t / bench.mounting.remanence_t(bench.world.drawing)
        self._shift = drawn - self._ratio * bench.mounting.rest_field_t

    def ask(self, sample: Sample) -> Array:
        return self._function(seen(self._bench.world, self._ratio * self._bench.field(sample) + self._shift))

    def told(self, raw: Array) -> Array | None:
        return np.asarray(raw, dtype=float)


def _nearest(count: int, bench: Bench) -> ContactFinder:
    known = known_of(bench.world.config)
    return FromField(bench, Nearest(known.inputs, known.press, count))


def _network(kind: str, size: tuple[int, ...], bench: Bench) -> ContactFinder:
    return FromField(bench, Network(_trained_on_fields(kind, size, bench.world.config)))


@lru_cache(maxsize=64)
def _trained_on_fields(kind: str, size: tuple[int, ...], config: PadConfig) -> BackPropagation | RadialBasis:
    """As those on poses: with noise, and light presses weighted as what they can tell."""
    known, random = known_of(config), np.random.default_rng(SEED)
    some = slice(None, None, len(known.press) // TRAINED_ON)
    inputs = (known.inputs + random.normal(0.0, NOISE_T, known.inputs.shape))[some]
    light = np.maximum(known.press[some, 2], 0.02)
    return _regressor(kind, size).fit(inputs, known.press[some], 1.0 / ((0.3 / light) ** 2 + 0.2**2))


class OneStep:
    """Place and force straight from the field: a look-up, and one Gauss–Newton step from it, ambient field and moment
    as nuisances; the ambient a random walk, the moment known to half a per cent."""

    MOMENT = 5e-3

    def __init__(self, bench: Bench) -> None:
        world = bench.mounted
        self._bench, self._response, self._pad = bench, bench.response, world.drawing
        self._rows = measurement_rows(np.zeros((len(self._pad.sensors), 3)), self._pad.sensors, world.noise_t)
        self._magnets, self._noise_t = magnet_rows(self._pad.magnet), world.noise_t
        self._ambient, self._variance = np.zeros(3), np.full(3, 1e-6**2)
        self._table = _nearest(1, bench)

    def ask(self, sample: Sample) -> Array:
        press = np.maximum(self._table.ask(sample), [-np.inf, -np.inf, 0.02])
        change, by_press = (values[0] for values in self._response.change_and_slope(press[None]))
        axis = self._pad.rest_axis + tangent_basis(self._pad.rest_axis) @ change[3:]
        axis = axis / np.sqrt(axis @ axis)
        state = State(self._pad.rest_position_m + change[:3] * 1e-3, axis, 0.0, self._ambient)
        self._rows[:, VALUE] = self._bench.field(sample).ravel()
        predicted, jacobian = predict(self._rows, self._magnets, state)
        to_step = np.zeros((5, 5))
        to_step[:3, :3], to_step[3:, 3:] = 1e-3 * np.eye(3), tangent_basis(axis).T @ tangent_basis(self._pad.rest_axis)
        slope = np.concatenate([jacobian[:, :5] @ to_step @ by_press[:, :3], jacobian[:, 5:9]], axis=1)
        self._variance = self._variance + AMBIENT_WALK_T2_PER_S * sample.elapsed_s
        # Place and force are all but free: half the pad, and as much force as there is.
        prior = np.r_[[1.0 / 20.0**2] * 2, 1.0 / 2.0**2, self.MOMENT**-2, 1.0 / self._variance]
        normal = slope.T @ slope / self._noise_t**2 + np.diag(prior)
        covariance = np.linalg.inv(normal)
        step = covariance @ (slope.T @ (self._rows[:, VALUE] - predicted) / self._noise_t**2)
        self._ambient, self._variance = self._ambient + step[4:], np.diagonal(covariance)[4:]
        return np.asarray(press + step[:3])

    def told(self, raw: Array) -> Array | None:
        return raw


class ContactMethod(NamedTuple):
    name: str
    family: str
    make: Callable[[Bench], ContactFinder]


DAEMON = "the daemon, frame → message"
SOLVER, FIELD, TABLE = "pose, then a network", "straight from field", "pose, then the pad's table"


def contact_methods() -> Iterator[ContactMethod]:
    yield ContactMethod(DAEMON, SOLVER, Whole)
    yield ContactMethod("shipped ONNX", SOLVER, partial(_shipped, False))
    yield ContactMethod("shipped ONNX, refined", TABLE, partial(_shipped, True))
    yield ContactMethod("spline inversion", TABLE, _inversion)
    for kind, size in (("BP", (5,)), ("BP", (10,)), ("BP", (20,)), ("BP", (12, 12)), ("RBF", (50,)), ("RBF", (200,))):
        label = f"{kind} {' × '.join(map(str, size))}"
        yield ContactMethod(f"{label} of pose", SOLVER, partial(_by_regressor, kind, size, np.float32))
        if size in ((20,), (12, 12)):
            yield ContactMethod(f"{label} of pose, float64", SOLVER, partial(_by_regressor, kind, size, np.float64))
        if size in ((10,), (20,), (12, 12), (200,)):
            yield ContactMethod(f"{label} of field", FIELD, partial(_network, kind, size))
    yield ContactMethod("look-up table", FIELD, partial(_nearest, 1))
    yield ContactMethod("4 nearest neighbours", FIELD, partial(_nearest, 4))
    yield ContactMethod("one step, field → contact", FIELD, OneStep)
