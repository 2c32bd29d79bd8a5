"""GPIO ports with the true levels of the pins; the two wires of an I2C bus and everything that pulls them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from emulator.chips import Tca9548a
    from emulator.stm32_i2c import I2c
    from emulator.stm32_machine import Machine

CRL, CRH, IDR, ODR, BSRR, BRR = range(0, 0x18, 4)
FLOATING_INPUT, PULLED_INPUT = 0x4, 0x8
OUTPUT, OPEN_DRAIN, ALTERNATE = 0x3, 0x4, 0x8


class Gpio:
    """`wire(pin, …)` connects a pin to something that receives the port's level and returns the resulting one."""

    def __init__(self) -> None:
        self._free = 0xFFFF  # pins to which nothing is wired
        self._levels: dict[int, Callable[[], bool]] = {}
        self._listeners: dict[int, Callable[[bool | None], None]] = {}
        self.reset()

    def reset(self) -> None:
        self._configuration = [FLOATING_INPUT] * 16
        self._output = 0
        self._tell()

    def wire(self, pin: int, level: Callable[[], bool], driven: Callable[[bool | None], None]) -> None:
        self._levels[pin], self._listeners[pin] = level, driven
        self._free &= ~(1 << pin)

    def is_alternate(self, pin: int, open_drain: bool) -> bool:
        mode = self._configuration[pin]
        return bool(mode & OUTPUT and mode & ALTERNATE) and bool(mode & OPEN_DRAIN) == open_drain

    def _driven(self, pin: int) -> bool | None:
        """What the port itself drives as a general output; None: nothing."""
        mode, high = self._configuration[pin], bool(self._output >> pin & 1)
        if not mode & OUTPUT or mode & ALTERNATE or (mode & OPEN_DRAIN and high):
            return None
        return high

    def _unwired(self, pin: int) -> bool:
        """The level of a pin to which nothing is connected."""
        driven = self._driven(pin)
        pulled_up = self._configuration[pin] == PULLED_INPUT and bool(self._output >> pin & 1)
        return pulled_up if driven is None else driven

    def _tell(self) -> None:
        self._alone = sum(self._unwired(pin) << pin for pin in range(16))
        for pin, listener in self._listeners.items():
            listener(self._driven(pin))

    def read(self, offset: int) -> int:
        if offset in (CRL, CRH):
            first = 8 if offset == CRH else 0
            return sum(self._configuration[first + i] << 4 * i for i in range(8))
        if offset == IDR:
            return self._alone & self._free | sum(level() << pin for pin, level in self._levels.items())
        return self._output if offset == ODR else 0

    def write(self, offset: int, value: int) -> None:
        if offset in (CRL, CRH):
            first = 8 if offset == CRH else 0
            self._configuration[first : first + 8] = [value >> 4 * i & 15 for i in range(8)]
        elif offset == ODR:
            self._output = value & 0xFFFF
        elif offset == BSRR:
            self._output = (self._output & ~(value >> 16) | value) & 0xFFFF
        elif offset == BRR:
            self._output &= ~value
        self._tell()


class Afio:
    """Remapping is stored, but wires do not follow it."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self.reset()

    def reset(self) -> None:
        self._registers = dict.fromkeys(range(0, 0x18, 4), 0)

    def read(self, offset: int) -> int:
        return self._registers.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        if offset == 4 and value & 0x6:
            self._machine.complain("I2C1 or USART1 is remapped to pins where nothing is wired")
        self._registers[offset] = value


class Holder:
    """A slave that holds SDA low until it got enough clocks; `clocks` None: for ever.

    Behind a mux it has an effect only while its channel is connected.
    """

    def __init__(self, clocks: int | None, mux: Tca9548a | None = None, channel: int = 0) -> None:
        self.clocks, self._mux, self._channel = clocks, mux, channel

    def pulls(self) -> bool:
        connected = self._mux is None or bool(self._mux.control >> self._channel & 1)
        return connected and self.clocks != 0

    def clocked(self, pulses: int = 1) -> None:
        if self.clocks is not None and self.pulls():
            self.clocks = max(0, self.clocks - pulses)


class Wires:
    """SCL and SDA of one port, pulled up; low if anything pulls. `on_change` is the peripheral, which watches them."""

    def __init__(self, muxes: list[Tca9548a]) -> None:
        self.muxes = muxes
        self.i2c: I2c  # the port at these wires
        self.holders: list[Holder] = []
        self.gpio_low = {"scl": False, "sda": False}
        self.on_change: Callable[[], None] = lambda: None
        self.on_gpio: Callable[[str, bool], None] = lambda line, high: None

    def hold(self, clocks: int | None, mux: Tca9548a | None = None, channel: int = 0) -> None:
        """From now on a slave holds SDA low; behind a mux only while its channel is connected."""
        self.holders.append(Holder(clocks, mux, channel))
        self.on_change()

    def release(self) -> None:
        self.holders.clear()
        self.on_change()

    def sda_held(self) -> bool:
        return any(holder.pulls() for holder in self.holders)

    def level(self, line: str) -> bool:
        return not self.gpio_low[line] and not (line == "sda" and self.sda_held())

    def clocked(self, pulses: int) -> None:
        for holder in self.holders:
            holder.clocked(pulses)

    def drive(self, line: str, high: bool | None) -> None:
        """What the port drives on a line as a general output; a high one is assumed to be open drain."""
        low = high is False
        if low == self.gpio_low[line]:
            return
        scl_was_high = self.level("scl")
        sda_was_high = self.level("sda")
        self.gpio_low[line] = low
        if line == "scl" and not low:
            self.clocked(1)
        if line == "sda" and not sda_was_high and self.level("sda") and scl_was_high:
            for mux in self.muxes:
                mux.stop()  # a rising SDA while SCL is high is a STOP, whatever causes it
        self.on_gpio(line, not low)
        self.on_change()

    def reset_muxes(self, driven: bool | None) -> None:
        """The pin at the switches' RESET; pulled up when nobody drives it."""
        for mux in self.muxes:
            mux.held_in_reset = driven is False
            if driven is False:
                mux.control = mux.pending = 0
        self.on_change()
