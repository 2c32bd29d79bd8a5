"""The parts that ARM designed: interrupt controller, system control block, SysTick, cycle counter (ARMv7-M B3)."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from emulator.stm32_machine import Event, Machine

PAGE = 0xE000_E000 >> 10
DWT_PAGE = 0xE000_1000 >> 10
NMI, HARD_FAULT, PENDSV, SYSTICK, FIRST_IRQ = 2, 3, 14, 15, 16
FIXED_PRIORITY = {NMI: -2, HARD_FAULT: -1}
THREAD = 256  # lower than any exception
IRQS = 43
CPUID = 0x411F_C231  # Cortex-M3 r1p1
AIRCR_KEY, AIRCR_READS = 0x05FA, 0xFA05
ENABLE, TICKINT, CLKSOURCE, COUNTFLAG = 1, 2, 4, 1 << 16


class SysTick:
    """Counts LOAD … 0; `_zero` is the tick at which it reaches 0."""

    def __init__(self, core: CoreRegisters) -> None:
        self._core, self._machine, self._clock = core, core.machine, core.machine.clock
        self._event: Event | None = None
        self.reset()

    def reset(self) -> None:
        self.control = self.load = self._frozen = self._zero = 0
        self._cancel()
        self._show()

    def _cancel(self) -> None:
        if self._event:
            self._event.cancel()
        self._event = None

    def _ticks_per_count(self) -> int:
        return self._clock.ticks_per_cycle * (1 if self.control & CLKSOURCE else 8)

    def value(self) -> int:
        if not self._event:
            return self._frozen
        counts = -(-(self._zero - self._clock.now) // self._ticks_per_count())
        return counts if counts <= self.load else 0

    def _count_from(self, counts: int) -> None:
        self._cancel()
        if self.control & ENABLE and self.load:
            self._zero = self._machine.now + counts * self._ticks_per_count()
            self._event = self._machine.after(counts * self._ticks_per_count(), self._reached_zero)
        self._show()

    def _show(self) -> None:
        """Passes values to the C side, which answers the firmware's reads."""
        self._clock.systick_runs = self._event is not None and bool(self.control & CLKSOURCE)
        self._clock.systick_load, self._clock.systick_zero = self.load, self._zero

    def _reached_zero(self) -> None:
        self.control |= COUNTFLAG
        if self.control & TICKINT:
            self._core.pend(SYSTICK)
        self._zero += (self.load + 1) * self._ticks_per_count()
        self._event = self._machine.after(max(self._zero - self._machine.now, 0), self._reached_zero)
        self._show()

    def core_clock_changes(self) -> int:
        """Call it before; returns the count that continues after."""
        return self.value()

    def core_clock_changed(self, value: int) -> None:
        if self._event:
            self._count_from(value or self.load + 1)

    def read(self, offset: int) -> int:
        if offset == 0x10:
            value = self.control
            self.control &= ~COUNTFLAG
            return value
        return {0x14: self.load, 0x18: self.value()}.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        counts = self.value()
        if offset == 0x10:
            self.control = self.control & COUNTFLAG | value & 7
            self._frozen = counts
            self._count_from(counts or self.load + 1)
        elif offset == 0x14:
            self.load = value & 0xFFFFFF
            self._show()
        elif offset == 0x18:
            self.control &= ~COUNTFLAG
            self._frozen = 0
            self._count_from(self.load + 1)


