"""The streams of AnySkin boards: each whole packet arrives once, damage costs only damaged packets, and times are
true."""

from __future__ import annotations

import math
import struct
from random import Random

import numpy as np
import pytest

from emulator.anyskin_board import binary, no_sample, quantised, steps_ut, text
from emulator.uart_line import read_at
from fmfts_skin.board.packets import LARGEST_UT, BinaryStream, TextStream, packet_of
from fmfts_skin.board.timing import StreamClock

FIELDS_UT = [(10.0 * n + 1.0, -5.0 * n, 300.0 + n) for n in range(5)]
FORMS = [(BinaryStream, binary), (TextStream, text)]


def numbered(form: object, count: int) -> list[bytes]:
    """Packets whose first field is their number."""
    return [form([(steps_ut()[0] * 10 * k, *FIELDS_UT[0][1:]), *FIELDS_UT[1:]]) for k in range(1, count + 1)]  # type: ignore[operator]


def numbers_of(packets: list) -> list[int]:
    return [round(packet[0].field_ut[0] / (10 * steps_ut()[0])) for packet in packets]


@pytest.mark.parametrize(("stream", "form"), FORMS)
@pytest.mark.parametrize("chunk", [1, 7, 82, 4096])
def test_every_packet_arrives_once_however_it_is_cut(stream: type, form: object, chunk: int) -> None:
    data = b"".join(numbered(form, 50))
    parser = stream(5)
    found = [packet for at in range(0, len(data), chunk) for packet in parser.feed(data[at : at + chunk])]
    first = 1 if stream is BinaryStream else 2  # nothing in a line that may have lost its beginning is accepted
    assert numbers_of(found)[: 50 - first] == list(range(first, 50))
    assert found[0][3].field_ut == pytest.approx(quantised(FIELDS_UT[3]), abs=0.01)
    assert found[0][3].temperature_c == 25.0


@pytest.mark.parametrize(("stream", "form"), FORMS)
@pytest.mark.parametrize("damage", ["garbage before", "bytes missing", "bytes changed", "half a packet", "joined late"])
def test_damage_costs_the_damaged_packets_and_no_other(stream: type, form: object, damage: str) -> None:
    packets, random = numbered(form, 40), Random(3)
    hurt = {10, 25}
    for k in hurt:
        at = random.randrange(5, 60)
        packets[k] = {
            "garbage before": bytes(random.randrange(256) for _ in range(200)) + packets[k],
            "bytes missing": packets[k][:at] + packets[k][at + 3 :],
            "bytes changed": packets[k][:-3] + b"\xff\x00\xfe",
            "half a packet": packets[k][:at],
            "joined late": packets[k],
        }[damage]
    data = b"".join(packets)[33 if damage == "joined late" else 0 :]
    parser = stream(5)
    found = numbers_of(list(parser.feed(data)))
    assert sorted(set(found)) == found
    due = set(range(3, 40)) - {k + 1 for k in hurt} - {k + 2 for k in hurt}
    assert due <= set(found)
    assert (parser.garbage_bytes > 0) is True


def test_end_of_packet_inside_of_a_float_does_not_mislead() -> None:
    (odd,) = struct.unpack("<f", b"\r\n\x20\x42")  # 40 µT whose bytes hold CR LF
    whole = binary([(0.0, 0.0, 0.0)] * 5)
    packet = whole[:4] + struct.pack("<f", odd) + whole[8:]
    assert len(list(BinaryStream(5).feed(packet * 20))) == 20
    assert len(list(BinaryStream(5).feed(packet[7:] + packet * 20))) >= 19


@pytest.mark.parametrize(("stream", "form"), FORMS)
@pytest.mark.parametrize("magnetometers", [4, 6])
def test_board_with_another_number_of_magnetometers_gives_no_packet(
    stream: type, form: object, magnetometers: int
) -> None:
    data = b"".join(form([FIELDS_UT[0]] * magnetometers) for _ in range(50))  # type: ignore[operator]
    assert list(stream(5).feed(data)) == []


