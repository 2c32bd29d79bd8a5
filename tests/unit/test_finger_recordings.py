"""Recordings of pads with several magnets: what is read is what was sent, and Foxglove can read it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgpack
import msgspec
import pytest
from bus_messages import contact_message, finger_message, fingers_message, pose_message, two_fingers
from json_schemas import fits

from fmfts.bus.encoding import encode
from fmfts.bus.messages import ContactMessage, without_estimate
from fmfts.config import PadConfig, SimulatedSource
from fmfts_recording.file import RecordingWriter, read
from fmfts_recording.finger_columns import Fingers
from fmfts_recording.foxglove import Entity, SceneUpdate
from fmfts_recording.plain_schema import plain_schema, with_nulls, without_nulls
from fmfts_recording.replay import Comparison
from fmfts_recording.scene import Drawn, PadScene

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
def test_recorded_message_is_read_unchanged(message: ContactMessage, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    writer = RecordingWriter(path)
    writer.add("contact", "demo", sent(message))
    writer.finish()
    writer.close()
    assert [one.message for one in read(path)] == [message]


@pytest.mark.parametrize("message", MESSAGES.values(), ids=MESSAGES.keys())
def test_recorded_message_fits_its_plain_schema_and_has_no_null(message: ContactMessage) -> None:
    body = without_nulls(sent(message), ContactMessage)
    assert fits(body, plain_schema(ContactMessage))
    assert b"null" not in msgspec.json.encode(body)
    assert with_nulls(body, ContactMessage) == sent(message)


def test_plain_schema_describes_every_field_of_a_finger() -> None:
    described = plain_schema(ContactMessage)["properties"]["contacts"]["items"]
    assert described["properties"].keys() == sent(fingers_message(*two_fingers()))["contacts"][0].keys()
    assert "shear_x_n" not in described["required"]
    assert "force_n" in described["required"]


def scenes(*messages: ContactMessage) -> list[list[Drawn]]:
    """The drawings of these messages, each a tenth of a second after the one before."""
    scene = PadScene.of_state("demo", msgspec.to_builtins(PadConfig(name="demo", source=SimulatedSource())))
    bodies = [sent(message) | {"utc_ns": 10**18 + number * 10**8} for number, message in enumerate(messages)]
    return [list(scene.contact(body)) for body in bodies]


def there(drawn: list[Drawn]) -> dict[str, Entity]:
    """The entities that a scene's updates put there, by id; an entity that is deleted is not."""
    updates = [each.message for each in drawn if isinstance(each.message, SceneUpdate)]
    found = {entity.id: entity for update in updates for entity in update.entities}
    return {name: entity for name, entity in found.items() if name not in {d.id for u in updates for d in u.deletions}}


def test_each_finger_is_drawn_without_the_resultant() -> None:
    (drawn,) = scenes(fingers_message(*two_fingers()))
    touch = there(drawn)["contact"]
    assert [(each.pose.position.x, each.pose.position.y) for each in touch.cylinders] == [
        (-0.004, 0.002),
        (0.006, -0.001),
    ]
    lengths = [each.shaft_length + each.head_length for each in touch.arrows]
    assert lengths == pytest.approx([0.02 * 0.6, 0.02 * (0.9**2 + 0.1**2) ** 0.5])
    assert [each.text for each in touch.texts] == ["3", "4"]
    assert len(there(drawn)["magnet"].cylinders) == len(there(drawn)["magnet"].spheres) == 2
    assert "health" not in there(drawn)


def test_vanished_objects_are_not_drawn() -> None:
    two, one, none, unknown = scenes(
        fingers_message(*two_fingers()), fingers_message(two_fingers()[1]), fingers_message(), UNKNOWN
    )
    assert [len(there(drawn)["contact"].arrows) for drawn in (two, one)] == [2, 1]
    assert "contact" not in there(none)
    assert "magnet" in there(none)
    assert {"contact", "magnet"} & there(unknown).keys() == set()


def test_unknown_fingers_draw_the_resultant_without_number() -> None:
    (drawn,) = scenes(fingers_message(*two_fingers(), contacts=None))
    touch = there(drawn)["contact"]
    assert (len(touch.arrows), len(touch.texts)) == (1, 0)
    assert touch.cylinders[0].pose.position.x == pytest.approx(0.002)


def test_more_than_two_fingers_is_reported_in_the_picture() -> None:
    (drawn,) = scenes(fingers_message(*two_fingers(), more=True))
    assert "two fingers do not explain" in there(drawn)["health"].texts[0].text


def test_finger_stays_in_its_column_while_it_touches() -> None:
    left, right = finger_message(7, x_m=-0.005), finger_message(8, x_m=0.005)
    third = finger_message(9)
    told = scenes(
        fingers_message(left, right),
        fingers_message(right, left),
        fingers_message(right),
        fingers_message(right, third),
        fingers_message(left, right, third),
        fingers_message(),
        UNKNOWN,
    )
    rows = [each.message for drawn in told for each in drawn if isinstance(each.message, Fingers)]
    columns = [(row.count, row.first and row.first.id, row.second and row.second.id) for row in rows]
    assert columns == [(2, 7, 8), (2, 7, 8), (1, None, 8), (2, 9, 8), (3, 9, 8), (0, None, None)]
    assert rows[0].first == left


def test_drawings_fit_their_plain_schemas() -> None:
    for drawn in scenes(fingers_message(*two_fingers()), fingers_message(two_fingers()[0])):
        for each in drawn:
            kind = type(each.message)
            text = msgspec.json.encode(without_nulls(msgspec.to_builtins(each.message), kind))
            assert fits(msgspec.json.decode(text), plain_schema(kind))
            assert b"null" not in text


def test_pad_with_one_magnet_has_none_of_these_channels() -> None:
    (drawn,) = scenes(contact_message())
    assert {each.topic.partition("/")[0] for each in drawn} == {"transform", "scene", "magnet", "wrench"}
    (drawn,) = scenes(fingers_message())
    assert {each.topic.partition("/")[0] for each in drawn} == {"transform", "scene", "magnets", "fingers", "wrench"}


def test_replay_names_what_differs_of_fingers() -> None:
    comparison = Comparison()
    one, two = two_fingers()
    recorded = [fingers_message(one, two, seq=number) for number in range(3)]
    weaker = msgspec.structs.replace(two, force_sd_n=0.05)
    replayed = [
        recorded[0],
        msgspec.structs.replace(recorded[1], contacts=[one, weaker]),
        msgspec.structs.replace(recorded[2], contacts=msgspec.UNSET, more=msgspec.UNSET, poses=msgspec.UNSET),
    ]
    for contact, other in zip(recorded, replayed, strict=True):
        comparison.replayed(other)
        comparison.recorded(contact)
    assert comparison.identical == 1
    assert [(seq, names) for _, seq, names in comparison.different] == [
        (1, ["contacts"]),
        (2, ["contacts", "more", "poses"]),
    ]
    assert not comparison.is_the_same
