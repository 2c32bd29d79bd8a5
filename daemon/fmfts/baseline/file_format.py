"""Recordings in the form of a baseline's file, and the conversion in both directions."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime, timezone
from itertools import chain
from typing import Any, TypeVar

import msgspec
import numpy as np

from fmfts.baseline.learned import LearnedGeometry
from fmfts.baseline.recording import Recording
from fmfts.baseline.refine import PressFields
from fmfts.baseline.sensitivity import Sensitivity
from fmfts.baseline.turn import Turn
from fmfts.common import possible
from fmfts.pad import Tolerance
from fmfts.sensor.chips import GAIN_CODES

Rows = tuple[tuple[float, float, float], ...]
Stored = TypeVar("Stored", bound=msgspec.Struct)
Facts = TypeVar("Facts")
MOST_FIELDS = 1000  # the most fields that a file may hold of a turn or of presses; a recording keeps 100 and 40


class StoredRecording(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A `Recording` with the time at which it was made."""

    utc: str
    mean_t: Rows
    noise_t: Rows
    samples: tuple[int, ...]
    gain_code: int
    temperature_c: float | None
    duration_s: float

    def __post_init__(self) -> None:
        require_fields(self.mean_t)
        possible.NOISE_T.require(chain(*self.noise_t))
        possible.SAMPLES.require(self.samples)
        possible.RECORDING_S.require([self.duration_s])
        possible.TEMPERATURE_C.require([] if self.temperature_c is None else [self.temperature_c])
        if not (0 <= self.gain_code < GAIN_CODES and len(self.mean_t) == len(self.noise_t) == len(self.samples)):
            raise ValueError("no chips make such a recording")

    @property
    def sensors(self) -> int:
        return len(self.mean_t)

    @classmethod
    def of(cls, recording: Recording) -> StoredRecording:
        return stored(cls, recording)

    def recording(self) -> Recording:
        return unstored(Recording, self)


class StoredGains(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The gains that a self-test measured, each with the same deviation, and the time at which it was made."""

    utc: str
    gain: Rows
    deviation: float

    def __post_init__(self) -> None:
        possible.GAIN.require(chain(*self.gain))
        possible.SHARE.require([self.deviation])

    @property
    def sensors(self) -> int:
        return len(self.gain)

    @classmethod
    def of(cls, facts: Mapping[str, Any]) -> StoredGains:
        """From the facts of a self-test that passed (`selftest_facts` in sensor/chips/selftest.py)."""
        gain = np.array([sensor["gain_factor"] for sensor in facts["sensors"]], dtype=float)
        return cls(now(), _plain(gain), facts["gain_factor_sd"])

    def sensitivity(self, tolerance: Tolerance) -> Sensitivity:
        return Sensitivity.tested(np.array(self.gain), self.deviation, tolerance)


class StoredTurn(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A `Turn` with the time at which it was made."""

    utc: str
    field_t: tuple[Rows, ...]
    deviation_t: Rows
    time_s: tuple[float, ...]

    def __post_init__(self) -> None:
        require_fields(*self.field_t, sensors=len(self.deviation_t))
        possible.NOISE_T.require(chain(*self.deviation_t))
        possible.RECORDING_S.require(self.time_s)
        if len(self.time_s) != len(self.field_t):
            raise ValueError("a time belongs to each field of a turn")

    @property
    def sensors(self) -> int:
        return len(self.deviation_t)

    @classmethod
    def of(cls, turn: Turn) -> StoredTurn:
        return stored(cls, turn)

    def turn(self) -> Turn:
        return unstored(Turn, self)


class StoredPresses(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """`PressFields` with the time at which they were made."""

    utc: str
    field_t: tuple[Rows, ...]
    deviation_t: Rows
    rest_t: Rows

    def __post_init__(self) -> None:
        require_fields(*self.field_t, self.rest_t, sensors=len(self.deviation_t))
        possible.NOISE_T.require(chain(*self.deviation_t))

    @property
    def sensors(self) -> int:
        return len(self.deviation_t)

    @classmethod
    def of(cls, presses: PressFields) -> StoredPresses:
        return stored(cls, presses)

    def presses(self) -> PressFields:
        return unstored(PressFields, self)


class StoredGeometry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """`LearnedGeometry` with the time at which it was learned. pose: position in m and axis, of each press."""

    utc: str
    place_m: Rows
    rotation_rad: Rows
    pose: tuple[tuple[float, float, float, float, float, float], ...]

    def __post_init__(self) -> None:
        possible.PLACE_M.require(chain(*self.place_m, *(one[:3] for one in self.pose)))
        possible.ROTATION_RAD.require(chain(*self.rotation_rad))
        possible.UNIT.require(chain(*(one[3:] for one in self.pose)))
        if len(self.place_m) != len(self.rotation_rad) or len(self.pose) > MOST_FIELDS:
            raise ValueError("such a geometry cannot come from presses")

    @property
    def sensors(self) -> int:
        return len(self.place_m)

    @classmethod
    def of(cls, learned: LearnedGeometry) -> StoredGeometry:
        return stored(cls, learned)

    def geometry(self) -> LearnedGeometry:
        return unstored(LearnedGeometry, self)


def stored(kind: type[Stored], facts: object, **others: float) -> Stored:
    """The file's form of `facts`, which has the same fields but for the time and `others`: arrays become tuples."""
    names = (name for name in kind.__struct_fields__ if name not in ("utc", *others))
    return kind(utc=now(), **{name: _plain(getattr(facts, name)) for name in names}, **others)


def unstored(kind: type[Facts], of_file: msgspec.Struct) -> Facts:
    """The inverse of `stored`."""
    values = {name: value for name, value in msgspec.structs.asdict(of_file).items() if name != "utc"}
    return kind(**{name: np.array(value) if isinstance(value, tuple) else value for name, value in values.items()})


def _plain(value: Any) -> Any:
    """Python's own numbers, in nested tuples."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    return tuple(map(_plain, value)) if isinstance(value, list) else value


def require_fields(*fields: Rows, sensors: int | None = None) -> None:
    """ValueError unless all are possible fields, of this many sensors."""
    if len(fields) > MOST_FIELDS:
        raise ValueError(f"{len(fields)} fields: no recording keeps more than {MOST_FIELDS}")
    for field in fields:
        possible.FIELD_T.require(chain(*field))
        if sensors is not None and len(field) != sensors:
            raise ValueError(f"a field of {len(field)} sensors among those of {sensors}")


def now() -> str:
    return datetime.now(timezone.utc).isoformat(timespec="seconds")
