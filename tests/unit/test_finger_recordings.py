"""Recordings of pads with several magnets: what is read is what was sent, and Foxglove can read it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jsonschema
import msgpack
import msgspec
import pytest
from bus_messages import contact_message, fingers_message, pose_message, two_fingers

from fmfts.bus.messages import ContactMessage, encode, without_estimate
from fmfts.recording.file import RecordingWriter, read
from fmfts.recording.plain_schema import plain_schema, with_nulls, without_nulls

UNKNOWN = without_estimate(fingers_message(*two_fingers()), health="lost")
MESSAGES = {
    "two fingers": fingers_message(*two_fingers()),
    "no ambient field": fingers_message(*two_fingers(), poses=[pose_message(ambient_t=None)]),
    "no finger": fingers_message(),
    "cannot tell": UNKNOWN,
    "one magnet": contact_message(),
    "one magnet, lost": without_estimate(contact_message(), health="lost"),
}


def sent(message: ContactMessage) -> dict[str, Any]:
    body: dict[str, Any] = msgpack.unpackb(encode(message))
    return body


@pytest.mark.parametrize("message", MESSAGES.values(), ids=MESSAGES.keys())
def test_a_recorded_message_is_read_as_it_was_sent(message: ContactMessage, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    writer = RecordingWriter(path)
    writer.add("contact", "demo", sent(message))
    writer.finish()
    writer.close()
    assert [one.message for one in read(path)] == [message]


@pytest.mark.parametrize("message", MESSAGES.values(), ids=MESSAGES.keys())
def test_a_recorded_message_fits_its_plain_schema_and_has_no_null(message: ContactMessage) -> None:
    body = without_nulls(sent(message), ContactMessage)
    jsonschema.validate(body, plain_schema(ContactMessage))
    assert b"null" not in msgspec.json.encode(body)
    assert with_nulls(body, ContactMessage) == sent(message)


def test_the_plain_schema_describes_every_field_of_a_finger() -> None:
    described = plain_schema(ContactMessage)["properties"]["contacts"]["items"]
    assert described["properties"].keys() == sent(fingers_message(*two_fingers()))["contacts"][0].keys()
    assert "shear_x_n" not in described["required"]
    assert "force_n" in described["required"]
