"""USART1: bytes take the time that BRR gives them; the host at the other end listens and sends at its own baud rate."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from emulator.stm32_engine import TICKS_PER_S

if TYPE_CHECKING:
    from collections.abc import Callable

    from emulator.stm32_clocks import Rcc
    from emulator.stm32_machine import Event, Machine

SR, DR, BRR, CR1, CR2, CR3, GTPR = range(0, 0x1C, 4)
FE, ORE, IDLE, RXNE, TC, TXE = 1 << 1, 1 << 3, 1 << 4, 1 << 5, 1 << 6, 1 << 7
RE, TE, IDLEIE, RXNEIE, TCIE, TXEIE, UE = (1 << bit for bit in (2, 3, 4, 5, 6, 7, 13))
FRAME_BITS = 10
IRQ = 37
BAUD_TOLERANCE = 0.025  # later, the stop bit is sampled in the wrong place
GARBLED = 0x5A


class Usart:
    """`connected` tells whether the transmit pin belongs to the USART; `sent` collects what left it."""

    def __init__(self, machine: Machine, rcc: Rcc, connected: Callable[[], bool], host_baud: int) -> None:
        self._machine, self._rcc, self._connected = machine, rcc, connected
        self._host_baud = host_baud
        self.sent = bytearray()
        self.overruns = 0
        self._incoming: deque[int] = deque()
        self._receiving: Event | None = None
        self._sending: Event | None = None
        self.reset()

    def reset(self) -> None:
        if self._sending:
            self._sending.cancel()
        self._sending = None
        self._sr, self._seen, self._received = TXE | TC, 0, 0
        self._registers = {BRR: 0, CR1: 0, CR2: 0, CR3: 0, GTPR: 0}
        self._waiting: int | None = None
        self._machine.core.line(IRQ, False)

    @property
    def _byte_ticks(self) -> int:
        return FRAME_BITS * max(16, self._registers[BRR]) * TICKS_PER_S // self._rcc.apb2_hz

    def _garbles(self) -> bool:
        baud = TICKS_PER_S * FRAME_BITS / self._byte_ticks
        return abs(baud / self._host_baud - 1) > BAUD_TOLERANCE

    def _update_interrupt(self) -> None:
        enabled, raised = self._registers[CR1], self._sr | (RXNE if self._sr & ORE else 0)
        self._machine.core.line(IRQ, bool(enabled & raised & (TXEIE | TCIE | RXNEIE | IDLEIE)))

    def read(self, offset: int) -> int:
        if offset == SR:
            self._seen = self._sr
            return self._sr
        if offset == DR:
            self._sr &= ~(RXNE | self._seen & (ORE | FE | IDLE))
            self._update_interrupt()
            return self._received
        return self._registers.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        if offset == DR:
            self._write_dr(value & 0xFF)
        elif offset == SR:
            self._sr &= value | ~(TC | RXNE)  # rc_w0
        elif offset in self._registers:
            if offset == CR3 and value:
                raise NotImplementedError("USART1: DMA, flow control and the other uses of CR3 have no model")
            self._registers[offset] = value & 0xFFFF
        self._update_interrupt()

    def _write_dr(self, value: int) -> None:
        if self._registers[CR1] & (UE | TE) != UE | TE:
            self._machine.complain("USART1: DR written while the transmitter is off")
        elif not self._sr & TXE:
            self._machine.complain("USART1: DR written before TXE: a byte is lost")
            self._waiting = value
        elif self._sending:
            self._waiting = value
            self._sr &= ~(TXE | TC)
        else:
            self._send(value)

    def _send(self, value: int) -> None:
        self._sr = self._sr & ~TC | TXE
        self._sending = self._machine.after(self._byte_ticks, lambda: self._sent(value))

    def _sent(self, value: int) -> None:
        self._sending = None
        if self._connected():
            self.sent.append(value ^ GARBLED if self._garbles() else value)
        if self._waiting is None:
            self._sr |= TC
        else:
            value, self._waiting = self._waiting, None
            self._send(value)
        self._update_interrupt()

    def host_sends(self, data: bytes) -> None:
        self._incoming.extend(data)
        if not self._receiving:
            self._receive_next()

    def _receive_next(self) -> None:
        self._receiving = None
        if self._incoming:
            self._receiving = self._machine.after(FRAME_BITS * TICKS_PER_S // self._host_baud, self._byte_arrived)

    def _byte_arrived(self) -> None:
        byte = self._incoming.popleft()
        if self._registers[CR1] & (UE | RE) == UE | RE:
            if self._sr & RXNE:
                self._sr |= ORE
                self.overruns += 1
            else:
                self._received = byte ^ GARBLED if self._garbles() else byte
                self._sr |= RXNE
            self._update_interrupt()
        self._receive_next()
