"""The project's own solvers as methods: the kernel with every model, tracker and daemon."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from fmfts.common.chi2 import quantile
from fmfts.pad import Array
from fmfts.pipeline.configured import load_contact_model
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.pose import STOP_CHI2, Batch, PoseEstimate, Problem, SensorErrors, State, parts_of
from fmfts.pose.gates import FALSE_ALARM
from fmfts.pose.kernel import CHI2, ROWS, STATUS, UNKNOWNS
from fmfts.pose.problem import MAX_ITERATIONS, NOISE, VALUE, magnet_rows, measurement_rows
from fmfts.pose.tracking_model import TrackingModel
from fmfts.scene.tracking import tracking_model_for
from fmfts_lab.bench.field_tracker import FieldTracker
from fmfts_lab.bench.workspace import MODELS
from fmfts_lab.study.method import NOTHING, Answer
from fmfts_lab.study.world import Sample, World

FREE = MODELS | {9: np.arange(9)}
SEED_OF_BASELINE = 5
CONVERGED = 0


class Kernel:
    """The kernel on one problem whose memory is reused, so that a call costs little more than the solve."""

    def __init__(
        self,
        world: World,
        unknowns: int,
        *,
        cylinder: bool | None = False,
        warm: bool = True,
        gated: bool = False,
        iterations: int = MAX_ITERATIONS,
    ) -> None:
        """cylinder: whether to use the octupole, None: as the daemon does. warm: start from the last answer. gated: χ²
        flags misfits."""
        self.batch = batch_of(world, parts_of(free=FREE[unknowns]), cylinder)
        self._rest = world.rest.vector()
        self._values = self.batch.measurements[0, :, VALUE]
        self._warm, self._gated, self._iterations = warm, gated, iterations

    def ask(self, sample: Sample) -> Batch:
        batch = self.batch
        self._values[:] = sample.field_t.ravel()
        batch.solve(STOP_CHI2, self._iterations)
        if self._warm:
            solved = batch.summary[0, STATUS] == CONVERGED
            batch.start[0] = batch.state[0] if solved else self._rest
        return batch

    def told(self, raw: Batch) -> Answer:
        summary = raw.summary[0]
        failed = summary[STATUS] > (1 if self._iterations < MAX_ITERATIONS else 0)
        if failed or (self._gated and misfits(summary[CHI2], summary[ROWS] - summary[UNKNOWNS])):
            return NOTHING
        deviation = np.sqrt(np.diagonal(raw.covariance[0])[:3])
        return Answer(raw.state[0, :3].copy(), raw.state[0, 3:6].copy(), deviation, False)


class KernelFilter:
    """The daemon's own model of the scene in the bare kernel: with a prior, an iterated Kalman filter."""

    def __init__(self, world: World, cylinder: bool | None = None) -> None:
        model = tracking_of(world)
        self.batch = batch_of(world, model.parts, cylinder, np.diag(model.initial))
        self._values = self.batch.measurements[0, :, VALUE]
        self._walk = np.diag(model.walk_per_s)

    def ask(self, sample: Sample) -> Batch:
        batch = self.batch
        assert batch.prior_mean is not None
        assert batch.prior_covariance is not None
        self._values[:] = sample.field_t.ravel()
        batch.prior_covariance[0] += self._walk * sample.elapsed_s
        batch.solve(STOP_CHI2, MAX_ITERATIONS)
        summary = batch.summary[0]
        if summary[STATUS] == CONVERGED and not misfits(summary[CHI2], summary[ROWS] - summary[UNKNOWNS]):
            batch.start[0] = batch.prior_mean[0] = batch.state[0]
            batch.prior_covariance[0] = batch.covariance[0]
        return batch

    def told(self, raw: Batch) -> Answer:
        summary = raw.summary[0]
        if summary[STATUS] != CONVERGED or misfits(summary[CHI2], summary[ROWS] - summary[UNKNOWNS]):
            return NOTHING
        deviation = np.sqrt(np.diagonal(raw.covariance[0])[:3])
        return Answer(raw.state[0, :3].copy(), raw.state[0, 3:6].copy(), deviation, False)