class CycleCounter:
    """DWT.CYCCNT, read only while it is enabled."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self.reset()

    def reset(self) -> None:
        self._control = self._zero_at = 0

    def read(self, offset: int) -> int:
        cycles = (self._machine.now - self._zero_at) // self._machine.clock.ticks_per_cycle
        return {0: self._control, 4: cycles & 0xFFFFFFFF if self._control & 1 else 0}.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        if offset == 0:
            self._control = value
        elif offset == 4:
            self._zero_at = self._machine.now - value * self._machine.clock.ticks_per_cycle


class CoreRegisters:
    """NVIC and SCB. Exceptions have their ARMv7-M numbers, interrupt i is exception 16 + i."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.systick = SysTick(self)
        machine.peripherals[DWT_PAGE] = CycleCounter(machine)
        for kilobyte in range(4):
            machine.peripherals[PAGE + kilobyte] = _Kilobyte(self, kilobyte << 10)
        self.reset()

    def reset(self) -> None:
        self.systick.reset()
        self._pending = self._lines = 0
        self._enabled = (1 << FIRST_IRQ) - 1
        self._priority = bytearray(FIRST_IRQ + IRQS)
        self._active: list[int] = []
        self.entered = dict.fromkeys(range(FIRST_IRQ + IRQS), 0)  # how often, since reset
        self.machine.engine.vector_table = 0
        self._show()

    def pend(self, number: int) -> None:
        self._pending |= 1 << number
        self._show()
        self.machine.attend()

    def line(self, irq: int, level: bool) -> None:
        """A peripheral's interrupt request; it pends again if it is still up after its handler."""
        bit = 1 << FIRST_IRQ + irq
        if not level:
            self._lines &= ~bit
        elif not self._lines & bit:
            self._lines |= bit
            self.pend(FIRST_IRQ + irq)

    def _urgency(self, number: int) -> int:
        return FIXED_PRIORITY.get(number, self._priority[number] & 0xF0)

    def _next(self) -> int | None:
        """The pending exception that may interrupt the present one, whatever PRIMASK says."""
        candidates = self._pending & self._enabled
        best, running = None, min((self._urgency(number) for number in self._active), default=THREAD)
        while candidates:
            number = (candidates & -candidates).bit_length() - 1
            candidates &= candidates - 1
            if self._urgency(number) < running:
                best, running = number, self._urgency(number)
        return best

    def waiting(self) -> bool:
        """True if only PRIMASK blocks an interrupt, which also ends a WFI."""
        return bool(self._pending & self._enabled) and self._next() is not None

    @property
    def in_handler(self) -> bool:
        return bool(self._active)

    def take_interrupt(self) -> bool:
        """Enter the handler of the most urgent exception, if there is one."""
        number = self._next() if self._pending & self._enabled else None
        if number is None or (number not in FIXED_PRIORITY and self.machine.engine.primask):
            return False
        self._pending &= ~(1 << number)
        self._active.append(number)
        self.entered[number] += 1
        self._show()
        self.machine.engine.enter_exception(number)
        return True

    def leave_interrupt(self) -> None:
        number = self._active.pop()
        self._pending |= self._lines & 1 << number
        self._show()
        self.machine.engine.leave_exception()

    def read(self, offset: int) -> int:
        if 0x10 <= offset < 0x20:
            return self.systick.read(offset)
        if 0x100 <= offset < 0x300:
            bits = self._enabled if offset < 0x200 else self._pending
            return bits >> FIRST_IRQ + 32 * (offset >> 2 & 0x1F) & 0xFFFFFFFF
        if 0x400 <= offset < 0x400 + IRQS:
            return int.from_bytes(self._priority[FIRST_IRQ + offset - 0x400 :][:4], "little")
        if 0xD18 <= offset < 0xD24:
            return int.from_bytes(self._priority[4 + offset - 0xD18 :][:4], "little")
        vector = self.machine.engine.vector_table
        return {0xD00: CPUID, 0xD04: self.machine.clock.icsr, 0xD08: vector, 0xD0C: AIRCR_READS << 16}.get(offset, 0)

    def _show(self) -> None:
        """Passes ICSR to the C side, which answers the firmware's reads."""
        active = self._active[-1] if self._active else 0
        pending = (self._pending >> SYSTICK & 1) << 26 | (self._pending >> PENDSV & 1) << 28
        self.machine.clock.icsr = active | pending

    def write(self, offset: int, value: int) -> None:
        if 0x10 <= offset < 0x20:
            self.systick.write(offset, value)
        elif 0x100 <= offset < 0x300:
            self._write_irq_bits(offset, value)
        elif 0x400 <= offset < 0x400 + IRQS:
            self._write_priorities(FIRST_IRQ + offset - 0x400, value)
        elif 0xD18 <= offset < 0xD24:
            self._write_priorities(4 + offset - 0xD18, value)
        elif offset == 0xD04:
            self._pending |= (value >> 26 & 1) << SYSTICK | (value >> 28 & 1) << PENDSV | (value >> 31) << NMI
            self._pending &= ~((value >> 25 & 1) << SYSTICK | (value >> 27 & 1) << PENDSV)
        elif offset == 0xD08:
            self.machine.engine.vector_table = value & ~0x7F
        elif offset == 0xD0C and value >> 16 == AIRCR_KEY and value & 4:
            self.machine.reset("software")
        self._show()
        self.machine.attend()

    def _write_irq_bits(self, offset: int, value: int) -> None:
        bits = value << FIRST_IRQ + 32 * (offset >> 2 & 0x1F)
        match offset & 0x380:
            case 0x100:
                self._enabled |= bits
            case 0x180:
                self._enabled &= ~bits
            case 0x200:
                self._pending |= bits
            case 0x280:
                self._pending = self._pending & ~bits | self._lines & bits

    def _write_priorities(self, number: int, value: int) -> None:
        for i in range(min(4, len(self._priority) - number)):
            self._priority[number + i] = value >> 8 * i & 0xF0  # four bits are implemented


class _Kilobyte:
    """One of the four kilobytes of the system control space."""

    def __init__(self, core: CoreRegisters, shift: int) -> None:
        self._core, self._shift = core, shift

    def reset(self) -> None: ...

    def read(self, offset: int) -> int:
        return self._core.read(self._shift + offset)

    def write(self, offset: int, value: int) -> None:
        self._core.write(self._shift + offset, value)
