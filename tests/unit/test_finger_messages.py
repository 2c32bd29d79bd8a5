"""The fields of pads with several magnets: they arrive as sent, and a pad with one magnet sends no additional byte."""

from __future__ import annotations

import json
import logging
import math
from pathlib import Path
from typing import Any

import msgpack
import msgspec
import pytest
from bus_messages import contact_message, finger_message, fingers_message, now_message, pose_message, two_fingers
from hypothesis import given
from hypothesis import strategies as st

from fmfts.bus.encoding import NotFiniteError, decode_contact, encode
from fmfts.bus.messages import ContactMessage, FingerMessage, PoseMessage, without_estimate
from fmfts.bus.publisher import Publisher
from fmfts_client import Contact, Endpoints, MessageError

# What is what: README.md there.
GOLDEN = Path(__file__).parents[1] / "data" / "messages"
TIMES = {"t_sample_ns": 1_000_000_000, "t_publish_ns": 1_004_600_000, "utc_ns": 1_767_225_600_000_000_000}
NOT_NUMBERS = (math.nan, math.inf, -math.inf)
OF_SEVERAL = ("contacts", "more", "poses")
FINGER_FIELDS = [name for name, hint in FingerMessage.__annotations__.items() if hint.startswith("float")]
POSE_FIELDS = [name for name, hint in PoseMessage.__annotations__.items() if hint.startswith("float")]

numbers = st.floats(-1e300, 1e300)
nullable = numbers | st.none()
fingers = st.builds(
    FingerMessage,
    id=st.integers(-(2**63), 2**63 - 1),
    **{name: numbers for name in FINGER_FIELDS if "shear" not in name},
    **{name: nullable for name in FINGER_FIELDS if "shear" in name},
)


def sent(message: ContactMessage) -> dict[str, Any]:
    decoded: dict[str, Any] = msgpack.unpackb(encode(message))
    return decoded


def lost_message() -> ContactMessage:
    nothing = ("contact", "x_m", "x_sd_m", "y_m", "y_sd_m", "force_n", "force_sd_n", "temperature_c", "baseline")
    null = dict.fromkeys((*nothing, "pose", "now"))
    return contact_message(**TIMES, **null, health="lost", reason="no pose fits")


def test_pad_with_one_magnet_sends_the_bytes_that_it_always_sent() -> None:
    touch = contact_message(**TIMES, now=now_message(1_004_500_000))
    assert encode(touch) == (GOLDEN / "one-magnet.msgpack").read_bytes()
    assert encode(lost_message()) == (GOLDEN / "one-magnet-lost.msgpack").read_bytes()


def golden_fingers() -> dict[str, ContactMessage]:
    poses = [
        pose_message(position_m=(-0.006, 0.0, 0.0104)),
        pose_message(position_m=(0.006, 0.0, 0.0104), ambient_t=None),
    ]
    return {
        "two-fingers": fingers_message(*two_fingers(), **TIMES, poses=poses),
        "no-finger": fingers_message(**TIMES, poses=poses),
        "cannot-tell": without_estimate(
            fingers_message(*two_fingers(), **TIMES, more=True), health="lost", reason="no pose fits"
        ),
    }


@pytest.mark.parametrize("name", golden_fingers())
def test_pad_with_several_magnets_sends_the_golden_bytes(name: str) -> None:
    assert encode(golden_fingers()[name]) == (GOLDEN / f"{name}.msgpack").read_bytes()


@pytest.mark.parametrize("name", [path.stem for path in sorted(GOLDEN.glob("*.msgpack"))])
def test_golden_messages_are_read_as_their_json_says(name: str) -> None:
    """tests/c_client/test_decoder.py tests the same for the C client."""
    wanted = json.loads((GOLDEN / f"{name}.json").read_text())
    contact = Contact.from_message(msgpack.unpackb((GOLDEN / f"{name}.msgpack").read_bytes()))
    told = json.loads(msgspec.json.encode(contact))
    assert {field: told.get(field) for field in wanted} == wanted
    assert all(told[field] is None for field in OF_SEVERAL if field not in wanted)


@pytest.mark.parametrize("name", ["one-magnet", "one-magnet-lost"])
def test_old_message_round_trip_keeps_every_byte(name: str) -> None:
    payload = (GOLDEN / f"{name}.msgpack").read_bytes()
    message = decode_contact(payload)
    assert [getattr(message, field) for field in OF_SEVERAL] == [msgspec.UNSET] * 3
    assert encode(message) == payload
    contact = Contact.from_message(msgpack.unpackb(payload))
    assert (contact.contacts, contact.more, contact.poses) == (None, None, None)
    assert not contact.tells_fingers


@given(st.none() | st.lists(fingers, max_size=3), st.booleans(), st.none() | st.integers(0, 3))
def test_fingers_arrive_as_they_were_sent(
    of_contact: list[FingerMessage] | None, more: bool, magnets: int | None
) -> None:
    poses = None if magnets is None else [pose_message(remanence_t=float(number)) for number in range(magnets)]
    message = fingers_message(contacts=of_contact, more=more, poses=poses)
    assert decode_contact(encode(message)) == message
    contact = Contact.from_message(sent(message))
    assert contact.more is more
    assert contact.tells_fingers
    assert _as_maps(contact.contacts) == sent(message)["contacts"]
    assert (contact.poses is None) is (poses is None)
    assert [pose.remanence_t for pose in contact.poses or ()] == [float(number) for number in range(magnets or 0)]


