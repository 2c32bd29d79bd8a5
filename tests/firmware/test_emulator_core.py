"""The emulated core and pins do what ARM's and ST's manuals say, whatever the firmware makes of it: ARMv7-M (ARM DDI
0403E), PM0056 and RM0008."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from emulator.stm32_core import FIRST_IRQ, HARD_FAULT, NMI, SYSTICK, CoreRegisters
from emulator.stm32_gpio import BSRR, CRL, IDR, Gpio

IRQ = FIRST_IRQ + 31  # I2C1's events
INPUT_FLOATING, INPUT_PULLED, PUSH_PULL, OPEN_DRAIN = 0b0100, 0b1000, 0b0011, 0b0111  # RM0008, table 20
PIN = 3


class Core:
    """NVIC and SCB on an engine that only notes which handlers it enters."""

    def __init__(self) -> None:
        self.entered: list[int] = []
        self.engine = SimpleNamespace(
            primask=False, vector_table=0, enter_exception=self.entered.append, leave_exception=lambda: None
        )
        clock = SimpleNamespace(now=0, ticks_per_cycle=1, icsr=0)
        machine: Any = SimpleNamespace(engine=self.engine, clock=clock, peripherals={}, now=0, attend=lambda: None)
        self.registers = CoreRegisters(machine)
        self.registers.write(0x100, 1 << 31)  # NVIC_ISER0

    def take(self, *pending: int) -> list[int]:
        """The handlers that it enters for these, one within the other."""
        self.entered.clear()
        for number in pending:
            self.registers.pend(number)
        while self.registers.take_interrupt():
            pass
        return list(self.entered)


@pytest.mark.parametrize("number", [IRQ, SYSTICK])
def test_primask_holds_back_what_has_a_priority_until_it_is_cleared(number: int) -> None:
    """PM0056 2.1.3: it prevents the activation of all exceptions with configurable priority."""
    core = Core()
    core.engine.primask = True
    assert core.take(number) == []
    assert core.registers.waiting(), "a WFI ends nevertheless (ARMv7-M B1.5.19)"
    core.engine.primask = False
    assert core.take() == [number], "it was held back, not lost"
    assert not core.registers.waiting()


@pytest.mark.parametrize("number", [NMI, HARD_FAULT])
def test_primask_holds_back_no_fault(number: int) -> None:
    """ARMv7-M B1.4.3: it raises the execution priority to 0, and these have -2 and -1."""
    core = Core()
    core.engine.primask = True
    assert core.take(number) == [number]


def test_handler_is_interrupted_by_a_smaller_priority_alone() -> None:
    core = Core()
    core.registers.write(0x400 + 28, 0x50 << 24)  # NVIC_IPR7: interrupt 31
    core.registers.write(0xD20, 0x50 << 24)  # SHPR3: SysTick
    assert core.take(SYSTICK) == [SYSTICK]
    assert core.take(IRQ) == [], "of equal priority"
    core.registers.leave_interrupt()
    assert core.take() == [IRQ]
    core.registers.write(0xD20, 0x40 << 24)
    assert core.take(SYSTICK) == [SYSTICK], "within the other's handler"


@pytest.mark.parametrize(
    ("mode", "output", "level"),
    [(INPUT_PULLED, 1, 1), (INPUT_PULLED, 0, 0), (PUSH_PULL, 1, 1), (PUSH_PULL, 0, 0), (OPEN_DRAIN, 0, 0)],
)
def test_pin_with_nothing_wired_to_it_reads_what_pulls_or_drives_it(mode: int, output: int, level: int) -> None:
    """RM0008 9.1.7 and 9.1.8, and table 20: ODR chooses an input's pull-up or pull-down."""
    port = Gpio()
    port.write(CRL, mode << 4 * PIN)
    port.write(BSRR, 1 << PIN + (0 if output else 16))
    assert port.read(IDR) >> PIN & 1 == level


def test_pin_that_is_wired_reads_the_wire() -> None:
    port, level = Gpio(), [False]
    port.wire(PIN, lambda: level[0], lambda _: None)
    port.write(CRL, INPUT_PULLED << 4 * PIN)
    port.write(BSRR, 1 << PIN)
    assert port.read(IDR) >> PIN & 1 == 0
    level[0] = True
    assert port.read(IDR) >> PIN & 1 == 1
