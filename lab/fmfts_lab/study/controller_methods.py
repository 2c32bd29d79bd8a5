"""Methods that give a controller the contact, each from the frames of one built pad: the daemon, straight lines,
filters, networks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, Protocol

import numpy as np
from msgspec import structs

from fmfts.bus.messages import ContactMessage
from fmfts.config import SimulatedSource
from fmfts.contact import ContactModel
from fmfts.pad import Array
from fmfts.pipeline.configured import load_contact_model
from fmfts.pipeline.encoded import Answer, message_of
from fmfts.pose import Alignment, State
from fmfts.pose.change import shortest_rotation
from fmfts.sensor.frame import WireFrame
from fmfts_lab.bench.drills import RATE_HZ
from fmfts_lab.bench.now_pads import TRANSPORT_S, BuiltPad
from fmfts_lab.bench.tapped import ManyFrames
from fmfts_lab.study.contact_bench import Bench, ContactFinder
from fmfts_lab.study.contact_methods import contact_methods
from fmfts_lab.study.filters import ExtendedKalman, UnscentedKalman
from fmfts_lab.study.method import Maker
from fmfts_lab.study.world import Sample, World

SMOOTHING_MS = 40.0
UNKNOWN = np.full(3, np.nan)
TO_SI = np.array([1e-3, 1e-3, 1.0])


class Told(NamedTuple):
    """The answer of a method after a frame: values (3,) x, y (m), force (N) at `at_s` of the frames' clock, and rates
    (3,) per second. NaN if it has none.
    """

    at_s: float
    values: Array
    rates: Array


NOTHING = Told(float("nan"), UNKNOWN, UNKNOWN)


class Teller(Protocol):
    """Only `ask` is timed."""

    def ask(self, frame: WireFrame) -> Any: ...

    def told(self, raw: Any) -> Told: ...


class Today:
    """The contact in a message's own fields, which hold at its `t_sample_ns`; without `now`."""

    def __init__(self, pad: BuiltPad, model: ContactModel | None = None) -> None:
        pipeline = pad.pipeline(model)
        pipeline._parameters.put("tells_now", 0.0)  # so that its cost is not in the time
        self.ask = pipeline.answer

    def told(self, raw: Answer) -> Told:
        return _own(message_of(raw))


def _own(message: ContactMessage) -> Told:
    return Told(message.t_sample_ns * 1e-9, _numbers(message.x_m, message.y_m, message.force_n), UNKNOWN)


def _numbers(*values: float | None) -> Array:
    return np.array([np.nan if value is None else value for value in values])


class Now:
    """`now` of the same messages; their own fields where it is null."""

    def __init__(self, pad: BuiltPad) -> None:
        self.ask = pad.pipeline().answer

    def told(self, raw: Answer) -> Told:
        message = message_of(raw)
        now = message.now
        if now is None:
            return _own(message)
        rates = _numbers(now.x_rate_m_per_s, now.y_rate_m_per_s, now.force_rate_n_per_s)
        return Told(now.t_ns * 1e-9, _numbers(now.x_m, now.y_m, now.force_n), rates)


class Line:
    """Another method's last two answers, extrapolated linearly to the time of publishing. The line itself is not timed:
    it is a few multiplications.
    """

    def __init__(self, of: Teller) -> None:
        self._of, self._before = of, NOTHING

    def ask(self, frame: WireFrame) -> tuple[int, Any]:
        return frame.sequence, self._of.ask(frame)

    def told(self, raw: tuple[int, Any]) -> Told:
        sequence, answer = raw
        last, before = self._of.told(answer), self._before
        self._before = last
        if not last.at_s > before.at_s:
            return last
        rates = (last.values - before.values) / (last.at_s - before.at_s)
        publish_s = sequence / RATE_HZ + TRANSPORT_S
        ahead = last.values + np.nan_to_num(rates) * (publish_s - last.at_s)
        ahead[2] = max(float(ahead[2]), 0.0)
        return Told(publish_s, ahead, rates)


@dataclass(frozen=True, slots=True)
class FrameBench(Bench):
    """A bench whose samples have the fields of real frames: brought to one instant, or taken for simultaneous."""

    def field(self, sample: Sample) -> Array:
        return self.mounting.magnet_field(sample.field_t)

    @classmethod
    def of_pad(cls, pad: BuiltPad) -> FrameBench:
        """Methods that learn do so for the drawing, which all pads share: so their worlds must be equal, too."""
        drawing = pad.config.pad()
        config = structs.replace(pad.config, source=SimulatedSource())
        world = World(config, drawing, ManyFrames(pad.config).built, float(RATE_HZ))
        refining = ContactModel.load(config.contact.model, drawing, refine=True)
        return cls(world, pad.mounting, pad.model, refining)


