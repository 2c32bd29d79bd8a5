"""A board's clock mapped to the host's, under the delays that serial lines and busy hosts really have."""

from __future__ import annotations

import numpy as np
import pytest

from fmfts.sensor.wire.clock import DeviceClock, HostClock

PERIOD_US = 4545
BOOT_NS = 5_000_000_000_000


class Board:
    """Sends a sample every period; its clock runs `ppm` slow, its packets take 300 µs and an exponential rest."""

    def __init__(self, ppm: float = 0.0, mean_delay_us: float = 200.0, minimum_delay_us: float = 0.0, seed: int = 1):
        self.rate = 1.0 + ppm * 1e-6
        self.mean_delay_us = mean_delay_us
        self.minimum_delay_us = minimum_delay_us
        self.random = np.random.default_rng(seed)
        self.start_ns = BOOT_NS

    def true_ns(self, device_us: int) -> int:
        return self.start_ns + int(device_us * 1000 * self.rate)

    def packets(self, seconds: float, start_us: int = 0) -> list[tuple[int, int]]:
        times = [start_us + i * PERIOD_US for i in range(int(seconds * 1e6 / PERIOD_US))]
        delays_us = self.minimum_delay_us + self.random.exponential(self.mean_delay_us, len(times))
        arrivals = [self.true_ns(t) + int(d * 1000) for t, d in zip(times, delays_us, strict=True)]
        return list(zip(times, np.maximum.accumulate(arrivals).tolist(), strict=True))


def errors_us(clock: DeviceClock, board: Board, packets: list[tuple[int, int]]) -> np.ndarray:
    mapped = [clock.to_host_ns(device_us, arrival_ns) for device_us, arrival_ns in packets]
    assert all(host_ns <= arrival_ns for host_ns, (_, arrival_ns) in zip(mapped, packets, strict=True))
    return np.array([host - board.true_ns(time) for host, (time, _) in zip(mapped, packets, strict=True)]) / 1000


@pytest.mark.parametrize("ppm", [-100, 0, 37, 100])
def test_crystals_drift_is_recovered_and_samples_are_timed_within_20_us(ppm: float) -> None:
    """With 200 µs mean excess delay the least of the 880 delays within the 4 s window is some 0.2 µs; the rest is the
    slope's error (a few ppm) over those 4 s."""
    board, clock = Board(ppm), DeviceClock(tolerance=200e-6)
    errors = errors_us(clock, board, board.packets(60))
    assert clock.drift_ppm == pytest.approx(ppm, abs=3)
    assert np.abs(errors[2200:]).max() < 20  # after ten seconds
    assert np.abs(errors[220:]).max() < 200  # after one delay, no worse than no mapping


@pytest.mark.parametrize("ppm", [-10_000, 10_000])
def test_rc_oscillators_percent_is_recovered(ppm: float) -> None:
    board, clock = Board(ppm), DeviceClock(tolerance=0.02)
    errors = errors_us(clock, board, board.packets(60))
    assert clock.drift_ppm == pytest.approx(ppm, abs=5)
    assert np.abs(errors[2200:]).max() < 50


def test_drift_that_changes_with_warmth_is_followed() -> None:
    """2 ppm a second, a warming RC oscillator: 32 s of window lag the slope by 32 ppm, 4 s of height by 0.13 ms."""
    board, clock = Board(), DeviceClock(tolerance=0.02)
    board.true_ns = lambda t: BOOT_NS + int(t * 1000 + 0.5 * 2e-6 * (t * 1e-6) ** 2 * 1e9)  # type: ignore[method-assign]
    errors = errors_us(clock, board, board.packets(90))
    assert np.abs(errors[2200:]).max() < 300


def test_hour_of_a_crystal_that_warms_and_cools_is_followed() -> None:
    """50 ppm, and 10 more up and down every twenty minutes: 0.05 ppm a second. The slope, of 32 s, lags by 0.8 ppm and
    is used over 4 s: a few µs; the rest is the least of 110 delays (2 µs) and the slope's noise."""
    board, clock = Board(), DeviceClock(tolerance=200e-6)
    turn = 2 * np.pi / 1200
    board.true_ns = lambda t: (  # type: ignore[method-assign]
        BOOT_NS + int(t * 1000 + 50e-6 * t * 1000 + 10e-6 / turn * (1 - np.cos(turn * t * 1e-6)) * 1e9)
    )
    errors = errors_us(clock, board, board.packets(3600)[::8])  # 27 Hz
    assert clock.restarts == 0
    assert np.abs(errors[275:]).max() < 20  # after ten seconds


