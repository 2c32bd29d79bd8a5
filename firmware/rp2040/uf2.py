"""usage: uf2.py IMAGE UF2: puts the checksum into the first 256 bytes of an RP2040's image, and writes it as UF2.

The ROM's boot loader runs those bytes only if the last four are the CRC-32 of the others (data sheet 2.8.1.3.1). A UF2
file is copied to the drive that a Pico shows while BOOTSEL is held at power-up.
"""

from __future__ import annotations

import struct
import sys
from pathlib import Path

FLASH, BLOCK, RP2040_FAMILY, HAS_FAMILY = 0x1000_0000, 256, 0xE48B_FF56, 0x2000


def checksum(data: bytes) -> int:
    """CRC-32 as the ROM has it: not reflected, not inverted at the end."""
    crc = 0xFFFF_FFFF
    for byte in data:
        crc ^= byte << 24
        for _ in range(8):
            crc = (crc << 1 ^ 0x04C1_1DB7 if crc & 0x8000_0000 else crc << 1) & 0xFFFF_FFFF
    return crc


def sealed(image: bytes) -> bytes:
    return image[:252] + struct.pack("<I", checksum(image[:252])) + image[256:]


def uf2(image: bytes) -> bytes:
    count = -(-len(image) // BLOCK)
    blocks = []
    for number in range(count):
        data = image[number * BLOCK : (number + 1) * BLOCK].ljust(476, b"\0")
        head = (0x0A32_4655, 0x9E5D_5157, HAS_FAMILY, FLASH + number * BLOCK, BLOCK, number, count, RP2040_FAMILY)
        blocks.append(struct.pack("<8I476sI", *head, data, 0x0AB1_6F30))
    return b"".join(blocks)


if __name__ == "__main__":
    image, out = map(Path, sys.argv[1:])
    image.write_bytes(sealed(image.read_bytes()))
    out.write_bytes(uf2(image.read_bytes()))