class FromFrames:
    """A contact method of the other charts, fed with frames as they come from chips that run on their own clocks.

    aligned: whether their samples are brought to one instant first, as the daemon does it.
    """

    def __init__(self, make: Callable[[Bench], ContactFinder], pad: BuiltPad, aligned: bool = True) -> None:
        self._finder = make(FrameBench.of_pad(pad))
        self._alignment = Alignment(len(pad.config.geometry.sensors_mm), 1e6 / RATE_HZ) if aligned else None
        self._last_s: float | None = None

    def ask(self, frame: WireFrame) -> tuple[float, Any]:
        field_t, time_us = frame.field_t, frame.device_time_us
        if self._alignment is not None:
            one = self._alignment.push(field_t, frame.sampled_us, frame.fresh, frame.timed)
            field_t, time_us = one.field_t, one.time_us
        at_s = time_us * 1e-6
        elapsed_s = 0.0 if self._last_s is None else max(at_s - self._last_s, 0.0)
        self._last_s = at_s
        return at_s, self._finder.ask(Sample(field_t, elapsed_s, frame))

    def told(self, raw: tuple[float, Any]) -> Told:
        at_s, answer = raw
        press = self._finder.told(answer)
        return NOTHING if press is None else Told(at_s, press * TO_SI, UNKNOWN)


class ThroughFilter:
    """A filter of the pose; then the config's network."""

    def __init__(self, make: Maker, bench: Bench) -> None:
        self._bench, self._drawing, mounted = bench, bench.world.drawing, bench.mounted
        self._filter = make(mounted)
        self._rest = State.at_rest(mounted.drawing)
        self._turn = shortest_rotation(self._rest.axis, self._drawing.rest_axis)

    def ask(self, sample: Sample) -> Array | None:
        answer = self._filter.told(self._filter.ask(sample._replace(field_t=self._bench.field(sample))))
        if answer.flagged:
            return None
        # The network was trained on the pad as drawn.
        moved_m = self._bench.mounting.pad_turn @ (answer.position_m - self._rest.position_m)
        position_m = self._drawing.rest_position_m + moved_m
        inference = self._bench.model.inference
        inference.pose[:] = np.concatenate([position_m * 1e3, self._turn @ answer.axis])
        inference.run()
        return inference.contact.astype(float)[:3]

    def told(self, raw: Array | None) -> Array | None:
        return raw


class ControllerMethod(NamedTuple):
    name: str
    family: str
    make: Callable[[BuiltPad], Teller]
    settings: str


DAEMON, LINES, FILTERS, OTHERS = "the daemon", "a line through two frames", "filters of the pose", "solved otherwise"
TODAY, NOW = "today's fields", "`now`"
SOLVER, NETWORK, ONE_STEP = "shipped ONNX", "BP 12 × 12 of field", "one step, field → contact"
ALIGNED, HELD = "samples brought to one instant", "held until the next message"


def controller_methods() -> Iterator[ControllerMethod]:
    """In the order of the tables; TODAY first, because times are given relative to its time."""
    finders = {one.name: one.make for one in contact_methods()}
    field, one_step = (partial(FromFrames, finders[name]) for name in (NETWORK, ONE_STEP))
    at_once = partial(FromFrames, finders[SOLVER], aligned=False)
    extended, unscented = (
        partial(FromFrames, partial(ThroughFilter, one)) for one in (ExtendedKalman, UnscentedKalman)
    )
    yield ControllerMethod(TODAY, DAEMON, Today, f"frame → message in C; {ALIGNED}; {HELD}")
    yield ControllerMethod(NOW, DAEMON, Now, "frame → message in C; carried on with its rates")
    yield ControllerMethod("today's, line", LINES, lambda pad: Line(Today(pad)), "carried on along the line")
    yield ControllerMethod("all samples at once, line", LINES, lambda pad: Line(at_once(pad)), "as without; line")
    yield ControllerMethod("network of field, line", LINES, lambda pad: Line(field(pad)), "as without; line")
    smoothing = f"smoothing_ms = {SMOOTHING_MS:g}, judged in Python; {HELD}"
    yield ControllerMethod("today's, smoothed", FILTERS, _smoothed, smoothing)
    yield ControllerMethod("extended Kalman", FILTERS, extended, f"{ALIGNED}; shipped network; {HELD}")
    yield ControllerMethod("unscented Kalman", FILTERS, unscented, f"{ALIGNED}; shipped network; {HELD}")
    yield ControllerMethod("all samples at once", OTHERS, at_once, f"taken for simultaneous; then as today; {HELD}")
    yield ControllerMethod(ONE_STEP, OTHERS, one_step, f"a table, one Gauss–Newton step; {ALIGNED}; {HELD}")
    yield ControllerMethod("network of field", OTHERS, field, f"{NETWORK}; {ALIGNED}; {HELD}")


def _smoothed(pad: BuiltPad) -> Teller:
    contact = structs.replace(pad.config.contact, smoothing_ms=SMOOTHING_MS)
    return Today(pad, load_contact_model(structs.replace(pad.config, contact=contact)))
