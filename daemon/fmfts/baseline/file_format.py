"""Recordings in the form of a baseline's file, and the conversion in both directions."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

import msgspec
import numpy as np

from fmfts.baseline.recording import Recording
from fmfts.baseline.refine import PressFields
from fmfts.baseline.sensitivity import Sensitivity
from fmfts.baseline.turn import Turn
from fmfts.pad import Tolerance

Rows = tuple[tuple[float, float, float], ...]


class StoredRecording(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A `Recording` with the time at which it was made."""

    utc: str
    mean_t: Rows
    noise_t: Rows
    samples: tuple[int, ...]
    gain_code: int
    temperature_c: float | None
    duration_s: float

    @classmethod
    def of(cls, recording: Recording) -> StoredRecording:
        return cls(
            utc=_now(),
            mean_t=_rows(recording.mean_t),
            noise_t=_rows(recording.noise_t),
            samples=tuple(int(count) for count in recording.samples),
            gain_code=recording.gain_code,
            temperature_c=recording.temperature_c,
            duration_s=recording.duration_s,
        )

    def recording(self) -> Recording:
        return Recording(
            mean_t=np.array(self.mean_t),
            noise_t=np.array(self.noise_t),
            samples=np.array(self.samples),
            gain_code=self.gain_code,
            temperature_c=self.temperature_c,
            duration_s=self.duration_s,
        )


class StoredGains(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The gains that a self-test measured, each with the same deviation, and the time at which it was made."""

    utc: str
    gain: Rows
    deviation: float

    def __post_init__(self) -> None:
        if not (all(0.1 < gain < 10.0 for row in self.gain for gain in row) and 0.0 < self.deviation < 1.0):
            raise ValueError("no chip has such gains")

    @classmethod
    def of(cls, facts: Mapping[str, Any]) -> StoredGains:
        """From the facts of a self-test that passed (`selftest_facts` in sensor/chips/selftest.py)."""
        gain = np.array([sensor["gain_factor"] for sensor in facts["sensors"]], dtype=float)
        return cls(_now(), _rows(gain), facts["gain_factor_sd"])

    def sensitivity(self, tolerance: Tolerance) -> Sensitivity:
        return Sensitivity.tested(np.array(self.gain), self.deviation, tolerance)


class StoredTurn(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A `Turn` with the time at which it was made."""

    utc: str
    field_t: tuple[Rows, ...]
    deviation_t: Rows
    time_s: tuple[float, ...]

    @classmethod
    def of(cls, turn: Turn) -> StoredTurn:
        times = tuple(float(time) for time in turn.time_s)
        return cls(_now(), tuple(_rows(field) for field in turn.field_t), _rows(turn.deviation_t), times)

    def turn(self) -> Turn:
        return Turn(np.array(self.field_t), np.array(self.deviation_t), np.array(self.time_s))


class StoredPresses(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """`PressFields` with the time at which they were made."""

    utc: str
    field_t: tuple[Rows, ...]
    deviation_t: Rows
    rest_t: Rows

    @classmethod
    def of(cls, presses: PressFields) -> StoredPresses:
        fields = tuple(_rows(field) for field in presses.field_t)
        return cls(_now(), fields, _rows(presses.deviation_t), _rows(presses.rest_t))

    def presses(self) -> PressFields:
        return PressFields(np.array(self.field_t), np.array(self.deviation_t), np.array(self.rest_t))


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _rows(array: np.ndarray) -> Rows:
    return tuple((float(x), float(y), float(z)) for x, y, z in array)
