"""Damages messages between peers, and demands that each decoder refuses them with its own errors.

    python tests/fuzz/peers.py --seconds 60

`control`: requests to the daemon; only BadRequestError may come out, with a text that can be encoded. `messages`: a
client's input from the bus and from an answer; only MessageError, SchemaError and ControlError may come out. Each input
is a real message in which a value or a key is replaced, a key is dropped, or bytes are damaged.

The seed and the number of an input reproduce it: --seed 1 --first 4711 --inputs 1.
"""

from __future__ import annotations

import argparse
import copy
import sys
import time
from collections import Counter
from collections.abc import Callable
from itertools import count
from pathlib import Path
from random import Random
from typing import Any

import msgpack

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[1] / "unit"))

from bus_messages import contact_message, event_message, now_message, pose_message, status_message

from drills.file_damage import damaged
from fmfts.bus.control import VERBS, BadRequestError, ControlServer, Request, _check, _decode, _identity
from fmfts.bus.encoding import encode, encode_facts
from fmfts.runtime.requests import _Baseline, _Nothing, _OfPad
from fmfts_client import Contact, ControlError, Event, MessageError, Status
from fmfts_client import control as client_control
from fmfts_client.clock import SenderClock
from fmfts_client.subscription import Subscription

LONGEST_S = 1.0
PLACE = "here stands another value"
DEPTHS = (100, 500, 960, 990, 1010, 1023, 3000)  # near the limits of msgpack, msgspec and Python's repr
# Values in msgpack, complete or not: nested, of every type, at the ends of their ranges, and with false sizes.
TOKENS = (
    b"\xc0", b"\xc1", b"\xc2", b"\xc3", b"\x00", b"\xff", b"\xcf" + b"\xff" * 8, b"\xd3\x80" + bytes(7),
    b"\xcb\x7f\xf0" + bytes(6), b"\xcb\xff\xf0" + bytes(6), b"\xcb\x7f\xf8" + bytes(6), b"\xcb\x7f\xef" + b"\xff" * 6,
    b"\xca\x7f\xc0\x00\x00", b"\xca\x00\x00\x00\x01", b"\xcb\x80" + bytes(7), b"\xa0", b"\xa1\xff", b"\xa3\xed\xa0\x80",
    b"\xa1\x00", b"\xa4left", b"\xda\x4e\x20" + b"x" * 20_000, b"\xdb\xff\xff\xff\xff", b"\xc4\x00", b"\xc4\x01\xff",
    b"\xc6\xff\xff\xff\xff", b"\x90", b"\x80", b"\x91\xc0", b"\x81\x00\x00", b"\x81\x80\x00", b"\x81\x90\x00",
    b"\x82\xa1a\x00\xa1a\x01", b"\xdc\xff\xff", b"\xdd\xff\xff\xff\xff", b"\xdf\xff\xff\xff\xff",
    b"\xd6\xff" + b"\xff" * 4,
    b"\xd7\xff" + b"\xff" * 8, b"\xc7\x0c\xff" + b"\xff" * 12, b"\xc7\x0c\xff" + bytes(4) + b"\x7f" + b"\xff" * 7,
    b"\xd4\x05\x00", b"\xc7\x00\x01", b"\xc9\xff\xff\xff\xff\x01",
    *(b"\x91" * depth + b"\xc0" for depth in DEPTHS), *(b"\x81\xa1a" * depth + b"\xc0" for depth in DEPTHS),
    b"\xdc\x27\x10" + b"\x00" * 10_000,
)  # fmt: skip

Target = Callable[[Random], None]


def spoilt(document: dict[str, Any], dice: Random) -> bytes:
    """Encoded in msgpack; a tenth of them unchanged."""
    kind = dice.random()
    if kind < 0.1:
        return bytes(msgpack.packb(document))
    if kind < 0.3:
        return damaged(msgpack.packb(document), dice)
    document = copy.deepcopy(document)
    at: Any = document
    while True:
        key = dice.choice(list(at) if isinstance(at, dict) else range(len(at)))
        if not isinstance(at[key], dict | list) or not at[key] or dice.random() < 0.2:
            break
        at = at[key]
    if kind < 0.4 and isinstance(at, dict):
        del at[key]
        return bytes(msgpack.packb(document))
    if kind < 0.45 and isinstance(at, dict):
        at[PLACE] = at.pop(key)  # another key
    else:
        at[key] = PLACE
    return bytes(msgpack.packb(document)).replace(msgpack.packb(PLACE), dice.choice(TOKENS))


