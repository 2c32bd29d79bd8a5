"""Every driver beside the HMC5983's, on a chip that is emulated from its data sheet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from emulated_bus import Clock, clock, emulated_pad, run

from emulator.chips import Hmc5983
from emulator.magnetometers import Lis3mdl, Mmc5603nj, Mmc5983ma, Qmc5883l, Qmc5883p
from emulator.mlx90393 import Mlx90393
from fmfts.sensor.chips import CHIPS
from fmfts.sensor.chips.driver import Setup
from fmfts.sensor.chips.recognised import why_not
from fmfts.sensor.i2c.bus import ChipWires
from fmfts.sensor.i2c.others import chips_answering
from fmfts.sensor.wire.packets import SensorState

__all__ = ["clock"]
KINDS: dict[str, Any] = {
    "qmc5883l": Qmc5883l,
    "qmc5883p": Qmc5883p,
    "lis3mdl": Lis3mdl,
    "mmc5983ma": Mmc5983ma,
    "mmc5603nj": Mmc5603nj,
    "mlx90393": Mlx90393,
}
RATE_HZ = {"qmc5883l": 200, "qmc5883p": 200, "lis3mdl": 155, "mmc5983ma": 200, "mmc5603nj": 200, "mlx90393": 226}
FIELD_GAUSS = (0.75, -1.5, 0.3)


@dataclass(frozen=True)
class Kind:
    """The promises of the data sheet, written here once more. range_gauss: of the gain code."""

    name: str
    gain_code: int
    counts_per_gauss: tuple[float, float, float]
    range_gauss: float


# The MMC5983MA is left-handed: its z points into the board.
# The MLX90393: 0.601 and 0.968 µT a count at GAIN_SEL 7, RES 2; its converter ends at 22000 counts.
PROMISED = [
    Kind("qmc5883l", 0, (12000, 12000, 12000), 2.73),
    Kind("qmc5883l", 1, (3000, 3000, 3000), 10.9),
    Kind("lis3mdl", 0, (6842, 6842, 6842), 4.0),
    Kind("lis3mdl", 1, (3421, 3421, 3421), 8.0),
    Kind("lis3mdl", 2, (2281, 2281, 2281), 12.0),
    Kind("lis3mdl", 3, (1711, 1711, 1711), 16.0),
    Kind("mmc5983ma", 0, (4096, 4096, -4096), 8.0),
    Kind("mmc5603nj", 0, (1024, 1024, -1024), 30.0),
    Kind("qmc5883p", 0, (15000, 15000, 15000), 2.0),
    Kind("qmc5883p", 1, (3750, 3750, 3750), 8.0),
    Kind("qmc5883p", 2, (2500, 2500, 2500), 12.0),
    Kind("qmc5883p", 3, (1000, 1000, 1000), 30.0),
    Kind("mlx90393", 0, (100 / 0.601, 100 / 0.601, 100 / 0.968), 132.0),
    Kind("mlx90393", 3, (100 / 1.202, 100 / 1.202, 100 / 1.936), 264.0),
    Kind("mlx90393", 5, (100 / 1.803, 100 / 1.803, 100 / 2.904), 396.0),
]


def chip_of(clock: Clock, kind: str, **options: Any) -> Any:
    """An emulated chip. A film whose pulses all leave the same zero; test_films.py has those that do not."""
    one = KINDS[kind](clock, **({"field_gauss": FIELD_GAUSS} | options))
    one.repeatability_gauss = 0.0
    return one


def best_rate_hz(kind: str) -> int:
    return min(CHIPS[kind].free_rate_hz, 250)


def last_counts(samples: list[Any]) -> np.ndarray:
    return samples[-1].counts


@pytest.mark.parametrize("kind", PROMISED, ids=lambda kind: f"{kind.name}-{kind.gain_code}")
def test_each_axis_has_the_data_sheets_scale_and_sign(clock: Clock, kind: Kind) -> None:
    pad, _ = emulated_pad(clock, kind.name, [chip_of(clock, kind.name)], gain_code=kind.gain_code, rate_hz=100)
    samples = run(pad, clock, 0.5, 100)
    assert pad.sensors[0].state == SensorState.OK
    due = np.array(FIELD_GAUSS) * kind.counts_per_gauss
    assert np.abs(last_counts(samples)[0] - due).max() <= 1.0 + 0.002 * np.abs(due).max()  # tables round to 0.2 %
    step_t = CHIPS[kind.name].step_t[kind.gain_code]
    assert last_counts(samples)[0] * step_t == pytest.approx(
        np.array(FIELD_GAUSS) * 1e-4, abs=step_t.max()
    )  # the MMC5983MA drops two bits


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("kind", PROMISED, ids=lambda kind: f"{kind.name}-{kind.gain_code}")
def test_saturated_axis_is_flagged_alone_and_is_good_again_after(
    clock: Clock, kind: Kind, axis: int, sign: int
) -> None:
    """Even far beyond the range: an output that wraps around must not read as a field."""
    one = chip_of(clock, kind.name)
    pad, _ = emulated_pad(clock, kind.name, [one], gain_code=kind.gain_code, rate_hz=100)
    saturated = CHIPS[kind.name].saturated_count
    for times in (1.05, 1.5, 2.0, 3.9):
        # z of the MLX90393 is 1.6 times as coarse.
        beyond = kind.range_gauss * times * (1.62 if kind.name == "mlx90393" and axis == 2 else 1.0)
        one.field_gauss = [sign * beyond if each == axis else 0.1 for each in range(3)]
        flags = last_counts(run(pad, clock, 0.1, 100))[0] == saturated
        if CHIPS[kind.name].film is None:
            assert flags.tolist() == [each == axis for each in range(3)], times
        elif times < 1.1:  # a field that may have upset the film makes all its axes unusable; a larger one reads anyhow
            assert flags.all()
    one.field_gauss = [0.8 * kind.range_gauss if each == axis else 0.1 for each in range(3)]
    counts = last_counts(run(pad, clock, 0.2, 100))[0]
    assert saturated not in counts
    due = 0.8 * kind.range_gauss * kind.counts_per_gauss[axis]
    assert counts[axis] == pytest.approx(due, rel=0.003)  # an earlier strong field has no effect any more


@pytest.mark.parametrize("muxed", [True, False])
@pytest.mark.parametrize("kind", KINDS)
def test_stream_loses_no_sample_and_doubles_none(clock: Clock, kind: str, muxed: bool) -> None:
    """Read faster than the chips convert, each conversion arrives once, whatever each chip's clock does."""
    rate_hz = RATE_HZ[kind]
    addresses = CHIPS[kind].addresses if not muxed else (None,) * 4
    chips = [
        chip_of(clock, kind, clock_error=error, phase_s=1e-4 * number, address=address, noise_gauss=0.02, seed=number)
        for number, (error, address) in enumerate(zip((-0.03, 0.0, 0.01, 0.03), addresses, strict=False))
    ]
    pad, _ = emulated_pad(clock, kind, chips, rate_hz=rate_hz, muxed=muxed)
    run(pad, clock, 0.5, 2 * rate_hz)
    made = [chip.conversions for chip in chips]
    samples = run(pad, clock, 20.0, 2 * rate_hz, watch_s=1e9)
    taken = sum(np.array([sample.fresh >> number & 1 for number in range(len(chips))]) for sample in samples)
    # The first and the last may or may not fall into the time.
    assert np.abs(taken - (np.array([chip.conversions for chip in chips]) - made)).max() <= 1
    assert all(pad.sensors[number].state == SensorState.OK for number in range(len(chips)))
    assert (pad.bus_errors, pad.config_repairs) == (0, 0)


