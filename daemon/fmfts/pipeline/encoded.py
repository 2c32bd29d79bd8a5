"""Messages of a pad that C has encoded, and C's report about those that it has sent."""

from __future__ import annotations

from typing import NamedTuple

import msgspec

from fmfts.bus.encoding import decode_contact
from fmfts.bus.messages import ContactMessage, Health
from fmfts.pipeline._pad import Pad


class EncodedMessage(msgspec.Struct, frozen=True, gc=False):
    """payload: the message as sent; `message` decodes it. The other fields repeat parts of it, which Python needs each
    time."""

    payload: bytes
    health: Health
    contact: bool | None
    over_range: bool
    slipping: bool
    t_sample_ns: int
    t_publish_ns: int

    @classmethod
    def of(cls, payload: bytes, pad: Pad) -> EncodedMessage:
        """payload: the message that `pad` encoded last."""
        gist = pad.last
        assert gist is not None
        return cls(payload, *gist)

    @property
    def message(self) -> ContactMessage:
        return decode_contact(self.payload)


Answer = ContactMessage | EncodedMessage


def message_of(answer: Answer) -> ContactMessage:
    return answer.message if isinstance(answer, EncodedMessage) else answer


class Passed(NamedTuple):
    """The messages that C published between `begin` and `end` of a Pad: of `frames`, and of samples that came before
    their frames.

    first_sequence, sequence: of the first frame and the last; without any, of the previous one. arrival_ns: of the last
    frame. frame_us, frame_ns: the last frame's time on the board's clock, and on the host's. t_sample_ns, payload: of
    the last message. changes: the messages whose health, contact, over_range or slipping differs from the one before.
    latencies_s: sample → publish, of each frame with a new sample.
    """

    frames: int
    first_sequence: int
    sequence: int
    arrival_ns: int
    frame_us: int
    frame_ns: int
    t_sample_ns: int
    payload: bytes
    changes: tuple[bytes, ...]
    latencies_s: list[float]