def default(world: World, cylinder: bool | None = None) -> Kernel | KernelFilter:
    """The daemon's solver for the world's scene. cylinder: whether to use the octupole, None: as the daemon does."""
    if tracking_of(world).has_prior:
        return KernelFilter(world, cylinder)
    return Kernel(world, 6, cylinder=cylinder, gated=True)


class Solved:
    """Any solver of `Problem`, started warm."""

    def __init__(
        self, world: World, solver: Callable[[Problem], Any], told: Callable[[Any], Answer], unknowns: int = 6
    ) -> None:
        self._rows = measurement_rows(np.zeros((len(world.drawing.sensors), 3)), world.drawing.sensors, world.noise_t)
        self._magnets = magnet_rows(world.drawing.magnet, octupole=False)
        self._parts = parts_of(free=FREE[unknowns])
        self._rest = self._start = world.rest
        self._solver, self._told = solver, told
        self._noise_t = world.noise_t

    def ask(self, sample: Sample) -> Any:
        rows = self._rows
        field = sample.field_t.ravel()
        seen = np.isfinite(field)
        rows[:, VALUE] = np.where(seen, field, 0.0)
        rows[:, NOISE] = np.where(seen, self._noise_t, np.inf)
        raw = self._solver(Problem(rows, self._magnets, self._parts, self._start))
        answer = self._told(raw)
        self._start = self._rest if answer.flagged else State(answer.position_m, answer.axis, 0.0, np.zeros(3))
        return answer

    def told(self, raw: Answer) -> Answer:
        return raw


class Tracking:
    """The daemon's tracker with its gates, which knows the pad exactly."""

    def __init__(self, world: World) -> None:
        shape = (len(world.drawing.sensors), 3)
        self._noise = np.full(shape, world.noise_t)
        self._nothing = np.zeros(shape)
        errors = SensorErrors(self._noise)
        self._tracker = FieldTracker(world.drawing, world.rest, tracking_of(world), 25.0, errors)

    def ask(self, sample: Sample) -> PoseEstimate | None:
        track = self._tracker.update(
            sample.field_t, self._noise, sample.elapsed_s, _number(sample.frame.temperature_c), self._nothing
        )
        return track.estimate if track.health in ("ok", "degraded") else None

    def told(self, raw: PoseEstimate | None) -> Answer:
        if raw is None:
            return NOTHING
        return Answer(raw.position_m, raw.axis, np.sqrt(np.diagonal(raw.covariance)[:3]), False)


def _number(temperature_c: float | None) -> float:
    return np.nan if temperature_c is None else temperature_c


def daemon(world: World) -> PadPipeline:
    """The daemon's pipeline from frame to message, with a baseline recorded before anything went wrong."""
    config = world.config
    pipeline = PadPipeline(world.drawing, load_contact_model(config), "study", world.rate_hz, tracking_of(world))
    pipeline.use(world.baseline(np.random.default_rng(SEED_OF_BASELINE)))
    return pipeline


def tracking_of(world: World) -> TrackingModel:
    return tracking_model_for(world.config.scene, world.config.magnet).tracking


def batch_of(world: World, parts: Any, cylinder: bool | None = None, prior: Array | None = None) -> Batch:
    """One problem that starts at rest; the caller fills in its measurements."""
    pad, rest = world.drawing, world.rest.vector()
    rows = measurement_rows(np.zeros((len(pad.sensors), 3)), pad.sensors, world.noise_t)
    return Batch.of(
        rows[None].copy(),
        magnet_rows(pad.magnet, octupole=cylinder)[None],
        parts[None],
        rest[None].copy(),
        None if prior is None else rest[None].copy(),
        None if prior is None else prior[None].copy(),
    )


def misfits(chi2: float, degrees_of_freedom: float) -> bool:
    """Whether the daemon's own gate refuses this χ²; a healthy sample misfits once in an hour.

    With as many unknowns as values, χ² means nothing.
    """
    return degrees_of_freedom > 0 and not chi2 < quantile(FALSE_ALARM, int(degrees_of_freedom))
