"""Bytes from a board and its clock against firmware/wire.md: packets by another encoder, times by linear programming.

CRC-16/CCITT-FALSE bit by bit (polynomial 0x1021 from 0xFFFF), COBS as S. Cheshire and M. Baker describe it (IEEE/ACM
Transactions on Networking 7, 1999). The line below all arrivals: S. Moon, P. Skelly, D. Towsley, INFOCOM 1999, as a
linear program.
"""

from __future__ import annotations

import struct

import numpy as np
import pytest
from scipy.optimize import linprog

from fmfts.sensor.frame import WireFrame
from fmfts.sensor.wire.clock import DeviceClock
from fmfts.sensor.wire.framing import Decoder
from fmfts.sensor.wire.packets import Early, Sample
from oracle.field import Array


def crc(content: bytes) -> int:
    value = 0xFFFF
    for byte in content:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1 ^ 0x1021 if value & 0x8000 else value << 1) & 0xFFFF
    return value


def stuffed(content: bytes) -> bytes:
    out, block = bytearray(), bytearray()
    for byte in content:
        if byte:
            block.append(byte)
        else:
            out += bytes([len(block) + 1]) + block
            block.clear()
    return bytes(out + bytes([len(block) + 1]) + block + b"\0")


def sample(pad: int, sequence: int, time_us: int, gain: int, valid: int, fresh: int, raw: int, rows: Array) -> bytes:
    """firmware/wire.md, packet 1. rows (N, 4): counts and age."""
    head = bytes([0x11, pad | len(rows) << 4]) + struct.pack("<I", sequence) + time_us.to_bytes(6, "little")
    body = head + bytes([gain, valid, fresh]) + struct.pack("<h", raw)
    body += b"".join(struct.pack("<hhhH", *row) for row in rows.tolist())
    return stuffed(body + struct.pack("<H", crc(body)))


@pytest.mark.parametrize("in_c", [True, False])
def test_samples_are_read_as_the_page_says(in_c: bool) -> None:
    random, decoder = np.random.default_rng(1), Decoder()
    for number in range(300):
        count = int(random.integers(1, 9))
        counts, age = random.integers(-2048, 2048, (count, 3)), random.integers(0, 65536, count)
        rows = np.column_stack([counts, age])
        masks, pad, gain = (
            random.integers(0, 1 << count, 2).tolist(),
            int(random.integers(0, 3)),
            int(random.integers(0, 8)),
        )
        time_us, raw = int(random.integers(0, 1 << 47)), int(random.integers(-32768, 32767))
        line = sample(pad, number, time_us, gain, *masks, raw, rows)
        if in_c:
            ((own_pad, sequence, own_us, own_raw, packed),), rest = decoder.leading_samples(line)
            assert rest == b""
            frame = WireFrame(own_pad, sequence, own_us, 0, packed, None)
            told = frame.counts, frame.age_us, frame.gain_code, frame.valid, frame.fresh
        else:
            (packet,) = decoder.feed(line)
            assert isinstance(packet, Sample)
            own_pad, sequence, own_us, own_raw = (
                packet.pad_index,
                packet.sequence,
                packet.time_us,
                packet.temperature_raw,
            )
            valid, fresh = (mask >> np.arange(count) & 1 for mask in (packet.valid, packet.fresh))
            told = packet.counts, packet.age_us, packet.gain_code, valid, fresh
        assert (own_pad, sequence, own_us, own_raw, told[2]) == (pad, number, time_us, raw, gain)
        assert (told[0] == counts).all()
        assert (told[1] == age).all()
        for mask, own in zip(masks, told[3:], strict=True):
            assert [int(one) for one in own] == [mask >> bit & 1 for bit in range(count)]
    damaged = bytearray(line)
    damaged[5] ^= 4
    assert decoder.feed(bytes(damaged)) == []
    assert decoder.crc_errors + decoder.garbage_packets == 1


@pytest.mark.parametrize("in_c", [True, False])
def test_early_samples_are_read_as_the_page_says(in_c: bool) -> None:
    random, decoder = np.random.default_rng(2), Decoder()
    for _ in range(100):
        pad, sensor, gain = (int(random.integers(0, most)) for most in (3, 8, 8))
        time_us, counts = int(random.integers(0, 1 << 47)), random.integers(-2048, 2048, 3).tolist()
        body = (
            bytes([0x17, pad | sensor << 4 | 0x80, gain]) + time_us.to_bytes(6, "little") + struct.pack("<hhh", *counts)
        )
        line = stuffed(body + struct.pack("<H", crc(body)))
        if in_c:
            (told,), _ = decoder.leading_samples(line)
            assert told == (pad, sensor, gain, time_us, tuple(counts))
        else:
            (packet,) = decoder.feed(line)
            assert isinstance(packet, Early)
            assert (packet.pad_index, packet.sensor, packet.gain_code, packet.time_us) == (pad, sensor, gain, time_us)
            assert list(packet.counts) == counts


def test_boards_clock_is_the_line_below_all_arrivals() -> None:
    random, delay_ns = np.random.default_rng(3), 150_000
    clock = DeviceClock(tolerance=0.02, fixed_delay_ns=delay_ns)
    device_us = 1_000_000 + 4545 * np.arange(8800)
    true_ns = 7_000_000_000 + np.rint(device_us * 1000 * (1.0 + 137e-6)).astype(int)
    arrival_ns = np.maximum.accumulate(
        true_ns + delay_ns + np.rint(random.exponential(200_000, len(true_ns))).astype(int)
    )
    told = np.array([clock.to_host_ns(*one) for one in zip(device_us.tolist(), arrival_ns.tolist(), strict=True)])
    last = slice(-7040, None)  # 32 s
    x = (device_us[last] - device_us[-1]) * 1e-6
    y = (arrival_ns[last] - 1000 * device_us[last] - (arrival_ns[-1] - 1000 * device_us[-1])).astype(float)
    # The highest line under all points, at their mean: max a·mean(x) + b with a·x + b ≤ y.
    found = linprog([-x.mean(), -1.0], A_ub=np.column_stack([x, np.ones(len(x))]), b_ub=y, bounds=[(None, None)] * 2)
    assert clock.drift_ppm == pytest.approx(found.x[0] * 1e-3, abs=0.5)
    assert np.abs(told[2200:] - true_ns[2200:]).max() < 20_000
    assert (told <= arrival_ns).all()
