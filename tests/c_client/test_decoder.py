"""The C client reads what the daemon's encoder writes, field by field, and refuses what the Python client refuses."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import msgpack
import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from c_client.built import CLIENT, HERE, NEW, REFUSED, ROOT, SANITIZED, WRONG_VERSION, Talker, build, need, run
from c_client.messages import anything, contacts
from fmfts.bus.encoding import encode
from fmfts.bus.messages import ContactMessage, FingerMessage, Health, PoseMessage
from fmfts_client import Contact, MessageError, SchemaError
from unit.bus_messages import contact_message, finger_message, fingers_message, pose_message, two_fingers

LONGEST_REASON = 255
HEALTHS = get_args(Health)

OF_SEVERAL = ("contacts", "more", "poses", "slip")  # sent only for pads with several magnets, or if it was requested
MAX_FINGERS, MAX_MAGNETS = 4, 9
FIELDS = sorted(field.name for field in msgspec.structs.fields(ContactMessage))
FINGER_FIELDS = sorted(field.name for field in msgspec.structs.fields(FingerMessage))
POSE_FIELDS = sorted(field.name for field in msgspec.structs.fields(PoseMessage))
GOLDEN_MESSAGES = ROOT / "tests/data/messages"
GOLDEN = encode(contact_message(t_sample_ns=1, t_publish_ns=2, utc_ns=3))
GOLDEN_OF_FINGERS = encode(fingers_message(*two_fingers(), t_sample_ns=1, t_publish_ns=2, utc_ns=3))


@pytest.fixture(scope="module")
def c_client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Talker]:
    program = tmp_path_factory.mktemp("c") / "decode"
    build(program, "gcc", [HERE / "decode.c", HERE / "shown.c"], *SANITIZED)
    with Talker(program) as talker:
        yield talker


def cut(reason: str) -> str:
    return reason.encode()[:LONGEST_REASON].decode(errors="ignore")


def expected(message: dict[str, Any]) -> dict[str, Any]:
    """What the Python client reads, as the C client should print it."""
    contact = Contact.from_message(message)
    plain: dict[str, Any] = json.loads(msgspec.json.encode(contact))
    plain["reason"] = cut(plain["reason"])
    for name, places in (("contacts", MAX_FINGERS), ("poses", MAX_MAGNETS)):
        plain[name] = plain[name] and plain[name][:places]
    del plain["v"], plain["clock_ahead_s"]
    return plain | {"measured": contact.valid}


def read(answer: dict[str, Any]) -> dict[str, Any]:
    assert answer["result"] == NEW, answer["why"]
    return {name: value for name, value in answer.items() if name not in ("result", "why", "size")}


@given(contacts)
@settings(max_examples=60)
def test_every_field_of_every_contact_is_read_as_it_was_encoded(c_client: Talker, contact: ContactMessage) -> None:
    payload = encode(contact)
    assert read(c_client.decode(payload)) == expected(msgpack.unpackb(payload))


@given(contacts, st.data())
@settings(max_examples=40)
def test_key_order_unknown_keys_and_number_widths_do_not_matter(
    c_client: Talker, contact: ContactMessage, data: st.DataObject
) -> None:
    message = msgpack.unpackb(encode(contact))
    later = {"later": data.draw(anything), "tau": {"deep": [1, {"x": b"y"}]}}
    keys = data.draw(st.permutations([*message, *later]))
    shuffled = {key: (message | later)[key] for key in keys}
    payload = msgpack.packb(shuffled, use_single_float=False)
    assert read(c_client.decode(payload)) == expected(message)


def test_whole_numbers_and_single_floats_serve_as_numbers(c_client: Talker) -> None:
    message = msgpack.unpackb(encode(contact_message(pose=None)))
    for force in (2, -2, 200, -200, 70000, -70000, 2**40, -(2**40), 2**63, 0.5):
        payload = msgpack.packb(message | {"force_n": force}, use_single_float=True)
        assert read(c_client.decode(payload))["force_n"] == force


@given(st.sampled_from(FIELDS), anything)
@settings(max_examples=150)
def test_c_client_refuses_the_same_messages_as_python(c_client: Talker, name: str, value: Any) -> None:
    message = msgpack.unpackb(encode(contact_message())) | {name: value}
    agree(c_client, msgpack.packb(message))


@given(contacts, st.sampled_from(POSE_FIELDS), anything)
@settings(max_examples=60)
def test_c_client_refuses_the_same_poses_as_python(
    c_client: Talker, contact: ContactMessage, name: str, value: Any
) -> None:
    message = msgpack.unpackb(encode(contact))
    if message["pose"] is not None:
        message["pose"][name] = value
        agree(c_client, msgpack.packb(message))


@given(st.sampled_from(FINGER_FIELDS), anything, st.integers(0, 5))
@settings(max_examples=80)
def test_c_client_refuses_the_same_fingers_as_python(c_client: Talker, name: str, value: Any, which: int) -> None:
    """Even in a finger beyond the client's room."""
    fingers = [finger_message(number) for number in range(6)]
    message = msgpack.unpackb(encode(fingers_message(*fingers)))
    message["contacts"][which][name] = value
    agree(c_client, msgpack.packb(message))


