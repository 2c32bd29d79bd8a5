"""The running self-tests of a device and their results, by pad."""

from __future__ import annotations

from fmfts.sensor.chips import Chip
from fmfts.sensor.chips.selftest import selftest_facts
from fmfts.sensor.source import CannotError
from fmfts.sensor.wire import faults
from fmfts.sensor.wire.packets import BOARD_SENSORS, HelloPad, Selftest

TIME_LIMIT_NS = 3_000_000_000  # for as many sensors as a board carries
A_SENSOR_NS = 200_000_000  # for each sensor more


class Selftests:
    """`result` is a pad's last result; None while a self-test runs, or before the first."""

    def __init__(self) -> None:
        self._results: dict[int, dict[str, object]] = {}
        self._deadlines_ns: dict[int, int] = {}
        self._limits_ns: dict[int, int] = {}

    @property
    def due_ns(self) -> int | None:
        return min(self._deadlines_ns.values(), default=None)

    def begin(self, pad_index: int, name: str, sensors: int, now_ns: int) -> None:
        if pad_index in self._deadlines_ns:
            raise CannotError(f"pad {name!r}: a self-test is running already: wait for its result")
        self._results.pop(pad_index, None)
        self._limits_ns[pad_index] = TIME_LIMIT_NS + max(0, sensors - BOARD_SENSORS) * A_SENSOR_NS
        self._deadlines_ns[pad_index] = now_ns + self._limits_ns[pad_index]

    def awaits(self, pad_index: int) -> bool:
        return pad_index in self._deadlines_ns

    def finish(self, selftest: Selftest, pad: HelloPad, chip: Chip) -> None:
        """Judge the measurements of all sensors of `pad`, and keep that as the result."""
        sensors = selftest.sensors
        reasons = [faults.no_measurement(pad, index, one.state, chip) for index, one in enumerate(sensors)]
        facts = selftest_facts(
            chip, selftest.gain_code, [one.positive for one in sensors], [one.negative for one in sensors], reasons
        )
        self._end(selftest.pad_index, facts)

    def fail(self, pad_index: int, error: str) -> None:
        self._end(pad_index, {"passed": False, "error": error})

    def fail_all(self, error: str) -> None:
        for pad_index in list(self._deadlines_ns):
            self.fail(pad_index, error)

    def give_up(self, now_ns: int) -> None:
        """Fail the self-tests whose time limit is over."""
        for pad_index in [index for index, deadline_ns in self._deadlines_ns.items() if now_ns >= deadline_ns]:
            self.fail(
                pad_index, f"no result within {self._limits_ns[pad_index] / 1e9:.0f} s: is the device still connected?"
            )

    def result(self, pad_index: int) -> dict[str, object] | None:
        return self._results.get(pad_index)

    def _end(self, pad_index: int, facts: dict[str, object]) -> None:
        self._results[pad_index] = facts
        self._deadlines_ns.pop(pad_index, None)
