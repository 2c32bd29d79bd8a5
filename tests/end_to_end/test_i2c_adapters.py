"""The kinds of I2C adapters in Linux, with real smbus2 on an emulated kernel bus: each reports what it refuses."""

from __future__ import annotations

import errno
import subprocess
import sys
from pathlib import Path

import pytest

from end_to_end.kernel_bus import all_valid, kernel_bus, pad, run
from end_to_end.processes import run_command
from fmfts.common import exit_codes

# The HMC5983's driver once asked for both in one call: status, and then the sample.
TWO_READS = """
import smbus2
write, read = smbus2.i2c_msg.write, smbus2.i2c_msg.read
messages = [write(0x1E, [9]), read(0x1E, 1), write(0x1E, [3]), read(0x1E, 6)]
with smbus2.SMBus("/dev/i2c-7") as bus:
    bus.i2c_rdwr(write(0x70, [1]))
    try:
        bus.i2c_rdwr(*messages)
    except OSError as error:
        print(error.strerror)
    else:
        print("accepted", len(bytes(messages[3])))
"""
PAD = '[[pad]]\nname = "left"\n[pad.source]\ntype = "i2c"\nbus = 7\n'
QMC = 'chip = "qmc5883l"\nrange_gauss = 8.0\n'


@pytest.mark.parametrize(
    ("adapter", "answer"),
    [("bcm2835", "Operation not supported"), ("designware", "accepted 6"), ("mcp2221", "Operation not supported")],
)
def test_transfer_with_two_reads_is_refused_on_a_raspberry_pi(adapter: str, answer: str) -> None:
    with kernel_bus(adapter=adapter):
        ended = subprocess.run([sys.executable, "-c", TWO_READS], capture_output=True, text=True, check=False)
    assert ended.stdout.strip() == answer, ended


def probed(folder: Path, source: str, *chips: object, adapter: str, clock_hz: int | None = None) -> tuple[int, str]:
    """The output of `probe`, and its exit code."""
    (folder / "pad.toml").write_text(PAD + source)
    with kernel_bus(*chips, adapter=adapter, clock_hz=clock_hz):
        ended = run_command("probe", "--config", folder / "pad.toml")
    assert "check SDA" not in ended.stdout
    assert "SCL held" not in ended.stdout
    return ended.returncode, ended.stdout


def test_probe_names_the_adapter(tmp_path: Path) -> None:
    code, said = probed(tmp_path, f"{QMC}rate_hz = 50\n", "qmc5883l", adapter="bcm2835")
    assert code == exit_codes.DONE, said
    assert "adapter: bcm2835 (i2c@7e804000), driver i2c-bcm2835" in said
    assert "faults: none" in said


def test_smbus_controller_is_refused_by_probe_and_init(tmp_path: Path) -> None:
    with kernel_bus(adapter="i801"):
        written = run_command("init", "--i2c", "7", "--config", tmp_path / "new.toml")
    assert written.returncode == exit_codes.UNAVAILABLE, written
    code, said = probed(tmp_path, "", adapter="i801")
    assert code == exit_codes.UNAVAILABLE, said
    for told in (written.stderr, said):
        assert "/dev/i2c-7 (SMBus I801 adapter at efa0, driver i801_smbus) is an SMBus controller" in told


def test_refused_transfer_blames_the_adapter_not_the_wires(tmp_path: Path) -> None:
    """An FT260 writes at most two bytes before it reads, and a register of an MLX90393 takes four."""
    source = 'chip = "mlx90393"\nrange_gauss = 132.0\nrate_hz = 50\nchannels = []\n'
    code, said = probed(tmp_path, source, "mlx90393", 12, 13, 14, 15, adapter="ft260")
    assert code == exit_codes.UNAVAILABLE, said
    refusal = "its adapter (FT260 usb-i2c bridge on hidraw0, driver ft260) refuses reading from 0x0c after writing 60"
    assert refusal in said
    assert "MLX90393 at 0x0C" in said  # the chip is there, but its adapter prevents reading it


def test_probe_says_what_a_usb_bridge_can_do(tmp_path: Path) -> None:
    code, said = probed(tmp_path, f"{QMC}rate_hz = 100\n", "qmc5883l", adapter="mcp2221")
    assert code == exit_codes.DONE, said
    assert "MCP2221 usb-i2c bridge, driver mcp2221, through USB: at most 25 frames/s of 4 sensors" in said
    assert (
        "rate_hz is 100, and each transfer of this adapter goes through USB, which carries at most 25 frames/s" in said
    )


def test_probe_warns_of_another_clock_and_init_writes_it(tmp_path: Path) -> None:
    code, said = probed(tmp_path, f"{QMC}rate_hz = 50\n", "qmc5883l", adapter="designware", clock_hz=100_000)
    assert code == exit_codes.DONE, said
    assert "the device tree says 100000 Hz for this bus, and [pad.source] clock_hz is 400000" in said
    with kernel_bus("mmc5983ma", clock_hz=100_000):
        assert run_command("init", "--i2c", "7", "--config", tmp_path / "new.toml").returncode == exit_codes.DONE
        again = run_command("probe", "--config", tmp_path / "new.toml")
    assert "faults: none" in again.stdout, again
    text = (tmp_path / "new.toml").read_text()
    assert "clock_hz = 100000 " in text
    checked = run_command("check-config", "--config", tmp_path / "new.toml")
    assert "left: I2C bus 7 carries 4 sensors at up to" in checked.stdout, checked
    rate_hz = next(line.split()[2] for line in text.splitlines() if line.startswith("rate_hz = "))
    assert f"{rate_hz} Hz (100 kHz)" in checked.stdout


def test_chip_that_is_unplugged_from_a_cp2112_does_not_answer() -> None:
    """For an address that nobody acknowledges, this adapter reports what others report for a stuck bus."""
    with kernel_bus("qmc5883l", adapter="cp2112") as kernel:
        source = kernel.open(pad(chip="qmc5883l", range_gauss=8.0, rate_hz=15))
        run(source, all_valid)
        kernel.chip(2, absent=True)
        run(source, lambda frames: source.state.sensor_faults)
        assert "sensor 3 (mux 0x70, channel 2) does not answer" in source.state.sensor_faults[0, 2]


def test_unplugged_bridge_is_reported_as_gone_and_comes_back() -> None:
    with kernel_bus("qmc5883l", adapter="mcp2221") as kernel:
        source = kernel.open(pad(chip="qmc5883l", range_gauss=8.0, rate_hz=15))
        run(source, all_valid)
        kernel.order(errno=errno.ENODEV)
        run(source, lambda frames: not source.state.connected)
        assert source.state.reason == (
            "/dev/i2c-7: its adapter (MCP2221 usb-i2c bridge, driver mcp2221) is gone: No such device. Plug it in again"
        )
        kernel.order(errno=0)
        run(source, all_valid)


@pytest.mark.real_time
def test_usb_bridge_carries_no_more_than_probe_says() -> None:
    with kernel_bus("qmc5883l", adapter="mcp2221") as kernel:
        source = kernel.open(pad(chip="qmc5883l", range_gauss=8.0, rate_hz=100))
        run(source, all_valid)
        frames = run(source, lambda frames: len(frames) > 40)
        measured_hz = (len(frames) - 1) * 1e6 / (frames[-1].device_time_us - frames[0].device_time_us)
        assert measured_hz < 26  # `probe` says 25
