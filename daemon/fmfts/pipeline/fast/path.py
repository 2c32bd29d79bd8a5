"""The fast path of one pad: its parameters, and its memory, which Python and C hand over to each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.baseline import Mounting
from fmfts.bus.messages import Health
from fmfts.common.double_table import DoubleTable
from fmfts.common.memory import hand_over, resume
from fmfts.contact import ContactModel, NoContactModel, TouchDetector
from fmfts.contact.inference import CompiledInference
from fmfts.pad import Pad
from fmfts.pipeline.fast import _fast
from fmfts.pipeline.fast.lane import KINDS, Kind, Lane
from fmfts.pipeline.fast.now_parameters import NowParameters, put_now
from fmfts.pipeline.fast.parameters import (
    put_contact,
    put_hidden_gradient,
    put_message,
    put_neighbours,
    put_sensors,
    put_silicone,
    put_touch,
    put_tracking,
)
from fmfts.pipeline.fast.template import Template
from fmfts.pose.hidden_gradient import HiddenGradient
from fmfts.pose.neighbour import NeighbourView
from fmfts.pose.sighting import Sighting
from fmfts.pose.silicone import SiliconeFollower
from fmfts.pose.tracking_model import TrackingModel
from fmfts.sensor.early import EarlySample
from fmfts.sensor.frame import Frame

if TYPE_CHECKING:
    from typing_extensions import Buffer

Array = NDArray[np.float64]


class Judged(NamedTuple):
    """instant_us, now_us: the board's time of the estimate, and of `now`."""

    instant_us: int
    now_us: float
    kind: Kind


class Verdict(NamedTuple):
    """What the messages of all frames say until Python judges one. whole: which sensors every axis is used of."""

    health: Health
    reason: str
    whole: tuple[bool, ...]
    tells_now: bool
    tells_force: bool
    tells_shear: bool


@dataclass(frozen=True, slots=True)
class Missing:
    """What every frame lacks until Python judges one. silent (N,): sensors; saturated (N, 3): axes of the others.

    blamed: the sensor that is left out because it contradicts the others. gain_code: of the frames, of which the reason
    tells the range; negative: nothing is missing, and any will do. most: so many frames may pass before Python looks.
    """

    silent: NDArray[np.bool_]
    saturated: NDArray[np.bool_]
    gain_code: int
    blamed: int | None = None
    most: float = np.inf

    @property
    def used(self) -> NDArray[np.bool_]:
        used: NDArray[np.bool_] = ~(self.saturated | self.silent[:, None])
        if self.blamed is not None:
            used[self.blamed] = False
        return used

    @classmethod
    def of(cls, frame: Frame) -> Missing:
        silent, overflow = ~frame.valid, frame.overflow
        saturated = overflow & frame.valid[:, None]
        return cls(silent, saturated, frame.gain_code if silent.any() or saturated.any() else -1)

    def without(self, sensor: int, gain_code: int, most: float) -> Missing:
        """The same, and this sensor is left out."""
        return replace(self, blamed=sensor, gain_code=gain_code, most=most)


