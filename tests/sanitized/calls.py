"""Calls of every function that the compiled parts export, as the package itself makes them."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from msgspec import msgpack

from fmfts.arithmetic import _arithmetic, matrix
from fmfts.config import PadConfig, SimulatedSource
from fmfts.contact import ContactModel, _contact
from fmfts.contact.touch import TouchDetector
from fmfts.pad import Placement, Silicone
from fmfts.pipeline import _pad
from fmfts.pipeline.creep import Creep
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.pipeline.parameters import packed_errors, packed_response
from fmfts.pipeline.words import Words, words_of
from fmfts.pose import Aligned, _alignment, _kernel
from fmfts.pose.alignment import Alignment
from fmfts.pose.kernel import deviations, predict, solve_problem
from fmfts.pose.neighbour import NeighbourView
from fmfts.pose.sighting import Sighting
from fmfts.pose.state import State
from fmfts.sensor import Frame
from fmfts.sensor.patience import BEHIND, IN_TIME
from fmfts.sensor.wire import _wire
from fmfts.sensor.wire.clock import DeviceClock
from fmfts.sensor.wire.framing import Decoder, encode
from fmfts.several import _several

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[1] / "unit"))

PADS = ModuleType("pads")  # functions in the place of methods


def judged(parts: tuple[Any, ...], frame: tuple[Any, ...]) -> bytes:
    """A frame for a pad made of these parts."""
    return _pad.Pad(*parts).judge(*frame)


def followed(parts: tuple[Any, ...], frame: tuple[Any, ...], early: tuple[Any, ...]) -> bytes | None:
    """The sample that comes after this frame, and before the next."""
    pad = _pad.Pad(*parts)
    pad.judge(*frame)
    return pad.early(*early)


def absent(parts: tuple[Any, ...], health: str, reason: str) -> bytes:
    return _pad.Pad(*parts).absent(health, reason)


def missing(parts: tuple[Any, ...], frame: tuple[Any, ...]) -> dict[int, str]:
    pad = _pad.Pad(*parts)
    pad.judge(*frame)
    return pad.missing()


def several(
    parts: tuple[Any, ...],
    bound: tuple[Any, ...],
    frame: tuple[Any, ...],
    judged: tuple[Any, ...],
    told: tuple[Any, ...],
    early: tuple[Any, ...],
) -> tuple[Any, ...]:
    """A frame of several magnets: C judges it; Python does, which finds a finger ahead; and a sample comes after it."""
    pad = _pad.Pad(*parts)
    pad.bind(*bound)
    pad.align(*frame)
    calm = pad.calm(*judged)
    *words, ahead = told
    return *calm, *pad.tell(*told), *pad.tell(*words, ahead or bound[1]), pad.follow_early(*early)


@ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int)
def _sent(_socket: int, _data: int, size: int, _flags: int) -> int:
    return size


def lent(
    parts: tuple[Any, ...], loan: tuple[Any, ...], unread: bytes, line: bytes, arrival_ns: int, descriptor: int
) -> tuple[Any, ...]:
    """Bytes of a board, for a loop that has the pad."""
    pad = _pad.Pad(*parts)
    pad.begin(*loan)
    loop = _pad.Loop(-1, ctypes.cast(_sent, ctypes.c_void_p).value or 0, 0, IN_TIME, BEHIND)
    loop.begin(descriptor, unread, (pad,))
    return loop.take(descriptor, line, arrival_ns), pad.last_ns(), loop.end(descriptor), pad.end(), pad.last


for function in (judged, followed, absent, missing, lent, several):
    setattr(PADS, function.__name__, function)

MODULES: dict[str, ModuleType] = {
    module.__name__: module for module in (_arithmetic, _kernel, _alignment, _wire, _contact, _several, _pad, PADS)
}
MOST_KEPT = 16  # of one function: calls that differ in their sizes, or in what came before
# Frozen worlds, with a frame of each, amid what it is about.
AMID = {
    "bare": 60, "cold": 120, "eight-sensors": 350, "faulty": 280, "faulty-constant": 200, "gradients": 190,
    "growing": 2310, "healthy": 250, "leaps": 501, "neighbours": 300, "samples-again": 260, "smoothed": 150,
    "steel-faulty": 620, "turning-constant": 260, "without-model": 300,
}  # fmt: skip


class Call(NamedTuple):
    """One call. arguments: arrays are copies, as bytes or, where the call writes them, as bytearrays."""

    module: str
    name: str
    arguments: tuple[Any, ...]

    @property
    def function(self) -> Callable[..., Any]:
        return getattr(MODULES[self.module], self.name)  # type: ignore[no-any-return]


def functions() -> list[tuple[str, str]]:
    """Module and name of every exported function. Loop is a class, and has tests of its own."""
    return [
        (module.__name__, name)
        for module in MODULES.values()
        for name, value in vars(module).items()
        if callable(value) and not name.startswith("__") and not isinstance(value, type)
    ]


def kept(argument: Any) -> Any:
    if isinstance(argument, tuple):
        return tuple(kept(each) for each in argument)
    try:
        view = memoryview(argument)
    except TypeError:
        return argument
    return bytes(view.cast("B") if view.nbytes else b"") if view.readonly else bytearray(view.tobytes())


@contextmanager
def _recorded(calls: dict[tuple[str, str], list[Call]]) -> Iterator[None]:
    """While this is open, it also records each call of an exported function."""
    originals = {(module, name): getattr(MODULES[module], name) for module, name in functions()}

    def recorder(module: str, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def recording(*arguments: Any) -> Any:
            of_it = calls.setdefault((module, name), [])
            if len(of_it) < MOST_KEPT:
                of_it.append(Call(module, name, kept(arguments)))
            return function(*arguments)

        return recording

    for (module, name), function in originals.items():
        setattr(MODULES[module], name, recorder(module, name, function))
    try:
        yield
    finally:
        for (module, name), function in originals.items():
            setattr(MODULES[module], name, function)


def recorded() -> dict[tuple[str, str], list[Call]]:
    """Some calls of each exported function, by module and name."""
    calls: dict[tuple[str, str], list[Call]] = {}
    with _recorded(calls):
        frames = (_frames, _fingers, _followed, _neighbours)
        for scenario in (_matrices, _poses, _samples, _contacts, _touches, _wire_lines, *frames):
            scenario(np.random.default_rng(1))
    uncalled = [name for name in functions() if name not in calls]
    assert not uncalled, f"no scenario calls {uncalled}"
    return calls


def _matrices(random: np.random.Generator) -> None:
    for size in (1, 3, 6):
        root = random.normal(size=(size, size))
        covariance = root @ root.T + np.eye(size)
        matrix.inverse(covariance)
        matrix.singular_values(root)
        matrix.complement(random.normal(size=(size + 2, size)))
        matrix.product(random.normal(size=(2, size, 3)), random.normal(size=(3, 4)))
    for x in (-800.0, 0.5):
        _arithmetic.exp(x)
        _arithmetic.has_finite_numbers(msgpack.encode([x, "x" * 40, {"x": None}, b"x"]))
        _arithmetic.log(abs(x))


def _poses(_: np.random.Generator) -> None:
    from kernel.problems import random_problem

    for seed in range(MOST_KEPT):
        problem = random_problem(seed, 3 + seed % 6, seed % 3, seed % 4 == 0)
        solve_problem(problem)
        deviations(problem)
        predict(problem.measurements, problem.magnets, problem.start)


def _samples(random: np.random.Generator) -> None:
    for sensors in (1, 4, 16):
        alignment = Alignment(sensors, 4545)
        for number in range(4):
            time_us = 10_000_000 + 4545 * number + random.integers(0, 4545, sensors)
            fresh = random.uniform(size=sensors) < 0.8
            alignment.push(random.normal(0.0, 1e-5, (sensors, 3)), time_us, fresh, None if number % 2 else fresh, None)
    for leap_us in (0, 2**20, -(2**46)):
        _alignment.leap_us(10_000_000, 1_000_000_000, 7, 10_004_545 + leap_us, 1_004_545_000, 8, 4545.0)
    for later_s in (0.02, 0.5, -1.0, np.nan):
        _alignment.posture(_alignment.POSTURE_KNOWN, later_s)


def _contacts(random: np.random.Generator) -> None:
    from test_pipeline import config_of
    from test_refine import RESPONSES

    from fmfts.contact.refinement import Refiner
    from fmfts.contact.shipped import DEFAULT_PATH

    for response in RESPONSES:
        press = np.array([1.0, 2.0, *[0.5] * response.loads])
        Refiner(response).refined(press, response.change(press[None])[0], 1e-6 * np.eye(5))
        response.basis(press[None])
    pad = config_of(3).pad()
    model = ContactModel.load(str(DEFAULT_PATH), pad)
    for width_m in (3e-3, 12e-3):
        model.reads(0.5, width_m)
    for _ in range(3):
        model.inference.pose[:] = random.normal(size=6)
        model.inference.run()
        place_m = pad.rest_position_m - np.array([0.0, 0.0, 2e-4 * random.random()])
        model.estimate(place_m, pad.rest_axis, 1e-9 * np.eye(6))


def _touches(random: np.random.Generator) -> None:
    """Without a frame: several magnets are touched, and a followed rest creeps."""
    detector, creep = TouchDetector(220.0), Creep(Silicone(), 1.0)
    for size_m in (0.0, 1e-6, 1e-3):
        change = size_m * random.normal(size=5)
        detector.update(change, 1e-12 * np.eye(5))
        detector.unseen()
        creep.left_behind(change, 4.5e-3)
        _pad.distance(change, 1e-12 * np.eye(5))


def _wire_lines(_: np.random.Generator) -> None:
    from fast_loop_host import sample_of
    from pad_frames import frames_of
    from test_pipeline import config_of

    from fmfts.sensor.patience import BEHIND, IN_TIME
    from fmfts.sensor.wire.clock import DeviceClock
    from fmfts.sensor.wire.newest import keep_newest
    from fmfts.sensor.wire.packets import Early

    samples = [sample_of(frame) for frame in frames_of(config_of(3), 0.1)]
    early = Early(2, 7, 5, 2**40, (-32768, 0, 32767))
    lines = b"".join(encode(sample) + encode(early) for sample in samples)
    Decoder().leading_samples(lines)
    for patience in (IN_TIME, BEHIND):
        keep_newest(lines, patience)
    clock = DeviceClock()
    for sample in samples:
        arrival_ns = 1_000_000_000 + 1000 * sample.time_us
        clock.is_plausible(sample.time_us, arrival_ns)
        clock.to_host_ns(sample.time_us, arrival_ns)
        clock.at_ns(sample.time_us, arrival_ns)
    clock.restart()


def _frames(_: np.random.Generator) -> None:
    """Of every health, each with a sample that comes before the next, and both as a board's bytes."""
    from golden.replayed import pipelines_of
    from golden.world import load

    healths = set()
    for name, number in AMID.items():
        (pad, *_), last = load(name)[0].pads, None
        with pipelines_of(load(name)[0]) as pipelines:
            pipeline = pipelines[pad.settings.name]
            assert isinstance(pipeline, PadPipeline)
            for place, events in pad.events():
                frame = next(event for event in events if isinstance(event, Frame))
                if place == number:
                    healths.add(_of_one_frame(pipeline, last or frame, frame))
                    break
                pipeline.answer(frame)
                last = frame
    assert healths == {"ok", "degraded", "disturbed", "lost", "no_baseline"}