def control(dice: Random) -> None:
    """A request, as ControlServer reads it."""
    request = {"id": dice.choice((7, "a" * 16)), "verb": dice.choice(sorted(VERBS)), "pad": "left"}
    more = {"rest": True, "bare": False, "seconds": 1.5, "nested": {"a": [1, 2.0, "b"]}}
    body = [spoilt(request | (more if dice.random() < 0.5 else {}), dice)]
    identity: int | str | None = None
    try:
        content = _decode(body * dice.choice((1, 1, 1, 1, 1, 1, 1, 0, 2)), dice.random() < 0.05)
        identity = _identity(content)
        _check(content)
        server: Any = ControlServer
        Request(server, (b"",), identity, content).arguments_as(dice.choice((_Nothing, _OfPad, _Baseline)))
    except BadRequestError as error:
        encode_facts({"id": identity, "error": str(error)})
        raise


def _sent() -> list[tuple[bytes, dict[str, Any]]]:
    """Topics and bodies of real messages, of all kinds."""
    whole = contact_message(pose=pose_message(), now=now_message(1))
    kept = sorted((Path(__file__).parents[1] / "data/messages").glob("*.msgpack"))
    bodies = [(b"contact", encode(whole)), (b"event", encode(event_message())), (b"status", encode(status_message()))]
    decoded = [(kind, msgpack.unpackb(body)) for kind, body in bodies]
    decoded += [(b"contact", msgpack.unpackb(file.read_bytes())) for file in kept]
    return [(kind + b"/" + body["pad"].encode(), body) for kind, body in decoded]


class Messages:
    """A message of the bus, and an answer, as a client reads them."""

    def __init__(self) -> None:
        self._sent = _sent()
        with Subscription(endpoint="ipc:///nowhere") as self._subscription:
            pass  # nothing is received: _accept gets the messages directly
        self._subscription._clock = SenderClock()  # as if from a daemon on another machine

    def __call__(self, dice: Random) -> None:
        (self._answer if dice.random() < 0.2 else self._message)(dice)

    def _answer(self, dice: Random) -> None:
        answers = ({"id": "0", "error": "no such pad", "code": 65}, {"id": "0", "ok": True, "pads": [self._sent[0][1]]})
        answer = client_control._decode(spoilt(dice.choice(answers), dice))
        if "error" in answer:
            raise client_control._refusal("status", answer)

    def _message(self, dice: Random) -> None:
        topic, body = dice.choice(self._sent)
        payload = spoilt(body, dice)
        if dice.random() < 0.1:
            topic = damaged(topic, dice)
        refused = self._subscription.refused
        message = self._subscription._accept([topic, payload, b""] if dice.random() < 0.02 else [topic, payload])
        if message is None and self._subscription.refused > refused:
            raise MessageError(self._subscription.refusal)
        if message is not None and message.kind == "contact":
            contact = Contact.from_message(message.body, message.clock_ahead_s)
            _ = contact.valid, contact.sample_age_s, contact.at()
        elif message is not None:
            (Event if message.kind == "event" else Status).from_message(message.body)


def fuzzed(name: str, seed: int, numbers: Any, until: float) -> Counter[str]:
    """How many inputs were read or refused. Re-raises an unexpected error, with a note that reproduces the input."""
    target: Target = {"control": lambda: control, "messages": Messages}[name]()
    said: Counter[str] = Counter()
    for number in numbers:
        begun = time.process_time()
        try:
            target(Random(f"{seed} {number}"))
            said["read"] += 1
        except (BadRequestError, MessageError, ControlError):
            said["refused"] += 1
        except BaseException as error:
            error.add_note(f"input {number} of seed {seed} to {name}")
            raise
        if time.process_time() - begun > LONGEST_S:
            raise TimeoutError(f"input {number} of seed {seed} to {name} took more than {LONGEST_S:g} s")
        if number % 100 == 0 and time.monotonic() > until:
            break
    return said


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("targets", nargs="*", default=["control", "messages"])
    parser.add_argument("--seconds", type=float, default=1e9, help="for each target")
    parser.add_argument("--inputs", type=int)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    options = parser.parse_args()
    for name in options.targets:
        numbers = count(options.first)
        if options.inputs is not None:
            numbers = range(options.first, options.first + options.inputs)  # type: ignore[assignment]
        begun = time.monotonic()
        said = fuzzed(name, options.seed, numbers, begun + options.seconds)
        print(f"{name}: {said.total()} inputs, {dict(said)}, {time.monotonic() - begun:.0f} s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