class FastPath:
    """Judges frames in C, with the same results as `Estimator.read`: healthy ones, and those that lack just what the
    last frame in Python lacked.

    Either C or Python holds the pad's memory. Call take_over() after a healthy frame in Python, and give_back() before
    Python judges the next frame.
    """

    def __init__(
        self,
        parameters: DoubleTable,
        model: ContactModel | NoContactModel,
        network: bytes | None,
        response: bytes | None,
    ) -> None:
        self._parameters = parameters
        self._memory = DoubleTable(_fast.MEMORY)
        self._judged = np.zeros(_fast.OUTCOME_BYTES // 8)  # what the last frame left for the samples that follow
        self._outcome = self._judged.data
        self._alone = parameters.buffer, self._memory.buffer, self._outcome, response, network
        self._pad: tuple[Buffer | None, ...] = self._alone
        self._around: tuple[Sighting, Sequence[NeighbourView]] | None = None
        self._lane: Lane | None = None
        self._tells = isinstance(model, ContactModel), isinstance(model, ContactModel) and model.has_shear
        self.verdict = Verdict("ok", "", (), False, *self._tells)

    @classmethod
    def of(
        cls,
        drawing: Pad,
        mounting: Mounting,
        tracking: TrackingModel,
        rest_temperature_c: float | None,
        model: ContactModel | NoContactModel,
        touch: TouchDetector,
        silicone: SiliconeFollower,
        hidden_gradient: HiddenGradient,
        change_error: Array,
        repeats_allowed: Array,
        stopped_us: float,
        detection_limit_n: float,
        now: NowParameters | None = None,
    ) -> FastPath | None:
        """A fast path; None if C cannot serve this pad.

        C serves contact models of the compiled network, whose error tables fit into tables.h. change_error (8, 5, M),
        repeats_allowed (N, 3).
        """
        network, refiner = None, None
        if isinstance(model, ContactModel):
            if not isinstance(model.inference, CompiledInference):
                return None
            network, refiner = model.inference.network, model.refiner
        parameters = DoubleTable(_fast.PARAMETERS)
        try:
            put_sensors(parameters, mounting, mounting.mounted(drawing), repeats_allowed, stopped_us)
            put_tracking(parameters, mounting, tracking, rest_temperature_c)
            put_silicone(parameters, silicone)
            put_hidden_gradient(parameters, hidden_gradient)
            put_touch(parameters, mounting, drawing, change_error, touch)
            if isinstance(model, ContactModel):
                put_contact(parameters, mounting, drawing, model, detection_limit_n)
            put_message(parameters, mounting, drawing.magnet.remanence_t)
            put_now(parameters, now)
        except ValueError:
            return None
        response = None if now is None else now.response
        return cls(parameters, model, network, response if refiner is None else refiner.packed)

    def be_among(self, own: Sighting, neighbours: Sequence[NeighbourView]) -> bool:
        """From now on, tell in `own` where the magnet is seen, and reckon with these neighbours. False if C cannot."""
        if self._around is not None and self._around[0] is own and self._around[1] == tuple(neighbours):
            return True
        if len(neighbours) > _fast.NEIGHBOURS or any(len(each.sighting.magnets) > 1 for each in neighbours):
            return False
        put_neighbours(self._parameters, neighbours)
        seen = (own, *(each.sighting for each in neighbours))
        self._pad, self._lane = (*self._alone, *(each.table.buffer for each in seen)), None
        self._around = own, tuple(neighbours)
        return True

    @property
    def is_alone(self) -> bool:
        """Whether it feels no neighbour."""
        return self._around is None or not self._around[1]

    def judge(self, frame: Frame) -> Judged | None:
        """Judge one frame. None, and the memory is unchanged, if the frame is not healthy in every respect."""
        temperature_c = np.nan if frame.temperature_c is None else frame.temperature_c
        times = frame.device_time_us, frame.host_time_ns
        judged = _fast.judge(self._pad, frame.packed, frame.sequence, *times, temperature_c)
        return None if judged is None else Judged(judged[0], judged[1], KINDS[judged[2]])

    def early(self, early: EarlySample) -> float | None:
        """Follow a sample that came before its frame, after judge() of a healthy one. Returns the board's time of the
        `now` that it tells, None if it tells none."""
        return _fast.early(self._pad, early.sensor, early.gain_code, *early.counts, early.device_time_us)

    def message(
        self, template: Template, seq: int, t_sample_ns: int, t_publish_ns: int, utc_ns: int, now_ns: int
    ) -> bytes:
        """The encoded message of the frame that was judged last. now_ns: the host's time of `now`."""
        times = t_sample_ns, t_publish_ns, utc_ns, now_ns
        return _fast.message(template.text, template.places, self._outcome, seq, *times)

    def lane(self, clock: bytearray, topic: bytes, pad_index: int, overdue_ns: int) -> Lane:
        """The lane of this pad.

        clock: `DeviceClock.line`. topic: of its messages on the bus. overdue_ns: older frames are left out.
        """
        if self._lane is None:
            self._lane = Lane(_fast.Lane(self._pad, clock, topic, pad_index, overdue_ns))
        return self._lane

    @property
    def tells_now(self) -> bool:
        """Whether messages tell the contact at the time of publishing."""
        return bool(self._parameters.number("tells_now"))

    def tell_no_now(self) -> None:
        self._parameters.put("tells_now", 0.0)

    def take_over(self, missing: Missing, health: Health, reason: str, *memories: object) -> None:
        """Copy the memory of earlier frames to C. It must not hold anything that only Python can judge.

        missing, health, reason: of the last frame, and of all that C will judge. Samples that come before the next
        frame wait for it: what Python judged, C does not know.
        """
        whole = tuple(bool(sensor.all()) for sensor in missing.used)
        tells_now = self.tells_now and missing.gain_code < 0 and self.is_alone
        self.verdict = Verdict(health, reason, whole, tells_now, *self._tells)
        self._judged.fill(0.0)
        for memory in memories:
            hand_over(memory, self._memory)
        self._memory.put("was_sound", 0)
        self._memory.put("passed", 0)
        self._memory.put("silent", int.from_bytes(np.packbits(missing.silent, bitorder="little").tobytes(), "little"))
        self._memory.put("saturated", missing.saturated.astype(np.float64))
        self._memory.put("gain_code", missing.gain_code)
        self._memory.put("blamed", -1 if missing.blamed is None else missing.blamed)
        self._memory.put("most", missing.most)

    @property
    def passed(self) -> int:
        """How many frames C judged since take_over()."""
        return int(self._memory.number("passed"))

    @property
    def was_sound(self) -> bool:
        """Whether the mean residuals were sound at any judgement since take_over()."""
        return bool(self._memory.number("was_sound"))

    def give_back(self, *memories: object) -> None:
        """Copy the memory back into the objects that take_over() read."""
        for memory in memories:
            resume(memory, self._memory)
