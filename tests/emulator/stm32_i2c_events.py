"""An I2C port of the STM32F103 as a master on the wires, event by event (RM0008 26.3.3).

Strict on purpose: an action that the manual demands before an event counts only before it. A driver's mistake shows as
a timeout, a byte too many, or a line held low, as on a board.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from emulator import stm32_i2c_registers as reg
from emulator.stm32_i2c_registers import BusyErratum, Phase

if TYPE_CHECKING:
    from collections.abc import Callable

    from emulator.chips import Bus
    from emulator.stm32_clocks import Rcc
    from emulator.stm32_gpio import Wires
    from emulator.stm32_machine import Event, Machine

STRETCHED = (Phase.AT_BTF, Phase.AT_NACK)


class I2cEvents:
    """From START to STOP; `connected` tells whether its pins are in alternate-function open-drain mode."""

    def __init__(
        self, machine: Machine, name: str, irq: int, rcc: Rcc, bus: Bus, wires: Wires, connected: Callable[[], bool]
    ) -> None:
        self._machine, self._name, self._irq, self._rcc = machine, name, irq, rcc
        self._bus, self._wires, self._connected = bus, wires, connected
        wires.on_change = self._lines_changed
        wires.on_gpio = self._gpio_moved
        self.busy = BusyErratum()
        self._event: Event | None = None
        self.reset()

    def reset(self) -> None:
        self._registers = {reg.CR2: 0, reg.OAR1: 0, reg.OAR2: 0, reg.CCR: 0, reg.TRISE: 2}
        self._cr1 = self._enabled_before = 0
        self._stop_everything()

    @property
    def is_idle(self) -> bool:
        return self._phase == Phase.IDLE

    def _stop_everything(self) -> None:
        if self._event:
            self._event.cancel()
        self._event = None
        self._phase = Phase.IDLE
        self._sr1 = self._seen = self._dr = self._shift = 0
        self._transmitting = self._owns_bus = False
        self._shift_full = self._slave_released = False
        self._next_ack = self._first_byte = True
        self._machine.core.line(self._irq, False)
        self._machine.core.line(self._irq + 1, False)

    def _update_interrupts(self) -> None:
        enabled, flags = self._registers[reg.CR2], self._sr1
        if not (enabled | self._enabled_before) & (reg.ITEVTEN | reg.ITERREN):
            return
        self._enabled_before = enabled
        events = flags & (
            reg.SB | reg.ADDR | reg.BTF | reg.STOPF | (reg.TXE | reg.RXNE if enabled & reg.ITBUFEN else 0)
        )
        self._machine.core.line(self._irq, bool(events and enabled & reg.ITEVTEN))
        self._machine.core.line(self._irq + 1, bool(flags & reg.ERRORS and enabled & reg.ITERREN))

    def _set(self, flags: int) -> None:
        self._sr1 |= flags
        self._seen &= ~flags
        self._update_interrupts()

    def _clear(self, flags: int) -> None:
        self._sr1 &= ~flags
        self._update_interrupts()

    # START and STOP

    def _begin(self, phase: str, bits: int, done: Callable[[], None]) -> None:
        self._phase = phase
        self._event = self._machine.after(bits * self._bit_ticks, done)

    def _serve_requests(self) -> None:
        """START and STOP take effect when the port is free to act; in the middle of a byte they wait for its end."""
        may_start = self._phase in STRETCHED or (self._phase == Phase.IDLE and self._bus_is_free())
        if self._phase in STRETCHED and self._cr1 & reg.STOP:
            self._begin_stop()
        elif self._cr1 & reg.START and may_start:
            self._begin(Phase.STARTING, 1, self._started)

    def _bus_is_free(self) -> bool:
        return self._connected() and not self.busy.latched and self._wires.level("scl") and self._wires.level("sda")

    def _started(self) -> None:
        self._event = None
        self._phase = Phase.AT_SB
        self._owns_bus = True
        self._transmitting = self._slave_released = False
        self._cr1 &= ~reg.START
        self._clear(reg.TXE | reg.BTF)
        self._set(reg.SB)

    def _begin_stop(self) -> None:
        self._clear((reg.TXE | reg.BTF) if self._transmitting else 0)
        self._begin(Phase.STOPPING, 1, self._stopped)

    def _stopped(self) -> None:
        self._event = None
        if self._wires.sda_held():
            return  # SDA cannot rise, so there is no STOP; `_lines_changed` tries again
        self._bus.stop()
        self._phase = Phase.IDLE
        self._owns_bus = self._transmitting = False
        self._cr1 &= ~reg.STOP
        self._serve_requests()

    # Address

    def _write_dr(self, value: int) -> None:
        if self._phase == Phase.AT_SB:
            if not self._seen & reg.SB:
                self._machine.complain(f"{self._name}: address written without reading SR1 (RM0008 26.6.6, SB)")
                return
            self._clear(reg.SB)
            self._shift = value
            self._begin(Phase.ADDRESSING, reg.BYTE_BITS, self._address_sent)
        elif self._transmitting and self._phase == Phase.AT_BTF:
            self._clear(reg.BTF)
            self._shift = value
            self._begin(Phase.SENDING, reg.BYTE_BITS, self._byte_sent)
        elif self._transmitting and self._phase == Phase.SENDING and self._sr1 & reg.TXE:
            self._dr = value
            self._clear(reg.TXE)
        else:
            self._machine.complain(f"{self._name}: DR written in state {self._phase}, where nothing takes the byte")

    def _lost_arbitration(self, sent: int) -> bool:
        if not (self._wires.sda_held() and sent):
            return False
        self._wires.clocked(reg.BYTE_BITS)
        self._phase = Phase.IDLE
        self._owns_bus = self._transmitting = False
        self._set(reg.ARLO)
        return True

    def _address_sent(self) -> None:
        self._event = None
        if self._lost_arbitration(self._shift):
            return
        reading = bool(self._shift & 1)
        if not self._bus.start(self._shift >> 1, reading):
            self._phase = Phase.AT_NACK
            self._set(reg.AF)
            self._serve_requests()
            return
        self._phase = Phase.AT_ADDR
        self._transmitting = not reading
        self._set(reg.ADDR)

    def _after_address(self) -> None:
        """ADDR was cleared, so SCL continues."""
        self._first_byte = True
        if self._transmitting:
            self._phase = Phase.AT_BTF
            self._set(reg.TXE)
            self._serve_requests()
        elif self._cr1 & (reg.STOP | reg.START):
            self._phase = Phase.AT_BTF
            self._serve_requests()
        else:
            # "The acknowledge disable is made during EV6, before the ADDR flag is cleared" (26.3.3, one byte). With
            # POS, ACK applies to the byte after the first.
            self._next_ack = bool(self._cr1 & (reg.ACK | reg.POS))
            self._begin(Phase.RECEIVING, reg.BYTE_BITS, self._byte_received)

    # Bytes

    def _byte_sent(self) -> None:
        self._event = None
        if self._lost_arbitration(self._shift):
            return
        if not self._bus.put(self._shift):
            self._phase = Phase.AT_NACK
            self._set(reg.AF)
        elif self._cr1 & (reg.STOP | reg.START) or self._sr1 & reg.TXE:
            if not self._sr1 & reg.TXE:
                self._machine.complain(f"{self._name}: START or STOP while DR was full: the byte in it is lost")
            self._phase = Phase.AT_BTF
            self._set(reg.BTF | reg.TXE)
        else:
            self._shift = self._dr
            self._set(reg.TXE)
            self._begin(Phase.SENDING, reg.BYTE_BITS, self._byte_sent)
            return
        self._serve_requests()

    def _acknowledged(self) -> bool:
        """The answer to the byte that just ended (CR1.POS: the bit applies to the next one)."""
        asked = bool(self._cr1 & reg.ACK)
        if self._cr1 & reg.POS:
            answer, self._next_ack = self._next_ack, asked
        else:
            answer = self._next_ack if self._first_byte else asked
        self._first_byte = False
        return answer

    def _byte_received(self) -> None:
        self._event = None
        byte = 0xFF if self._slave_released else self._bus.get()
        if self._wires.sda_held():
            byte = 0
            self._wires.clocked(reg.BYTE_BITS)
        acknowledged = self._acknowledged()
        self._slave_released |= not acknowledged
        if self._sr1 & reg.RXNE:
            self._shift, self._shift_full = byte, True
            self._set(reg.BTF)
        else:
            self._dr = byte
            self._set(reg.RXNE)
        if self._cr1 & (reg.STOP | reg.START) and acknowledged:
            # The slave has already put the next bit on SDA: a zero keeps the line low, and no STOP can follow.
            self._hold_next_zeros()
        self._phase = Phase.AT_BTF
        if self._cr1 & (reg.STOP | reg.START):
            self._serve_requests()
        elif not self._shift_full:
            # Refused or not, the clock continues until STOP, so a late STOP comes after one byte too many.
            self._begin(Phase.RECEIVING, reg.BYTE_BITS, self._byte_received)

    def _hold_next_zeros(self) -> None:
        following = self._bus.get()
        zeros = 8 - following.bit_length()
        self._machine.complain(f"{self._name}: STOP or START after a byte that was acknowledged (RM0008 26.3.3)")
        if zeros:
            self._wires.hold(zeros)

    def _read_dr(self) -> int:
        value = self._dr
        if self._shift_full:
            self._dr, self._shift_full = self._shift, False
            self._clear(reg.BTF)
            if self._phase == Phase.AT_BTF:
                self._begin(Phase.RECEIVING, reg.BYTE_BITS, self._byte_received)
        else:
            self._clear(reg.RXNE)
        return value

    # The lines, moved by others

    def _gpio_moved(self, line: str, high: bool) -> None:
        if not self._cr1 & reg.PE:
            self.busy.moved(line, high)

    def _lines_changed(self) -> None:
        if self._phase == Phase.STOPPING and not self._event and not self._wires.sda_held():
            self._begin_stop()
        self._serve_requests()
