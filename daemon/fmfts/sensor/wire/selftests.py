"""The running self-tests of a device and their results, by pad."""

from __future__ import annotations

from fmfts.sensor.chips import Chip
from fmfts.sensor.chips.selftest import selftest_facts
from fmfts.sensor.source import CannotError
from fmfts.sensor.wire import faults
from fmfts.sensor.wire.packets import HelloPad, Selftest

# A board takes a third of a second, sixteen chips on an I2C bus four seconds. A busy computer, which reads that bus
# itself, takes several times as long.
LIMIT_S = 20


class Selftests:
    """`result` is a pad's last result; None while a self-test runs, or before the first."""

    def __init__(self) -> None:
        self._results: dict[int, dict[str, object]] = {}
        self._deadlines_ns: dict[int, int] = {}

    @property
    def due_ns(self) -> int | None:
        return min(self._deadlines_ns.values(), default=None)

    def begin(self, pad_index: int, name: str, now_ns: int) -> None:
        if pad_index in self._deadlines_ns:
            raise CannotError(f"pad {name!r}: a self-test is running already: wait for its result")
        self._results.pop(pad_index, None)
        self._deadlines_ns[pad_index] = now_ns + LIMIT_S * 1_000_000_000

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
                pad_index,
                f"no result within {LIMIT_S} s: it was lost on the way, or this computer is overloaded; try again",
            )

    def result(self, pad_index: int) -> dict[str, object] | None:
        return self._results.get(pad_index)

    def _end(self, pad_index: int, facts: dict[str, object]) -> None:
        self._results[pad_index] = facts
        self._deadlines_ns.pop(pad_index, None)