@given(st.sampled_from(OF_SEVERAL), anything | st.lists(anything, max_size=3))
@settings(max_examples=80)
def test_both_clients_refuse_invalid_lists(c_client: Talker, name: str, value: Any) -> None:
    agree(c_client, msgpack.packb(msgpack.unpackb(encode(fingers_message(*two_fingers()))) | {name: value}))


@pytest.mark.parametrize("name", [path.stem for path in sorted(GOLDEN_MESSAGES.glob("*.msgpack"))])
def test_golden_messages_are_read_as_their_json_says(c_client: Talker, name: str) -> None:
    """tests/unit/test_finger_messages.py asks the same of the Python client."""
    wanted = json.loads((GOLDEN_MESSAGES / f"{name}.json").read_text())
    told = read(c_client.decode((GOLDEN_MESSAGES / f"{name}.msgpack").read_bytes()))
    assert {field: told.get(field) for field in wanted if field != "v"} == {
        field: value for field, value in wanted.items() if field != "v"
    }
    assert all(told[field] is None for field in OF_SEVERAL if field not in wanted)


def test_fingers_and_magnets_without_a_place_are_left_out(c_client: Talker) -> None:
    fingers = [finger_message(number) for number in range(7)]
    message = fingers_message(*fingers, poses=[pose_message(chi2=float(number)) for number in range(12)])
    told = read(c_client.decode(encode(message)))
    assert [finger["id"] for finger in told["contacts"]] == [0, 1, 2, 3]
    assert [pose["chi2"] for pose in told["poses"]] == list(range(9))
    assert told["force_n"] == pytest.approx(7 * 0.6)


def test_last_of_two_equal_keys_counts(c_client: Talker) -> None:
    """As in Python. No finger of the first list may remain."""
    body = encode(fingers_message(*two_fingers()))
    pairs = int.from_bytes(body[1:3], "big")
    for last, known in (([], []), (None, None)):
        twice = body[:1] + (pairs + 1).to_bytes(2, "big") + body[3:] + msgpack.packb("contacts") + msgpack.packb(last)
        assert msgpack.unpackb(twice)["contacts"] == last
        assert read(c_client.decode(twice))["contacts"] == known


def agree(c_client: Talker, payload: bytes) -> None:
    answer = c_client.decode(payload)
    try:
        wanted = expected(msgpack.unpackb(payload))
    except SchemaError:
        assert answer["result"] == WRONG_VERSION
    except MessageError:
        assert answer["result"] == REFUSED
    else:
        if answer["result"] == REFUSED:
            # Values that C cannot hold: 64 bits of sign and number, and words of 64 bytes.
            assert re.search("integer of 64 bits|is not text", answer["why"]), answer
        elif wanted["health"] not in HEALTHS:
            assert answer["health"] == "unknown"
        else:
            assert read(answer) == wanted


@pytest.mark.parametrize("name", [name for name in FIELDS if name not in ("v", "now", *OF_SEVERAL)])
def test_missing_key_is_named_and_not_null(c_client: Talker, name: str) -> None:
    message = msgpack.unpackb(encode(contact_message()))
    del message[name]
    answer = c_client.decode(msgpack.packb(message))
    assert (answer["result"], answer["why"]) == (REFUSED, f"{name} is missing")


def test_daemon_that_does_not_send_now_is_read(c_client: Talker) -> None:
    message = msgpack.unpackb(encode(contact_message()))
    del message["now"]
    answer = c_client.decode(msgpack.packb(message))
    assert answer["now"] is None
    assert answer["force_n"] == 1.5


def test_other_version_is_distinguished_whatever_else_is_in_message(c_client: Talker) -> None:
    for message in ({"v": 2}, {"force_n": "much", "v": 2}, {}, {"v": True}, {"v": "1"}, {"v": 1.0}):
        answer = c_client.decode(msgpack.packb(message))
        assert answer["result"] == WRONG_VERSION, message
        assert "this client reads 1" in answer["why"]


@given(st.binary(max_size=64))
def test_bytes_that_are_no_message_are_refused(c_client: Talker, payload: bytes) -> None:
    assert c_client.decode(payload)["result"] in (REFUSED, WRONG_VERSION)