def _as_maps(fingers: Any) -> Any:
    return None if fingers is None else [vars(finger) for finger in fingers]


def test_no_contact_and_unknown_are_different_answers() -> None:
    assert Contact.from_message(sent(fingers_message())).contacts == ()
    unknown = Contact.from_message(sent(fingers_message(contacts=None)))
    assert unknown.contacts is None
    assert unknown.tells_fingers


def test_reader_that_knows_no_fingers_reads_their_resultant() -> None:
    message = {name: value for name, value in sent(fingers_message(*two_fingers())).items() if name not in OF_SEVERAL}
    contact = Contact.from_message(message)
    assert contact.valid
    assert contact.force_n == pytest.approx(1.5)
    assert contact.x_m == pytest.approx((0.6 * -0.004 + 0.9 * 0.006) / 1.5)


@pytest.mark.parametrize("number", NOT_NUMBERS)
@pytest.mark.parametrize("field", FINGER_FIELDS)
@pytest.mark.parametrize("which", [0, 1])
def test_finger_with_a_non_finite_number_is_not_encoded(field: str, number: float, which: int) -> None:
    fingers = list(two_fingers())
    fingers[which] = msgspec.structs.replace(fingers[which], **{field: number})
    with pytest.raises(NotFiniteError, match=rf"pad 'demo': ContactMessage\.contacts\.{which}\.{field} "):
        encode(fingers_message(contacts=fingers))


@pytest.mark.parametrize("number", NOT_NUMBERS)
@pytest.mark.parametrize("field", POSE_FIELDS)
def test_magnet_pose_with_a_non_finite_number_is_not_encoded(field: str, number: float) -> None:
    poses = [pose_message(), pose_message(**{field: number})]
    with pytest.raises(NotFiniteError, match=rf"ContactMessage\.poses\.1\.{field} "):
        encode(fingers_message(poses=poses))
    with pytest.raises(NotFiniteError, match=r"poses\.0\.position_m\.1"):
        encode(fingers_message(poses=[pose_message(position_m=(0.0, number, 0.0))]))


def test_infinities_of_two_fingers_do_not_cancel() -> None:
    with pytest.raises(NotFiniteError):
        encode(fingers_message(contacts=[finger_message(1, x_m=math.inf), finger_message(2, x_m=-math.inf)]))


@pytest.mark.parametrize(
    ("finger", "named"),
    [
        ({"force_n": math.nan}, "force_n"),
        ({"x_m": None}, "x_m"),
        ({"id": 1.0}, "id"),
        ({"id": None}, "id"),
        ({"shear_x_n": "0.1"}, "shear_x_n"),
    ],
)
def test_client_refuses_a_wrong_finger_by_name(finger: dict[str, Any], named: str) -> None:
    message = sent(fingers_message(*two_fingers()))
    message["contacts"][1] |= finger
    with pytest.raises(MessageError, match=rf"contacts: Finger\.{named}"):
        Contact.from_message(message)


@pytest.mark.parametrize("field", ["contacts", "more", "poses"])
@pytest.mark.parametrize("value", [1.5, "two", {}, [3]])
def test_client_refuses_wrong_kinds_of_these_fields(field: str, value: object) -> None:
    with pytest.raises(MessageError, match=field):
        Contact.from_message(sent(fingers_message(*two_fingers())) | {field: value})


def test_client_ignores_keys_of_a_later_finger() -> None:
    message = sent(fingers_message(*two_fingers()))
    message["contacts"][0]["slip"] = 0.5
    assert Contact.from_message(message).contacts is not None


def test_without_an_estimate_each_kind_of_pad_keeps_its_keys() -> None:
    several = sent(without_estimate(fingers_message(*two_fingers(), more=True), health="lost"))
    assert (several["contacts"], several["more"], several["poses"]) == (None, False, None)
    assert (several["force_n"], several["pose"], several["health"]) == (None, None, "lost")
    one = sent(without_estimate(contact_message(), health="lost"))
    assert not {*OF_SEVERAL} & one.keys()
    assert (one["force_n"], one["pose"], one["health"]) == (None, None, "lost")


def test_finger_with_nan_removes_all_estimates(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    publisher = Publisher(Endpoints.from_base(f"ipc://{tmp_path}"), "b00t", pads=["demo"])
    try:
        with caplog.at_level(logging.ERROR):
            message = fingers_message(finger_message(1, force_sd_n=math.nan), more=True)
            told = publisher.send_contact("demo", message)
    finally:
        publisher.close()
    assert (told.health, told.contacts, told.more, told.poses, told.force_n) == ("lost", None, False, None, None)
    assert "contacts.0.force_sd_n" in told.reason
    assert publisher.refused == 1
