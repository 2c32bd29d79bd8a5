"""The rates of docs/i2c-adapters.md, and what the checks and `check-config` say of the clock of an I2C bus."""

from __future__ import annotations

from pathlib import Path

import pytest

from fmfts.config import GeometryConfig, I2cSource, PadConfig
from fmfts.config.i2c_checks import of_buses, of_pad, rates_carried
from fmfts.sensor.chips import CHIPS
from fmfts.sensor.chips.rates import BusLoad, i2c_rate_hz
from fmfts.sensor.i2c.adapter import USB_S, Adapter

PAGE = (Path(__file__).parents[2] / "docs" / "i2c-adapters.md").read_text()


@pytest.mark.parametrize("chip", [chip for chip in CHIPS.values() if not chip.streamed], ids=lambda chip: chip.name)
def test_page_has_the_rates_of_each_chip(chip: object) -> None:
    muxed = len(chip.addresses) < 4  # type: ignore[attr-defined]
    clocks_hz = (100_000, 400_000) if muxed else (100_000, 400_000, 1_000_000)
    rates = [str(i2c_rate_hz(chip, "free", clock_hz, BusLoad(4, 1, muxed))) for clock_hz in clocks_hz]  # type: ignore[arg-type]
    where = "behind a mux" if muxed else "without one"
    row = f"| {chip.label}, {where} | {' | '.join(rates)} |"  # type: ignore[attr-defined]
    assert row + (" |" if muxed else "") in PAGE


def test_page_has_the_rates_of_usb_bridges() -> None:
    def rates(load: BusLoad) -> list[int | None]:
        return [Adapter(driver=driver, is_usb=True).highest_rate_hz(load) for driver in USB_S]

    muxed, direct = rates(BusLoad(4, 1)), rates(BusLoad(4, 1, muxed=False))
    page = PAGE.replace("\n", " ")
    assert f"at most {muxed[0]}, {muxed[1]} and {muxed[2]} frames/s" in page
    assert f"without a mux {direct[0]}, not at all (FT260), and {direct[2]}" in page


def made(name: str, sensors: int = 4, **source: object) -> PadConfig:
    places = tuple((float(10 * number), 0.0, 0.0) for number in range(sensors))
    settings = {"bus": 1, "chip": "qmc5883l", "range_gauss": 8.0, "rate_hz": 50} | source
    return PadConfig(name=name, source=I2cSource(**settings), geometry=GeometryConfig(sensors_mm=places))  # type: ignore[arg-type]


def carried(*pads: PadConfig) -> str:
    assert isinstance(pads[0].source, I2cSource)
    return rates_carried(pads, pads[0].source)


def test_check_config_says_what_all_pads_of_a_bus_can_have() -> None:
    one, other = made("left", chip="lis3mdl"), made("right", chip="lis3mdl", channels=(4, 5, 6, 7))
    assert carried(one) == "I2C bus 1 carries 4 sensors at up to 211 Hz (100 kHz), 847 Hz (400 kHz)"
    # 8 sensors of 93 and 20 bits, and 2 times 20 to read the mux back: 944 bits.
    assert carried(one, other) == "I2C bus 1 carries 8 sensors at up to 105 Hz (100 kHz), 423 Hz (400 kHz)"
    assert carried(one, made("right", bus=2)) == carried(one)


def two_pads(**source: object) -> list[PadConfig]:
    """On one bus, behind one mux."""
    wired = {"left": (0, 1, 2, 3), "right": (4, 5, 6, 7)}
    return [made(name, 4, chip="mmc5983ma", channels=channels, **source) for name, channels in wired.items()]


def test_two_pads_on_a_bus_are_both_named_with_the_rates_that_it_carries() -> None:
    pads = two_pads(trigger="simultaneous", rate_hz=None)
    assert list(of_buses(pads[:1])) == []
    ((path, text),) = of_buses(pads)
    assert path == ("pad", 1, "source", "rate_hz")
    assert text == (
        'at most 185: more than bus 1 can carry, 8 sensors with trigger = "simultaneous" and clock_hz = 400000: 220 Hz '
        "is too much for all its pads; set rate_hz = 185 in pads 'left' and 'right', "
        'or trigger = "free" (at most 282 Hz)'
    )
    assert list(of_buses(two_pads(trigger="simultaneous", rate_hz=185))) == []
    assert list(of_buses(two_pads(rate_hz=282))) == []
    three = [*pads, made("thumb", chip="mmc5983ma", trigger="simultaneous", rate_hz=None, mux_address=0x71)]
    ((path, text),) = of_buses(three)
    assert path[1] == 2
    assert "in pads 'left' and 'right' and 'thumb'" in text


def test_fastest_clock_is_said_only_without_a_mux() -> None:
    direct = made("left", chip="mlx90393", range_gauss=132.0, channels=())
    assert carried(direct) == "I2C bus 1 carries 4 sensors at up to 225 Hz (100 kHz), 475 Hz (400 kHz), 475 Hz (1 MHz)"


def test_clock_above_400_khz_is_refused_with_a_mux_alone() -> None:
    muxed, direct = made("left", clock_hz=1_000_000), made("left", chip="mlx90393", clock_hz=1_000_000, channels=())
    assert isinstance(muxed.source, I2cSource)
    assert isinstance(direct.source, I2cSource)
    assert list(of_pad(muxed.source, 4)) == [
        (("source", "clock_hz"), "at most 400000 with a TCA9548A; more only without a mux")
    ]
    assert list(of_pad(direct.source, 4)) == []