def parts_of(pipeline: PadPipeline) -> tuple[Any, ...]:
    """The parts of its Pad, copied."""
    model = pipeline.model
    return (
        bytearray(pipeline._parameters.buffer.tobytes()),
        bytearray(pipeline._memory.buffer.tobytes()),
        model.inference.for_c if isinstance(model, ContactModel) else None,
        packed_response(model),
        tuple(words_of(pipeline.pad, "boot", model, pipeline.baselined, "no baseline")),
        bytearray(pipeline.be_felt().table.buffer.tobytes()),
        tuple(
            (bytearray(each.sighting.table.buffer.tobytes()), len(each.sighting.magnets))
            for each in pipeline._neighbours
        ),
        None if pipeline.hand is None else bytearray(pipeline.hand.table.buffer.tobytes()),
        packed_errors(pipeline.baselined),
    )


def _of_one_frame(pipeline: PadPipeline, before: Frame, frame: Frame) -> str:
    """Returns the frame's health. before: the frame before it."""
    from fast_loop_host import sample_of

    from fmfts.sensor.wire.packets import Early

    taken = (*frame.packed, frame.sequence, frame.device_time_us, frame.host_time_ns, frame.temperature_c or 20.0)
    sensor, after_us, counts = 1, 2000, (100, -200, 50)
    early = sensor, frame.gain_code, *counts, frame.device_time_us + after_us
    PADS.judged(parts_of(pipeline), taken)
    PADS.missing(parts_of(pipeline), taken)
    PADS.followed(parts_of(pipeline), taken, early)
    PADS.absent(parts_of(pipeline), "lost", "an error")
    one, other = sample_of(before), sample_of(frame)
    clock, arrival_ns = DeviceClock(), 10_000_000_000
    clock.to_host_ns(one.time_us, arrival_ns)
    loan = bytearray(clock.line), b"contact/pad", 0, 1 << 62
    line = encode(other) + encode(Early(0, sensor, frame.gain_code, other.time_us + after_us, counts))
    PADS.lent(parts_of(pipeline), loan, b"", line, arrival_ns + 1000 * (other.time_us - one.time_us), 3)
    if pipeline.baselined is not None:
        none = np.zeros(3 * len(pipeline.pad.sensors))
        parameters, memory, *_, errors = parts_of(pipeline)
        covariance = bytearray(8 * 14 * 14)
        _pad.track_field(parameters, memory, none.data, (none + 2e-7).data, none.data, covariance, 4.5e-3, 25.0, errors)
    return pipeline.answer(frame).health


