"""Damaged and random inputs to both decoders of AnySkin's streams; `make fuzz` runs a million.

    .venv/bin/python tests/drills/anyskin_fuzz.py --inputs 1000000

Each input is a packet with bits flipped, bytes cut, doubled or replaced, or plain noise, between whole packets, and in
pieces as a port gives it. Nothing may raise; every decoded packet must be possible and stand in the input; and the
third whole packet after the damage must be decoded.
"""

from __future__ import annotations

import argparse
import math
import random
import struct
import sys
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[1] / "firmware/fuzz"))

from python_decoder import damaged

from emulator.anyskin_board import binary, quantised, text
from fmfts_skin.board.packets import BinaryStream, Packet, TextStream

MAGNETOMETERS, BEFORE, BEHIND = 5, 2, 4
STREAMS = {"binary": (binary, BinaryStream), "text": (text, TextStream)}


def fields_ut(chance: random.Random) -> list[list[float]]:
    return [[round(chance.uniform(-3000.0, 3000.0), 2) for _ in range(3)] for _ in range(MAGNETOMETERS)]


def pieces(data: bytes, chance: random.Random) -> list[bytes]:
    cuts = sorted(chance.randrange(len(data) + 1) for _ in range(chance.randrange(4)))
    return [data[start:stop] for start, stop in zip([0, *cuts], [*cuts, len(data)], strict=True)]


def is_possible(packet: Packet) -> bool:
    """The data sheet's limits, written here again: some chip has a possible temperature, and no field is absurd."""
    finite = [value for reading in packet for value in reading.field_ut if math.isfinite(value)]
    return (
        len(packet) == MAGNETOMETERS
        and any(-40.0 <= reading.temperature_c <= 125.0 for reading in packet)
        and all(abs(value) <= 5e5 for value in finite)  # 0xFFFF with GAIN_SEL 0 and RES 3: 4.8e5
    )


def stands_in(packet: Packet, form: str, data: bytes) -> bool:
    """Its numbers stand in the input, one after the other."""
    values = [value for reading in packet for value in (reading.temperature_c, *reading.field_ut)]
    if form == "binary":
        return struct.pack(f"<{4 * MAGNETOMETERS}f", *values) + b"\r\n" in data or any(map(math.isnan, values))
    written = [f"{value:.2f}".encode() for value in values if math.isfinite(value)]
    place = 0
    for number in written:
        place = data.find(number.lstrip(b"-"), place) + 1
        if place == 0:
            return False
    return True


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--inputs", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    chance, counts = random.Random(options.seed), Counter[str]()
    golden = {form: [(write(one), one) for one in (fields_ut(chance) for _ in range(50))]
              for form, (write, _) in STREAMS.items()}  # fmt: skip
    for number in range(options.inputs):
        form = ("binary", "text")[number % 2]
        packets = [chance.choice(golden[form]) for _ in range(BEFORE + 1 + BEHIND)]
        spoiled = damaged(packets[BEFORE][0], chance)
        behind = [packet for packet, _ in packets[BEFORE + 1 :]]
        data = b"".join([*(packet for packet, _ in packets[:BEFORE]), spoiled, *behind])
        stream = STREAMS[form][1](MAGNETOMETERS)
        given = [packet for piece in pieces(data, chance) for packet in stream.feed(piece)]
        counts["given"] += len(given)
        counts["impossible"] += sum(not is_possible(packet) for packet in given)
        counts["never fed"] += sum(not stands_in(packet, form, data) for packet in given)
        third = packets[BEFORE + 3][1][0]
        came = any(math.dist(packet[0].field_ut, quantised(third)) < 0.01 for packet in given[-BEHIND:])
        counts["lost after damage"] += not came
    wrong = {what: counts[what] for what in ("impossible", "never fed", "lost after damage")}
    print(f"{options.inputs} inputs, {counts['given']} packets given, {wrong}")
    return int(any(wrong.values()))


if __name__ == "__main__":
    sys.exit(main())
