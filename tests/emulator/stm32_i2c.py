"""The I2C master of the STM32F103, event by event (RM0008 26.3.3 and 26.6; errata sheet ES096).

Strict on purpose: a flag is cleared by its own sequence only, and what the manual demands before an event counts only
before it. What a driver gets wrong shows as a time-out, a byte too many, or a line held low, as it does on a board.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from emulator.stm32_engine import TICKS_PER_S

if TYPE_CHECKING:
    from collections.abc import Callable

    from emulator.chips import Bus
    from emulator.stm32_clocks import Rcc
    from emulator.stm32_gpio import Wires
    from emulator.stm32_machine import Event, Machine

CR1, CR2, OAR1, OAR2, DR, SR1, SR2, CCR, TRISE = range(0, 0x24, 4)
PE, START, STOP, ACK, POS, SWRST = (1 << bit for bit in (0, 8, 9, 10, 11, 15))
SB, ADDR, BTF, STOPF, RXNE, TXE, BERR, ARLO, AF = (1 << bit for bit in (0, 1, 2, 4, 6, 7, 8, 9, 10))
MSL, BUSY, TRA = 1, 2, 4
ITERREN, ITEVTEN, ITBUFEN = 1 << 8, 1 << 9, 1 << 10
ERRORS = BERR | ARLO | AF
FAST, DUTY = 1 << 15, 1 << 14
FAST_MAX_HZ = 400_000
BYTE_BITS = 9  # eight and the acknowledge

# What the port is doing. In the last four it holds SCL low and waits for the software.
IDLE, STARTING, STOPPING, ADDRESSING, SENDING, RECEIVING = (
    "idle",
    "starting",
    "stopping",
    "addressing",
    "sending",
    "receiving",
)
AT_SB, AT_ADDR, AT_BTF, AT_NACK = "SB", "ADDR", "BTF", "NACK"
STRETCHED = (AT_BTF, AT_NACK)


class I2c:
    """One port; `connected` tells whether its pins are in alternate-function open-drain mode."""

    def __init__(
        self, machine: Machine, name: str, irq: int, rcc: Rcc, bus: Bus, wires: Wires, connected: Callable[[], bool]
    ) -> None:
        self._machine, self._name, self._irq, self._rcc = machine, name, irq, rcc
        self._bus, self._wires, self._connected = bus, wires, connected
        wires.on_change = self._lines_changed
        wires.on_gpio = self._gpio_moved
        self.busy_latched = False  # the erratum: BUSY stays although both lines are high
        self._lines_seen: set[tuple[str, bool]] = set()
        self._event: Event | None = None
        self.reset()

    def reset(self) -> None:
        self._registers = {CR2: 0, OAR1: 0, OAR2: 0, CCR: 0, TRISE: 2}
        self._cr1 = self._enabled_before = 0
        self._stop_everything()

    def _stop_everything(self) -> None:
        if self._event:
            self._event.cancel()
        self._event = None
        self._phase = IDLE
        self._sr1 = self._seen = self._dr = self._shift = 0
        self._transmitting = self._owns_bus = False
        self._shift_full = self._slave_released = False
        self._next_ack = self._first_byte = True
        self._machine.core.line(self._irq, False)
        self._machine.core.line(self._irq + 1, False)

    # Registers

    def read(self, offset: int) -> int:
        if offset == DR:
            return self._read_dr()
        if self._event:
            self._machine.polled((self, offset))
        if offset == SR1:
            self._seen = self._sr1
            return self._sr1
        if offset == SR2:
            return self._read_sr2()
        if offset == CR1:
            return self._cr1
        return self._registers.get(offset, 0)

    def _read_sr2(self) -> int:
        busy = self._owns_bus or self.busy_latched or not (self._wires.level("scl") and self._wires.level("sda"))
        value = MSL * self._owns_bus | BUSY * (busy and bool(self._cr1 & PE)) | TRA * self._transmitting
        if self._sr1 & self._seen & ADDR:
            self._clear(ADDR)
            self._after_address()
        return value

    def write(self, offset: int, value: int) -> None:
        if offset == CR1:
            self._write_cr1(value)
        elif offset == DR:
            self._write_dr(value & 0xFF)
        elif offset == SR1:
            self._clear(ERRORS & ~value)  # rc_w0
        elif offset in (CCR, TRISE) and self._cr1 & PE:
            self._machine.complain(f"{self._name}: CCR or TRISE written while the port is enabled (RM0008 26.6.8)")
        elif offset in self._registers:
            self._registers[offset] = value & 0xFFFF
            self._update_interrupts()

    def _write_cr1(self, value: int) -> None:
        pending = self._cr1 & (START | STOP)
        if pending and value & PE and not value & SWRST:
            self._machine.complain(f"{self._name}: CR1 written while START or STOP is pending (RM0008 26.6.1)")
        if value & SWRST:
            if {("scl", False), ("scl", True), ("sda", False), ("sda", True)} <= self._lines_seen:
                self.busy_latched = False
            self.reset()
            self._cr1 = SWRST
            return
        enabled = value & PE and not self._cr1 & PE
        self._cr1 = value if value & PE else value & ~(START | STOP | ACK)
        if not value & PE:
            self._stop_everything()
            return
        if enabled:
            self._lines_seen.clear()
            self._check_timing()
        self._serve_requests()

    def _check_timing(self) -> None:
        apb1_mhz, ccr = self._rcc.apb1_hz // 1_000_000, self._registers[CCR]
        rise_limit_ns = 300 if ccr & FAST else 1000
        if self._registers[CR2] & 0x3F != apb1_mhz:
            self._machine.complain(f"{self._name}: FREQ is {self._registers[CR2] & 0x3F}, APB1 runs at {apb1_mhz} MHz")
        if self._registers[TRISE] != apb1_mhz * rise_limit_ns // 1000 + 1:
            self._machine.complain(f"{self._name}: TRISE is {self._registers[TRISE]} (RM0008 26.6.9)")
        cycles = max(1, ccr & 0xFFF) * ((25 if ccr & DUTY else 3) if ccr & FAST else 2)
        self._bit_ticks = cycles * TICKS_PER_S // self._rcc.apb1_hz
        if self._bit_ticks * FAST_MAX_HZ < TICKS_PER_S:
            self._machine.complain(f"{self._name}: {TICKS_PER_S // self._bit_ticks} Hz, 400000 are allowed")

    def _update_interrupts(self) -> None:
        enabled, flags = self._registers[CR2], self._sr1
        if not (enabled | self._enabled_before) & (ITEVTEN | ITERREN):
            return
        self._enabled_before = enabled
        events = flags & (SB | ADDR | BTF | STOPF | (TXE | RXNE if enabled & ITBUFEN else 0))
        self._machine.core.line(self._irq, bool(events and enabled & ITEVTEN))
        self._machine.core.line(self._irq + 1, bool(flags & ERRORS and enabled & ITERREN))

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
        """START and STOP take effect where the port is free to act; in the middle of a byte they wait for its end."""
        may_start = self._phase in STRETCHED or (self._phase == IDLE and self._bus_is_free())
        if self._phase in STRETCHED and self._cr1 & STOP:
            self._begin_stop()
        elif self._cr1 & START and may_start:
            self._begin(STARTING, 1, self._started)

    def _bus_is_free(self) -> bool:
        return self._connected() and not self.busy_latched and self._wires.level("scl") and self._wires.level("sda")

    def _started(self) -> None:
        self._event = None
        self._phase = AT_SB
        self._owns_bus = True
        self._transmitting = self._slave_released = False
        self._cr1 &= ~START
        self._clear(TXE | BTF)
        self._set(SB)

    def _begin_stop(self) -> None:
        self._clear((TXE | BTF) if self._transmitting else 0)
        self._begin(STOPPING, 1, self._stopped)

    def _stopped(self) -> None:
        self._event = None
        if self._wires.sda_held():
            return  # SDA cannot rise, so there is no STOP; `_lines_changed` tries again
        self._bus.stop()
        self._phase = IDLE
        self._owns_bus = self._transmitting = False
        self._cr1 &= ~STOP
        self._serve_requests()

    # Address

    def _write_dr(self, value: int) -> None:
        if self._phase == AT_SB:
            if not self._seen & SB:
                self._machine.complain(f"{self._name}: address written without reading SR1 (RM0008 26.6.6, SB)")
                return
            self._clear(SB)
            self._shift = value
            self._begin(ADDRESSING, BYTE_BITS, self._address_sent)
        elif self._transmitting and self._phase == AT_BTF:
            self._clear(BTF)
            self._shift = value
            self._begin(SENDING, BYTE_BITS, self._byte_sent)
        elif self._transmitting and self._phase == SENDING and self._sr1 & TXE:
            self._dr = value
            self._clear(TXE)
        else:
            self._machine.complain(f"{self._name}: DR written in state {self._phase}, where nothing takes the byte")

    def _lost_arbitration(self, sent: int) -> bool:
        if not (self._wires.sda_held() and sent):
            return False
        self._wires.clocked(BYTE_BITS)
        self._phase = IDLE
        self._owns_bus = self._transmitting = False
        self._set(ARLO)
        return True

    def _address_sent(self) -> None:
        self._event = None
        if self._lost_arbitration(self._shift):
            return
        reading = bool(self._shift & 1)
        if not self._bus.start(self._shift >> 1, reading):
            self._phase = AT_NACK
            self._set(AF)
            self._serve_requests()
            return
        self._phase = AT_ADDR
        self._transmitting = not reading
        self._set(ADDR)

    def _after_address(self) -> None:
        """ADDR was cleared, SCL goes on."""
        self._first_byte = True
        if self._transmitting:
            self._phase = AT_BTF
            self._set(TXE)
            self._serve_requests()
        elif self._cr1 & (STOP | START):
            self._phase = AT_BTF
            self._serve_requests()
        else:
            # "The acknowledge disable is made during EV6, before the ADDR flag is cleared" (26.3.3, one byte). With
            # POS, ACK is about the byte after the first.
            self._next_ack = bool(self._cr1 & (ACK | POS))
            self._begin(RECEIVING, BYTE_BITS, self._byte_received)

    # Bytes

    def _byte_sent(self) -> None:
        self._event = None
        if self._lost_arbitration(self._shift):
            return
        if not self._bus.put(self._shift):
            self._phase = AT_NACK
            self._set(AF)
        elif self._cr1 & (STOP | START) or self._sr1 & TXE:
            if not self._sr1 & TXE:
                self._machine.complain(f"{self._name}: START or STOP while DR was full: the byte in it is lost")
            self._phase = AT_BTF
            self._set(BTF | TXE)
        else:
            self._shift = self._dr
            self._set(TXE)
            self._begin(SENDING, BYTE_BITS, self._byte_sent)
            return
        self._serve_requests()

    def _acknowledged(self) -> bool:
        """The answer to the byte that is just over (CR1.POS: the bit is about the next one)."""
        asked = bool(self._cr1 & ACK)
        if self._cr1 & POS:
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
            self._wires.clocked(BYTE_BITS)
        acknowledged = self._acknowledged()
        self._slave_released |= not acknowledged
        if self._sr1 & RXNE:
            self._shift, self._shift_full = byte, True
            self._set(BTF)
        else:
            self._dr = byte
            self._set(RXNE)
        if self._cr1 & (STOP | START) and acknowledged:
            # The slave has already put the next bit on SDA: a zero keeps the line low, and no STOP can follow.
            self._hold_next_zeros()
        self._phase = AT_BTF
        if self._cr1 & (STOP | START):
            self._serve_requests()
        elif not self._shift_full:
            # Refused or not, the clock goes on until STOP: a late one comes after a byte too many.
            self._begin(RECEIVING, BYTE_BITS, self._byte_received)

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
            self._clear(BTF)
            if self._phase == AT_BTF:
                self._begin(RECEIVING, BYTE_BITS, self._byte_received)
        else:
            self._clear(RXNE)
        return value

    # The lines, moved by others

    def latch_busy(self) -> None:
        self.busy_latched = True
        self._lines_seen.clear()

    def _gpio_moved(self, line: str, high: bool) -> None:
        if not self._cr1 & PE:
            self._lines_seen.add((line, high))

    def _lines_changed(self) -> None:
        if self._phase == STOPPING and not self._event and not self._wires.sda_held():
            self._begin_stop()
        self._serve_requests()
