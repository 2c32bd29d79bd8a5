"""Which samples newer ones supersede, packet by packet, as the docstring of sensor/wire/newest.py says it.

No independent witness: the daemon once used it, and newest.c must match it to the last byte.
"""

from __future__ import annotations

from collections import Counter

from fmfts.sensor.patience import Patience
from fmfts.sensor.wire.codec import VERSION, MalformedError, unpack
from fmfts.sensor.wire.framing import checked_body
from fmfts.sensor.wire.newest import PADS
from fmfts.sensor.wire.packets import Early, Sample

Key = tuple[int, int | None]  # pad, and sensor of an early sample


def keep_newest(data: bytes, patience: Patience) -> tuple[bytes, tuple[int, ...]]:
    *lines, rest = data.split(b"\0")
    kept, left_out, newest_us = Counter[Key](), Counter[int](), dict[Key, int]()
    stay = []
    for line in reversed(lines):
        packet = _packet(line)
        if packet is not None:
            pad, sensor = packet.pad_index, packet.sensor if isinstance(packet, Early) else None
            if sensor is not None and kept[pad, None] >= patience.most:
                continue  # a frame holds all that came before it
            key = pad, sensor
            if packet.time_us > newest_us.get(key, -1):  # after this packet the line carries old, repeated ones
                newest_us[key], kept[key] = packet.time_us, 0
            age_us = newest_us[key] - packet.time_us
            if kept[key] and (kept[key] >= patience.most or age_us > patience.longest_us):
                left_out[pad] += sensor is None
                continue
            kept[key] += 1
        stay.append(line)
    return b"\0".join([*reversed(stay), rest]), tuple(left_out[pad] for pad in range(PADS))


def _packet(line: bytes) -> Sample | Early | None:
    try:
        body = checked_body(line)
        packet = unpack(body) if body is not None and body[0] >> 4 == VERSION else None
    except MalformedError:
        return None
    return packet if isinstance(packet, Sample | Early) and packet.pad_index < PADS else None
