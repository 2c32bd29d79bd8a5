"""The firmware's ELF with other chips on its buses: it identifies each of them by itself."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from emulated_stream import EVERYONE, EmulatedStream

from emulator.magnetometer import Magnetometer
from emulator.magnetometers import Lis3mdl, Mmc5603nj, Mmc5983ma, Qmc5883l, Qmc5883p
from emulator.memsic_film import Memsic
from emulator.mlx90393 import Mlx90393
from emulator.stm32_board import Place
from fmfts.sensor.chips import CHIPS, QMC5883L
from fmfts.sensor.wire.packets import NO_MUX, Result, Sample, SensorState, Verb

pytestmark = pytest.mark.needs("arm-none-eabi-gcc")
FIELDS_GAUSS = [(0.1 * (n + 1), -0.05 * (n + 1), 0.3) for n in range(4)]
SECONDS = 1.0  # in which the chips' clocks, 2.2 % off, pass some five frames


@dataclass(frozen=True)
class Kind:
    """An emulated chip, a gain code, and a rate at which no frame is faster than the chips."""

    name: str
    emulated: type[Magnetometer]
    gain_code: int
    rate_hz: int


OTHERS = [
    Kind("mmc5983ma", Mmc5983ma, 0, 220),
    Kind("mlx90393", Mlx90393, 0, 220),
    Kind("lis3mdl", Lis3mdl, 3, 155),
]
# All kinds in `make long`; `make test` takes the one whose driver does most, as the core's own C tests take every kind.
each_kind = pytest.mark.parametrize(
    "kind",
    [pytest.param(kind, id=kind.name, marks=() if kind.name == "mlx90393" else pytest.mark.long) for kind in OTHERS],
)


def with_chips(
    replaced: dict[int, Magnetometer | None], emulated: type[Magnetometer] = Qmc5883l, noise_gauss: float = 0.002
) -> tuple[EmulatedStream, list[Magnetometer]]:
    """A board whose first mux has chips of another kind on these channels (None: made here)."""
    stream = EmulatedStream()
    mux = next(iter(stream.board.muxes.values()))
    chips = []
    for channel in replaced:
        chip = emulated(
            lambda: stream.board.machine.now_s,
            FIELDS_GAUSS[channel],
            clock_error=(channel - 1.5) * 0.015,
            phase_s=0.0007 * channel,
            noise_gauss=noise_gauss,
            seed=channel,
        )
        if isinstance(chip, Memsic):
            chip.repeatability_gauss = 0.0  # otherwise each SET leaves 1 mG, four steps, and shifts the means
        mux.channels[channel] = chip
        chips.append(chip)
    return stream, chips


def asked(stream: EmulatedStream, verb: Verb, argument: int) -> None:
    assert stream.request(verb, argument).result == Result.DONE


def test_four_qmc5883l_are_found_set_up_and_sampled_once_each() -> None:
    stream, chips = with_chips(dict.fromkeys(range(4)))
    stream.run(0.3)
    asked(stream, Verb.RANGE, 1)
    asked(stream, Verb.RATE, 200)
    stream.run(0.5)
    before = [chip.conversions for chip in chips]
    samples = stream.samples(2 * SECONDS)
    made = np.array([chip.conversions for chip in chips]) - before
    assert len(samples) / (2 * SECONDS) >= 199
    assert [b.sequence - a.sequence for a, b in pairwise(samples)] == [1] * (len(samples) - 1)
    assert all(sample.valid == EVERYONE for sample in samples)
    taken = [sum(sample.fresh >> sensor & 1 for sample in samples) for sensor in range(4)]
    # Frames are no faster than the chips: of a faster chip the newest sample is sent, as for the HMC5983.
    assert np.all(np.abs(made - taken) <= np.maximum(3, 0.04 * made)), (made, taken)
    assert {sample.gain_code for sample in samples} == {1}
    field_t = np.mean([sample.counts for sample in samples], axis=0) * QMC5883L.step_t[1]
    assert field_t == pytest.approx(np.array(FIELDS_GAUSS) * 1e-4, abs=5e-8)  # 0.2 µT of noise in 400 samples
    assert samples[-1].temperature_raw == -32768
    assert [QMC5883L.is_identity(sensor.identification) for sensor in stream.hello.pads[0].sensors] == [True] * 4
    assert set(stream.status.pads[0].states) == {SensorState.OK}


def test_saturated_axis_of_a_qmc5883l_is_marked_on_the_board() -> None:
    stream, chips = with_chips(dict.fromkeys(range(4)))
    stream.run(0.3)
    asked(stream, Verb.RANGE, 1)
    chips[2].field_gauss = [0.1, 12.0, 0.2]
    stream.run(0.3)
    sample = stream.samples(0.1)[-1]
    assert np.argwhere(sample.counts == QMC5883L.saturated_count).tolist() == [[2, 1]]
    chips[2].field_gauss = [0.1, -12.0, 0.2]
    stream.run(0.1)
    sample = stream.samples(0.1)[-1]
    assert np.argwhere(sample.counts == QMC5883L.saturated_count).tolist() == [[2, 1]]


def test_qmc5883l_that_was_power_cycled_is_set_up_again() -> None:
    stream, chips = with_chips(dict.fromkeys(range(4)))
    stream.run(0.5)
    chips[1].power_on()
    samples = stream.samples(1.0)
    shown = [sample for sample in samples[-20:] if isinstance(sample, Sample)]
    assert all(sample.valid == EVERYONE for sample in shown)
    assert chips[1].registers[0x09] == 0x1D  # 200 Hz, ±8 G, continuous, by data sheet section 9.2.3


def test_board_with_two_kinds_of_chips_reports_their_places() -> None:
    """Only the host can say that they do not belong together."""
    stream, _ = with_chips({1: None, 3: None})
    stream.run(1.0)
    kinds = [QMC5883L.is_identity(sensor.identification) for sensor in stream.hello.pads[0].sensors]
    assert kinds == [False, True, False, True]
    assert stream.samples(0.1)[-1].valid == EVERYONE


def test_qmc5883l_has_no_selftest_and_no_trigger() -> None:
    stream, _ = with_chips(dict.fromkeys(range(4)))
    stream.run(0.5)
    asked(stream, Verb.TRIGGER, 1)
    stream.run(0.5)
    assert set(stream.status.pads[0].states) == {SensorState.CONFIGURATION_LOST}
    asked(stream, Verb.TRIGGER, 0)
    stream.run(1.5)
    assert stream.samples(0.1)[-1].valid == EVERYONE


@each_kind
def test_flashed_program_reads_each_kind_and_loses_no_frame(kind: Kind) -> None:
    chip = CHIPS[kind.name]
    stream, chips = with_chips(dict.fromkeys(range(4)), kind.emulated, noise_gauss=0.002)
    stream.run(0.3)
    asked(stream, Verb.RANGE, kind.gain_code)
    asked(stream, Verb.RATE, kind.rate_hz)
    stream.run(0.5)
    before = [each.conversions for each in chips]
    samples = stream.samples(SECONDS)
    made = np.array([each.conversions for each in chips]) - before
    assert len(samples) / SECONDS >= kind.rate_hz - 1
    assert [b.sequence - a.sequence for a, b in pairwise(samples)] == [1] * (len(samples) - 1)
    assert all(sample.valid == EVERYONE for sample in samples)
    taken = [sum(sample.fresh >> sensor & 1 for sample in samples) for sensor in range(4)]
    # Frames are no faster than some chips: of a faster chip the newest sample is sent.
    assert np.all(taken >= np.minimum(made, kind.rate_hz * SECONDS) * 0.95), (made, taken)
    field_t = np.mean([sample.counts for sample in samples], axis=0) * chip.step_t[kind.gain_code]
    # One step, because some chips cut bits off, and five deviations of the mean of this many samples with 0.2 µT of
    # noise.
    tolerance_t = float(np.nanmax(chip.step_t[kind.gain_code])) + 5 * 2e-7 / len(samples) ** 0.5
    assert field_t == pytest.approx(np.array(FIELDS_GAUSS) * 1e-4, abs=tolerance_t)
    temperature_c = chip.temperature_c(samples[-1].temperature_raw)
    assert temperature_c is None if chip.thermometer is None else temperature_c == pytest.approx(25.0, abs=0.13)
    assert all(chip.is_identity(sensor.identification) for sensor in stream.hello.pads[0].sensors)
    assert set(stream.status.pads[0].states) == {SensorState.OK}
    assert stream.is_clean()


@each_kind
def test_flashed_program_triggers_each_kind_at_once(kind: Kind) -> None:
    most_hz = CHIPS[kind.name].board_single_hz
    stream, _ = with_chips(dict.fromkeys(range(4)), kind.emulated, noise_gauss=0.0)
    stream.run(0.3)
    asked(stream, Verb.RANGE, kind.gain_code)
    asked(stream, Verb.TRIGGER, 1)
    assert stream.request(Verb.RATE, most_hz + 1).result == Result.OUT_OF_RANGE
    asked(stream, Verb.RATE, most_hz)
    stream.run(0.5)
    samples = stream.samples(1.0)
    assert most_hz - 2 <= len(samples) <= most_hz + 1
    assert all(sample.valid == sample.fresh == EVERYONE for sample in samples)
    field_t = samples[-1].counts * CHIPS[kind.name].step_t[kind.gain_code]
    step_t = float(np.nanmax(CHIPS[kind.name].step_t[kind.gain_code]))
    assert field_t == pytest.approx(np.array(FIELDS_GAUSS) * 1e-4, abs=step_t)
    assert stream.status.pads[0].config_repairs == 0
    assert stream.is_clean()


@each_kind
def test_flashed_program_sets_a_power_cycled_chip_up_again(kind: Kind) -> None:
    stream, chips = with_chips(dict.fromkeys(range(4)), kind.emulated)
    stream.run(0.5)
    chips[1].power_on()
    samples = stream.samples(1.0)
    assert all(sample.valid == EVERYONE for sample in samples[-20:])
    assert sum(sample.fresh >> 1 & 1 for sample in samples[-20:]) > 5


@pytest.mark.parametrize("emulated", [Qmc5883l, Qmc5883p, Mmc5983ma, Mmc5603nj])
def test_second_pad_behind_a_mux_is_found(emulated: type[Magnetometer]) -> None:
    """Even if the chips' address is above 31."""
    stream = EmulatedStream(places=(Place(1, 0x70, 0), Place(1, 0x70, 4)))
    mux = next(iter(stream.board.muxes.values()))
    for channel in range(8):
        mux.channels[channel] = emulated(lambda: stream.board.machine.now_s, FIELDS_GAUSS[channel % 4], seed=channel)
    stream.run(0.4)
    assert [[sensor.state for sensor in pad.sensors] for pad in stream.hello.pads] == [[SensorState.OK] * 4] * 2