def test_damaged_bytes_give_only_possible_readings() -> None:
    """Half a million bytes: half of them random, half of damaged packets."""
    random = Random(1)
    good = b"".join(numbered(binary, 20)) + b"".join(numbered(text, 20))
    for stream in (BinaryStream, TextStream):
        parser, given = stream(5), 0
        while given < 250_000:
            damaged = bytearray(good)
            for _ in range(random.randrange(1, 40)):
                damaged[random.randrange(len(damaged))] = random.randrange(256)
            for data in (bytes(damaged), random.randbytes(2000)):
                given += len(data)
                for packet in parser.feed(data):
                    assert any(reading.is_measured for reading in packet)
                    for reading in packet:
                        finite = [value for value in reading.field_ut if math.isfinite(value)]
                        assert all(abs(value) <= LARGEST_UT for value in finite)


def test_magnetometer_without_sample_is_not_measured_and_others_are() -> None:
    packet = packet_of([25.0, 1.0, 2.0, 3.0, *no_sample()])
    assert packet is not None
    assert [reading.is_measured for reading in packet] == [True, False]
    assert packet_of([*no_sample(), *no_sample()]) is None


def arrivals(
    rate_hz: float, seconds: float, random: Random, *, lost: dict[int, int] | None = None, drift: float = 0.0
) -> list[tuple[int, float]]:
    """The arrival in ns and the time of making in s of each packet that came. Delays: 0.3 ms and more, sometimes much
    more.
    """
    found, number = [], 0
    while number / rate_hz < seconds:
        number += (lost or {}).get(len(found), 0) + 1
        made_s = 5.0 + number / rate_hz * (1.0 + drift * number / rate_hz)
        delay_s = 3e-4 + random.expovariate(1 / 2e-4) + (random.random() < 0.01) * random.uniform(0.0, 0.03)
        found.append((round(1e9 * (made_s + delay_s)), made_s))
    # They arrive in order: a late one delays those behind it.
    latest = 0
    for at, (arrival, made_s) in enumerate(found):
        latest = max(latest, arrival)
        found[at] = latest, made_s
    return found


@pytest.mark.parametrize("rate_hz", [50.0, 200.0, 400.0])
def test_times_follow_the_board_though_arrivals_jitter(rate_hz: float) -> None:
    clock, errors = StreamClock(), []
    for arrival_ns, made_s in arrivals(rate_hz, 30.0, Random(2), drift=2e-6):
        stamp = clock.stamped(arrival_ns)
        if stamp is not None and made_s > 10.0:
            errors.append(stamp[2] / 1e9 - made_s)
    assert clock.rate_hz == pytest.approx(rate_hz, rel=0.03)
    # The smallest delay cannot be known, but the jitter can: compared with 0.5 ms of the arrivals themselves.
    assert np.std(errors) < 1.5e-4
    assert 0.0 < np.mean(errors) < 8e-4
    assert clock.lost == 0


@pytest.mark.parametrize("rate_hz", [50.0, 200.0, 400.0])
@pytest.mark.parametrize("missing", [1, 3, 20])
def test_lost_packets_are_counted_by_their_time_alone(rate_hz: float, missing: int) -> None:
    clock = StreamClock()
    late = []
    for arrival_ns, made_s in arrivals(rate_hz, 20.0, Random(4), lost={round(10 * rate_hz): missing}):
        stamp = clock.stamped(arrival_ns)
        if stamp is not None and made_s > 17.0:
            late.append(stamp[2] / 1e9 - made_s)
    assert clock.lost == missing
    assert np.abs(late).max() < 2e-3


def test_stall_of_this_computer_is_no_gap() -> None:
    clock = StreamClock()
    for arrival_ns, made_s in arrivals(200.0, 20.0, Random(5)):
        stalled = 10.0 < made_s < 10.4
        clock.stamped(round(10.4e9) if stalled else arrival_ns)
    assert clock.lost == 0


def test_pause_of_the_stream_begins_anew() -> None:
    clock, random = StreamClock(), Random(6)
    for arrival_ns, _ in arrivals(200.0, 3.0, random):
        clock.stamped(arrival_ns)
    assert clock.stamped(60_000_000_000) is None


