"""Shared by emulated magnetometers: field, gains, a clock of their own, and conversions that end between accesses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from random import Random


class Magnetometer:
    """`clock_error` is relative; `gain` multiplies the data sheet's nominal gain; noise is one deviation."""

    address = 0
    sensitivity_per_k = 0.0  # relative, from that of 25 °C
    has_own_noise = False  # the noise that the chip's file states for its settings, instead of noise_gauss

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
        self._field_gauss = list(field_gauss)
        # The field in gauss at `time_s`; it replaces field_gauss. A chip averages over its measurement if its file
        # knows when that begins; otherwise it takes the field at its end.
        self.field_at: Callable[[float], Sequence[float]] | None = None
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
        self.converted_s = 0.0  # of the newest conversion
        self.power_on()

    @property
    def field_gauss(self) -> list[float]:
        return self._field_gauss

    @field_gauss.setter
    def field_gauss(self, field_gauss: Sequence[float]) -> None:
        self.exposed(self._field_gauss)
        self._field_gauss = list(field_gauss)

    def exposed(self, field_gauss: Sequence[float]) -> None:
        """This field was at the chip until now, whether or not it measured."""

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
        """The time from one conversion to the next; None after a single one."""
        raise NotImplementedError

    def field_during(self, begin_s: float, end_s: float) -> list[float]:
        """The mean field over this time, from five instants."""
        if self.field_at is None:
            return self.field_gauss
        instants = [begin_s + (end_s - begin_s) * part for part in (0.1, 0.3, 0.5, 0.7, 0.9)]
        return [sum(axis) / len(instants) for axis in zip(*map(self.field_at, instants), strict=True)]

    def own_noise_gauss(self) -> float:
        """One deviation at the present settings."""
        raise NotImplementedError(f"no source states the noise of {type(self).__name__}")

    def sensed_gauss(self, field_gauss: Sequence[float] | None = None) -> list[float]:
        """This field, or the field at the end of the conversion, with noise, gains and temperature."""
        if field_gauss is None:
            field_gauss = self.field_during(self.converted_s, self.converted_s)
        warmth = 1.0 + self.sensitivity_per_k * (self.temperature_c - 25.0)
        noise_gauss = self.own_noise_gauss() if self.has_own_noise else self.noise_gauss
        return [
            (field + self.random.gauss(0.0, noise_gauss) if noise_gauss else field) * gain * warmth
            for field, gain in zip(field_gauss, self.gain, strict=True)
        ]

    def feel(self, field_gauss: Sequence[float]) -> None:
        """From the next conversion on."""
        self.run()
        self.field_gauss = list(field_gauss)

    def begin(self, conversion_s: float, phase_s: float = 0.0) -> None:
        """phase_s: of a free-running chip; a single conversion has none."""
        self.next_conversion_s = self.time_s() + conversion_s * (1.0 + self.clock_error) + phase_s

    def run(self) -> None:
        """Catch up with the clock. Skips conversions that nobody could have read, except for the last."""
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
                ended_s += missed * period_s
                self.next_conversion_s = ended_s + period_s
            self.conversions += 1
            self.converted_s = ended_s
            self.convert()
