"""The schema: one meaning for the daemon, the Python client and the documentation; nothing in it that is no number."""

from __future__ import annotations

import math
import re
import time
from dataclasses import fields
from pathlib import Path
from typing import Any

import msgpack
import msgspec
import numpy as np
import pytest
from bus_messages import (
    contact_message,
    event_message,
    frame_message,
    now_message,
    pose_message,
    status_message,
)
from hypothesis import given
from hypothesis import strategies as st

from fmfts.bus.encoding import NotFiniteError, encode, encode_facts
from fmfts.bus.messages import (
    ContactMessage,
    EarlyMessage,
    EventMessage,
    FingerMessage,
    FrameMessage,
    NowMessage,
    PoseMessage,
    StateMessage,
    StatusMessage,
)
from fmfts_client import Contact, Event, Finger, MessageError, Now, Pose, SchemaError, Status
from fmfts_client.fields import NOT_SENT

REPOSITORY = Path(__file__).parents[2]
NOT_NUMBERS = (math.nan, math.inf, -math.inf)
FLOAT_FIELDS = [name for name, hint in ContactMessage.__annotations__.items() if hint.startswith("float")]
POSE_FIELDS = [name for name, hint in PoseMessage.__annotations__.items() if hint.startswith(("float", "Vector"))]
# Keys that only pads with several magnets send, or pads whose configuration asks for slip.
OF_SEVERAL = [name for name, hint in ContactMessage.__annotations__.items() if "UnsetType" in hint]
MAY_BE_ABSENT = {"now", *OF_SEVERAL}
NOW_FIELDS = [name for name, hint in NowMessage.__annotations__.items() if hint.startswith("float")]


def sent(message: Any) -> dict[str, Any]:
    """The message that a subscriber decodes."""
    decoded: dict[str, Any] = msgpack.unpackb(encode(message))
    return decoded


def documented_keys() -> dict[str, set[str]]:
    """Section word → keys in the first column of its table in docs/messages.md."""
    text = (REPOSITORY / "docs" / "messages.md").read_text()
    sections = re.split(r"^##+ ", text, flags=re.MULTILINE)[1:]
    keys = {}
    for section in sections:
        rows = re.findall(r"^\| (`[^|]*`) \| (?:int|str|bool|bytes|float|map|\[)", section, flags=re.MULTILINE)
        keys[re.split(r"[/:\n]", section)[0].strip("` ")] = set(re.findall(r"`(\w+)`", " ".join(rows)))
    return keys


@pytest.mark.parametrize(
    ("section", "struct"),
    [
        ("contact", ContactMessage),
        ("pose", PoseMessage),
        ("contacts", FingerMessage),
        ("now", NowMessage),
        ("event", EventMessage),
        ("status", StatusMessage),
        ("frame", FrameMessage),
        ("early", EarlyMessage),
        ("state", StateMessage),
    ],
)
def test_documentation_names_exactly_the_fields_that_are_sent(section: str, struct: type[msgspec.Struct]) -> None:
    documented = documented_keys()
    common = set() if struct in (PoseMessage, FingerMessage, NowMessage) else documented["Every message"]
    assert documented[section] | common == set(struct.__struct_fields__)


@pytest.mark.parametrize(
    ("struct", "read"),
    [
        (ContactMessage, Contact),
        (PoseMessage, Pose),
        (FingerMessage, Finger),
        (NowMessage, Now),
        (EventMessage, Event),
        (StatusMessage, Status),
    ],
)
def test_client_reads_exactly_the_fields_that_are_sent(struct: type[msgspec.Struct], read: Any) -> None:
    assert {field.name for field in fields(read) if field.metadata != NOT_SENT} == set(struct.__struct_fields__)


def test_client_reads_back_what_was_sent() -> None:
    message = contact_message(shear_x_n=-0.25, temperature_c=None)
    contact = Contact.from_message(sent(message))
    assert contact.pose is not None
    for name in ContactMessage.__struct_fields__:
        if name not in ("pose", "now", *OF_SEVERAL):
            assert getattr(contact, name) == getattr(message, name), name
    assert contact.now is not None
    for name in NowMessage.__struct_fields__:
        assert getattr(contact.now, name) == getattr(message.now, name), name
    for name in PoseMessage.__struct_fields__:
        assert getattr(contact.pose, name) == getattr(message.pose, name), name
    assert Status.from_message(sent(status_message())).board == {"firmware": "0.1.0"}
    assert Event.from_message(sent(event_message())).kind == "onset"


