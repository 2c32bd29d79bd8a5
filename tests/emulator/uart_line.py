"""How a UART reads bytes that were sent at another baud rate: 8N1, sampled in the middle of each bit."""

from __future__ import annotations

BITS = 10  # a start bit (0), eight of data, the lowest first, a stop bit (1)


def read_at(data: bytes, sent_baud: float, read_baud: float) -> bytes:
    """The line is idle before and after. A byte whose stop bit is missing is also read, as by a raw port."""
    levels = [level for byte in data for level in (0, *((byte >> bit) & 1 for bit in range(8)), 1)]

    def level_at(time: float) -> int:  # in bits as sent
        return levels[int(time)] if time < len(levels) else 1

    read = bytearray()
    step = sent_baud / read_baud
    time = 0.0
    while time < len(levels):
        if level_at(time):
            time = float(int(time) + 1)  # a start bit begins where the line falls, which it does between two bits
            continue
        read.append(sum(level_at(time + (bit + 1.5) * step) << bit for bit in range(8)))
        time += (BITS - 0.5) * step  # the middle of the stop bit
        while time < len(levels) and not level_at(time):  # no stop bit: the next start bit is another falling edge
            time = float(int(time) + 1)
    return bytes(read)