@pytest.mark.parametrize("message", [contact_message, lambda **changes: fingers_message(*two_fingers(), **changes)])
def test_message_cut_off_or_too_long_is_refused_at_every_byte(c_client: Talker, message: Any) -> None:
    payload = encode(message(temperature_c=None, reason="häßlich"))
    for size in range(len(payload)):
        assert c_client.decode(payload[:size])["result"] == REFUSED, size
    assert c_client.decode(payload + b"\xc0")["result"] == REFUSED
    assert c_client.decode(payload)["result"] == NEW


@pytest.mark.parametrize("golden", [GOLDEN, GOLDEN_OF_FINGERS], ids=["one magnet", "several"])
@given(st.data())
@settings(max_examples=150)
def test_damaged_byte_decodes_as_in_python(c_client: Talker, golden: bytes, data: st.DataObject) -> None:
    payload = bytearray(golden)
    payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    try:
        unpacked = msgpack.unpackb(bytes(payload))
    except (ValueError, msgpack.UnpackException):
        assert c_client.decode(bytes(payload))["result"] in (REFUSED, WRONG_VERSION)
    else:
        if isinstance(unpacked, dict):
            agree(c_client, bytes(payload))


def test_long_reason_is_cut_between_characters(c_client: Talker) -> None:
    for reason in ("x" * 255, "x" * 256, "x" * 254 + "é", "x" * 253 + "é" * 5, "€" * 200, "x" * 65000):
        assert read(c_client.decode(encode(contact_message(reason=reason))))["reason"] == cut(reason)


def test_nesting_to_any_depth_is_skipped(c_client: Talker) -> None:
    message = msgpack.unpackb(encode(contact_message()))
    body = msgpack.packb(message)
    head, pairs = body[:3], int.from_bytes(body[1:3], "big")
    assert head[0] == 0xDE
    deep = b"\xde" + (pairs + 1).to_bytes(2, "big") + b"\xa1z" + b"\x91" * 60000 + b"\xc0" + body[3:]
    assert c_client.decode(deep)["result"] == NEW


def test_non_finite_number_is_refused_everywhere(c_client: Talker) -> None:
    message = msgpack.unpackb(encode(contact_message()))
    places = [(message, name) for name, value in message.items() if isinstance(value, float)]
    places += [(message["pose"], name) for name, value in message["pose"].items() if isinstance(value, float)]
    places += [(value, 2) for value in message["pose"].values() if isinstance(value, list)]
    assert len(places) > 15
    for place, name in places:
        good = place[name]
        for bad in (math.nan, math.inf, -math.inf):
            place[name] = bad
            assert c_client.decode(msgpack.packb(message))["result"] == REFUSED, name
        place[name] = good
    assert read(c_client.decode(msgpack.packb(message)))["measured"]


@pytest.mark.parametrize(
    "change",
    [
        {"over_range": True},
        {"health": "degraded"},
        {"health": "lost"},
        {"contact": None},
        {"force_n": None},
        {"x_m": None},
    ],
)
def test_contact_with_unmeasured_facts_is_not_measured(c_client: Talker, change: dict[str, Any]) -> None:
    assert not read(c_client.decode(encode(contact_message(**change))))["measured"]


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_client_compiles_without_a_warning(compiler: str, tmp_path: Path) -> None:
    for optimisation in ("-O0", "-O3"):
        build(tmp_path / "decode", compiler, [HERE / "decode.c", HERE / "shown.c"], optimisation)
    for standard in ("c++11", "c++20"):
        header = tmp_path / "header.cpp"
        header.write_text('#include "fmfts.h"\nstatic_assert(FMFTS_SCHEMA_VERSION == 1, "");\n')
        warnings = ["-Wall", "-Wextra", "-Wpedantic", "-Werror"]
        compile_header = [f"-std={standard}", *warnings, f"-I{CLIENT}", "-c", header, "-o", tmp_path / "header.o"]
        run([need("g++" if compiler == "gcc" else "clang++"), *compile_header])


def test_fuzzed_decoder_stays_within_bounds_on_corpus_and_near_it(tmp_path: Path) -> None:
    program = build(tmp_path / "fuzz", "clang", [HERE / "fuzz_decoder.c"], "-fsanitize=fuzzer", *SANITIZED)
    corpus = ROOT / "tests/c_client/corpus"
    assert len(list(corpus.iterdir())) > 10, "the corpus is gone"
    (tmp_path / "new").mkdir()
    run([program, "-seed=1", "-runs=20000", "-max_len=2048", tmp_path / "new", corpus], cwd=tmp_path)