# Rates, scales and identification come from the emulated chips' sources, not from the daemon's tables.
NEW_KINDS = [
    (Qmc5883p, 200, 15000.0, (1, 1, 1), b"\x80\x2c\x00"),
    (Mmc5603nj, 220, 1024.0, (1, 1, -1), b"\x10\x00\x00"),
]


@pytest.mark.parametrize(("emulated", "rate_hz", "counts_per_gauss", "signs", "identity"), NEW_KINDS)
def test_flashed_program_reads_the_chips_that_are_sold_today(
    emulated: type[Magnetometer], rate_hz: int, counts_per_gauss: float, signs: tuple[int, ...], identity: bytes
) -> None:
    stream, _ = with_chips(dict.fromkeys(range(4)), emulated, noise_gauss=0.0)
    stream.run(0.3)
    asked(stream, Verb.RANGE, 0)
    asked(stream, Verb.RATE, rate_hz)
    stream.run(0.3)
    samples = stream.samples(1.0)
    assert len(samples) >= rate_hz - 1
    assert all(sample.valid == EVERYONE for sample in samples)
    expected = np.array(FIELDS_GAUSS) * counts_per_gauss * np.array(signs)
    assert samples[-1].counts == pytest.approx(expected, rel=0.002, abs=1)
    assert {sensor.identification for sensor in stream.hello.pads[0].sensors} == {identity}
    assert stream.is_clean()


