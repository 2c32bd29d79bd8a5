"""Every fault of a bench, with the firmware's ELF on the emulated chip: it reports the fault, and recovers.

A failed sensor is tried again after 50 ms, then after twice that, up to 0.8 s; so recovery may take a second, and most
faults last only some tenths of a second.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from emulated_stream import EVERYONE, EmulatedStream

from fmfts.sensor.wire.framing import encode
from fmfts.sensor.wire.packets import ALL_PADS, Hello, Request, Result, Sample, SensorState, Status, Verb

RECOVERY_S = 1.0
FAULT_S = 0.3
SATURATED = -4096
SOFTWARE, WATCHDOG = 3, 4
HSI = 2
FIELD_T = np.array([[10, -20, 100], [11, -21, 101], [12, -22, 102], [13, -23, 103]]) * 1e-6

pytestmark = pytest.mark.needs("arm-none-eabi-gcc")


@pytest.fixture
def stream() -> EmulatedStream:
    """Streaming, all sensors valid, nothing wrong yet."""
    stream = EmulatedStream()
    stream.board.set_field(0, FIELD_T)
    stream.run(0.3)
    assert is_right(stream.latest(Sample))
    return stream


def is_right(sample: Sample, sensors: int = EVERYONE) -> bool:
    expected = np.round(FIELD_T * 1e4 * 660)
    return sample.valid == sensors and all(
        np.array_equal(sample.counts[i], expected[i]) for i in range(4) if sensors >> i & 1
    )


def assert_stream_is_right(stream: EmulatedStream, within_s: float = RECOVERY_S) -> None:
    """Within this time all four recover, and from then on nothing is missing or wrong."""
    stream.wait(lambda packet: isinstance(packet, Sample) and packet.valid == EVERYONE, within_s)
    samples = stream.samples(0.2)
    assert len(samples) >= 43
    assert all(is_right(sample) for sample in samples)
    assert stream.is_clean()


def test_unplugged_sensor_is_reported_and_found_among_others(stream: EmulatedStream) -> None:
    stream.board.unplug(0, 2)
    status = stream.wait_for_status(lambda status: status.pads[0].states[2] == SensorState.NO_ANSWER, 0.1)
    assert status.pads[0].states == (0, 0, SensorState.NO_ANSWER, 0)
    assert status.pads[0].bus_errors >= 3
    samples = stream.samples(FAULT_S)
    assert len(samples) >= 65
    assert all(is_right(sample, 0b1011) for sample in samples)
    stream.board.replug(0, 2)
    assert_stream_is_right(stream)
    assert stream.wait_for_status(lambda status: not any(status.pads[0].states))


def test_unplugged_mux_is_reported_and_found_again(stream: EmulatedStream) -> None:
    stream.board.unplug_mux(0)
    status = stream.wait_for_status(lambda status: status.pads[0].states[0] == SensorState.MUX_SILENT, 0.2)
    assert status.pads[0].states == (SensorState.MUX_SILENT,) * 4
    stream.run(FAULT_S)
    assert stream.latest(Sample).valid == 0
    stream.board.unplug_mux(0, absent=False)
    assert_stream_is_right(stream)


@pytest.mark.parametrize("sensor", [None, 1])
def test_sda_held_for_a_few_clocks_is_clocked_free(stream: EmulatedStream, sensor: int | None) -> None:
    recoveries = stream.status.pads[0].bus_recoveries
    while not stream.board.bus_is_idle(0):  # in the middle of a byte only that byte's bits would be affected
        stream.run(10e-6)
    stream.board.hold_sda(0, clocks=5, sensor=sensor)
    assert_stream_is_right(stream)
    status = stream.wait_for_status(lambda status: status.pads[0].bus_recoveries > recoveries)
    assert status.pads[0].bus_errors


def test_sda_held_for_ever_is_reported_as_a_stuck_bus(stream: EmulatedStream) -> None:
    stream.board.hold_sda(0)
    status = stream.wait_for_status(lambda status: status.pads[0].states[0] == SensorState.BUS_STUCK, 0.2)
    assert status.pads[0].states == (SensorState.BUS_STUCK,) * 4
    stream.run(FAULT_S)
    assert stream.latest(Sample).valid == 0
    stream.board.release_sda(0)
    assert_stream_is_right(stream)


def test_sensor_that_holds_sda_for_ever_does_not_stop_other_three(stream: EmulatedStream) -> None:
    stream.board.hold_sda(0, sensor=1)
    stream.run(FAULT_S)
    stream.request(Verb.STATUS)
    stream.run(0.05)
    states = stream.status.pads[0].states
    assert states[1] in (SensorState.NO_ANSWER, SensorState.BUS_STUCK)
    assert (states[0], states[2], states[3]) == (0, 0, 0)
    samples = stream.samples(RECOVERY_S)
    # Each new attempt on the wedged channel costs only a recovery of the bus.
    assert sum(is_right(sample, 0b1101) for sample in samples) >= 0.9 * len(samples)
    assert len(samples) >= 215
    stream.board.release_sda(0)
    assert_stream_is_right(stream)


def test_busy_flag_that_is_stuck_is_cleared_as_errata_sheet_says(stream: EmulatedStream) -> None:
    recoveries = stream.status.pads[0].bus_recoveries
    stream.board.latch_busy(0)
    assert_stream_is_right(stream)
    assert stream.wait_for_status(lambda status: status.pads[0].bus_recoveries > recoveries)


@pytest.mark.parametrize("identification", [b"H44", b"\0\0\0"])
def test_foreign_chip_is_reported_and_never_used(stream: EmulatedStream, identification: bytes) -> None:
    stream.board.replace(0, 3, identification)
    stream.wait_for_status(lambda status: status.pads[0].states[3] == SensorState.WRONG_IDENTIFICATION, 1.0)
    samples = stream.samples(FAULT_S)
    assert all(is_right(sample, 0b0111) for sample in samples)
    stream.request(Verb.HELLO)
    stream.run(0.02)
    assert stream.hello.pads[0].sensors[3].identification == identification
    stream.board.unplug(0, 3)
    stream.board.replug(0, 3)
    assert_stream_is_right(stream)


@pytest.mark.parametrize(("register", "flip"), [(0, 0x04), (1, 0x60)], ids=["rate", "range"])
def test_corrupted_configuration_is_repaired_and_counted(stream: EmulatedStream, register: int, flip: int) -> None:
    stream.board.corrupt(0, 0, register, flip)
    stream.wait_for_status(lambda status: status.pads[0].config_repairs == 1, 1.5)
    assert_stream_is_right(stream)


def test_sensor_that_fell_idle_is_reported_and_configured_anew(stream: EmulatedStream) -> None:
    stream.board.corrupt(0, 0, register=2, flip=2)
    stream.wait_for_status(lambda status: status.pads[0].states[0] == SensorState.NO_NEW_DATA, 0.2)
    assert_stream_is_right(stream)


def test_saturated_axis_is_sent_as_such_and_the_rest_is_right(stream: EmulatedStream) -> None:
    stream.board.saturate(0, 1, axis=2)
    samples = stream.samples(FAULT_S)
    assert samples[-1].counts[1].tolist() == [*np.round(FIELD_T[1, :2] * 1e4 * 660), SATURATED]
    assert all(sample.valid == EVERYONE for sample in samples)
    stream.board.replug(0, 1)
    stream.run(0.02)
    assert_stream_is_right(stream)


@pytest.mark.parametrize("interrupts", [True, False], ids=["loop", "interrupts masked"])
def test_hang_ends_in_watchdog_reset_reported_in_hello(stream: EmulatedStream, interrupts: bool) -> None:
    stream.board.hang(interrupts)
    assert_stream_is_right_after_reset(stream, WATCHDOG)


def test_running_off_the_end_of_memory_resets_and_hello_says_so(stream: EmulatedStream) -> None:
    stream.board.machine.jump(0x2000_4000)  # unused RAM, zeros, which do nothing; behind it there is no memory
    stream.run(0.5)
    assert stream.hello.reset_cause == SOFTWARE
    assert stream.board.complaints  # instruction of the fault itself
    stream.wait_until_whole()


def assert_stream_is_right_after_reset(stream: EmulatedStream, cause: int) -> None:
    begun = len(stream.packets)
    stream.wait(lambda packet: isinstance(packet, Hello) and packet.reset_cause == cause, RECOVERY_S)
    first = next(p for p in stream.packets[begun:] if isinstance(p, Sample) and p.sequence == 0)
    assert first.time_us < RECOVERY_S * 1e6
    assert_stream_is_right(stream)


def test_crystal_that_stops_costs_reset_and_internal_clock_takes_over(stream: EmulatedStream) -> None:
    stream.board.crystal_stops()
    stream.wait(lambda packet: isinstance(packet, Hello), RECOVERY_S)
    assert (stream.hello.reset_cause, stream.hello.clock) == (SOFTWARE, HSI)
    stream.wait_until_whole()


def test_slow_host_loses_only_the_hit_packets(stream: EmulatedStream) -> None:
    before = stream.latest(Sample).sequence
    packets = stream.decoder.feed(stream.board.run_unread(0.5, buffer_bytes=2000))
    kept = sum(isinstance(packet, Sample) for packet in packets)
    samples = stream.samples(0.5)
    assert stream.decoder.crc_errors + stream.decoder.garbage_packets <= 1  # the one in which the loss began and ended
    assert [b.sequence - a.sequence for a, b in pairwise(samples)] == [1] * (len(samples) - 1)
    assert samples[0].sequence - before > kept + 50  # the gap tells the host how much it missed
    assert all(is_right(sample) for sample in samples)


def test_line_too_slow_drops_whole_packets_and_counts_them() -> None:
    """A flood of requests: answers are made faster than the line sends them, and the ring overflows."""
    stream = EmulatedStream(pads=3)
    stream.run(0.3)
    for _ in range(60):
        stream.board.send(encode(Request(Verb.HELLO, 1, ALL_PADS, 0)) + encode(Request(Verb.STATUS, 2, ALL_PADS, 0)))
    stream.run(0.6)  # eleven kilobytes of answers take a quarter of a second, beside the stream
    stream.board.send(b"\0")  # ends whatever the receiver kept of the flood
    stream.request(Verb.STATUS)
    stream.run(0.05)
    assert stream.status.transmit_dropped > 0
    assert stream.is_clean()
    assert len(stream.samples(0.2)) >= 43


def test_fast_requests_are_not_mixed_up(stream: EmulatedStream) -> None:
    before = len(stream.packets)
    for _ in range(20):
        assert stream.request(Verb.STATUS).result == Result.DONE
    stream.run(0.05)
    assert sum(isinstance(packet, Status) for packet in stream.packets[before:]) >= 20
    assert_stream_is_right(stream)
