"""The chip: CPU, interrupt controller and peripherals on one clock, run for a requested time.

Time is counted in ticks of 1/576 µs. It advances with the instructions executed and jumps to the next event where the
CPU only waits: in WFI, and when a peripheral with an event pending is polled again and again.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any, Protocol

from unicorn import UcError

from emulator.stm32_core import CoreRegisters
from emulator.stm32_engine import NEVER, SYSTEM_MEMORY, TICKS_PER_S, Engine, read_elf

HARD_FAULT = 3
FLASH_SIZE_KIB, UNIQUE_ID = SYSTEM_MEMORY + 0x7E0, SYSTEM_MEMORY + 0x7E8  # RM0008 30.1, 30.2
NOT_POLLED: tuple[object, int] = (None, 0)
POLL_TICKS = 5 * TICKS_PER_S // 1_000_000  # two reads of a register within 5 µs are a poll


class Peripheral(Protocol):
    """A block of registers at offsets from its base; reset by the system's reset and by its bit in RCC."""

    def read(self, offset: int) -> int: ...
    def write(self, offset: int, value: int) -> None: ...
    def reset(self) -> None: ...


class Event:
    """Something that will happen at a tick unless it is cancelled."""

    __slots__ = ("action", "tick")

    def __init__(self, tick: int, action: Callable[[], None]) -> None:
        self.tick = tick
        self.action: Callable[[], None] | None = action

    def cancel(self) -> None:
        self.action = None


class Machine:
    """Flash and RAM, registers, interrupts and time. `complaints` lists mistakes that a real chip would not forgive."""

    def __init__(self, elf: Path, uid: bytes) -> None:
        self.engine = Engine(self._read, self._write)
        self.clock = self.engine.clock
        self.complaints: list[str] = []
        self._events: list[tuple[int, int, Event]] = []
        self._order = count()
        self._until = 0
        self._sleeping = False
        self._attend = False
        self._masked_for = 1
        self._polled = NOT_POLLED
        self._reset_requested: str | None = None
        self.on_reset: Callable[[str], None] = lambda cause: None
        self.peripherals: dict[int, Peripheral] = {}
        self.core = CoreRegisters(self)
        self.engine.load([*read_elf(elf), (FLASH_SIZE_KIB, (64).to_bytes(2, "little")), (UNIQUE_ID, uid)])

    @property
    def now(self) -> int:
        return self.clock.now

    @property
    def now_s(self) -> float:
        return self.clock.now / TICKS_PER_S

    def complain(self, what: str) -> None:
        """Note a mistake of the firmware, once, with its place."""
        where = f"{what} (pc 0x{self.engine.pc:08x}, {self.now_s:.6f} s)"
        if not any(complaint.startswith(what) for complaint in self.complaints):
            self.complaints.append(where)

    # Time

    def after(self, ticks: int, action: Callable[[], None]) -> Event:
        event = Event(self.clock.now + ticks, action)
        heapq.heappush(self._events, (event.tick, next(self._order), event))
        self.clock.due = self._events[0][0]
        self.clock.deadline = min(self.clock.deadline, self.clock.due)
        return event

    def _run_due(self) -> None:
        while self.clock.due <= self.clock.now:
            action = heapq.heappop(self._events)[2].action
            if action:
                action()
            self.clock.due = self._events[0][0] if self._events else NEVER
        if not self._attend:
            self.clock.deadline = min(self.clock.due, self._until)

    def attend(self) -> None:
        """Check interrupts before the next block: one may have become pending."""
        self._attend = True
        self.clock.deadline = 0

    def polled(self, register: object) -> None:
        """A register was read while its bus event is on its way: a second read in a row waits for it."""
        before, tick = self._polled
        if before == register and self.clock.now - tick < POLL_TICKS and not self._attend:
            self.clock.now = max(self.clock.now, min(self.clock.due, self._until))
            self._run_due()
        self._polled = (register, self.clock.now)

    # Registers

    def _read(self, address: int, width: int) -> int:
        if self.clock.now >= self.clock.due:
            self._run_due()
        return self._block(address, width).read(address & 0x3FF)

    def _write(self, address: int, width: int, value: int) -> None:
        if self.clock.now >= self.clock.due:
            self._run_due()
        self._polled = NOT_POLLED  # a program that writes does more than wait
        self._block(address, width).write(address & 0x3FF, value)

    def _block(self, address: int, width: int) -> Any:
        peripheral = self.peripherals.get(address >> 10)
        if peripheral is None:
            raise NotImplementedError(f"no model of the register at 0x{address:08x} (pc 0x{self.engine.pc:08x})")
        if width == 1:
            self.complain(f"byte access to 0x{address:08x}: registers take words or half-words (RM0008 2.3)")
        return peripheral

    # Running

    def reset(self, cause: str) -> None:
        """Ask for a reset; it happens before the next block."""
        self._reset_requested = cause
        self.attend()

    def _reset_now(self, cause: str) -> None:
        self._reset_requested = None
        self._sleeping = False
        for peripheral in self.peripherals.values():
            peripheral.reset()
        self.on_reset(cause)
        self.core.reset()
        self.engine.reset()

    def run_until(self, tick: int) -> None:
        """Run the firmware until this tick (a block later at most)."""
        self._until = tick
        while self.clock.now < tick:
            self._run_due()
            self._attend = False
            if self._reset_requested:
                self._reset_now(self._reset_requested)
            if self.core.take_interrupt():
                self._sleeping = False
            masked = self.core.waiting()
            if self._sleeping and not masked:
                self.clock.now = max(self.clock.now, min(self.clock.due, tick))
                continue
            self._sleeping = False
            # No hook tells when PRIMASK is cleared: look again soon, and less often the longer it lasts.
            self._attend = masked
            self._masked_for = 2 * self._masked_for if masked else 1
            self.clock.deadline = min(self.clock.due if not masked else self.clock.now + self._masked_for, tick)
            self._run_engine()

    def jump(self, address: int) -> None:
        """Send the main program somewhere else, once no handler runs; it also wakes up."""
        while self.core.in_handler:
            self.run_until(self.clock.now + 1)
        self._sleeping = False
        self.engine.jump(address)

    def _run_engine(self) -> None:
        try:
            stopped = self.engine.run()
        except UcError as error:
            self.complain(str(error))
            self._fault()
            return
        if self.engine.exception is not None:
            self.complain(f"CPU exception {self.engine.exception} at 0x{self.engine.faulting_pc:08x}")
            self.engine.jump(self.engine.faulting_pc)
            self._fault()
        elif not stopped:
            self._sleeping = True
        elif self.engine.in_trap:
            self.core.leave_interrupt()

    def _fault(self) -> None:
        self.core.pend(HARD_FAULT)
