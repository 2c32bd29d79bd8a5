"""A million random and damaged inputs to the Python decoder: no crash, and no packet that a separate CRC refuses.

    python tests/firmware/fuzz/python_decoder.py --inputs 1000000

Every input is a golden line with bits flipped, bytes cut, doubled or replaced, or plain noise, followed by a whole
golden line, which must be decoded unless the damage hit the zero before it.
"""

from __future__ import annotations

import argparse
import configparser
import random
import sys
from pathlib import Path

from fmfts.sensor.wire.framing import Decoder

VECTORS = Path(__file__).parents[2] / "data" / "wire_vectors.ini"


def golden_lines() -> list[bytes]:
    vectors = configparser.ConfigParser()
    vectors.read(VECTORS)
    return [bytes.fromhex(section["line"]) for name, section in vectors.items() if "line" in section]


def damaged(line: bytes, chance: random.Random) -> bytes:
    kind = chance.randrange(5)
    if kind == 0:
        return chance.randbytes(chance.randrange(1, 80))
    spoiled = bytearray(line)
    for _ in range(chance.randrange(1, 4)):
        place = chance.randrange(len(spoiled))
        if kind == 1:
            spoiled[place] ^= 1 << chance.randrange(8)
        elif kind == 2:
            spoiled[place] = chance.randrange(256)
        elif kind == 3 and len(spoiled) > 1:
            del spoiled[place]
        else:
            spoiled.insert(place, spoiled[place])
    return bytes(spoiled)


def crc_is_right(line: bytes) -> bool:
    """COBS and CRC-16/CCITT-FALSE bit by bit, from firmware/wire.md and nothing else."""
    packet, place = bytearray(), 0
    while place < len(line):
        code = line[place]
        if code == 0 or place + code > len(line):
            return False
        packet += line[place + 1 : place + code]
        place += code
        if code < 255 and place < len(line):
            packet.append(0)
    if len(packet) < 3:
        return False
    register = 0xFFFF
    for byte in packet[:-2]:
        register ^= byte << 8
        for _ in range(8):
            register = (register << 1 ^ 0x1021 if register & 0x8000 else register << 1) & 0xFFFF
    return register == packet[-2] | packet[-1] << 8


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--inputs", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    chance, lines = random.Random(options.seed), golden_lines()
    accepted = wrong = lost = 0
    for _ in range(options.inputs):
        spoiled, whole = damaged(chance.choice(lines), chance), chance.choice(lines)
        decoder = Decoder()
        from_damage = len(decoder.feed(spoiled))
        behind = len(decoder.feed(whole))
        accepted += from_damage + behind
        if from_damage > sum(crc_is_right(part) for part in spoiled.split(b"\0")[:-1] if part):
            wrong += 1
        if spoiled.endswith(b"\0") and len(whole) > 1 and behind != 1 and whole in lines:
            lost += len(Decoder().feed(whole)) - behind
    print(f"{options.inputs} inputs, {accepted} packets accepted, {wrong} with a wrong CRC, {lost} good ones lost")
    return 1 if wrong or lost else 0


if __name__ == "__main__":
    sys.exit(main())