def _fingers(random: np.random.Generator) -> None:
    from several_world import fingers_of, measured_of, models_of

    from fmfts.several.fit import Fitter
    from fmfts.several.free_poses import free_poses
    from fmfts.several.poses import poses_of
    from fmfts.several.reading import FingersMemory
    from fmfts.several.recovery import Recovery
    from fmfts.several.since_rest import CONSTANT, SinceRest
    from fmfts.several.valley import valley_variance
    from fmfts_calibrate.resultant import resultant_deviation

    none = np.zeros(3)
    for sizes in ((4, 8, 48, 15, 1), (1, 2, 1, 4, 3), (9, 16, 96, 12, 8)):
        fitter = Fitter(models_of(1, *sizes))
        mounting, response = fitter.model.mounting, fitter.model.response
        mounting.magnets.changed(np.zeros(5 * sizes[0]), mounting.frames)
        each = np.ones((sizes[1], 3))
        since = SinceRest(fitter.model.pad, mounting, np.inf * each, CONSTANT)
        memory = FingersMemory(Recovery(np.zeros(each.size)))
        since.begin(None, memory, 0.01)
        aligned = Aligned(each, np.ones((sizes[1], 1)), 0.0 * each, 0, np.zeros(each.shape, dtype=np.int64))
        since.measured(aligned, (), memory, np.zeros(each.size))
        for count in (1, 2):
            fingers = fingers_of(random, count)
            measured = measured_of(random, fitter.model, fingers)
            fit = replace(fitter.fit(fingers, measured, none), fingers=fingers)
            root = fitter.whitener(fingers, measured, none)
            resultant_deviation(fit)
            fitter.chi2_with(root, fingers, measured)
            response.pressed_alone(*fingers.T)
            fitter.best_single(root, measured)
            fitter.best_pairs(root, measured, 3)
            fitter.another(root, fingers, measured)
            unsure = replace(fit, covariance=np.eye(3 * count))
            valley_variance(fitter, unsure, measured, np.full(3, 1e-5))
            poses_of(fitter, fit, measured, none)
            free_poses(fitter.model, np.zeros(5 * sizes[0]), measured, none)
            fitter.model.covariance(fingers, fitter.model.predict(fingers), measured.variance_t2, none)