def without_a_mux() -> tuple[EmulatedStream, list[Magnetometer]]:
    """A board with four MLX90393 on its first port itself."""
    stream = EmulatedStream()
    chips = []
    for number in range(4):
        chip = Mlx90393(
            lambda: stream.board.machine.now_s,
            FIELDS_GAUSS[number],
            clock_error=(number - 1.5) * 0.015,
            phase_s=0.0007 * number,
            noise_gauss=0.002,
            seed=number,
        )
        chip.address = 0x0C + number
        chips.append(chip)
    stream.board.buses[1].chips = chips
    return stream, chips


def check_fields(stream: EmulatedStream, pad_index: int) -> None:
    samples = stream.samples(SECONDS, pad_index)
    assert len(samples) / SECONDS >= 219
    assert all(sample.valid == EVERYONE for sample in samples)
    step_t = CHIPS["mlx90393"].step_t[0]
    field_t = np.mean([sample.counts for sample in samples], axis=0) * step_t
    assert field_t == pytest.approx(np.array(FIELDS_GAUSS) * 1e-4, abs=float(np.max(step_t)))


def test_four_chips_without_a_mux_are_a_pad() -> None:
    stream, _ = without_a_mux()
    stream.board.unplug_mux(0)
    stream.run(0.3)
    asked(stream, Verb.RANGE, 0)
    asked(stream, Verb.RATE, 220)
    stream.run(0.5)
    (pad,) = stream.hello.pads
    assert (pad.mux_address, [sensor.channel for sensor in pad.sensors]) == (NO_MUX, [0x0C, 0x0D, 0x0E, 0x0F])
    assert {sensor.state for sensor in pad.sensors} == {SensorState.OK}
    check_fields(stream, 0)
    assert stream.board.buses[1].conflicts == 0
    assert stream.board.complaints == []


def test_pad_without_a_mux_comes_after_that_with_one() -> None:
    stream, _ = without_a_mux()
    stream.run(0.3)
    asked(stream, Verb.RANGE, 0)
    stream.run(0.5)
    assert [pad.mux_address for pad in stream.hello.pads] == [0x70, NO_MUX]
    assert {sample.valid for sample in stream.samples(1.0)} == {EVERYONE}
    assert {sample.valid for sample in stream.samples(1.0, pad=1)} == {EVERYONE}
    assert stream.board.buses[1].conflicts == 0


def test_chip_that_is_missing_without_a_mux_is_named() -> None:
    stream, chips = without_a_mux()
    stream.board.unplug_mux(0)
    chips[2].absent = True
    stream.run(1.0)
    states = [sensor.state for sensor in stream.hello.pads[0].sensors]
    assert states == [SensorState.OK, SensorState.OK, SensorState.NO_ANSWER, SensorState.OK]


def test_single_chip_without_mux_makes_no_pad() -> None:
    """It may be of a kind that the board does not search there."""
    stream, chips = without_a_mux()
    for chip in chips[1:]:
        chip.absent = True
    stream.run(0.5)
    assert [pad.mux_address for pad in stream.hello.pads] == [0x70]