def test_unknown_is_null_and_never_left_out() -> None:
    message = sent(contact_message(x_m=None, pose=None))
    assert message["x_m"] is None
    assert message["pose"] is None


@pytest.mark.parametrize("number", NOT_NUMBERS)
@pytest.mark.parametrize("field", FLOAT_FIELDS)
def test_contact_with_a_non_finite_number_is_not_encoded(field: str, number: float) -> None:
    with pytest.raises(NotFiniteError, match=rf"pad 'demo': ContactMessage.{field} "):
        encode(contact_message(**{field: number}))


def test_client_reads_a_daemon_that_does_not_send_now() -> None:
    message = sent(contact_message())
    del message["now"]
    contact = Contact.from_message(message)
    assert contact.now is None
    assert contact.at() is None
    assert contact.valid


def test_now_is_extrapolated_to_the_clients_time() -> None:
    message = contact_message()
    contact = Contact.from_message(sent(message))
    assert message.now is not None
    later, earlier = contact.at(message.now.t_ns + 5_000_000), contact.at(message.now.t_ns - 5_000_000)
    assert later is not None
    assert earlier is not None
    assert later.force_n == pytest.approx(1.51 + 2.0 * 5e-3)
    assert later.force_sd_n == earlier.force_sd_n == pytest.approx(0.05 + 5.0 * 5e-3)
    assert later.x_m == pytest.approx(0.005 + 0.01 * 5e-3)
    assert later.t_ns - earlier.t_ns == 10_000_000
    assert later.shear_x_n is None
    assert contact.at(message.now.t_ns + 30_000_000) is None


def test_force_that_is_carried_on_never_pulls() -> None:
    now_ns = time.monotonic_ns()
    falling = now_message(now_ns, force_n=0.1, force_rate_n_per_s=-50.0)
    contact = Contact.from_message(sent(contact_message(now=falling)))
    carried = contact.at(now_ns + 10_000_000)
    assert carried is not None
    assert carried.force_n == 0.0


def test_another_machines_instant_is_translated() -> None:
    """The reader's clock is 3 s ahead of the daemon's."""
    message = contact_message()
    assert message.now is not None
    contact = Contact.from_message(sent(message), clock_ahead_s=3.0)
    carried = contact.at(message.now.t_ns + 3_005_000_000)
    assert carried is not None
    assert carried.force_n == pytest.approx(1.51 + 2.0 * 5e-3, abs=1e-6)
    assert Contact.from_message(sent(message), clock_ahead_s=None).at(message.now.t_ns) is None


def nested(depth: int) -> list[Any]:
    """A list as deep as msgpack decodes; Python's repr of it raises RecursionError."""
    value: list[Any] = []
    for _ in range(depth):
        value = [value]
    return value


@pytest.mark.parametrize("field", ["v", "pad", "force_n"])
def test_client_refuses_a_nested_value_in_its_own_words(field: str) -> None:
    with pytest.raises(MessageError, match=r"\["):
        Contact.from_message(sent(contact_message()) | {field: nested(1020)})


@pytest.mark.parametrize("number", NOT_NUMBERS)
@pytest.mark.parametrize("field", NOW_FIELDS)
def test_now_with_a_non_finite_number_is_not_encoded(field: str, number: float) -> None:
    with pytest.raises(NotFiniteError, match=rf"now\.{field}"):
        encode(contact_message(now=now_message(1, **{field: number})))


@pytest.mark.parametrize("number", NOT_NUMBERS)
@pytest.mark.parametrize("field", POSE_FIELDS)
def test_pose_with_a_non_finite_number_is_not_encoded(field: str, number: float) -> None:
    value = (1.0, number, 0.0) if "Vector" in PoseMessage.__annotations__[field] else number
    with pytest.raises(NotFiniteError, match=rf"pose\.{field}"):
        encode(contact_message(pose=pose_message(**{field: value})))


