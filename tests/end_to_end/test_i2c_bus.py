"""The I2C source with real smbus2 on an emulated kernel bus: the reader process, and everything that befalls a bus."""

from __future__ import annotations

import json
import os
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from emulator.chips import LSB_PER_GAUSS
from fmfts.config import GeometryConfig, I2cSource, PadConfig
from fmfts.sensor import Frame, SourceError
from fmfts.sensor.i2c import I2c

SYSTEM_PYTHON = "/usr/bin/python3"
SERVER = Path(__file__).parents[1] / "emulator" / "i2c_kernel_bus.py"
PACKAGES = "umockdev, gir1.2-umockdev-1.0 and python3-gi"
PATIENCE_S = 20.0  # liveness on a busy machine; starting a reader takes half a second


def missing() -> bool:
    check = "import gi; gi.require_version('UMockdev', '1.0'); from gi.repository import UMockdev"
    libraries = list(Path("/usr/lib").glob("**/libumockdev-preload.so.0"))
    return not libraries or subprocess.run([SYSTEM_PYTHON, "-c", check], capture_output=True).returncode != 0


class KernelBus:
    """The server process; `order` changes what is on the bus."""

    def __init__(self) -> None:
        command = [SYSTEM_PYTHON, str(SERVER)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self.process.stdin
        assert self.process.stdout
        self.root = self.process.stdout.readline().strip()
        assert self.root, "the emulated bus did not start"

    def order(self, **what: object) -> str:
        assert self.process.stdin
        assert self.process.stdout
        self.process.stdin.write(json.dumps(what) + "\n")
        self.process.stdin.flush()
        return self.process.stdout.readline().strip()

    def chip(self, channel: int, mux: int = 0, **changes: object) -> None:
        assert self.order(chip=[mux, channel], set=changes) == "done"

    def report(self) -> dict:
        facts: dict = json.loads(self.order(report=True))
        return facts

    def stop(self) -> None:
        assert self.process.stdin
        self.process.stdin.close()
        self.process.wait(10)
        if self.process.stdout:
            self.process.stdout.close()


@pytest.fixture
def kernel(monkeypatch: pytest.MonkeyPatch) -> Iterator[KernelBus]:
    if missing():
        if os.environ.get("CI"):
            pytest.fail(f"this test needs {PACKAGES}")
        pytest.skip(f"needs {PACKAGES}")
    bus = KernelBus()
    monkeypatch.setenv("LD_PRELOAD", "libumockdev-preload.so.0")  # for the reader, our child; we run without
    monkeypatch.setenv("UMOCKDEV_DIR", bus.root)
    yield bus
    bus.stop()


def pad(name: str = "left", sensors: int = 4, **source: object) -> PadConfig:
    settings = {"bus": 7, "rate_hz": 75, "channels": tuple(range(sensors))} | source
    positions = tuple((float(i), 0.0, 0.0) for i in range(sensors))
    return PadConfig(name=name, source=I2cSource(**settings), geometry=GeometryConfig(sensors_mm=positions))  # type: ignore[arg-type]


@pytest.fixture
def opened() -> Iterator[Callable[..., I2c]]:
    sources: list[I2c] = []

    def open_pads(*pads: PadConfig) -> I2c:
        sources.append(I2c(dict(enumerate(pads))))
        return sources[-1]

    yield open_pads
    for source in sources:
        source.close()


def run(source: I2c, until: Callable[[list[Frame]], object]) -> list[Frame]:
    """Poll until the frames so far satisfy `until`; all of them."""
    frames: list[Frame] = []
    end = time.monotonic() + PATIENCE_S
    while not until(frames):
        assert time.monotonic() < end, f"still waiting: {source.state}, {len(frames)} frames"
        frames += source.poll(time.monotonic_ns())
        time.sleep(0.002)
    return frames


def all_valid(frames: list[Frame]) -> bool:
    return bool(frames) and bool(frames[-1].valid.all())


def expected_counts(gain_code: int, sensors: int = 4, mux: int = 0) -> np.ndarray:
    fields = [(0.1 * (c + 1), -0.05 * (c + 1), 0.3 + mux) for c in range(sensors)]
    return np.rint(np.array(fields) * LSB_PER_GAUSS[gain_code])


def test_four_sensors_arrive_as_counts_with_age_freshness_and_temperature(kernel: KernelBus, opened: Callable) -> None:
    kernel.chip(1, temperature_c=27.0)
    source = opened(pad())
    run(source, lambda frames: len(frames) > 150)
    frames = run(source, lambda frames: len(frames) > 75)
    last = frames[-1]
    assert np.array_equal(last.counts, expected_counts(gain_code=3))
    assert last.temperature_c == pytest.approx(25.5, abs=0.01)  # the mean of 25, 27, 25, 25
    assert last.gain_code == 3
    assert all(frame.valid.all() for frame in frames)
    assert [frame.sequence for frame in frames] == list(range(frames[0].sequence, frames[0].sequence + len(frames)))
    now_ns = time.monotonic_ns()
    assert all(frame.host_time_ns <= now_ns for frame in frames)
    ages = np.array([frame.age_us for frame in frames])
    assert (ages.min(axis=1) == 0).all()  # the newest defines the frame's time
    assert np.median(ages) < 20_000  # a period of 13.3 ms and half a look; single ones are late when the machine is
    fresh = np.mean([frame.fresh for frame in frames])
    assert fresh > 0.5  # chips at 75 Hz ± 3 % read at 75 Hz: nearly all, less on a machine that falls behind
    assert kernel.report()["conflicts"] == 0
    assert source.state.sensor_faults == {}
    assert source.state.crc_errors == source.state.garbage_bytes == 0


def test_a_change_of_range_discards_the_sample_with_the_old_gain(kernel: KernelBus, opened: Callable) -> None:
    frames = run(opened(pad(range_gauss=8.1)), lambda frames: sum(frame.valid.all() for frame in frames) > 20)
    seen = {tuple(frame.counts[frame.valid].ravel()) for frame in frames if frame.valid.all()}
    assert seen == {tuple(expected_counts(gain_code=7).astype(int).ravel())}


def test_simultaneous_conversions_share_one_time(kernel: KernelBus, opened: Callable) -> None:
    source = opened(pad(rate_hz=40, trigger="simultaneous"))
    frames = run(source, lambda frames: sum(frame.valid.all() for frame in frames) > 20)
    ready = [frame for frame in frames if frame.fresh.all()]
    assert len(ready) > 10
    assert all((frame.age_us == 0).all() for frame in ready)
    assert np.array_equal(ready[-1].counts, expected_counts(gain_code=3))
    assert kernel.report()["conflicts"] == 0


def test_a_saturated_axis_reads_overflow_and_nothing_else_suffers(kernel: KernelBus, opened: Callable) -> None:
    kernel.chip(2, field_gauss=[0.1, 5.0, 0.2])
    frame = run(opened(pad()), all_valid)[-1]
    assert np.argwhere(frame.overflow).tolist() == [[2, 1]]
    assert np.isnan(frame.field_t).sum() == 1


def test_one_sensor_that_does_not_answer_leaves_the_others_and_comes_back(kernel: KernelBus, opened: Callable) -> None:
    source = opened(pad())
    run(source, all_valid)
    kernel.chip(2, absent=True)
    frames = run(source, lambda frames: source.state.sensor_faults)
    assert source.state.sensor_faults == {
        (0, 2): "sensor 3 (mux 0x70, channel 2) does not answer at 0x1E: check SDA/SCL of that channel"
    }
    frames = run(source, lambda frames: len(frames) > 10)
    assert frames[-1].valid.tolist() == [True, True, False, True]
    assert frames[-1].counts[2].tolist() == [0, 0, 0]
    assert frames[-1].age_us[2] == 65535
    assert source.state.connected
    kernel.chip(2, absent=False)
    run(source, all_valid)
    run(source, lambda frames: not source.state.sensor_faults)


def test_another_chip_is_named_by_its_answer(kernel: KernelBus, opened: Callable) -> None:
    kernel.chip(0, identification="H44")
    source = opened(pad())
    frames = run(source, lambda frames: frames and source.state.sensor_faults)
    frames = run(source, lambda frames: frames and frames[-1].valid[1:].all())
    assert "sensor 1 (mux 0x70, channel 0) answers 48 34 34" in source.state.sensor_faults[0, 0]
    assert not frames[-1].valid[0]


def test_a_mux_that_does_not_answer_is_blamed_and_not_its_sensors(kernel: KernelBus, opened: Callable) -> None:
    kernel.order(mux=0, set={"absent": True})
    source = opened(pad())
    run(source, lambda frames: len(source.state.sensor_faults) == 4)
    assert all("the mux does not answer" in sentence for sentence in source.state.sensor_faults.values())


def test_a_corrupted_configuration_is_found_and_repaired(kernel: KernelBus, opened: Callable) -> None:
    source = opened(pad())
    run(source, all_valid)
    good = kernel.report()["registers"][1]
    kernel.order(chip=[0, 1], registers={"1": 0x20})
    assert kernel.report()["registers"][1] != good
    run(source, lambda frames: source.state.board["bus_0"]["repairs"] == 1)
    assert kernel.report()["registers"][1] == good
    run(source, all_valid)


def test_a_power_cycled_sensor_is_set_up_again(kernel: KernelBus, opened: Callable) -> None:
    source = opened(pad())
    run(source, all_valid)
    kernel.order(chip=[0, 3], call="power_on")
    assert kernel.report()["registers"][3] == [0x10, 0x20, 0x01]
    run(source, lambda frames: kernel.report()["registers"][3][1] == 0x60)
    run(source, all_valid)


def test_a_chip_whose_clock_has_stopped_is_not_repeated_for_ever(kernel: KernelBus, opened: Callable) -> None:
    source = opened(pad())
    run(source, all_valid)
    kernel.chip(0, frozen=True)
    frames = run(source, lambda frames: frames and not frames[-1].valid[0])
    assert frames[-1].valid[1:].all()
    run(source, lambda frames: "delivers no new samples" in source.state.sensor_faults.get((0, 0), ""))


def test_a_foreign_user_of_the_mux_costs_the_frame_and_is_named(kernel: KernelBus, opened: Callable) -> None:
    source = opened(pad())
    run(source, all_valid)

    def interfered(_: list[Frame]) -> bool:
        kernel.order(mux=0, set={"control": 0x80, "pending": 0x80})
        return "bus" in source.state.warnings

    frames = run(source, interfered)
    assert any(not frame.valid.any() for frame in frames)
    assert "another program uses the mux" in source.state.warnings["bus"]
    run(source, all_valid)
    run(source, lambda frames: "bus" not in source.state.warnings)


def test_a_mux_bound_by_the_kernel_is_named(kernel: KernelBus, opened: Callable) -> None:
    kernel.order(busy=[0x70])
    source = opened(pad())
    run(source, lambda frames: "bound by the kernel" in source.state.reason)
    assert "0x70 on /dev/i2c-7 is bound by the kernel:" in source.state.reason
    kernel.order(busy=[])
    run(source, all_valid)


def test_a_wedged_bus_blocks_nobody_says_where_it_hangs_and_recovers(kernel: KernelBus, opened: Callable) -> None:
    source = opened(pad())
    run(source, all_valid)
    kernel.order(block_s=60)
    longest_s = 0.0
    end = time.monotonic() + PATIENCE_S
    while "wedged" not in source.state.reason:
        assert time.monotonic() < end
        start = time.monotonic()
        source.poll(time.monotonic_ns())
        longest_s = max(longest_s, time.monotonic() - start)
        time.sleep(0.002)
    assert longest_s < 0.5  # a poll on a busy machine, against sixty seconds of the call
    assert not source.state.connected
    assert "/dev/i2c-7 is wedged for 0." in source.state.reason
    assert "(mux 0x70, channels 0b" in source.state.reason
    kernel.order(block_s=0)
    run(source, all_valid)
    assert source.state.reconnects == 1


def test_a_reader_that_dies_is_started_again(kernel: KernelBus, opened: Callable) -> None:
    source = opened(pad())
    run(source, all_valid)
    source._process.kill()
    run(source, lambda frames: not source.state.connected)
    assert source.state.reason == "its reader ended with code -9"
    run(source, all_valid)
    assert source.state.reconnects == 1


def test_a_second_reader_is_refused_with_the_firsts_pid(kernel: KernelBus, opened: Callable) -> None:
    first, second = opened(pad()), opened(pad())
    run(first, all_valid)
    run(second, lambda frames: "in use" in second.state.reason)
    assert f"/dev/i2c-7 is in use by process {first._process.pid} (" in second.state.reason
    first.close()
    run(second, all_valid)


def test_a_bus_that_is_absent_is_named(kernel: KernelBus, opened: Callable) -> None:
    source = opened(pad(bus=6))
    run(source, lambda frames: "/dev/i2c-6 does not exist" in source.state.reason)


def test_two_pads_on_one_bus_never_have_two_channels_open(kernel: KernelBus, opened: Callable) -> None:
    source = opened(pad("left"), pad("right", mux_address=0x71))
    frames = run(source, lambda frames: {f.pad_index for f in frames if f.valid.all()} == {0, 1} and len(frames) > 50)
    for mux in (0, 1):
        of_pad = [frame for frame in frames if frame.pad_index == mux and frame.valid.all()]
        assert all(np.array_equal(frame.counts, expected_counts(3, mux=mux)) for frame in of_pad)
    assert kernel.report()["conflicts"] == 0


def test_a_selftest_measures_every_axis_and_streaming_goes_on(kernel: KernelBus, opened: Callable) -> None:
    kernel.chip(0, gain=[1.04, 0.96, 1.0])
    kernel.chip(1, strap=0.1)
    kernel.chip(2, field_gauss=[0.0, 0.0, 6.0])
    source = opened(pad())
    run(source, lambda frames: frames and frames[-1].valid.all())
    source.request_selftest(0)
    run(source, lambda frames: source.selftest_result(0))
    result = source.selftest_result(0)
    assert result["passed"] is False
    first, weak, saturated, good = result["sensors"]
    assert first["passed"]
    assert first["gain_factor"] == pytest.approx([1.04, 0.96, 1.0], abs=2e-3)  # half a count of 420
    assert good["positive_counts"] == [452, 452, 421]
    assert good["negative_counts"] == [-452, -452, -421]
    assert "x: +45 and -45 counts" in weak["failures"][0]
    assert weak["gain_factor"] == [None, None, None]
    assert "z: saturated" in saturated["failures"][0]
    kernel.chip(2, field_gauss=[0.3, -0.15, 0.3])
    frame = run(source, lambda frames: len(frames) > 5 and all_valid(frames))[-1]
    assert frame.gain_code == 3
    assert np.array_equal(frame.counts[3], expected_counts(gain_code=3)[3])


def test_a_chip_that_leaves_the_field_in_its_selftest_is_judged_by_its_strap_alone(
    kernel: KernelBus, opened: Callable
) -> None:
    """The data sheet can be read both ways; 0.5 G outside is 195 counts, and would fail a good axis or pass a bad."""
    for channel in range(4):
        kernel.chip(channel, field_gauss=[0.5, -0.5, 0.3], subtracts_field=channel % 2 == 0)
    kernel.chip(3, strap=0.1)
    source = opened(pad())
    run(source, all_valid)
    source.request_selftest(0)
    run(source, lambda frames: source.selftest_result(0))
    *good, weak = source.selftest_result(0)["sensors"]
    assert [sensor["positive_counts"] for sensor in good] == [[452, 452, 421]] * 3
    assert [sensor["negative_counts"] for sensor in good] == [[-452, -452, -421]] * 3
    assert all(sensor["passed"] for sensor in good)
    assert "x: +45 and -45 counts" in weak["failures"][0]


def test_closing_ends_the_reader(kernel: KernelBus, opened: Callable) -> None:
    source = opened(pad())
    run(source, all_valid)
    pid = source._process.pid
    source.close()
    source.close()
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


@pytest.mark.parametrize(
    ("pads", "words"),
    [
        ([{"clock_hz": 100_000, "rate_hz": 220}], "4 sensors at 220 Hz are more than I2C bus 7 carries at 100000 Hz"),
        ([{"rate_hz": 160, "trigger": "simultaneous"}], "at most 127 Hz"),
        ([{"rate_hz": 200, "trigger": "simultaneous"}], "at most 160 Hz are possible"),
        ([{"rate_hz": 220, "chip": "hmc5883l"}], "at most 75 Hz are possible"),
        ([{"range_gauss": 3.0}], "no range of ±3.0 G"),
        ([{}, {}], "pads 'pad0' and 'pad1' both use channel 0 of mux 0x70"),
        ([{"channels": (0, 1, 1, 2)}], "every sensor needs a channel of its own"),
        ([{"channels": (0, 1, 2)}], "3 channels, but 4 places"),
        ([{"mux_address": 0x70 + i} for i in range(4)], "4 pads on one I2C bus"),
    ],
)
def test_what_cannot_work_is_refused_before_anything_is_opened(pads: list[dict], words: str) -> None:
    with pytest.raises(SourceError, match="pad") as refusal:
        I2c({index: pad(f"pad{index}", **options) for index, options in enumerate(pads)})
    assert words in str(refusal.value)


def test_three_pads_fit_on_one_bus_at_220_hz() -> None:
    I2c({index: pad(f"pad{index}", rate_hz=220, mux_address=0x70 + index) for index in range(3)}).close()