@pytest.mark.parametrize("rate_hz", [20, 75, 150, 220, 400, 900])
@pytest.mark.parametrize("kind", [kind for kind in KINDS if not CHIPS[kind].paced_by_host])
def test_chip_converts_at_the_slowest_rate_that_suffices(clock: Clock, kind: str, rate_hz: int) -> None:
    chip = CHIPS[kind]
    if rate_hz > chip.free_rate_hz:
        with pytest.raises(ValueError, match=f"{kind} delivers at most"):
            chip.output_rate_hz(rate_hz)
        return
    one = chip_of(clock, kind)
    emulated_pad(clock, kind, [one], rate_hz=rate_hz)[0].poll()
    clock.sleep(1.0)
    one.run()
    before = one.conversions
    clock.sleep(10.0)
    one.run()
    assert (one.conversions - before) / 10.0 == pytest.approx(chip.output_rate_hz(rate_hz), rel=0.02)  # whole hertz
    assert (one.conversions - before) / 10.0 >= rate_hz


@pytest.mark.parametrize("kind", [kind for kind in KINDS if CHIPS[kind].has_trigger])
def test_trigger_makes_every_sample_new_and_of_one_time(clock: Clock, kind: str) -> None:
    rate_hz = min(CHIPS[kind].single_rate_hz, 100)
    chips = [chip_of(clock, kind, clock_error=error) for error in (-0.04, 0.0, 0.04)]
    pad, _ = emulated_pad(clock, kind, chips, rate_hz=rate_hz, trigger=1)
    samples = run(pad, clock, 2.0, rate_hz)[3:]
    assert all(sample.fresh == sample.valid == 0b111 for sample in samples)
    assert all((sample.age_us == 0).all() for sample in samples)
    assert pad.bus_errors == 0


