"""A whole board: the firmware's ELF on the chip, two I2C buses with switches and sensors, the host's end of the UART.

board = Board(Path("firmware/build/fmfts.elf"))
stream = board.run(2.0)         # two seconds of the board's time; what it sent
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from emulator.chips import Bus, Hmc5983, Tca9548a
from emulator.hx711 import Hx711
from emulator.magnetometer import Magnetometer
from emulator.stm32_clocks import Gated, Rcc, Watchdog
from emulator.stm32_engine import SYSTEM_MEMORY, TICKS_PER_S
from emulator.stm32_gpio import Afio, Gpio, Wires
from emulator.stm32_i2c import I2c
from emulator.stm32_machine import Machine
from emulator.stm32_usart import Usart

DEFAULT_UID = b"emul" + bytes(7) + b"\1"
HOST_BAUD = 460_800
GAUSS_PER_TESLA = 1e4
SENSORS = 4
DEFAULT_CLOCKS_PPM = (-30_000, -10_000, 13_000, 30_000)  # ±3 %, like the data sheet's chips
ENDLESS_LOOP = SYSTEM_MEMORY + 0x100
GPIO_A, GPIO_B, AFIO, USART1 = 0x4001_0800, 0x4001_0C00, 0x4001_0000, 0x4001_3800
I2C_BASES, I2C_IRQS = {1: 0x4000_5400, 2: 0x4000_5800}, {1: 31, 2: 33}
TRANSMIT_PIN = 9
LOAD_DATA_PIN, LOAD_CLOCK_PIN = 0, 1  # of port A


class Pins(NamedTuple):
    """Pins of port B."""

    scl: int
    sda: int
    mux_reset: int


class Place(NamedTuple):
    """A pad's connection."""

    port: int
    mux_address: int
    first_channel: int


PINS = {1: Pins(6, 7, 5), 2: Pins(10, 11, 12)}  # docs/firmware.md
PLACES = (Place(1, 0x70, 0), Place(2, 0x70, 0), Place(2, 0x70, 4))


class Sensor(Hmc5983):
    """A chip that remembers when its conversions ended (seconds), and adds noise to the field (gauss, deviation)."""

    def __init__(self, machine: Machine, clock_error: float, phase_s: float, seed: int) -> None:
        super().__init__(lambda: machine.now_s, clock_error=clock_error, phase_s=phase_s)
        self.ended_s: list[float] = []
        self.number_conversions = False
        self.noise_gauss = 0.0
        self.saturated_axes: set[int] = set()
        self.steady_gauss = [0.0, 0.0, 0.0]
        self._random = random.Random(seed)

    def feel(self, field_gauss: Sequence[float]) -> None:
        self.run()
        self.steady_gauss = list(field_gauss)

    def converted(self, ended_s: float) -> None:
        if self.locked:
            return
        self.ended_s.append(ended_s)
        field = list(self.steady_gauss)
        if self.noise_gauss:
            field = [value + self._random.gauss(0.0, self.noise_gauss) for value in field]
        for axis in self.saturated_axes:
            field[axis] = 100.0
        self.field_gauss = field
        super().converted(ended_s)
        if self.number_conversions:  # its data then show to which of `ended_s` they belong
            number = len(self.ended_s) - 1
            self.registers[3:9] = b"".join(part.to_bytes(2, "big") for part in (number >> 10, 0, number & 1023))


