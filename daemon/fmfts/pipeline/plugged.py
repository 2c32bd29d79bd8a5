"""The pipeline of a pad whose contact model is another package's, as the daemon, a replay and a recorder use it.

`PadPipeline` describes each method. C never takes such a pad's frames from a board's bytes: `begin` gives None.
"""

from __future__ import annotations

from typing import Any, Protocol

from fmfts.baseline import Baseline
from fmfts.bus.messages import ContactMessage, Health
from fmfts.contact.plugged import PluggedModel
from fmfts.pad import Pad, Placement
from fmfts.pipeline import _pad
from fmfts.pose.hand import Hand
from fmfts.pose.sighting import Sighting
from fmfts.sensor import Frame
from fmfts.sensor.early import EarlySample


class PluggedPipeline(Protocol):
    """memory_kind: the type of `memory`, by which a recording keeps it."""

    pad: Pad
    memory_kind: type[Any]
    missing: dict[int, str]
    messages: int
    further_drift: str
    hand: Hand | None

    @property
    def model(self) -> PluggedModel: ...

    @property
    def model_hash(self) -> str: ...

    @property
    def baseline(self) -> Baseline | None: ...

    @property
    def mounting(self) -> Any: ...

    @property
    def force_scale(self) -> float | None: ...

    @property
    def force_scale_sd(self) -> float | None: ...

    @property
    def memory(self) -> Any: ...

    def recall(self, memory: Any) -> None: ...

    def use(self, baseline: Baseline, mounting: Any = None) -> Any: ...

    def refuse(self, reason: str) -> None: ...

    def feel(self, neighbour: Sighting, placement: Placement) -> None: ...

    def be_felt(self) -> Sighting: ...

    def start_anew(self) -> None: ...

    def process(self, frame: Frame) -> ContactMessage: ...

    def answer(self, frame: Frame) -> ContactMessage: ...

    def early(self, early: EarlySample) -> ContactMessage | None: ...

    def absent(self, health: Health, reason: str) -> ContactMessage: ...

    def begin(self, clock: memoryview, topic: bytes, pad_index: int, overdue_ns: int) -> None: ...

    def end(self, pad: _pad.Pad) -> None: ...

    def host_time_ns(self, device_time_us: int) -> int: ...
