"""The contact methods that the studies compare: through the pose of the daemon's solver, or directly from the field."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
from msgspec import structs

from fmfts.config import PadConfig
from fmfts.contact import ContactModel
from fmfts.pad import Array
from fmfts.pipeline.drawn import in_nominal_frame
from fmfts.pipeline.encoded import Answer, message_of
from fmfts.pose import State
from fmfts.pose.solver import estimate_of
from fmfts.sensor.chips import NOISE_T
from fmfts_calibrate.likelihood import invert
from fmfts_calibrate.samples import Samples, presses_within
from fmfts_calibrate.tracked import FrameSolver
from fmfts_lab.calibration.regressors import BackPropagation, RadialBasis
from fmfts_lab.calibration.simulated import rest_field_of
from fmfts_lab.study.contact_bench import Bench, ContactFinder, regressor_of
from fmfts_lab.study.contact_from_field import OneStep, nearest, network
from fmfts_lab.study.kernels import KernelFilter, daemon
from fmfts_lab.study.learned import SEED, Network
from fmfts_lab.study.pose_methods import TRAINED_ON
from fmfts_lab.study.world import Sample


class Whole:
    """The whole daemon, from frame to packed message."""

    def __init__(self, refine: bool, bench: Bench) -> None:
        config = bench.world.config
        told = structs.replace(config, contact=structs.replace(config.contact, refine=refine))
        self.ask_frame = daemon(replace(bench.world, config=told)).answer

    def ask(self, sample: Sample) -> Answer:
        return self.ask_frame(sample.frame)

    def told(self, raw: Answer) -> Array | None:
        message = message_of(raw)
        if message.x_m is None or message.y_m is None or message.force_n is None:
            return None
        return np.array([message.x_m * 1e3, message.y_m * 1e3, message.force_n])


class ThroughPose:
    """The daemon's solver and model of the scene; then a function from the pose (6,) (mm and unit axis, for the pad as
    drawn) and its covariance (5, 5) to the press."""

    def __init__(self, bench: Bench, contact: Callable[[Array, Array], Array]) -> None:
        self._bench, self._contact = bench, contact
        self._pose = KernelFilter(bench.mounted)
        self._spread = np.diag([1e3, 1e3, 1e3, 1.0, 1.0, 1.0])
        self._rest = State.at_rest(bench.mounted.drawing)

    def ask(self, sample: Sample) -> Array:
        raw = self._pose.ask(sample._replace(field_t=self._bench.field(sample)))
        estimate = estimate_of(raw.solution(0), self._bench.mounted.drawing.magnet)
        drawing, pad_turn = self._bench.world.drawing, self._bench.mounting.pad_turn
        position, axis, covariance = in_nominal_frame(estimate, self._rest, drawing, pad_turn)
        pose = np.concatenate([position * 1e3, axis])
        return self._contact(pose, (self._spread @ covariance @ self._spread)[:5, :5])

    def told(self, raw: Array) -> Array | None:
        return np.asarray(raw, dtype=float)


def _shipped(refine: bool, bench: Bench) -> ContactFinder:
    """Only the network of the config's model, without envelope and deviations."""
    model = bench.refining if refine else bench.model

    def contact(pose: Array, covariance: Array) -> Array:
        model.inference.pose[:] = pose
        model.inference.run()
        found = model.inference.contact.astype(float)
        if model.refiner is not None:
            found, *_ = model.refiner.refined(found, (pose - model.rest_pose)[:5], covariance)
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
    """Trained on poses with the noise of single frames, each press weighted by the information of a frame."""
    pad, random = config.pad(), np.random.default_rng(SEED)
    model = ContactModel.load(config.contact.model, pad, refine=True)
    assert model.refiner is not None
    solver = FrameSolver(pad, rest_field_of(pad), config.scene.solved, NOISE_T)
    press = presses_within(model.refiner.response, TRAINED_ON, random)
    samples = Samples.expected(model.refiner.response, solver, press).noisy(1, random)
    regressor = regressor_of(kind, size)
    return regressor.fit(samples.pose[:, :5], samples.press[:, :3], _weight(samples.bound))


def _weight(bound: Array) -> Array:
    """(K,) weight of each press, from the bound of its place plus 0.2 mm (in squares): better places count alike."""
    square: Array = np.mean(bound[:, :2] ** 2, axis=1)
    return 1.0 / (square + 0.2**2)


class ContactMethod(NamedTuple):
    name: str
    family: str
    make: Callable[[Bench], ContactFinder]


DAEMON = "the daemon, frame → message"
SOLVER, FIELD, TABLE = "pose, then a network", "straight from field", "pose, then the pad's table"


def contact_methods() -> Iterator[ContactMethod]:
    yield ContactMethod(DAEMON, SOLVER, partial(Whole, False))  # as it is configured by default
    yield ContactMethod("the daemon, refine = true", TABLE, partial(Whole, True))
    yield ContactMethod("shipped ONNX", SOLVER, partial(_shipped, False))
    yield ContactMethod("shipped ONNX, refined", TABLE, partial(_shipped, True))
    yield ContactMethod("spline inversion", TABLE, _inversion)
    for kind, size in (("BP", (5,)), ("BP", (10,)), ("BP", (20,)), ("BP", (12, 12)), ("RBF", (50,)), ("RBF", (200,))):
        label = f"{kind} {' × '.join(map(str, size))}"
        yield ContactMethod(f"{label} of pose", SOLVER, partial(_by_regressor, kind, size, np.float32))
        if size in ((20,), (12, 12)):
            yield ContactMethod(f"{label} of pose, float64", SOLVER, partial(_by_regressor, kind, size, np.float64))
        if size in ((10,), (20,), (12, 12), (200,)):
            yield ContactMethod(f"{label} of field", FIELD, partial(network, kind, size))
    yield ContactMethod("look-up table", FIELD, partial(nearest, 1))
    yield ContactMethod("4 nearest neighbours", FIELD, partial(nearest, 4))
    yield ContactMethod("one step, field → contact", FIELD, OneStep)