@pytest.mark.parametrize("rate_hz", [50.0, 200.0, 400.0])
@pytest.mark.parametrize("waited_s", [0.3, 3.0])
def test_packets_from_before_opening_do_not_set_the_rate(rate_hz: float, waited_s: float) -> None:
    clock, opened_ns = StreamClock(), round(1e9 * (5.0 + waited_s))
    for arrival_ns, made_s in arrivals(rate_hz, 10.0, Random(7)):
        stamp = clock.stamped(max(arrival_ns, opened_ns))
        if stamp is not None:
            assert clock.rate_hz == pytest.approx(rate_hz, rel=0.02)
            assert stamp[2] / 1e9 - made_s < 5e-3
    assert clock.number > rate_hz * (10.0 - waited_s - 1.5)
    assert (clock.lost, clock.epochs) == (0, 1)


@pytest.mark.parametrize("stall_s", [(5.0, 5.3), (5.2, 5.4), (5.3, 5.6), (5.45, 5.9)])
def test_stall_during_period_measurement_does_not_set_the_rate(stall_s: tuple[float, float]) -> None:
    clock = StreamClock()
    for arrival_ns, made_s in arrivals(200.0, 10.0, Random(8)):
        stamp = clock.stamped(round(stall_s[1] * 1e9) if stall_s[0] < made_s < stall_s[1] else arrival_ns)
        if stamp is not None:
            assert clock.rate_hz == pytest.approx(200.0, rel=0.02)
    assert clock.number > 200.0 * 8.0
    assert (clock.lost, clock.epochs) == (0, 1)


@pytest.mark.parametrize("other_hz", [100.0, 230.0, 400.0])
def test_changed_period_is_measured_within_three_seconds(other_hz: float) -> None:
    """As if it had been learned wrong: the numbers restart, in another run."""
    clock, late_s = StreamClock(), []
    for arrival_ns, _ in arrivals(200.0, 5.0, Random(9)):
        clock.stamped(arrival_ns)
    for arrival_ns, made_s in arrivals(other_hz, 10.0, Random(10)):
        stamp = clock.stamped(arrival_ns + 5_000_000_000)
        if stamp is not None and made_s > 5.0 + 3.0:
            late_s.append(stamp[2] / 1e9 - made_s - 5.0)
    assert clock.rate_hz == pytest.approx(other_hz, rel=0.02)
    assert clock.epochs == 2
    assert np.abs(late_s).max() < 5e-3


def test_occasional_losses_do_not_change_the_period() -> None:
    random = Random(11)
    lost = {number: 1 for number in range(400, 20_000) if random.random() < 0.01}
    clock = StreamClock()
    for arrival_ns, _ in arrivals(200.0, 60.0, random, lost=lost):
        clock.stamped(arrival_ns)
    assert clock.epochs == 1
    came = [number for number in lost if number < 60 * 200 - sum(lost.values())]
    assert abs(clock.lost - len(came)) <= 3  # the last ones may not have been counted yet


def test_waiting_packets_are_not_stamped_too_young() -> None:
    """A busy computer reads the stream only every 0.15 s: no packet was lost, and none is lost later."""
    clock, too_young_s = StreamClock(), []
    for arrival_ns, made_s in arrivals(200.0, 20.0, Random(12)):
        busy = 10.0 < made_s < 15.0
        read_ns = -(-arrival_ns // 150_000_000) * 150_000_000 if busy else arrival_ns
        stamp = clock.stamped(read_ns)
        if not busy or arrival_ns + 5_000_000 > read_ns:  # the last one before this read
            clock.found_empty(read_ns)
        if stamp is not None:
            too_young_s.append(stamp[2] / 1e9 - made_s)
    assert max(too_young_s) < 6e-3  # a period: the newest packet of each read may have waited this long
    assert (clock.lost, clock.epochs) == (0, 1)


@pytest.mark.parametrize(("stream", "form"), FORMS)
@pytest.mark.parametrize("read_baud", [9_600, 57_600, 230_400, 460_800])
def test_packets_at_another_baud_rate_are_no_packets(stream: type, form: object, read_baud: int) -> None:
    sent = numbered(form, 200)
    assert [read_at(packet, 115_200, 115_200 * ratio) for packet in sent[:5] for ratio in (0.98, 1.0, 1.02)] == [
        packet for packet in sent[:5] for _ in range(3)
    ]  # the most that a UART can carry
    parser = stream(5)
    assert [packet for each in sent for packet in parser.feed(read_at(each, 115_200, read_baud))] == []
