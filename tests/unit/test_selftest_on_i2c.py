"""The self-test of a chip on an I2C bus waits for a sample, and looks for it once more when the time for it is over."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from fmfts.sensor.chips.mmc5983ma import MMC5983MA
from fmfts.sensor.i2c import selftest

SAMPLE = b"\x01\x02\x03\x04\x05\x06"


class Stopwatch:
    """The time of `selftest`: it passes only while something is waited for, or while the computer stands still."""

    def __init__(self) -> None:
        self.now_s = 10.0

    def monotonic(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


def pad_that_is_ready_at(stopwatch: Stopwatch, ready_s: float, stands_still_s: float = 0.0) -> SimpleNamespace:
    """stands_still_s: for so long nothing runs after the first look."""
    looks: list[float] = []

    def sample(_: object) -> tuple[bool, bytes | None]:
        looks.append(stopwatch.now_s)
        is_ready = stopwatch.now_s >= ready_s
        stopwatch.now_s += stands_still_s if len(looks) == 1 else 0.0
        return is_ready, SAMPLE if is_ready else None

    return SimpleNamespace(chip=SimpleNamespace(driver=SimpleNamespace(sample=sample), set_reset=None))


@pytest.mark.parametrize(
    ("ready_after_s", "stands_still_s", "found"),
    [(0.0, 0.0, SAMPLE), (0.05, 0.0, SAMPLE), (0.05, 1.0, SAMPLE), (9.0, 0.0, None), (9.0, 1.0, None)],
)
def test_sample_that_came_while_computer_stood_still_is_found(
    monkeypatch: pytest.MonkeyPatch, ready_after_s: float, stands_still_s: float, found: bytes | None
) -> None:
    stopwatch = Stopwatch()
    monkeypatch.setattr(selftest, "time", stopwatch)
    pad = pad_that_is_ready_at(stopwatch, stopwatch.now_s + ready_after_s, stands_still_s)
    assert selftest._next(pad, SimpleNamespace(wires=None)) == found  # type: ignore[arg-type]


class Measuring:
    """The wires of an MMC5983MA whose measurement ends after so long. Each message takes 0.1 ms."""

    def __init__(self, stopwatch: Stopwatch, ends_after_s: float) -> None:
        self._stopwatch = stopwatch
        self._ends_s = stopwatch.now_s + ends_after_s
        self._has_ended = self._is_announced = False

    def _pass_time(self) -> None:
        self._stopwatch.now_s += 1e-4
        if self._stopwatch.now_s >= self._ends_s and not self._has_ended:
            self._has_ended = self._is_announced = True

    def write(self, data: bytes) -> None:
        """Clears what announces the measurement."""
        self._pass_time()
        self._is_announced = False

    def exchange(self, data: bytes, count: int) -> bytes:
        self._pass_time()
        self._pass_time()
        return bytes((self._is_announced,)) if count == 1 else SAMPLE


@pytest.mark.parametrize("ends_after_s", [0.5e-4, 1.5e-4, 2.5e-4, 3.5e-4, 4.5e-4, 22.5e-4])
def test_measurement_that_ends_while_chip_is_asked_for_it_is_found(
    monkeypatch: pytest.MonkeyPatch, ends_after_s: float
) -> None:
    stopwatch = Stopwatch()
    monkeypatch.setattr(selftest, "time", stopwatch)
    wires = Measuring(stopwatch, ends_after_s)
    pad = SimpleNamespace(chip=MMC5983MA)
    assert selftest._next(pad, SimpleNamespace(wires=wires)) == SAMPLE  # type: ignore[arg-type]