@pytest.mark.parametrize("kind", ["lis3mdl", "mlx90393"])
@pytest.mark.parametrize("temperature_c", [-10.0, 25.0, 60.0])
def test_temperature_is_the_data_sheets(clock: Clock, kind: str, temperature_c: float) -> None:
    one = chip_of(clock, kind)
    one.temperature_c = temperature_c
    pad, _ = emulated_pad(clock, kind, [one], rate_hz=100)
    sample = run(pad, clock, 1.0, 100)[-1]
    assert CHIPS[kind].temperature_c(sample.temperature_raw) == pytest.approx(temperature_c, abs=0.13)  # 1/8 °C a step


@pytest.mark.parametrize(
    ("kind", "per_k"),
    [
        ("qmc5883l", -5e-4),
        ("qmc5883p", -5e-4),
        ("lis3mdl", -3e-4),
        ("mmc5983ma", -2e-4),
        ("mmc5603nj", -2e-4),
        ("mlx90393", -3e-4),
    ],
)
def test_warmer_chip_counts_less_of_the_same_field(clock: Clock, kind: str, per_k: float) -> None:
    """If it is equal on all axes and chips, it looks like a weaker magnet, on which no pose depends."""
    one = chip_of(clock, kind)
    pad, _ = emulated_pad(clock, kind, [one], rate_hz=100)
    cold = last_counts(run(pad, clock, 1.0, 100))[0]
    one.temperature_c = 65.0
    warm = last_counts(run(pad, clock, 1.0, 100))[0]
    assert warm == pytest.approx(cold * (1.0 + 40.0 * per_k), abs=1.5), "each is rounded, or cut off"


@pytest.mark.parametrize("kind", KINDS)
def test_chip_that_was_reset_is_set_up_again_and_gives_no_wrong_number(clock: Clock, kind: str) -> None:
    one = chip_of(clock, kind)
    gain_code = len(CHIPS[kind].ranges_gauss) - 1
    pad, _ = emulated_pad(clock, kind, [one], gain_code=gain_code, rate_hz=100)
    good = last_counts(run(pad, clock, 0.5, 100))[0]
    for _ in range(5):
        one.power_on()
        samples = run(pad, clock, 1.5, 100)
        assert samples[-1].valid == 1
        assert samples[-1].fresh == 1 or samples[-2].fresh == 1
        shown = [sample.counts[0] for sample in samples if sample.valid]
        assert all(np.abs(counts - good).max() <= 1 for counts in shown)


@pytest.mark.parametrize("kind", KINDS)
def test_bus_error_costs_sample_and_three_sensor_until_it_answers(clock: Clock, kind: str) -> None:
    pad, bus = emulated_pad(clock, kind, [chip_of(clock, kind)], rate_hz=100)
    run(pad, clock, 0.3, 100)
    bus.error = OSError(5, "Input/output error")
    pad.poll()
    bus.error = None
    assert run(pad, clock, 0.1, 100)[-1].valid == 1
    bus.error = OSError(5, "Input/output error")
    for _ in range(4):
        pad.poll()
    assert pad.sensors[0].state == SensorState.NO_ANSWER
    assert pad.sample().valid == 0
    bus.error = None
    assert run(pad, clock, 1.0, 100)[-1].valid == 1


@pytest.mark.parametrize("kind", KINDS)
def test_chip_with_stopped_clock_gives_no_new_sample(clock: Clock, kind: str) -> None:
    one = chip_of(clock, kind)
    pad, _ = emulated_pad(clock, kind, [one], rate_hz=100)
    run(pad, clock, 0.3, 100)
    one.frozen = True
    samples = run(pad, clock, 0.2 if CHIPS[kind].paced_by_host else 0.6, 100, watch_s=1e9)
    assert pad.sensors[0].state == SensorState.NO_NEW_DATA
    assert not any(sample.fresh for sample in samples[2:])


