"""The I2C registers of the STM32F103: the effect of reading and writing them (RM0008 26.6).

Only its own sequence clears a flag: SB by SR1 and then DR, ADDR by SR1 and then SR2.
"""

from __future__ import annotations

from emulator import stm32_i2c_registers as reg
from emulator.stm32_i2c_events import I2cEvents
from emulator.stm32_i2c_registers import Timing


class I2c(I2cEvents):
    """One port of the chip."""

    def read(self, offset: int) -> int:
        if offset == reg.DR:
            return self._read_dr()
        if self._event:
            self._machine.polled((self, offset))
        if offset == reg.SR1:
            self._seen = self._sr1
            return self._sr1
        if offset == reg.SR2:
            return self._read_sr2()
        if offset == reg.CR1:
            return self._cr1
        return self._registers.get(offset, 0)

    def _read_sr2(self) -> int:
        busy = self._owns_bus or self.busy.latched or not (self._wires.level("scl") and self._wires.level("sda"))
        value = reg.MSL * self._owns_bus | reg.BUSY * (busy and bool(self._cr1 & reg.PE)) | reg.TRA * self._transmitting
        if self._sr1 & self._seen & reg.ADDR:
            self._clear(reg.ADDR)
            self._after_address()
        return value

    def write(self, offset: int, value: int) -> None:
        if offset == reg.CR1:
            self._write_cr1(value)
        elif offset == reg.DR:
            self._write_dr(value & 0xFF)
        elif offset == reg.SR1:
            self._clear(reg.ERRORS & ~value)  # rc_w0
        elif offset in (reg.CCR, reg.TRISE) and self._cr1 & reg.PE:
            self._machine.complain(f"{self._name}: CCR or TRISE written while the port is enabled (RM0008 26.6.8)")
        elif offset in self._registers:
            self._registers[offset] = value & 0xFFFF
            self._update_interrupts()

    def _write_cr1(self, value: int) -> None:
        pending = self._cr1 & (reg.START | reg.STOP)
        if pending and value & reg.PE and not value & reg.SWRST:
            self._machine.complain(f"{self._name}: CR1 written while START or STOP is pending (RM0008 26.6.1)")
        if value & reg.SWRST:
            self.busy.software_reset()
            self.reset()
            self._cr1 = reg.SWRST
            return
        enabled = value & reg.PE and not self._cr1 & reg.PE
        self._cr1 = value if value & reg.PE else value & ~(reg.START | reg.STOP | reg.ACK)
        if not value & reg.PE:
            self._stop_everything()
            return
        if enabled:
            self.busy.enabled()
            timing = Timing(
                self._registers[reg.CR2], self._registers[reg.CCR], self._registers[reg.TRISE], self._rcc.apb1_hz
            )
            self._bit_ticks = timing.bit_ticks
            for mistake in timing.mistakes():
                self._machine.complain(f"{self._name}: {mistake}")
        self._serve_requests()

    def _take_timing(self) -> None:
        values = (self._registers[offset] for offset in (reg.CR2, reg.CCR, reg.TRISE))
        timing = Timing(*values, self._rcc.apb1_hz)
        self._bit_ticks = timing.bit_ticks
        for mistake in timing.mistakes():
            self._machine.complain(f"{self._name}: {mistake}")
