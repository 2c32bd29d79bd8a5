"""RCC (clock tree, peripheral clocks and resets, reset cause), the flash's wait states, the independent watchdog."""

from __future__ import annotations

from typing import TYPE_CHECKING

from emulator.stm32_core import NMI
from emulator.stm32_engine import TICKS_PER_S

if TYPE_CHECKING:
    from emulator.stm32_machine import Event, Machine, Peripheral

RCC, FLASH_INTERFACE, IWDG = 0x4002_1000, 0x4002_2000, 0x4000_3000
CR, CFGR, CIR, APB2RSTR, APB1RSTR, AHBENR, APB2ENR, APB1ENR, BDCR, CSR = range(0, 0x28, 4)
HSION, HSIRDY, HSEON, HSERDY, CSSON, PLLON, PLLRDY = (1 << bit for bit in (0, 1, 16, 17, 19, 24, 25))
CSSF, CSSC = 1 << 7, 1 << 23
PLLSRC, PLLXTPRE = 1 << 16, 1 << 17
RMVF, PINRSTF, PORRSTF, SFTRSTF, IWDGRSTF = (1 << bit for bit in (24, 26, 27, 28, 29))
CAUSES = {"power": PORRSTF, "pin": 0, "software": SFTRSTF, "watchdog": IWDGRSTF}
HSI_HZ = HSE_HZ = 8_000_000
HSE_START_S, PLL_LOCK_S = 2e-3, 200e-6  # data sheet, tables 22 and 26
LSI_HZ = 40_000
APB1_MAX_HZ = 36_000_000
MHZ_PER_WAIT_STATE = 24_000_000
# Bit of the enable and reset registers, by the peripheral's base: RM0008 7.3.3 to 7.3.8.
APB2_BITS = {0x4001_0000: 0, **{0x4001_0800 + 0x400 * port: 2 + port for port in range(7)}, 0x4001_3800: 14}
APB1_BITS = {0x4000_5400: 21, 0x4000_5800: 22}


class Rcc:
    """`hse_ok` is the crystal; `hz`, `apb1_hz`, `apb2_hz` result from it and the firmware."""

    def __init__(self, machine: Machine, hse_ok: bool) -> None:
        self._machine = machine
        self.hse_ok = hse_ok
        self._cause_flags = 0
        self._ready: list[Event] = []
        self.gates: dict[int, Gated] = {}
        self.reset()
        machine.on_reset = self.note_cause
        machine.peripherals[RCC >> 10] = self
        self.flash = Flash(machine, self)

    def reset(self) -> None:
        for event in self._ready:
            event.cancel()
        self._ready = []
        self._registers = {CR: HSION | HSIRDY | 0x80, CFGR: 0, CIR: 0, AHBENR: 0x14, APB2ENR: 0, APB1ENR: 0}
        self._registers |= {APB2RSTR: 0, APB1RSTR: 0, BDCR: 0}
        self._gate()
        self.hz = self.apb1_hz = self.apb2_hz = HSI_HZ
        self._machine.clock.ticks_per_cycle = TICKS_PER_S // HSI_HZ

    def note_cause(self, cause: str) -> None:
        # Every source of a reset pulls NRST low for 20 µs, hence PINRSTF each time (RM0008 7.1.1).
        self._cause_flags = (0 if cause == "power" else self._cause_flags) | CAUSES[cause] | PINRSTF

    def crystal_stops(self) -> None:
        self.hse_ok = False
        if not self._registers[CR] & HSERDY:
            return
        self._registers[CR] &= ~HSERDY
        if self._registers[CR] & CSSON:
            # The clock security system puts the core on HSI and raises the NMI (RM0008 7.2.7).
            self._registers[CR] &= ~(HSEON | CSSON | PLLON | PLLRDY)
            self._registers[CFGR] &= ~0xF
            self._registers[CIR] |= CSSF
            self._update_clocks()
            self._machine.core.pend(NMI)

    def _gate(self) -> None:
        for register, bits in ((APB1ENR, APB1_BITS), (APB2ENR, APB2_BITS)):
            for base, bit in bits.items():
                if base in self.gates:
                    self.gates[base].clocked = bool(self._registers[register] >> bit & 1)

    def read(self, offset: int) -> int:
        return self._cause_flags if offset == CSR else self._registers.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        if offset == CSR:
            self._cause_flags = 0 if value & RMVF else self._cause_flags
        elif offset == CR:
            self._write_cr(value)
        elif offset == CFGR:
            self._write_cfgr(value)
        elif offset == CIR:
            if value & CSSC:
                self._registers[CIR] &= ~CSSF
        elif offset in self._registers:
            self._registers[offset] = value
            if offset in (APB1RSTR, APB2RSTR):
                self._reset_peripherals(APB1_BITS if offset == APB1RSTR else APB2_BITS, value)
            self._gate()

    def _reset_peripherals(self, bits: dict[int, int], value: int) -> None:
        for base, bit in bits.items():
            if value >> bit & 1 and base in self.gates:
                self.gates[base].reset()

    def _write_cr(self, value: int) -> None:
        before = self._registers[CR]
        self._registers[CR] = before & (HSIRDY | HSERDY | PLLRDY) | value & (HSION | HSEON | CSSON | PLLON | 0xF8)
        for enable, ready, seconds in ((HSEON, HSERDY, HSE_START_S), (PLLON, PLLRDY, PLL_LOCK_S)):
            if value & enable and not before & enable:
                self._ready.append(
                    self._machine.after(round(seconds * TICKS_PER_S), lambda bit=ready: self._is_ready(bit))
                )
            elif not value & enable:
                self._registers[CR] &= ~ready

    def _is_ready(self, ready: int) -> None:
        from_hse = self._registers[CFGR] & PLLSRC
        alive = self.hse_ok if ready == HSERDY or from_hse else True
        if alive and self._registers[CR] & ready >> 1:
            self._registers[CR] |= ready

    def _write_cfgr(self, value: int) -> None:
        before = self._registers[CFGR]
        if self._registers[CR] & PLLON and (before ^ value) & 0x3F0000:
            self._machine.complain("PLL source or factor written while the PLL is on (RM0008 7.3.2)")
            value = value & ~0x3F0000 | before & 0x3F0000
        switch = value & 3
        if self._registers[CR] & {0: HSIRDY, 1: HSERDY, 2: PLLRDY}.get(switch, 0):
            self._registers[CFGR] = value & ~0xC | switch << 2
        else:
            self._registers[CFGR] = value & ~0xC | before & 0xC
        self._update_clocks()

    def _update_clocks(self) -> None:
        configuration = self._registers[CFGR]
        source = configuration >> 2 & 3
        if source == 2:
            factor = min((configuration >> 18 & 15) + 2, 16)
            halved = not configuration & PLLSRC or configuration & PLLXTPRE
            self.hz = HSE_HZ * factor // (2 if halved else 1)
        else:
            self.hz = HSI_HZ
        hpre = configuration >> 4 & 15
        self.hz >>= 0 if hpre < 8 else (1, 2, 3, 4, 6, 7, 8, 9)[hpre - 8]
        self.apb1_hz, self.apb2_hz = (self.hz >> max(0, (configuration >> shift & 7) - 3) for shift in (8, 11))
        counts = self._machine.core.systick.core_clock_changes()
        self._machine.clock.ticks_per_cycle = TICKS_PER_S // self.hz
        self._machine.core.systick.core_clock_changed(counts)
        if self.apb1_hz > APB1_MAX_HZ:
            self._machine.complain(f"APB1 runs at {self.apb1_hz / 1e6} MHz, 36 are allowed")
        if self.flash.wait_states < (self.hz - 1) // MHZ_PER_WAIT_STATE:
            self._machine.complain(f"{self.flash.wait_states} wait states of the flash at {self.hz / 1e6} MHz")


