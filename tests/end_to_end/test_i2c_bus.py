"""The I2C source with real smbus2 on an emulated kernel bus: its readings, and faults of chips and mux."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import pytest

from end_to_end.kernel_bus import KernelBus, all_valid, expected_counts, kernel_bus, pad, run
from fmfts.config import PadConfig
from fmfts.sensor import Frame
from fmfts.sensor.early import EarlySample

SLOW_RATE_HZ = 15  # a bus that is slow to emulate still has time for the two polls a frame that samples need


@pytest.fixture
def kernel() -> Iterator[KernelBus]:
    with kernel_bus() as bus:
        yield bus


@pytest.mark.real_time
def test_four_sensors_arrive_as_counts_with_age_freshness_and_temperature(kernel: KernelBus) -> None:
    kernel.chip(1, temperature_c=27.0)
    source = kernel.open(pad())
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
    assert np.median(ages) < 20_000  # a period of 13.3 ms and half a poll; single ones are late when the machine is
    fresh = np.mean([frame.fresh for frame in frames])
    assert fresh > 0.5  # chips at 75 Hz ± 3 % read at 75 Hz: nearly all, fewer on a slow machine
    assert kernel.report()["conflicts"] == 0
    assert source.state.sensor_faults == {}
    assert source.state.crc_errors == source.state.garbage_bytes == 0


@pytest.mark.real_time
def test_samples_come_before_their_frames_if_requested(kernel: KernelBus) -> None:
    source = kernel.open(pad(publish="sample", rate_hz=SLOW_RATE_HZ))
    early: list[EarlySample] = []
    held: set[tuple[int, int]] = set()

    def polled(frames: list[Frame]) -> bool:
        early.extend(one for _, one in source.take_early())
        # Two chips are off by 1 %: up to a hundred frames pass until a sample falls between two of these.
        return len(frames) > 50 and len(early) > 40 and len({one.sensor for one in early}) == 4

    for frame in run(source, polled):
        held |= {(sensor, int(time_us)) for sensor, time_us in enumerate(frame.sampled_us)}
    ours = [(one.sensor, one.device_time_us) for one in early]
    assert len(set(ours)) == len(ours)
    assert len(held.intersection(ours)) > 0.5 * len(ours)  # others were followed by a newer one in the same frame
    expected = expected_counts(gain_code=3)
    assert all(one.counts == tuple(expected[one.sensor]) for one in early)
    assert source.state.warnings == {}


def test_foreign_access_to_the_mux_gives_no_early_sample(kernel: KernelBus) -> None:
    source = kernel.open(pad(publish="sample", rate_hz=SLOW_RATE_HZ))
    early: list[EarlySample] = []

    def polled(frames: list[Frame]) -> bool:
        early.extend(one for _, one in source.take_early())
        return len(frames) > 30

    run(source, polled)
    for _ in range(20):
        kernel.order(mux=0, set={"control": 0x80, "pending": 0x80})
        run(source, lambda frames: polled(frames) or len(frames) > 2)
    expected = expected_counts(gain_code=3)
    assert early
    assert all(one.counts == tuple(expected[one.sensor]) for one in early)


def test_sample_after_the_callers_clock_look_is_not_older(kernel: KernelBus) -> None:
    source = kernel.open(pad())
    run(source, all_valid)
    looked_ns = time.monotonic_ns()
    frames = run(
        source, lambda frames: frames and frames[-1].device_time_us * 1000 > looked_ns, now_ns=lambda: looked_ns
    )
    assert frames[-1].host_time_ns > looked_ns


def test_change_of_range_discards_the_sample_with_the_old_gain(kernel: KernelBus) -> None:
    frames = run(kernel.open(pad(range_gauss=8.1)), lambda frames: sum(frame.valid.all() for frame in frames) > 20)
    seen = {tuple(frame.counts[frame.valid].ravel()) for frame in frames if frame.valid.all()}
    assert seen == {tuple(expected_counts(gain_code=7).astype(int).ravel())}


def test_simultaneous_conversions_share_one_time(kernel: KernelBus) -> None:
    source = kernel.open(pad(rate_hz=40, trigger="simultaneous"))
    frames = run(source, lambda frames: sum(frame.valid.all() and frame.fresh.all() for frame in frames) > 10)
    ready = [frame for frame in frames if frame.fresh.all()]
    assert all((frame.age_us == 0).all() for frame in ready)
    assert np.array_equal(ready[-1].counts, expected_counts(gain_code=3))
    assert kernel.report()["conflicts"] == 0


def test_saturated_axis_reads_overflow_without_other_effects(kernel: KernelBus) -> None:
    kernel.chip(2, field_gauss=[0.1, 5.0, 0.2])
    frame = run(kernel.open(pad()), all_valid)[-1]
    assert np.argwhere(frame.overflow).tolist() == [[2, 1]]
    assert np.isnan(frame.field_t).sum() == 1


def test_silent_sensor_does_not_affect_others_and_comes_back(kernel: KernelBus) -> None:
    source = kernel.open(pad())
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


def test_another_chip_is_named_by_its_answer(kernel: KernelBus) -> None:
    kernel.chip(0, identification="H44")
    source = kernel.open(pad())
    frames = run(source, lambda frames: frames and source.state.sensor_faults)
    frames = run(source, lambda frames: frames and frames[-1].valid[1:].all())
    assert "sensor 1 (mux 0x70, channel 0) answers 48 34 34" in source.state.sensor_faults[0, 0]
    assert not frames[-1].valid[0]


def test_silent_mux_is_blamed_instead_of_its_sensors(kernel: KernelBus) -> None:
    kernel.order(mux=0, set={"absent": True})
    source = kernel.open(pad())
    run(source, lambda frames: len(source.state.sensor_faults) == 4)
    assert all("the mux does not answer" in sentence for sentence in source.state.sensor_faults.values())


def test_corrupted_configuration_is_found_and_repaired(kernel: KernelBus) -> None:
    source = kernel.open(pad())
    run(source, all_valid)
    good = kernel.report()["registers"][1]
    damaged = kernel.report(chip=[0, 1], registers={"1": 0x20})
    assert damaged["registers"][1] != good
    run(source, lambda frames: dict(source.state.board.get("bus_0", {})).get("repairs") == 1)
    assert kernel.report()["registers"][1] == good
    run(source, all_valid)


def test_power_cycled_sensor_is_set_up_again(kernel: KernelBus) -> None:
    source = kernel.open(pad())
    run(source, all_valid)
    started = kernel.report(chip=[0, 3], call="power_on")
    assert started["registers"][3] == [0x10, 0x20, 0x01]
    run(source, lambda frames: kernel.report()["registers"][3][1] == 0x60)
    run(source, all_valid)


def test_chip_whose_clock_has_stopped_is_not_repeated_for_ever(kernel: KernelBus) -> None:
    source = kernel.open(pad())
    run(source, all_valid)
    kernel.chip(0, frozen=True)
    frames = run(source, lambda frames: frames and not frames[-1].valid[0])
    assert frames[-1].valid[1:].all()
    run(source, lambda frames: "delivers no new samples" in source.state.sensor_faults.get((0, 0), ""))


def test_other_program_on_the_mux_is_named_and_costs_the_frame(kernel: KernelBus) -> None:
    source = kernel.open(pad())
    run(source, all_valid)

    def interfered(_: list[Frame]) -> bool:
        kernel.order(mux=0, set={"control": 0x80, "pending": 0x80})
        return "bus" in source.state.warnings

    frames = run(source, interfered)
    assert any(not frame.valid.any() for frame in frames)
    assert "another program uses the mux" in source.state.warnings["bus"]
    run(source, all_valid)
    run(source, lambda frames: "bus" not in source.state.warnings)


def test_two_pads_on_one_bus_never_have_two_channels_open(kernel: KernelBus) -> None:
    source = kernel.open(pad("left"), pad("right", mux_address=0x71))
    frames = run(source, lambda frames: {f.pad_index for f in frames if f.valid.all()} == {0, 1} and len(frames) > 50)
    for mux in (0, 1):
        of_pad = [frame for frame in frames if frame.pad_index == mux and frame.valid.all()]
        assert all(np.array_equal(frame.counts, expected_counts(3, mux=mux)) for frame in of_pad)
    assert kernel.report()["conflicts"] == 0


def wide() -> PadConfig:
    """Sixteen sensors behind two muxes."""
    return pad(sensors=16, mux_addresses=(0x70,) * 8 + (0x71,) * 8, channels=(*range(8), *range(8)))


def test_sixteen_sensors_behind_two_muxes_make_one_frame() -> None:
    with kernel_bus("wide") as kernel:
        source = kernel.open(wide())
        last = run(source, lambda frames: len(frames) > 30 and all_valid(frames))[-1]
        assert np.array_equal(last.counts[:8], expected_counts(3, sensors=8, mux=0))
        assert np.array_equal(last.counts[8:], expected_counts(3, sensors=8, mux=1))
        assert source.state.board["pads"][0]["mux_addresses"] == ["0x70"] * 8 + ["0x71"] * 8  # type: ignore[index]
        kernel.chip(4, mux=1, absent=True)
        last = run(
            source, lambda frames: (0, 12) in source.state.sensor_faults and frames and not frames[-1].valid[12]
        )[-1]
        assert last.valid.sum() == 15
        assert source.state.sensor_faults[0, 12].startswith("sensor 13 (mux 0x71, channel 4) does not answer at 0x1E")
        kernel.chip(4, mux=1, absent=False)
        run(source, all_valid)
        assert kernel.report()["conflicts"] == 0
        assert source.state.crc_errors == source.state.garbage_bytes == 0


def test_sixteen_sensors_behind_two_muxes_are_tested_in_one_request() -> None:
    with kernel_bus("wide") as kernel:
        kernel.chip(7, mux=1, strap=0.1)
        source = kernel.open(wide())
        run(source, all_valid)
        source.request_selftest(0)
        run(source, lambda frames: source.selftest_result(0))
        sensors = source.selftest_result(0)["sensors"]
        assert [one["passed"] for one in sensors] == [True] * 15 + [False]
        assert "x: +45 and -45 counts" in sensors[15]["failures"][0]
        run(source, all_valid)


def test_selftest_measures_every_axis_and_streaming_goes_on(kernel: KernelBus) -> None:
    kernel.chip(0, gain=[1.04, 0.96, 1.0])
    kernel.chip(1, strap=0.1)
    kernel.chip(2, field_gauss=[0.0, 0.0, 6.0])
    source = kernel.open(pad())
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


def test_selftest_subtracts_the_field_that_a_chip_leaves_in(kernel: KernelBus) -> None:
    """The data sheet is ambiguous; 0.5 G outside is 195 counts, and would fail a good axis or pass a bad one."""
    for channel in range(4):
        kernel.chip(channel, field_gauss=[0.5, -0.5, 0.3], subtracts_field=channel % 2 == 0)
    kernel.chip(3, strap=0.1)
    source = kernel.open(pad())
    run(source, all_valid)
    source.request_selftest(0)
    run(source, lambda frames: source.selftest_result(0))
    *good, weak = source.selftest_result(0)["sensors"]
    assert [sensor["positive_counts"] for sensor in good] == [[452, 452, 421]] * 3
    assert [sensor["negative_counts"] for sensor in good] == [[-452, -452, -421]] * 3
    assert all(sensor["passed"] for sensor in good)
    assert "x: +45 and -45 counts" in weak["failures"][0]