def test_late_arrivals_do_not_move_the_map() -> None:
    """Every third second the host stalls for half a second; its backlog arrives at once."""
    board, clock = Board(50), DeviceClock(tolerance=200e-6)
    packets = []
    for device_us, arrival_ns in board.packets(40):
        since_ns = (arrival_ns - BOOT_NS) % 3_000_000_000
        packets.append((device_us, arrival_ns + 500_000_000 - since_ns if since_ns < 500_000_000 else arrival_ns))
    errors = errors_us(clock, board, packets)
    assert clock.restarts == 0
    assert clock.drift_ppm == pytest.approx(50, abs=5)
    assert np.abs(errors[2200:]).max() < 50


def test_backlog_that_comes_in_two_bursts_is_no_standstill() -> None:
    """After the first the host stalls again, and packets that were in time are long outdated when they are read, or
    never came."""
    board, clock = Board(50), DeviceClock(tolerance=200e-6)
    errors_us(clock, board, board.packets(10))
    backlog = [device_us for device_us, _ in board.packets(0.5, start_us=10_000_000)]
    first, second = (board.true_ns(10_000_000) + ms * 1_000_000 for ms in (400, 900))
    late = [(device_us, first if index < 50 else second) for index, device_us in enumerate(backlog)]
    assert np.abs(errors_us(clock, board, late)).max() < 200
    assert clock.restarts == 0


def test_packets_the_host_read_late_are_no_standstill() -> None:
    """A host that reads four times a second, each time packets up to 0.2 s old, for ten seconds."""
    board, clock = Board(50), DeviceClock(tolerance=200e-6)
    errors_us(clock, board, board.packets(10))
    for read in range(40):
        begin_us = 10_000_000 + read * 250_000
        late = [(time, board.true_ns(begin_us + 450_000)) for time, _ in board.packets(0.25, start_us=begin_us)]
        assert np.abs(errors_us(clock, board, late)).max() < 200
        clock.found_empty(board.true_ns(begin_us + 200_000))
    assert clock.restarts == 0


def test_burst_of_late_arrivals_in_first_second_does_not_tilt_map() -> None:
    """Before there is a slope, half a second's backlog looks like a clock that runs 2 % slow."""
    board, clock = Board(50), DeviceClock(tolerance=0.02)
    stall = (BOOT_NS + 300_000_000, BOOT_NS + 800_000_000)
    packets = [(t, stall[1] if stall[0] <= arrival < stall[1] else arrival) for t, arrival in board.packets(3)]
    assert np.abs(errors_us(clock, board, packets)).max() < 2000  # one delay, of an exponential with mean 0.2 ms
    assert clock.restarts == 0


@pytest.mark.parametrize("uptime_s", [1, 10])
@pytest.mark.parametrize("pause_s", [0.03, 0.5])
def test_board_clock_that_stood_still_is_followed_within_half_a_second(uptime_s: float, pause_s: float) -> None:
    """A debugger, or flash that is being written: device time continues from where it was, later."""
    board, clock = Board(80), DeviceClock(tolerance=200e-6)
    errors_us(clock, board, board.packets(uptime_s))
    board.start_ns += int(pause_s * 1e9)
    errors = errors_us(clock, board, board.packets(20, start_us=int(uptime_s * 1e6)))
    assert np.abs(errors[110:]).max() < 200  # half a second: 110 frames
    assert np.abs(errors[2200:]).max() < 20
    assert clock.drift_ppm == pytest.approx(80, abs=3)  # a clock that stands still says nothing about the pace
    assert clock.restarts == 0


def test_slow_streams_clock_that_stood_still_is_followed_too() -> None:
    board, clock = Board(), DeviceClock(tolerance=200e-6)
    errors_us(clock, board, board.packets(10)[::44])  # 5 Hz
    board.start_ns += 500_000_000
    errors = errors_us(clock, board, board.packets(10, start_us=10_000_000)[::44])
    assert np.abs(errors[8:]).max() < 2000


def test_constant_part_of_the_delay_is_what_the_caller_says() -> None:
    board = Board(minimum_delay_us=1150)
    clock = DeviceClock(tolerance=200e-6, fixed_delay_ns=1_150_000)
    assert np.abs(errors_us(clock, board, board.packets(30))[2200:]).max() < 20


