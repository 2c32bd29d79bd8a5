"""An HX711 on two pins: conversions 80 times a second, read bit by bit (Avia Semiconductor data sheet)."""

from __future__ import annotations

from collections.abc import Callable

PERIOD_S = 1 / 80
PULSES = 25
POWER_DOWN_S = 60e-6
SHORTEST_LEVEL_S = 0.2e-6


class Hx711:
    """`counts`: the load cell's present value, None while nothing is plugged in. now_s: the board's time."""

    def __init__(self, now_s: Callable[[], float], complain: Callable[[str], None]) -> None:
        self.counts: int | None = None
        self._now_s = now_s
        self._complain = complain
        self._ready_s = PERIOD_S
        self._clock = False
        self._changed_s = 0.0
        self._pulses = 0
        self._bits = 0

    def data_level(self) -> bool:
        if self.counts is None:
            return True
        if self._pulses == 0:
            return self._now_s() < self._ready_s
        return self._pulses >= PULSES or bool(self._bits >> (PULSES - 1 - self._pulses) & 1)

    def clock_driven(self, high: bool | None) -> None:
        high, now_s = bool(high), self._now_s()
        if high == self._clock:
            return
        held_s, self._clock, self._changed_s = now_s - self._changed_s, high, now_s
        if self.counts is None:
            return
        if held_s < SHORTEST_LEVEL_S:
            self._complain(f"PD_SCK changed after {held_s * 1e6:.2f} µs")
        if high:
            self._rise(now_s)
        elif held_s > POWER_DOWN_S:
            self._complain(f"PD_SCK was high for {held_s * 1e6:.0f} µs: powered down")
        elif self._pulses == PULSES:
            self._pulses = 0

    def _rise(self, now_s: float) -> None:
        if self._pulses == 0:
            if now_s < self._ready_s:
                self._complain("PD_SCK rose before a conversion was ready")
                return
            assert self.counts is not None
            self._bits = self.counts & 0xFFFFFF
        self._pulses += 1
        if self._pulses == PULSES:
            self._ready_s += (int((now_s - self._ready_s) / PERIOD_S) + 1) * PERIOD_S