class Board:
    """`chip_ppm`: how much slower than nominal each of a pad's chips runs (their periods); `uid`: twelve bytes."""

    def __init__(
        self,
        elf: Path,
        pads: int = 1,
        uid: bytes = DEFAULT_UID,
        hse_ok: bool = True,
        chip_ppm: Sequence[float] = DEFAULT_CLOCKS_PPM,
        places: Sequence[Place] | None = None,
    ) -> None:
        self.machine = Machine(elf, uid)
        self.machine.engine.load([(ENDLESS_LOOP, b"\xfe\xe7")])
        self.rcc = Rcc(self.machine, hse_ok)
        self.watchdog = Watchdog(self.machine)
        self.gpio_a, self.gpio_b = Gpio(), Gpio()
        connected = lambda: self.gpio_a.is_alternate(TRANSMIT_PIN, open_drain=False)  # noqa: E731
        self.uart = Usart(self.machine, self.rcc, connected, HOST_BAUD)
        blocks = [("GPIOA", GPIO_A, self.gpio_a), ("GPIOB", GPIO_B, self.gpio_b), ("USART1", USART1, self.uart)]
        for name, base, block in [*blocks, ("AFIO", AFIO, Afio(self.machine))]:
            Gated(name, base, block, self.rcc, self.machine)
        self.places = tuple(places or PLACES[:pads])
        self.muxes: dict[tuple[int, int], Tca9548a] = {}
        self.sensors: list[list[Any]] = [
            self._hang_pad(place, chip_ppm, seed) for seed, place in enumerate(self.places)
        ]
        self.buses: dict[int, Bus] = {}
        self.wires = {port: self._wire_port(port) for port in (1, 2)}
        self.converter = Hx711(lambda: self.machine.now_s, self.machine.complain)
        self.gpio_a.wire(LOAD_DATA_PIN, self.converter.data_level, lambda driven: None)
        self.gpio_a.wire(LOAD_CLOCK_PIN, lambda: False, self.converter.clock_driven)
        self._seconds = 0.0
        self.machine.reset("power")

    def _hang_pad(self, place: Place, chip_ppm: Sequence[float], seed: int) -> list[Sensor]:
        mux = self.muxes.setdefault((place.port, place.mux_address), Tca9548a(place.mux_address, {}))
        sensors = [
            Sensor(self.machine, chip_ppm[i] * 1e-6, (0.0007 * (3 * i + seed)) % 0.0045, seed * SENSORS + i)
            for i in range(SENSORS)
        ]
        mux.channels |= {place.first_channel + i: sensor for i, sensor in enumerate(sensors)}
        return sensors

    def _wire_port(self, port: int) -> Wires:
        muxes = [mux for (of_port, _), mux in self.muxes.items() if of_port == port]
        wires, pins = Wires(muxes), PINS[port]
        bus = self.buses[port] = Bus(muxes)
        for line in ("scl", "sda"):
            self.gpio_b.wire(
                getattr(pins, line),
                lambda line=line: wires.level(line),
                lambda driven, line=line: wires.drive(line, driven),
            )
        self.gpio_b.wire(pins.mux_reset, lambda: True, wires.reset_muxes)
        connected = lambda: all(self.gpio_b.is_alternate(pin, open_drain=True) for pin in pins[:2])  # noqa: E731
        i2c = I2c(self.machine, f"I2C{port}", I2C_IRQS[port], self.rcc, bus, wires, connected)
        Gated(f"I2C{port}", I2C_BASES[port], i2c, self.rcc, self.machine)
        wires.i2c = i2c
        return wires

    @property
    def now_s(self) -> float:
        return self.machine.now_s

    @property
    def complaints(self) -> list[str]:
        """The firmware's actions that a real chip or sensor does not forgive; also reads with several channels on."""
        conflicts = sum(mux.conflicts for mux in self.muxes.values())
        return self.machine.complaints + ([f"{conflicts} reads with several channels on"] if conflicts else [])

    def run(self, seconds: float) -> bytes:
        """Let the board run; returns the bytes that the host received meanwhile."""
        self._seconds += seconds
        self.machine.run_until(round(self._seconds * TICKS_PER_S))
        received = bytes(self.uart.sent)
        self.uart.sent.clear()
        return received

    def run_unread(self, seconds: float, buffer_bytes: int = 4096) -> bytes:
        """Like `run`, but the host is too slow: its adapter keeps the first bytes and loses the rest."""
        return self.run(seconds)[:buffer_bytes]

    def send(self, data: bytes) -> None:
        """From the host, at its baud rate, after the bytes still on the line."""
        self.uart.host_sends(data)

    def set_field(self, pad: int, field_t: np.ndarray) -> None:
        """Field (4, 3) in tesla at the chips, in their own axes, from the next conversions on."""
        for sensor, field in zip(self.sensors[pad], np.asarray(field_t, float), strict=True):
            sensor.feel([float(value) * GAUSS_PER_TESLA for value in field])

    def hang_other_chips(self, emulated: type[Magnetometer], pad: int = 0) -> None:
        """Replaces the pad's HMC5983, each on its own channel, as soldered there; before the board runs."""
        place, mux = self.places[pad], self._mux_of(pad)
        self.sensors[pad] = [
            emulated(lambda: self.machine.now_s, clock_error=(i - 1.5) * 0.01, phase_s=0.0007 * i, seed=i + 1)
            for i in range(SENSORS)
        ]
        mux.channels |= {place.first_channel + i: sensor for i, sensor in enumerate(self.sensors[pad])}

    # Faults

    def _mux_of(self, pad: int) -> Tca9548a:
        return self.muxes[self.places[pad].port, self.places[pad].mux_address]

    def unplug(self, pad: int, sensor: int) -> None:
        self.sensors[pad][sensor].absent = True

    def replug(self, pad: int, sensor: int) -> None:
        """It returns as after power-on, whatever its fault was."""
        chip = self.sensors[pad][sensor]
        if chip.absent:
            chip.power_on()
        chip.absent = chip.frozen = False
        if isinstance(chip, Sensor):
            chip.identification = b"H43"
            chip.saturated_axes.clear()

    def replace(self, pad: int, sensor: int, identification: bytes) -> None:
        """Replaces the chip by another one, fresh from power-on."""
        self.sensors[pad][sensor].power_on()
        self.sensors[pad][sensor].identification = identification

    def unplug_mux(self, pad: int, absent: bool = True) -> None:
        mux = self._mux_of(pad)
        mux.absent = absent
        mux.control = mux.pending = 0

    def bus_is_idle(self, pad: int) -> bool:
        return self.wires[self.places[pad].port].i2c.is_idle

    def hold_sda(self, pad: int, clocks: int | None = None, sensor: int | None = None) -> None:
        """SDA low until it got this many clocks (None: for ever); by a sensor behind its mux, or by any chip before
        it."""
        place = self.places[pad]
        behind = () if sensor is None else (self._mux_of(pad), place.first_channel + sensor)
        self.wires[place.port].hold(clocks, *behind)

    def release_sda(self, pad: int) -> None:
        self.wires[self.places[pad].port].release()

    def latch_busy(self, pad: int) -> None:
        """The erratum: the port takes the bus for busy until SCL and SDA were moved by hand and SWRST was given."""
        self.wires[self.places[pad].port].i2c.busy.latch()

    def corrupt(self, pad: int, sensor: int, register: int = 1, flip: int = 0x60) -> None:
        self.sensors[pad][sensor].run()
        self.sensors[pad][sensor].registers[register] ^= flip

    def saturate(self, pad: int, sensor: int, axis: int) -> None:
        self.sensors[pad][sensor].saturated_axes.add(axis)

    def hang(self, interrupts: bool = True) -> None:
        """The main program enters an endless loop, with interrupts running or masked."""
        self.machine.jump(ENDLESS_LOOP)
        self.machine.engine.primask = not interrupts

    def reset(self, cause: str = "pin") -> None:
        self.machine.reset(cause)

    def crystal_stops(self) -> None:
        self.rcc.crystal_stops()
