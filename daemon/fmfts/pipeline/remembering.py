"""What a pipeline remembers of earlier frames, with one magnet or several. snapshot.py makes bytes of it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

from fmfts.baseline import Baseline
from fmfts.bus.messages import ContactMessage
from fmfts.common.memory import require_alike
from fmfts.common.record import Record, Values
from fmfts.pad import Pad
from fmfts.pipeline import _pad
from fmfts.pipeline.encoded import EncodedMessage
from fmfts.pipeline.first_memory import first_memory, with_later
from fmfts.pipeline.possible_memory import require_possible
from fmfts.pipeline.words import NO_BASELINE
from fmfts.pose.neighbour import NeighbourView
from fmfts.pose.sighting import Sighting, SightingMemory
from fmfts.sensor import Frame
from fmfts.several.reading import FingersMemory, PosesMemory


@dataclass(slots=True)
class PadMemory:
    """All that the next message depends on, besides its frame, the configuration and the baseline.

    fields: of FMFTS_MEMORY (frame.h), by name. why_no_baseline: the reason of messages without one. sensors: of the
    pad; has_baseline: whether it had one. Of several magnets only: fingers and, where `now` is published, followed
    (the fields of FMFTS_FOLLOWED_MEMORY, finger.h) with a table of presses; poses without one.
    """

    fields: Values
    sighting: SightingMemory
    why_no_baseline: str
    sensors: int
    has_baseline: bool
    fingers: FingersMemory | None = None
    poses: PosesMemory | None = None
    followed: Values | None = None


class RememberingPipeline(ABC):
    """The pipeline of one pad. memory_kind: the type of `memory`, by which a recording keeps it."""

    memory_kind = PadMemory

    def __init__(self, pad: Pad) -> None:
        self.pad = pad
        self._memory = Record(_pad.MEMORY)
        self._memory.fill(first_memory(pad, None))
        self._sighting = Sighting.unseen(pad)
        self._neighbours: list[NeighbourView] = []
        self._why_none = NO_BASELINE

    @property
    @abstractmethod
    def baseline(self) -> Baseline | None: ...

    @abstractmethod
    def answer(self, frame: Frame) -> EncodedMessage:
        """The message of one frame, encoded."""

    def process(self, frame: Frame) -> ContactMessage:
        """The message of one frame."""
        return self.answer(frame).message

    @property
    def messages(self) -> int:
        """The number of the last message."""
        return self._memory.integer("number")

    def host_time_ns(self, device_time_us: int) -> int:
        """The host's time of the board's, near the last frame."""
        return self._memory.integer("frame_ns") + 1000 * (device_time_us - self._memory.integer("frame_us"))

    @property
    def memory(self) -> PadMemory:
        """The pipeline's memory between two frames."""
        sensors, has_baseline = len(self.pad.sensors), self.baseline is not None
        return PadMemory(self._memory.copy(), self._sighting.memory, self._why_none, sensors, has_baseline)

    def recall(self, memory: PadMemory) -> None:
        """Continue from the memory of another pipeline of the same configuration and baseline.

        ValueError, and nothing changes, if the memory does not fit this pipeline.
        """
        own, memory = self.memory, replace(memory, fields=with_later(memory.fields))
        if memory.sensors != own.sensors:
            raise ValueError(f"of a pad with {memory.sensors} sensors, and this one has {own.sensors}")
        if memory.has_baseline != own.has_baseline:
            raise ValueError("of a pad with a baseline, and this one has none, or the other way round")
        require_alike(memory, own)
        for fields in filter(None, (memory.fields, memory.followed)):
            require_possible(fields, memory.sensors)
        self._memory.recall(memory.fields)
        self._sighting.recall(memory.sighting)
        self._go_on(memory)

    @abstractmethod
    def _go_on(self, memory: PadMemory) -> None:
        """Take the parts of a memory that only this kind of pipeline has."""
