"""What a kind of magnetometer is: every number that depends on the chip. One file of this folder describes each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from fmfts.sensor.chips.driver import Driver, Dump

TESLA_PER_GAUSS = 1e-4
USUAL_RANGE_GAUSS = 2.5  # the standard pad's field under any load that it is made for
GAIN_CODES = 32  # gain codes of a chip at most; three bits of the wire name the first eight (firmware/wire.md)

Axes = tuple[int, int, int]
PerAxis = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Thermometer:
    """Temperature registers: `at_zero_c` + count · `c_per_count`. range_c: where the chip works, the only temperatures
    that it can report."""

    at_zero_c: float
    c_per_count: float
    range_c: tuple[float, float]


@dataclass(frozen=True, slots=True)
class BiasStrap:
    """The self-test: a strap on the chip makes a known field, and a good axis shows counts within `limits`.

    field_gauss: nominal, per axis; its own tolerance is inside the limits. limits: least and largest count of a good
    axis at `gain_code`, of either sign. deviation: of the strap's field from one axis to another, as a fraction.
    settings: what to write to measure without bias, with the positive and with the negative one.
    """

    gain_code: int
    limits: tuple[int, int]
    field_gauss: PerAxis
    deviation: float
    settings: Callable[[Chip], tuple[bytes, bytes, bytes]]


@dataclass(frozen=True, slots=True)
class OwnField:
    """A self-test that separates good axes from broken ones, without gains: the chip makes a field of nearly unknown
    strength. gain_code: for the measurement.

     limits: least and largest count of it, of either sign, by axis.
    without, with_field: what to write; settle_s: the time after each until samples count; samples: that are averaged.
    """

    gain_code: int
    limits: tuple[tuple[int, int], tuple[int, int], tuple[int, int]]
    without: bytes
    with_field: bytes
    settle_s: tuple[float, float]
    samples: int


@dataclass(frozen=True, slots=True)
class SetReset:
    """A self-test with bridges that a pulse reverses: the field changes its sign, the bridge's own zero does not.

    stop: what to write to end a stream. set_pulse, reset_pulse: for either pulse; settle_s: the time after `stop`, and
    after a pulse. measure: for one measurement without a pulse of the chip's own; samples: that are averaged.
    coil: for a current through its own coil one way, and the other, until it is set up; its field is hardly known.
    largest_zero_gauss: of a good axis, of either sign. least_coil_gauss: the smallest change when the current reverses.
    """

    stop: bytes
    set_pulse: bytes
    reset_pulse: bytes
    settle_s: tuple[float, float]
    measure: bytes
    samples: int
    coil: tuple[bytes, bytes]
    largest_zero_gauss: float
    least_coil_gauss: float


@dataclass(frozen=True, slots=True)
class Film:
    """A magnetic film that the host has to magnetise: by a pulse at set-up, after a strong field, and now and then.

    upset_gauss: a field (norm) that may upset the film, so that no axis counts until a pulse. doubtful_gauss: a
    stronger field may read like this while the film is upset (assumed); a pulse follows when the field has gone. pulse:
    what to write; pause_s: until a measurement may begin. every_s: a pulse that was not needed costs another zero of 1
    mG (more than a frame's noise), so they are rare. One is needed only after a strong field while the chip was not
    read.
    """

    upset_gauss: float
    doubtful_gauss: float
    pulse: bytes
    pause_s: float
    every_s: float = 600.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Chip:
    """The facts of one kind of chip. `name` is for the configuration, `label` for people.

    driver: its registers. address: where it answers first; other_addresses: by its pins. identity: its identification
    where identity_mask has ones. ranges_gauss, counts_per_gauss: by gain code; the second for each axis x, y, z,
    negative where the axis is inverted to make them right-handed, z out of the chip's face. largest_count: of the
    converter, of either sign (and −largest_count − 1). saturated_count: what it returns beyond its range.
    output_rates_hz: by the chip's rate code, slowest first; free_rate_hz: the highest that this chip has.
    paced_by_host: its stream is not used: to run free, each chip is restarted whenever it was read.
    single_rate_hz, single_conversion_s, single_wait_s: of triggered measurements; the wait is long enough for the
    slowest chip; a rate of 0: it cannot be triggered. clock_tolerance: relative, of the chip's own clock. noise_t:
    standard deviation of one sample at the rate that serves 220 Hz. noises_t: of each of output_rates_hz, empty where
    it is the same at all. single_noise_t: of a triggered measurement; None: noise_t. zero_t: the typical reading of an
    axis without a field; None: in no source. sensitivity_per_k: relative change of the counts with temperature.
    offset_t_per_k: deviation of the drift of each axis's offset. The offset after set and reset pulses is in no data
    sheet: assumed, a fifteenth of the HMC5983's count. For chips without such pulses it is a guess (unverified).
    thermometer: None where the chip has none that can be used. bias_strap: None where it has no self-test of its gains.
    film: None if the chip magnetises it by itself, or has none. own_field, set_reset: the self-tests of others, on I2C
    only. board_rates_hz: those of output_rates_hz that the firmware of boards uses; empty: it does not read this chip.
    board_single_hz: the highest rate of simultaneous measurements there, of one pad. asked_by_command: it has no
    identification to read: `identify` writes to the chip at its address, whatever it is. streamed: only a board of
    another maker reads it. dump: reads its registers for `fmfts-daemon report`; None: they are not known. supply:
    availability and price; remarks: other facts for the buyer, and unverified ones.
    """

    name: str
    label: str
    driver: Driver
    address: int
    other_addresses: tuple[int, ...] = ()
    identity: bytes
    identity_mask: bytes = b"\xff\xff\xff"
    ranges_gauss: tuple[float, ...]
    counts_per_gauss: tuple[PerAxis, ...]
    largest_count: int
    saturated_count: int
    paced_by_host: bool = False
    output_rates_hz: tuple[float, ...]
    free_rate_hz: int
    single_rate_hz: int
    single_conversion_s: float
    single_wait_s: float
    clock_tolerance: float
    noise_t: float
    noises_t: tuple[float, ...] = ()
    single_noise_t: float | None = None
    zero_t: float | None = None
    sensitivity_per_k: float
    offset_t_per_k: float = 1e-8
    thermometer: Thermometer | None
    bias_strap: BiasStrap | None
    film: Film | None = None
    own_field: OwnField | None = None
    set_reset: SetReset | None = None
    board_rates_hz: tuple[float, ...] = ()
    board_single_hz: int = 0
    asked_by_command: bool = False
    streamed: bool = False
    dump: Dump | None = None
    supply: str = ""
    remarks: str = ""
    # (GAIN_CODES, 3) the field of one count in tesla, by gain code and axis, negative as counts_per_gauss is; NaN where
    # the chip has no such code.
    step_t: NDArray[np.float64] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        steps = np.full((GAIN_CODES, 3), np.nan)
        steps[: len(self.counts_per_gauss)] = TESLA_PER_GAUSS / np.array(self.counts_per_gauss, dtype=float)
        steps.setflags(write=False)
        object.__setattr__(self, "step_t", steps)

    def coarseness_t(self, gain_code: int) -> NDArray[np.float64]:
        """(3,) the step between two counts of each axis, in tesla."""
        size: NDArray[np.float64] = np.abs(self.step_t[gain_code])
        return size

    @property
    def named(self) -> str:
        """The label with its article, for sentences: "an HMC5983", "a QMC5883L". "LIS" is said as a word."""
        return f"{'an' if self.label[0] in 'AEFHIMNORSX' else 'a'} {self.label}"

    @property
    def addresses(self) -> tuple[int, ...]:
        return (self.address, *self.other_addresses)

    @property
    def on_boards(self) -> bool:
        """The firmware of boards reads it, too."""
        return bool(self.board_rates_hz)

    @property
    def tested_on_i2c(self) -> bool:
        """It has a self-test that measures no gains, and that only an I2C bus of the computer carries out."""
        return self.own_field is not None or self.set_reset is not None

    @property
    def has_trigger(self) -> bool:
        """It can be triggered."""
        return self.single_rate_hz > 0

    @property
    def usual_range_gauss(self) -> float:
        """The default range: the finest that holds the standard pad's field."""
        return min(each for each in self.ranges_gauss if each >= USUAL_RANGE_GAUSS)

    def gain_code_for_range(self, range_gauss: float) -> int:
        """The gain code whose range is `range_gauss`; ValueError names the ranges that exist."""
        for code, value in enumerate(self.ranges_gauss):
            if abs(value - range_gauss) < 1e-9:
                return code
        raise ValueError(f"the chip has no range of ±{range_gauss} G: one of {', '.join(map(str, self.ranges_gauss))}")

    def highest_rate_hz(self, trigger: str) -> int:
        """The chip's largest rate: by itself ("free"), or triggered ("simultaneous")."""
        return self.single_rate_hz if trigger == "simultaneous" else self.free_rate_hz

    def output_rate_hz(self, rate_hz: float) -> float:
        """The chip's slowest own rate that is not below `rate_hz`; ValueError where there is none."""
        if self.paced_by_host and rate_hz <= self.free_rate_hz:
            return rate_hz
        for rate in self.output_rates_hz:
            if rate_hz <= rate <= self.free_rate_hz:
                return rate
        raise ValueError(f"the {self.name} delivers at most {self.free_rate_hz} Hz, not {rate_hz:g} Hz")

    def noise_at_t(self, rate_hz: float, trigger: str) -> float:
        """Standard deviation of one sample, in tesla, as the chip is set up for `rate_hz`."""
        if trigger == "simultaneous":
            return self.noise_t if self.single_noise_t is None else self.single_noise_t
        return (
            self.noises_t[self.output_rates_hz.index(self.output_rate_hz(rate_hz))] if self.noises_t else self.noise_t
        )

    def temperature_c(self, count: int) -> float | None:
        """None if the chip has no thermometer, or cannot work at this temperature."""
        thermometer = self.thermometer
        return None if thermometer is None else self.believed_c(thermometer.at_zero_c + count * thermometer.c_per_count)

    def believed_c(self, temperature_c: float | None) -> float | None:
        """The temperature, or None if this chip cannot report it."""
        if temperature_c is None or self.thermometer is None:
            return None
        lowest_c, highest_c = self.thermometer.range_c
        return temperature_c if lowest_c <= temperature_c <= highest_c else None

    def is_identity(self, answer: bytes) -> bool:
        """Necessary, not sufficient: a clone may answer the same, and fails the self-test."""
        return len(answer) == len(self.identity) and all(
            one & mask == due for one, mask, due in zip(answer, self.identity_mask, self.identity, strict=True)
        )

    def why_not_identity(self, answer: bytes) -> str | None:
        """What is wrong with the identification registers, None if nothing is."""
        if self.is_identity(answer):
            return None
        masked = bytes(due if mask else 0 for due, mask in zip(self.identity, self.identity_mask, strict=True))
        text = masked.decode("ascii", "replace")
        due = f"{masked.hex(' ')} ({text})" if text.isprintable() else masked.hex(" ")
        return f"answers {answer.hex(' ')} where {self.named} says {due}: another chip is fitted, or the bus is noisy"