class Flash:
    """Only its wait states: nothing here is programmed."""

    def __init__(self, machine: Machine, rcc: Rcc) -> None:
        self._rcc = rcc
        self.reset()
        machine.peripherals[FLASH_INTERFACE >> 10] = self

    def reset(self) -> None:
        self._acr = 0x30

    @property
    def wait_states(self) -> int:
        return self._acr & 7

    def read(self, offset: int) -> int:
        return self._acr if offset == 0 else 0

    def write(self, offset: int, value: int) -> None:
        if offset == 0:
            self._acr = value & 0x1F | self._acr & 0x20


class Watchdog:
    """IWDG: once started nothing but a reset stops it."""

    KEY_RELOAD, KEY_UNLOCK, KEY_START = 0xAAAA, 0x5555, 0xCCCC

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._event: Event | None = None
        self.reset()
        machine.peripherals[IWDG >> 10] = self

    def reset(self) -> None:
        if self._event:
            self._event.cancel()
        self._event = None
        self._prescaler, self._reload, self._unlocked, self._barks_at = 0, 0xFFF, False, 0

    @property
    def timeout_ticks(self) -> int:
        return (self._reload + 1) * (4 << min(self._prescaler, 6)) * TICKS_PER_S // LSI_HZ

    def _barks(self) -> None:
        if self._machine.now < self._barks_at:
            self._event = self._machine.after(self._barks_at - self._machine.now, self._barks)
        else:
            self._machine.reset("watchdog")

    def read(self, offset: int) -> int:
        return {4: self._prescaler, 8: self._reload}.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        if offset == 0:
            self._unlocked = value == self.KEY_UNLOCK
            if value in (self.KEY_RELOAD, self.KEY_START):
                self._barks_at = self._machine.now + self.timeout_ticks
            if value == self.KEY_START and not self._event:
                self._event = self._machine.after(self.timeout_ticks, self._barks)
        elif not self._unlocked:
            self._machine.complain("watchdog register written without its key")
        elif offset == 4:
            self._prescaler = value & 7
        elif offset == 8:
            self._reload = value & 0xFFF


class Gated:
    """A peripheral behind its clock: without it, it reads as 0 and ignores writes."""

    clocked = False

    def __init__(self, name: str, base: int, behind: Peripheral, rcc: Rcc, machine: Machine) -> None:
        self._name, self._behind, self._machine = name, behind, machine
        self.reset = behind.reset
        rcc.gates[base] = self
        machine.peripherals[base >> 10] = self

    def read(self, offset: int) -> int:
        if self.clocked:
            return self._behind.read(offset)
        self._machine.complain(f"{self._name} read without its clock")
        return 0

    def write(self, offset: int, value: int) -> None:
        if self.clocked:
            self._behind.write(offset, value)
        else:
            self._machine.complain(f"{self._name} written without its clock")
