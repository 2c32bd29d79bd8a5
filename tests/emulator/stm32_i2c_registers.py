"""The I2C registers of the STM32F103 (RM0008 26.6): offsets, bits, and the timing that they select."""

from __future__ import annotations

from enum import Enum, auto
from typing import NamedTuple

from emulator.stm32_engine import TICKS_PER_S

CR1, CR2, OAR1, OAR2, DR, SR1, SR2, CCR, TRISE = range(0, 0x24, 4)
PE, START, STOP, ACK, POS, SWRST = (1 << bit for bit in (0, 8, 9, 10, 11, 15))
SB, ADDR, BTF, STOPF, RXNE, TXE, BERR, ARLO, AF = (1 << bit for bit in (0, 1, 2, 4, 6, 7, 8, 9, 10))
MSL, BUSY, TRA = 1, 2, 4
ITERREN, ITEVTEN, ITBUFEN = 1 << 8, 1 << 9, 1 << 10
ERRORS = BERR | ARLO | AF
FAST, DUTY = 1 << 15, 1 << 14
FAST_MAX_HZ = 400_000
BYTE_BITS = 9  # eight and the acknowledge


class Phase(Enum):
    """The state of a port; in the AT_ phases it holds SCL low and waits for the software."""

    IDLE = auto()
    STARTING = auto()
    STOPPING = auto()
    ADDRESSING = auto()
    SENDING = auto()
    RECEIVING = auto()
    AT_SB = auto()
    AT_ADDR = auto()
    AT_BTF = auto()
    AT_NACK = auto()


class Timing(NamedTuple):
    """The timing of CR2, CCR and TRISE on a peripheral clock of `apb1_hz`."""

    cr2: int
    ccr: int
    trise: int
    apb1_hz: int

    @property
    def bit_ticks(self) -> int:
        cycles = max(1, self.ccr & 0xFFF) * ((25 if self.ccr & DUTY else 3) if self.ccr & FAST else 2)
        return cycles * TICKS_PER_S // self.apb1_hz

    def mistakes(self) -> list[str]:
        apb1_mhz, frequency = self.apb1_hz // 1_000_000, self.cr2 & 0x3F
        rise_limit_ns = 300 if self.ccr & FAST else 1000
        found = []
        if frequency != apb1_mhz:
            found.append(f"FREQ is {frequency}, APB1 runs at {apb1_mhz} MHz")
        if self.trise != apb1_mhz * rise_limit_ns // 1000 + 1:
            found.append(f"TRISE is {self.trise} (RM0008 26.6.9)")
        if self.bit_ticks * FAST_MAX_HZ < TICKS_PER_S:
            found.append(f"{TICKS_PER_S // self.bit_ticks} Hz, {FAST_MAX_HZ} are allowed")
        return found


class BusyErratum:
    """ES096: BUSY may stay set although both lines are high, until both were moved by hand and SWRST was given."""

    def __init__(self) -> None:
        self.latched = False
        self._seen: set[tuple[str, bool]] = set()

    def latch(self) -> None:
        self.latched = True
        self._seen.clear()

    def enabled(self) -> None:
        self._seen.clear()

    def moved(self, line: str, high: bool) -> None:
        self._seen.add((line, high))

    def software_reset(self) -> None:
        if len(self._seen) == 4:  # both lines, both ways
            self.latched = False