@pytest.mark.parametrize("uptime_s", [0.05, 3, 3600])
def test_reset_board_is_noticed_at_its_first_sample(uptime_s: float) -> None:
    board, clock = Board(80), DeviceClock(tolerance=200e-6)
    for packet in board.packets(uptime_s if uptime_s < 60 else 5):
        clock.to_host_ns(*packet)
    board.start_ns += int(uptime_s * 1e9) + 700_000_000
    errors = errors_us(clock, board, board.packets(30))
    assert clock.restarts == 1
    assert errors[0] < 2000  # one delay at most: the old map has no effect
    assert np.abs(errors[2200:]).max() < 20


def test_reset_amid_late_arrivals_is_a_reset_and_no_standstill() -> None:
    board, clock = Board(), DeviceClock(tolerance=200e-6)
    errors_us(clock, board, board.packets(5))
    board.start_ns += 500_000_000
    errors_us(clock, board, board.packets(0.2, start_us=5_000_000))
    board.start_ns += 6_000_000_000
    errors = errors_us(clock, board, board.packets(10))
    assert clock.restarts == 1
    assert np.abs(errors).max() < 2000


def test_host_that_slept_starts_a_new_map() -> None:
    """CLOCK_MONOTONIC stands still while the host is suspended; the board's clock does not."""
    board, clock = Board(10), DeviceClock(tolerance=200e-6)
    for packet in board.packets(10):
        clock.to_host_ns(*packet)
    board.start_ns -= 60_000_000_000
    errors = errors_us(clock, board, board.packets(20, start_us=70_000_000))
    assert clock.restarts == 1
    assert np.abs(errors[2200:]).max() < 20


def test_pads_of_one_board_may_interleave_out_of_order() -> None:
    board, clock = Board(20), DeviceClock(tolerance=200e-6)
    packets = board.packets(20)
    swapped = [(time - (3000 if i % 2 else 0), arrival) for i, (time, arrival) in enumerate(packets)]
    mapped = [clock.to_host_ns(*packet) for packet in swapped]
    assert clock.restarts == 0
    assert all(host <= arrival for host, (_, arrival) in zip(mapped, swapped, strict=True))


def test_years_of_uptime_lose_no_precision() -> None:
    board, clock = Board(30), DeviceClock(tolerance=200e-6)
    errors = errors_us(clock, board, board.packets(30, start_us=2**48 - 60_000_000))
    assert np.abs(errors[2200:]).max() < 20


def test_source_on_this_host_needs_no_map() -> None:
    assert HostClock().to_host_ns(1234, 9_999_999) == 1_234_000
    assert HostClock().to_host_ns(1234, 1_000_000) == 1_000_000


def test_hours_between_packets_do_not_change_the_drift() -> None:
    """An old minimum is forgotten: products of such times would not fit into 64 bits."""
    board, clock = Board(100), DeviceClock(tolerance=0.02)
    errors_us(clock, board, board.packets(10))
    after = board.packets(20, start_us=20_000_000_000)
    assert np.abs(errors_us(clock, board, after)[1000:]).max() < 200
    assert abs(clock.drift_ppm - 100) < 30
    assert clock.restarts <= 1


@pytest.mark.parametrize("seed", range(4))
def test_clock_line_holds_all_learned_values(seed: int) -> None:
    """Stalls, resets, packets out of order: a copy of the line gives the same results, to the last bit."""
    draw = np.random.default_rng(seed)
    board = Board(ppm=draw.uniform(-300, 300), seed=seed)
    tolerance = (200e-6, 0.02)[seed % 2]
    clock = DeviceClock(tolerance)
    late_ns = ahead_us = 0
    for number, (device_us, arrival_ns) in enumerate(board.packets(90)[::2]):
        if number % 1100 == 900 and number < 5000:
            late_ns = int(draw.choice([30, 300, 900])) * 1_000_000
        elif number % 1100 == 960:
            late_ns = 0
        if number == 1300:
            ahead_us += 700_000
        device_us += ahead_us - int(draw.choice([0, 0, 0, 5000]))
        if device_us < 0:
            continue
        copy = DeviceClock(tolerance)
        copy.line[:] = clock.line
        goes_on = clock.is_plausible(device_us, arrival_ns + late_ns)
        host_ns = clock.to_host_ns(device_us, arrival_ns + late_ns)
        assert copy.to_host_ns(device_us, arrival_ns + late_ns) == host_ns
        assert bytes(copy.line) == bytes(clock.line)
        assert host_ns <= arrival_ns + late_ns
        assert goes_on or clock.restarts > 0
    assert clock.restarts > 0, "its clock leapt"
