"""The compiled path of one pad: its facts, the memory between its frames, and handing that memory over."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from fmfts.baseline import Mounting
from fmfts.common.double_table import DoubleTable
from fmfts.common.memory import hand_over, resume
from fmfts.contact import ContactModel, TouchDetector
from fmfts.contact.inference import CompiledInference
from fmfts.pad import Pad
from fmfts.pipeline.fast.compiled import AVAILABLE, _fast
from fmfts.pipeline.fast.parameters import put_contact, put_message, put_sensors, put_tracking
from fmfts.pipeline.fast.template import Template
from fmfts.pose.tracking_model import TrackingModel
from fmfts.sensor.frame import Packed

Array = NDArray[np.float64]


class Kind(IntEnum):
    """What a healthy frame says of contact, as tables.h numbers it."""

    QUIET = 0
    TOUCHED = 1
    OVER_RANGE = 2


KINDS = tuple(Kind)


class Judged(NamedTuple):
    """instant_us: the device's time of the estimate."""

    instant_us: int
    kind: Kind


class Passed(NamedTuple):
    """Frames that went from their bytes to the bus without Python; sequences of the first and the last of them.

    number, kind, payload, arrival_ns, t_sample_ns, t_publish_ns: of the last message. latencies_s: of each, sample →
    publish. change: the first message of another kind than before, None where there was none; there is no second.
    """

    frames: int
    first_sequence: int
    sequence: int
    number: int
    kind_number: int
    payload: bytes
    change: bytes | None
    arrival_ns: int
    t_sample_ns: int
    t_publish_ns: int
    latencies_s: list[float]

    @property
    def kind(self) -> Kind:
        return KINDS[self.kind_number]


class Lane:
    """Lets a pad's frames pass while they are healthy: lane.h."""

    def __init__(self, compiled: _fast.Lane) -> None:
        self.compiled = compiled

    def begin(self, templates: Sequence[Template], kind: Kind, number: int) -> None:
        """templates: of each kind. kind, number: of the last message. This has the pad's memory until `end`."""
        quiet, touched, over_range = [(template.text, template.places) for template in templates]
        self.compiled.begin((quiet, touched, over_range), kind, number)

    def last_ns(self) -> int:
        """When the last frame came that has passed since `begin`, 0: none has."""
        return self.compiled.last_ns()

    def end(self) -> Passed | None:
        """None where no frame has passed since `begin`."""
        passed = self.compiled.end()
        return None if passed is None else Passed(*passed)


class FastPath:
    """Judges frames as `Estimator.read` does, as long as nothing is wrong. Either of the two holds the pad's memory:

    `take` it after a healthy frame in Python, `give` it back before the next frame that is judged there.
    """

    def __init__(self, parameters: DoubleTable, model: ContactModel) -> None:
        assert isinstance(model.inference, CompiledInference)
        response = None if model.refiner is None else model.refiner.packed
        self._memory = DoubleTable(_fast.MEMORY)
        self._outcome = np.zeros(_fast.OUTCOME_BYTES // 8).data
        self._pad = parameters.buffer, self._memory.buffer, self._outcome, response, model.inference.network
        self._lane: Lane | None = None

    @classmethod
    def of(
        cls,
        drawing: Pad,
        mounting: Mounting,
        tracking: TrackingModel,
        rest_temperature_c: float | None,
        model: ContactModel,
        touch: TouchDetector,
        change_error: Array,
        repeats_allowed: Array,
        stopped_us: float,
        detection_limit_n: float,
    ) -> Self | None:
        """None where nothing compiled is there, or the contact model is not of the compiled network, tells shear or
        smooths, or has larger error tables than there is room for."""
        if not (AVAILABLE and model.plain and isinstance(model.inference, CompiledInference)):
            return None
        parameters = DoubleTable(_fast.PARAMETERS)
        try:
            put_sensors(parameters, mounting, mounting.mounted(drawing), repeats_allowed, stopped_us)
            put_tracking(parameters, mounting, tracking, rest_temperature_c)
            put_contact(parameters, mounting, drawing, change_error, touch, model, detection_limit_n)
            put_message(parameters, mounting, drawing.magnet.remanence_t)
        except ValueError:
            return None
        return cls(parameters, model)

    def judge(self, packed: Packed, device_time_us: int, temperature_c: float | None) -> Judged | None:
        """None where the frame is not healthy in every respect: the memory then is as it was."""
        temperature_c = np.nan if temperature_c is None else temperature_c
        judged = _fast.judge(*self._pad, packed, device_time_us, temperature_c)
        return None if judged is None else Judged(judged[0], KINDS[judged[1]])

    def message(self, template: Template, seq: int, t_sample_ns: int, t_publish_ns: int, utc_ns: int) -> bytes:
        """The last judged frame's."""
        return _fast.message(template.text, template.places, self._outcome, seq, t_sample_ns, t_publish_ns, utc_ns)

    def lane(self, clock: bytearray, topic: bytes, pad_index: int) -> Lane:
        """Of this pad, whose messages are about `topic`; clock: `DeviceClock.line`."""
        if self._lane is None:
            self._lane = Lane(_fast.Lane(self._pad, clock, topic, pad_index))
        return self._lane

    def take(self, *memories: object) -> None:
        """Take over what the frames before have left: nothing that only Python can judge is pending in it."""
        for memory in memories:
            hand_over(memory, self._memory)
        self._memory.put("was_sound", 0)
        self._memory.put("passed", 0)

    @property
    def passed(self) -> int:
        """Frames judged here since the memory was taken over."""
        return int(self._memory.number("passed"))

    @property
    def was_sound(self) -> bool:
        """The mean of the residuals, at any judgement since then."""
        return bool(self._memory.number("was_sound"))

    def give(self, *memories: object) -> None:
        """Give it back, into those that it was taken from."""
        for memory in memories:
            resume(memory, self._memory)
