"""Chips beside the HMC5983 with real smbus2 on an emulated kernel bus, with and without a mux, to a contact."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from end_to_end.kernel_bus import KernelBus, all_valid, kernel_bus, pad, run
from end_to_end.processes import RunningDaemon, run_command
from fmfts.common import exit_codes
from fmfts.config import I2cSource
from fmfts.config.file import load
from fmfts.sensor.chips import CHIPS, TESLA_PER_GAUSS
from fmfts.sensor.i2c.source import I2c
from fmfts_simulation.mounted import MountedPad

# Rate, range, and addresses without a mux; if there are none, the chips are behind a mux.
WIRED: dict[str, dict[str, Any]] = {
    "mlx90393": {"rate_hz": 220, "range_gauss": 132.0, "channels": (), "addresses": (0x0C, 0x0D, 0x0E, 0x0F)},
    "lis3mdl": {"rate_hz": 150, "range_gauss": 4.0, "channels": (), "addresses": (0x1C, 0x1E)},
    "qmc5883l": {"rate_hz": 200, "range_gauss": 8.0},
    "qmc5883p": {"rate_hz": 200, "range_gauss": 8.0},
    "mmc5983ma": {"rate_hz": 220, "range_gauss": 8.0},
    "mmc5603nj": {"rate_hz": 220, "range_gauss": 30.0},
}


@contextmanager
def wired(chip: str, **options: Any) -> Iterator[tuple[KernelBus, I2c]]:
    settings = WIRED[chip] | options
    sensors = len(settings.get("addresses", range(4)))
    with kernel_bus(chip, *settings.get("addresses", ())) as kernel:
        yield kernel, kernel.open(pad(sensors=sensors, **{"chip": chip, "channels": tuple(range(sensors))} | settings))


PULSE_ZERO_T = 5e-7  # five deviations of the zero that a set pulse leaves: 1 mG (MMC5983MA, data sheet page 2)


@pytest.mark.parametrize("chip", WIRED)
def test_every_chip_arrives_as_a_field(chip: str) -> None:
    with wired(chip) as (kernel, source):
        frame = run(source, all_valid)[-1]
        sensors = len(frame.valid)
        due = np.array([(0.1 * (c + 1), -0.05 * (c + 1), 0.3) for c in range(sensors)]) * TESLA_PER_GAUSS
        assert frame.chip is CHIPS[chip]
        scatter_t = PULSE_ZERO_T if CHIPS[chip].film else 0.0
        assert frame.field_t == pytest.approx(due, abs=frame.chip.step_t[frame.gain_code].max() + scatter_t)
        # Frames that a busy computer delays come soon after one another, and then hold no new sample.
        assert any(
            np.mean([frame.fresh for frame in run(source, lambda frames: len(frames) > 60)]) > 0.5 for _ in range(10)
        )
        assert kernel.report()["conflicts"] == 0
        assert source.state.sensor_faults == {}
        if CHIPS[chip].thermometer is not None:
            run(source, lambda frames: frames and frames[-1].temperature_c == pytest.approx(25.0, abs=0.2))


def test_silent_chip_without_a_mux_is_named_by_its_address() -> None:
    with wired("mlx90393") as (kernel, source):
        run(source, all_valid)
        assert kernel.order(direct=2, set={"absent": True}) == "done"
        run(source, lambda frames: source.state.sensor_faults)
        assert source.state.sensor_faults == {
            (0, 2): "sensor 3 (at 0x0e) does not answer: check its supply, SDA, SCL and address pins "
            "(two chips at one address spoil each other)"
        }
        assert run(source, lambda frames: len(frames) > 5)[-1].valid.tolist() == [True, True, False, True]
        assert kernel.order(direct=2, set={"absent": False}) == "done"
        run(source, all_valid)
        run(source, lambda frames: not source.state.sensor_faults)


def test_chip_sold_as_another_is_named_with_what_to_set() -> None:
    with kernel_bus("qmc5883l") as kernel:
        source = kernel.open(pad())
        run(source, lambda frames: len(source.state.sensor_faults) == 4)
        assert source.state.sensor_faults[0, 1] == (
            'sensor 2 (mux 0x70, channel 1) is a QMC5883L at 0x0D, not an HMC5983: set chip = "qmc5883l"'
        )


def test_saturated_axis_of_another_chip_is_flagged_alone() -> None:
    with wired("qmc5883l") as (kernel, source):
        run(source, all_valid)
        kernel.chip(2, field_gauss=[0.1, 12.0, 0.2])
        frames = run(source, lambda frames: frames and frames[-1].overflow.any())
        assert np.argwhere(frames[-1].overflow).tolist() == [[2, 1]]


def test_chip_that_was_power_cycled_is_set_up_again() -> None:
    with wired("mlx90393") as (kernel, source):
        run(source, all_valid)
        assert kernel.order(direct=0, call="power_on") == "done"
        run(source, lambda frames: any(not frame.fresh[0] for frame in frames))
        run(source, lambda frames: all_valid(frames) and frames[-1].fresh[0])


# The silicone and the finger are the model's own: the errors of others have tests of their own.
CONTACT_CONFIG = """
[[pad]]
name = "left"
[pad.source]
type = "i2c"
bus = 7
chip = "{chip}"
rate_hz = {rate_hz}
range_gauss = {range_gauss}
channels = {channels}
[pad.tolerance]
modulus = 0.0
thickness_mm = 0.0
[pad.contact]
finger_mm = [6.0, 6.0]
"""
FORCE_N, PRESSED_MM = 1.0, (3.0, -2.0)


@pytest.mark.parametrize(("chip", "rate_hz", "muxed"), [("mlx90393", 130, False), ("qmc5883l", 100, True)])
def test_press_on_a_pad_of_other_chips_becomes_a_contact(chip: str, rate_hz: int, muxed: bool, tmp_path: Path) -> None:
    """From registers to place and force: the daemon, its baseline and its messages, as with the first chip."""
    addresses = () if muxed else CHIPS[chip].addresses[:4]
    noise_gauss = CHIPS[chip].noise_at_t(rate_hz, "free") / TESLA_PER_GAUSS
    config = CONTACT_CONFIG.format(
        chip=chip,
        rate_hz=rate_hz,
        range_gauss=CHIPS[chip].ranges_gauss[-1 if muxed else 0],
        channels=[0, 1, 2, 3] if muxed else [],
    )
    with kernel_bus(chip, *addresses) as kernel, RunningDaemon(tmp_path, config) as daemon:
        mounted = MountedPad.exact(load(daemon.config)[0].pad[0].pad())

        def press(force_n: float) -> None:
            places = [np.full(4, value) for value in (PRESSED_MM[0] * 1e-3, PRESSED_MM[1] * 1e-3, force_n, 0.0, 0.0)]
            field_gauss = mounted.magnet_field(*places) / TESLA_PER_GAUSS
            for number, field in enumerate(field_gauss):
                changes = {"field_gauss": field.tolist(), "noise_gauss": noise_gauss}
                assert kernel.order(**{"chip": [0, number]} if muxed else {"direct": number}, set=changes) == "done"

        press(0.0)
        daemon.wait_for(lambda contact: contact.health == "no_baseline" and contact.sensors_ok == 0b1111)
        assert daemon.request("baseline", pad="left", rest=True, timeout_s=60.0)["kind"] == "rest"
        quiet = daemon.wait_for(lambda contact: contact.health == "ok")
        assert quiet.contact is False
        press(FORCE_N)
        settled_ns = time.monotonic_ns() + 500_000_000  # the chips' fields change one after another
        felt = daemon.wait_for(lambda contact: contact.t_sample_ns > settled_ns and contact.health == "ok")
        assert felt.contact
        # Deviations include the noise and the baseline's remaining errors; five of them, of one message.
        assert abs(felt.force_n - FORCE_N) < 5 * felt.force_sd_n
        assert abs(felt.x_m - PRESSED_MM[0] * 1e-3) < 5 * felt.x_sd_m
        assert abs(felt.y_m - PRESSED_MM[1] * 1e-3) < 5 * felt.y_sd_m
        # A frame's own noise widens its deviation; of one in twenty it is above this.
        pressed = [daemon.wait_for(lambda contact: contact.health == "ok") for _ in range(50)]
        assert np.median([contact.force_sd_n for contact in pressed]) < 0.2 * FORCE_N


def test_probe_names_devices_on_bus_when_pad_has_faults(tmp_path: Path) -> None:
    config = tmp_path / "pad.toml"
    config.write_text('[[pad]]\nname = "left"\n[pad.source]\ntype = "i2c"\nbus = 7\n')
    with kernel_bus("qmc5883l"):
        ended = run_command("probe", "--config", config)
        recorded = run_command("baseline", "--rest", "--config", config)
    assert ended.returncode == exit_codes.FAULTY, ended
    cause = 'sensor 1 (mux 0x70, channel 0) is a QMC5883L at 0x0D, not an HMC5983: set chip = "qmc5883l"'
    assert cause in ended.stdout
    assert f"no frame within 3 s: {cause}" in recorded.stderr
    for channel in range(4):
        assert f"QMC5883L at 0x0D, mux 0x70, channel {channel}" in ended.stdout


def test_qmc5883p_is_named_but_no_other_device_at_its_address(tmp_path: Path) -> None:
    """A digital potentiometer at 0x2C answers every read with 0x80, even that of the identification."""
    config = tmp_path / "pad.toml"
    source = 'type = "i2c"\nbus = 7\nchip = "qmc5883l"\nrate_hz = 200\nrange_gauss = 8.0\n'
    config.write_text(f'[[pad]]\nname = "left"\n[pad.source]\n{source}')
    with kernel_bus("qmc5883p") as kernel:
        kernel.order(chip=[0, 3], registers={0x0B: 0x80})
        probed = run_command("probe", "--config", config)
        written = run_command("init", "--i2c", "7", "--config", tmp_path / "new.toml")
    assert probed.returncode == exit_codes.FAULTY, probed
    for channel in range(3):
        where = f"sensor {channel + 1} (mux 0x70, channel {channel})"
        assert f'{where} is a QMC5883P at 0x2C, not a QMC5883L: set chip = "qmc5883p"' in probed.stdout
    assert "sensor 4 (mux 0x70, channel 3) does not answer" in probed.stdout
    assert "QMC5883P at 0x2C, mux 0x70, channel 3" not in probed.stdout
    assert written.returncode == 0, written
    new = (tmp_path / "new.toml").read_text()
    assert 'chip = "qmc5883p"' in new
    assert "channels = [0, 1, 2]" in new


@pytest.mark.parametrize("chip", ["mlx90393", "lis3mdl", "mmc5983ma"])
def test_init_writes_the_chips_that_it_finds_and_their_pad_runs(chip: str, tmp_path: Path) -> None:
    addresses = WIRED[chip].get("addresses", ())
    with kernel_bus(chip, *addresses):
        written = run_command("init", "--i2c", "7", "--config", tmp_path / "pad.toml")
        assert written.returncode == 0, written
        if len(addresses) == 2:  # two chips are no pad, so the command asks for their places
            assert "FILL IN" in (tmp_path / "pad.toml").read_text()
            return
        checked = run_command("check-config", "--config", tmp_path / "pad.toml")
        assert checked.returncode == 0, checked
        probed = run_command("probe", "--config", tmp_path / "pad.toml")
    assert probed.returncode == 0, probed
    source = load(tmp_path / "pad.toml")[0].pad[0].source
    assert isinstance(source, I2cSource)
    assert (source.chip, source.addresses) == (chip, addresses)
    assert bool(source.channels) is not bool(addresses)


def test_init_reports_chips_behind_two_muxes_apart(tmp_path: Path) -> None:
    with kernel_bus():
        written = run_command("init", "--i2c", "7", "--config", tmp_path / "pad.toml")
        assert written.returncode == 0, written
    pads = load(tmp_path / "pad.toml")[0].pad
    assert [(pad.source.mux_address, pad.source.channels) for pad in pads] == [
        (0x70, (0, 1, 2, 3)),
        (0x71, (0, 1, 2, 3)),
    ]


def test_init_on_a_bus_that_is_held_says_in_which_call_it_hangs(tmp_path: Path) -> None:
    with kernel_bus() as kernel:
        kernel.order(block_s=60)
        hung = run_command("init", "--i2c", "7", "--config", tmp_path / "pad.toml")
        kernel.order(block_s=0)
    assert hung.returncode == exit_codes.UNAVAILABLE, hung
    assert "no pad found: /dev/i2c-7 hangs in writing 08 to 0x70" in hung.stderr
    assert "look for SDA or SCL held low" in hung.stderr


def test_selftest_of_lis3mdl_names_broken_axis_and_streaming_goes_on() -> None:
    with wired("lis3mdl") as (kernel, source):
        run(source, all_valid)
        assert "self_test" not in source.state.board  # there is one
        assert kernel.order(direct=1, set={"own_field_gauss": [2.0, 0.2, 0.5]}) == "done"
        source.request_selftest(0)
        run(source, lambda frames: source.selftest_result(0))
        result = source.selftest_result(0)
        good, broken = result["sensors"]
        assert (good["passed"], broken["passed"], result["passed"]) == (True, False, False)
        assert broken["failures"] == [
            "y: +456 counts of the chip's own field, where 2281 to 6843 are due: the chip is damaged"
        ]
        assert good["gain_factor"] == [None, None, None]
        assert run(source, all_valid)[-1].gain_code == 0


def test_selftest_fails_a_lost_chip_only_while_it_is_silent() -> None:
    with wired("mmc5983ma", trigger="simultaneous") as (kernel, source):
        run(source, all_valid)
        kernel.chip(1, absent=True)
        kernel.chip(3, absent=True)
        run(source, lambda frames: frames and not frames[-1].valid[[1, 3]].any())
        kernel.chip(3, absent=False)
        source.request_selftest(0)
        run(source, lambda frames: source.selftest_result(0))
        result = source.selftest_result(0)
        assert [sensor["passed"] for sensor in result.get("sensors", [])] == [True, False, True, True], result


def test_mmc5983ma_selftest_reports_zeros_and_names_a_large_one() -> None:
    with wired("mmc5983ma", trigger="simultaneous") as (kernel, source):
        run(source, all_valid)
        assert "self_test" not in source.state.board  # there is one
        kernel.chip(0, zero_gauss=[0.25, 0.0, -0.125])
        kernel.chip(2, zero_gauss=[0.0, 0.75, 0.0])
        source.request_selftest(0)
        run(source, lambda frames: source.selftest_result(0))
        result = source.selftest_result(0)
        assert [sensor["passed"] for sensor in result["sensors"]] == [True, True, False, True]
        # The chip's z axis is reversed.
        assert result["sensors"][0]["zero_t"] == pytest.approx([25e-6, 0.0, 12.5e-6], abs=PULSE_ZERO_T)
        (reason,) = result["sensors"][2]["failures"]
        assert reason.startswith("y: its zero is +75.0 µT, where ±50 are due: magnetised, or broken:")
        assert run(source, all_valid)[-1].field_t[0] == pytest.approx([35e-6, -5e-6, 42.5e-6], abs=PULSE_ZERO_T)