@pytest.mark.parametrize("there", [*KINDS, "hmc5983"])
@pytest.mark.parametrize("configured", [*KINDS, "hmc5983"])
def test_another_chip_in_its_place_is_named(clock: Clock, configured: str, there: str) -> None:
    one = Hmc5983(clock, FIELD_GAUSS) if there == "hmc5983" else chip_of(clock, there)
    pad, _ = emulated_pad(clock, configured, [one], rate_hz=50)
    samples = run(pad, clock, 1.2, 50)
    sensor = pad.sensors[0]
    if there == configured:
        assert samples[-1].valid == 1
        return
    assert samples[-1].valid == 0
    assert sensor.state == SensorState.WRONG_IDENTIFICATION
    words = str(why_not(CHIPS[configured], sensor.identification))
    assert f"is {CHIPS[there].named}" in words
    assert words.endswith(f'not {CHIPS[configured].named}: set chip = "{there}"')


def test_each_chips_name_has_its_article() -> None:
    named = {chip.named for chip in CHIPS.values() if not chip.streamed}
    assert named == {
        "an HMC5983",
        "an HMC5883L",
        "an MMC5983MA",
        "an MMC5603NJ",
        "an MLX90393",
        "a QMC5883L",
        "a QMC5883P",
        "a LIS3MDL",
    }


def test_other_chip_is_named_with_its_address_where_it_has_one() -> None:
    qmc, hmc = CHIPS["qmc5883l"], CHIPS["hmc5983"]
    assert why_not(hmc, qmc.identity) == 'is a QMC5883L at 0x0D, not an HMC5983: set chip = "qmc5883l"'
    assert why_not(hmc, hmc.identity) is None
    assert "answers 01 02 03" in str(why_not(hmc, b"\x01\x02\x03"))


def test_chip_at_another_address_is_identified_by_registers(clock: Clock) -> None:
    """LIS3MDL and HMC5983 share 0x1E; MLX90393 and QMC5883L share 0x0D."""
    pad, _ = emulated_pad(clock, "hmc5983", [chip_of(clock, "lis3mdl", address=0x1E)], rate_hz=50)
    run(pad, clock, 0.5, 50)
    assert "is a LIS3MDL" in str(why_not(CHIPS["hmc5983"], pad.sensors[0].identification))
    pad, _ = emulated_pad(clock, "mlx90393", [chip_of(clock, "qmc5883l")], rate_hz=50, muxed=False)
    run(pad, clock, 0.5, 50)
    assert "is a QMC5883L at 0x0D" in str(why_not(CHIPS["mlx90393"], pad.sensors[0].identification))


@pytest.mark.parametrize("kind", [kind for kind in KINDS if CHIPS[kind].film is None])  # others cannot be read back
def test_chip_that_does_not_hold_what_is_written_is_not_used(clock: Clock, kind: str) -> None:
    one = chip_of(clock, kind)
    pad, bus = emulated_pad(clock, kind, [one], rate_hz=100)
    pad.select(pad.sensors[0])
    good = one.put

    def lossy(byte: int) -> None:
        good(byte & 0xF7)

    one.put = lossy
    assert not CHIPS[kind].driver.set_up(ChipWires(bus, one.address), CHIPS[kind], Setup(1, 100.0, False))


def test_factory_settings_of_the_mlx90393_stay_as_they_are(clock: Clock) -> None:
    one = chip_of(clock, "mlx90393")
    factory = one.values[0] & ~0x7F
    pad, _ = emulated_pad(clock, "mlx90393", [one], gain_code=4, rate_hz=100)
    run(pad, clock, 0.2, 100)
    assert one.values[0] == factory | 3 << 4 | 0x0C


def test_strong_magnet_leaves_nothing_in_the_mmc5983ma(clock: Clock) -> None:
    for trigger in (0, 1):
        one = chip_of(clock, "mmc5983ma")
        pad, _ = emulated_pad(clock, "mmc5983ma", [one], rate_hz=100, trigger=trigger)
        good = last_counts(run(pad, clock, 0.5, 100))[0]
        one.field_gauss = [30.0, 0.0, 0.0]
        run(pad, clock, 0.1, 100)
        assert one.film.upset
        one.field_gauss = list(FIELD_GAUSS)
        assert (last_counts(run(pad, clock, 0.1, 100))[0] == good).all()


@pytest.mark.parametrize("first", [0x0C, 0x10, 0x14, 0x18], ids=hex)
def test_scan_names_mlx90393_of_every_order_code_at_each_of_its_pins(clock: Clock, first: int) -> None:
    addresses = list(range(first, first + 4))
    _, bus = emulated_pad(
        clock, "mlx90393", [chip_of(clock, "mlx90393", address=one) for one in addresses], muxed=False
    )
    found = [(chip.name, where) for chip, where in chips_answering(bus)]  # type: ignore[arg-type]
    assert found == [("mlx90393", one) for one in addresses]