def _followed(_: np.random.Generator) -> None:
    """A finger on four magnets, and a sample before the next frame."""
    from test_now_of_several import frames, ready, tapping

    from fmfts.sensor.early import EarlySample

    pipeline, noted = ready(early_s=1.1e-3), dict[str, tuple[Any, ...]]()
    made, compiled = pipeline._frames, pipeline._frames.compiled

    class Noted:
        """The pad, whose last calls are noted."""

        def __getattr__(self, name: str) -> Any:
            def noting(*arguments: Any) -> Any:
                noted[name] = kept(arguments)
                return getattr(compiled, name)(*arguments)

            return noting if callable(getattr(compiled, name)) else getattr(compiled, name)

    assert pipeline._calm is not None
    assert pipeline._followed is not None
    made.compiled = pipeline._calm._compiled = pipeline._followed._compiled = Noted()  # type: ignore[assignment]
    words = tuple(Words(1, "pad", "boot", "model", None, "", "", "", ((), "")))
    for count in (20, 88):  # untouched, and a finger
        for frame in frames(count, tapping):
            buffers = tuple(bytearray(part.buffer.tobytes()) for part in (made.parameters, made.memory))
            bound = kept(made.bound)
            pipeline.answer(frame)
        pipeline.early(EarlySample(frame.pad_index, 1, frame.device_time_us + 2000, frame.gain_code, (100, -200, 50)))
        pad = *buffers, None, None, words, bytearray(made._unseen.tobytes()), ()
        early = noted.get("follow_early", (1, 0, 100, -200, 50, 10, None))
        if count == 88:  # the first of these writes to the pad's memory
            PADS.several(pad, bound, noted["align"], noted["calm"], noted["tell"], early)
            model, values = pipeline._followed._estimator.fitter.model, made.parameters.integer("sensors") * 3
            finger = made.found["fingers"][:3]
            fields = (made.found[name][:values] for name in ("change_t", "noise_t", "misfit_t"))
            others = made.found["slope_t"][: 3 * values], made.found["ambient_t"]
            rooms = np.zeros(values), finger + 0.1, np.array([1.0, 0.2]), np.empty(values), np.empty(3 * values)
            _several.ahead(model.packed, model.work, finger, *fields, *others, *rooms)


def _neighbours(_: np.random.Generator) -> None:
    pad = PadConfig(name="one", source=SimulatedSource()).pad()
    placement = Placement(np.array([0.03, 0.0, 0.0]), np.eye(3), 2e-4)
    for magnets in (1, 4, 9):
        rest = (State.at_rest(pad),) * magnets
        covariance, rest_error = 1e-9 * np.eye(6 * magnets), np.full((magnets, 2), 1e-3)
        for seen_ns in (None, 0):
            sighting = Sighting((pad.magnet,) * magnets, rest, rest, covariance, rest_error, seen_ns)
            NeighbourView(sighting, placement).at(10**7).effect(pad.sensors)
