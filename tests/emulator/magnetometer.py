"""What emulated magnetometers share: field, gains, a clock of their own, conversions that end while nobody looks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from random import Random


class Magnetometer:
    """`clock_error` is relative; `gain` multiplies what the data sheet calls nominal; noise is one deviation."""

    address = 0
    sensitivity_per_k = 0.0  # relative, from that of 25 °C

    def __init__(
        self,
        time_s: Callable[[], float],
        field_gauss: Sequence[float] = (0.0, 0.0, 0.0),
        clock_error: float = 0.0,
        phase_s: float = 0.0,
        address: int | None = None,
        noise_gauss: float = 0.0,
        seed: int = 1,
    ) -> None:
        self.time_s = time_s
        self.field_gauss = list(field_gauss)
        self.clock_error = clock_error
        self.phase_s = phase_s
        self.address = self.address if address is None else address
        self.noise_gauss = noise_gauss
        self.random = Random(seed)
        self.gain = [1.0, 1.0, 1.0]
        self.temperature_c = 25.0
        self.absent = False
        self.frozen = False  # a clock that has stopped
        self.conversions = 0
        self.next_conversion_s: float | None = None
        self.power_on()

    def power_on(self) -> None:
        raise NotImplementedError

    def started(self, reading: bool) -> None:
        """It was addressed."""
        raise NotImplementedError

    def put(self, byte: int) -> None:
        """A byte was written to it."""
        raise NotImplementedError

    def get(self) -> int:
        """A byte is read from it."""
        raise NotImplementedError

    def write(self, data: bytes) -> None:
        self.started(reading=False)
        for byte in data:
            self.put(byte)

    def read(self, count: int) -> bytes:
        self.started(reading=True)
        return bytes(self.get() for _ in range(count))

    def convert(self) -> None:
        """A conversion ended: its result goes to the output."""
        raise NotImplementedError

    def following_s(self) -> float | None:
        """The time from one conversion to the next; None where one was all."""
        raise NotImplementedError

    def sensed_gauss(self) -> list[float]:
        warmth = 1.0 + self.sensitivity_per_k * (self.temperature_c - 25.0)
        return [
            (field + self.random.gauss(0.0, self.noise_gauss) if self.noise_gauss else field) * gain * warmth
            for field, gain in zip(self.field_gauss, self.gain, strict=True)
        ]

    def feel(self, field_gauss: Sequence[float]) -> None:
        """From the next conversion on."""
        self.run()
        self.field_gauss = list(field_gauss)

    def begin(self, conversion_s: float) -> None:
        self.next_conversion_s = self.time_s() + conversion_s * (1.0 + self.clock_error) + self.phase_s

    def run(self) -> None:
        """Catch up with the clock. Of conversions that nobody could have seen only the last is made."""
        if self.next_conversion_s is None or self.frozen:
            return
        now_s = self.time_s()
        while self.next_conversion_s is not None and self.next_conversion_s <= now_s:
            ended_s, following_s = self.next_conversion_s, self.following_s()
            if following_s is None:
                self.next_conversion_s = None
            else:
                period_s = following_s * (1.0 + self.clock_error)
                missed = max(0, int((now_s - ended_s) / period_s) - 1)
                self.conversions += missed
                self.next_conversion_s = ended_s + (missed + 1) * period_s
            self.conversions += 1
            self.convert()