def test_infinities_of_both_signs_do_not_cancel() -> None:
    with pytest.raises(NotFiniteError):
        encode(contact_message(x_m=math.inf, y_m=-math.inf))


def test_numbers_in_maps_and_lists_are_checked() -> None:
    with pytest.raises(NotFiniteError, match=r"board\.chips\.1\.gain"):
        encode(status_message(board={"chips": [{"gain": 1.0}, {"gain": math.nan}]}))
    with pytest.raises(NotFiniteError, match="noise_t"):
        encode_facts({"noise_t": math.inf})


def test_numpy_scalars_are_sent_as_numbers() -> None:
    assert sent(contact_message(force_n=np.float64(1.25)))["force_n"] == 1.25
    with pytest.raises(NotFiniteError):
        encode(contact_message(force_n=np.float64("nan")))


def test_frame_message_keeps_counts() -> None:
    assert sent(frame_message(7))["counts"][1] == [4, 5, -4096]


@pytest.mark.parametrize("field", [name for name in ContactMessage.__struct_fields__ if name not in MAY_BE_ABSENT])
def test_client_refuses_a_contact_without_a_field(field: str) -> None:
    message = sent(contact_message())
    del message[field]
    with pytest.raises(MessageError, match=field if field != "v" else "version"):
        Contact.from_message(message)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        *((field, number) for field in FLOAT_FIELDS for number in NOT_NUMBERS),
        ("force_n", "1.5"),
        ("force_n", True),
        ("seq", 1.0),
        ("seq", True),
        ("seq", None),
        ("over_range", 1),
        ("contact", 0),
        ("health", None),
        ("sensors_ok", "1111"),
        ("pose", [1, 2, 3]),
        ("pose", {}),
        ("baseline", 3),
    ],
)
def test_client_refuses_a_wrong_value_by_name(field: str, value: object) -> None:
    with pytest.raises(MessageError, match=field):
        Contact.from_message(sent(contact_message()) | {field: value})


@pytest.mark.parametrize("vector", [[0.0, 1.0], [0.0, 1.0, 2.0, 3.0], [0.0, math.nan, 0.0], "abc", 3.0, None])
def test_client_refuses_an_invalid_position(vector: object) -> None:
    message = sent(contact_message())
    message["pose"]["position_m"] = vector
    with pytest.raises(MessageError, match="position_m"):
        Contact.from_message(message)


@pytest.mark.parametrize("version", [0, 2, "1", None, True, 1.5])
def test_client_refuses_another_schema_version(version: object) -> None:
    with pytest.raises(SchemaError, match="schema version"):
        Contact.from_message(sent(contact_message()) | {"v": version})


def test_client_ignores_keys_of_a_later_daemon() -> None:
    assert Contact.from_message(sent(contact_message()) | {"grip": 0.5}).force_n == 1.5


JUNK = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=6,
)


@given(field=st.sampled_from(ContactMessage.__struct_fields__), value=JUNK)
def test_client_never_returns_a_non_finite_number(field: str, value: Any) -> None:
    try:
        contact = Contact.from_message(sent(contact_message()) | {field: value})
    except MessageError:
        return
    for name in FLOAT_FIELDS:
        number = getattr(contact, name)
        assert number is None or (type(number) is float and math.isfinite(number))


@pytest.mark.parametrize(
    ("changes", "valid"),
    [
        ({}, True),
        ({"contact": False, "x_m": None, "y_m": None, "force_n": 0.0}, True),
        ({"health": "degraded"}, False),
        ({"health": "no_baseline", "contact": None, "force_n": None}, False),
        ({"contact": None}, False),
        ({"force_n": None}, False),
        ({"x_m": None}, False),
        ({"over_range": True, "force_min_n": 3.0}, False),
    ],
)
def test_contact_is_valid_only_when_it_is_a_measurement(changes: dict[str, Any], valid: bool) -> None:
    assert Contact.from_message(sent(contact_message(**changes))).valid is valid
