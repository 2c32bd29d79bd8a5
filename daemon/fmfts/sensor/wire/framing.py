"""Packets as a stream of bytes: adds CRC and COBS, and finds the packets in any bytes that arrive (wire.md)."""

from __future__ import annotations

from binascii import crc_hqx
from collections.abc import Sequence

from fmfts.sensor.frame import Packed
from fmfts.sensor.wire import _wire
from fmfts.sensor.wire.codec import VERSION, MalformedError, pack, unpack
from fmfts.sensor.wire.packets import Packet

MAX_LINE_BYTES = 255  # 254 bytes of packet and one of COBS, without the closing zero
_CRC_INITIAL = 0xFFFF


def encode(packet: Packet) -> bytes:
    """The bytes of `packet` on the line, with the closing zero."""
    body = pack(packet)
    return _stuff(body + crc_hqx(body, _CRC_INITIAL).to_bytes(2, "little")) + b"\0"


def _stuff(packet: bytes) -> bytes:
    """Apply COBS. A packet of at most 254 bytes has no block that needs the code 0xFF in its middle."""
    return b"".join(bytes((len(block) + 1,)) + block for block in packet.split(b"\0"))


def _unstuff(line: bytes) -> bytes:
    packet = bytearray(line)
    zero = 0
    while zero < len(line):
        step = line[zero]
        packet[zero] = 0
        zero += step
    if zero != len(line) or len(line) > MAX_LINE_BYTES:
        raise MalformedError("no COBS packet")
    return bytes(packet[1:])


def checked_body(line: bytes) -> bytes | None:
    """The packet in a line, without its closing zero; None if the CRC is wrong. MalformedError if it is no packet."""
    packet = _unstuff(line)
    if len(packet) < 3:
        raise MalformedError("too short for a header and a CRC")
    body = packet[:-2]
    return body if crc_hqx(body, _CRC_INITIAL) == packet[-2] | packet[-1] << 8 else None


# pad_index, sequence, time_us, temperature_raw, and the sensors' readings.
PackedSample = tuple[int, int, int, int, Packed]
# pad_index, sensor, gain_code, time_us, and the axes' counts.
PackedEarly = tuple[int, int, int, int, tuple[int, int, int]]


class Decoder:
    """Finds the packets in a stream of bytes, whatever else is in it. The counters only grow.

    Bytes before the first zero or good packet are not counted as errors: the host starts reading in mid-packet.
    """

    def __init__(self) -> None:
        self.crc_errors = 0
        self.garbage_packets = 0
        self.garbage_bytes = 0
        self.foreign_version: int | None = None  # wire version of the last packet that had another one
        self._pending = b""
        self._joined = False
        self._overlong = False

    def leading_samples(self, data: bytes) -> tuple[Sequence[PackedSample | PackedEarly], bytes]:
        """The samples and early samples at the beginning of `data`, unpacked in C, and the rest, for `feed`."""
        data = self._pending + data
        samples, end = _wire.samples(data)
        self._pending = b""
        self._joined |= end > 0
        return samples, data[end:]

    @property
    def has_joined(self) -> bool:
        """Whether a zero or a good packet has come: the next bytes begin or continue a packet."""
        return self._joined

    def give_back(self) -> bytes:
        """Take out the beginning of a packet whose rest has not come yet: for `feed` later, or for another reader."""
        pending, self._pending = self._pending, b""
        return pending

    def feed(self, data: bytes) -> list[Packet]:
        """The packets that `data` completes. Never raises, whatever the bytes are."""
        *lines, pending = (self._pending + data).split(b"\0")
        packets = []
        for line in lines:
            if line:
                packet = self._decode(line)
                if packet is not None:
                    packets.append(packet)
            self._joined = True
        # A packet is never this long without a zero.
        self._overlong |= len(pending) > MAX_LINE_BYTES
        # From an endless line one byte more than allowed is kept: enough to recognise it as garbage.
        self._pending = pending[: MAX_LINE_BYTES + 1]
        self._count_garbage(0, len(pending) - len(self._pending))
        return packets

    def _decode(self, line: bytes) -> Packet | None:
        try:
            body = checked_body(line)
            if body is None:
                self.crc_errors += self._joined
                return None
            if body[0] >> 4 != VERSION:
                self.foreign_version = body[0] >> 4
                return None
            return unpack(body)
        except MalformedError:
            self._count_garbage(1, len(line))
            return None

    def _count_garbage(self, packets: int, size: int) -> None:
        if self._joined or self._overlong:
            self.garbage_packets += packets
            self.garbage_bytes += size
