"""Commands over real ZeroMQ: answered, refused, and never fatal."""

from __future__ import annotations

import math
import random
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgpack
import msgspec
import pytest
import zmq

from drills.control_fuzz import random_request
from fmfts.bus.control import LARGEST_REQUEST, MOST_UNREAD, VERBS, BadRequestError, ControlServer, Request
from fmfts.bus.encoding import not_finite_field
from fmfts.bus.lock import BusError
from fmfts_client import RefusedError, UnreachableError, request


@pytest.fixture
def base(tmp_path: Path) -> str:
    return f"ipc://{tmp_path}"


@pytest.fixture
def server(base: str) -> Iterator[ControlServer]:
    server = ControlServer(f"{base}/control")
    yield server
    server.close()


def waiting_at(server: ControlServer) -> list[Request]:
    """The valid requests that have arrived."""
    taken: list[Request] = []
    while server.serve_one(taken.append):
        pass
    return taken


class Dealer:
    """A peer that may say anything."""

    def __init__(self, base: str, kind: int = zmq.DEALER) -> None:
        self.socket: zmq.Socket[bytes] = zmq.Context.instance().socket(kind)
        self.socket.setsockopt(zmq.LINGER, 0)
        self.socket.connect(f"{base}/control")

    def ask(self, server: ControlServer, *parts: bytes) -> tuple[list[Request], dict[str, Any] | None]:
        """The requests that `parts` make, and the answer that the server gives by itself."""
        self.socket.send_multipart(parts)
        for _ in range(1000):
            requests = waiting_at(server)
            if requests or self.socket.poll(5):
                return requests, None if requests else self.answer()
        raise AssertionError("neither a request nor an answer")

    def answer(self) -> dict[str, Any]:
        assert self.socket.poll(5000)
        decoded: dict[str, Any] = msgpack.unpackb(self.socket.recv_multipart()[-1])
        return decoded


@pytest.fixture
def dealer(base: str) -> Iterator[Dealer]:
    dealer = Dealer(base)
    yield dealer
    dealer.socket.close()


@contextmanager
def answering(server: ControlServer, act: Any) -> Iterator[None]:
    """A loop like the daemon's, until the block ends."""
    done = threading.Event()

    def loop() -> None:
        while not done.is_set():
            while server.serve_one(act):
                pass
            done.wait(0.002)

    thread = threading.Thread(target=loop)
    thread.start()
    yield
    done.set()
    thread.join()


def test_answer_and_progress_reach_the_client(server: ControlServer, base: str) -> None:
    def act(request: Request) -> None:
        request.progress(done=0.5)
        request.reply(verb=request.verb, given=request.arguments)

    seen: list[dict[str, Any]] = []
    with answering(server, act):
        facts = request("baseline", endpoint=base, progress=seen.append, pad="demo", mode="rest")
    assert facts == {"verb": "baseline", "given": {"pad": "demo", "mode": "rest"}}
    assert seen == [{"done": 0.5}]


def test_refusal_reaches_the_client_in_the_daemons_words(server: ControlServer, base: str) -> None:
    with (
        answering(server, lambda each: each.fail("pad 'left': no such pad")),
        pytest.raises(RefusedError, match="selftest: pad 'left': no such pad"),
    ):
        request("selftest", endpoint=base, pad="left")


def test_client_shows_a_non_text_error(server: ControlServer, base: str) -> None:
    nested: list[Any] = []
    for _ in range(1010):  # Python's repr of it raises RecursionError
        nested = [nested]
    with (
        answering(server, lambda each: each._send(msgpack.packb({"id": each._identity, "error": nested}), last=True)),
        pytest.raises(RefusedError, match="status: "),
    ):
        request("status", endpoint=base)


def test_unknown_verb_is_refused_with_those_that_exist(server: ControlServer, base: str) -> None:
    with (
        answering(server, lambda each: each.reply()),
        pytest.raises(RefusedError, match="unknown verb 'reboot': one of baseline, pads, probe, selftest, status"),
    ):
        request("reboot", endpoint=base)


def test_progress_extends_the_patience_of_the_client(
    server: ControlServer, base: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each message comes after two thirds of its patience, by a clock that only they move."""
    now_s = 0.0

    def passes(_: object) -> None:
        nonlocal now_s
        now_s += 40.0

    def act(request: Request) -> None:
        for number in range(6):
            request.progress(number=number)
        request.reply()

    monkeypatch.setattr("fmfts_client.control.time", SimpleNamespace(monotonic=lambda: now_s))
    with answering(server, act):
        assert request("probe", endpoint=base, timeout_s=60.0, progress=passes) == {}
    assert now_s == 6 * 40.0


def test_absent_daemon_is_named_with_its_endpoint(base: str) -> None:
    with pytest.raises(UnreachableError, match=rf"no answer from {base}/control for 0.1 s: is fmfts-daemon running"):
        request("status", endpoint=base, timeout_s=0.1)


def test_plain_req_socket_is_served_too(server: ControlServer, base: str) -> None:
    peer = Dealer(base, zmq.REQ)
    requests, _ = peer.ask(server, msgpack.packb({"id": 1, "verb": "pads"}))
    requests[0].reply(pads=["demo"])
    assert peer.answer() == {"id": 1, "ok": True, "pads": ["demo"]}
    peer.socket.close()


class OfPad(msgspec.Struct, forbid_unknown_fields=True):
    pad: str


class BaselineArguments(OfPad, forbid_unknown_fields=True):
    seconds: float = 2.0


def test_arguments_are_read_strictly(server: ControlServer, dealer: Dealer) -> None:
    good, _ = dealer.ask(server, msgpack.packb({"id": 1, "verb": "baseline", "pad": "demo", "seconds": 3}))
    assert good[0].arguments_as(BaselineArguments) == BaselineArguments("demo", 3.0)
    bad, _ = dealer.ask(server, msgpack.packb({"id": 2, "verb": "baseline", "pad": "demo", "second": 3}))
    with pytest.raises(BadRequestError, match=r"baseline: .*no argument 'second'; it takes pad, seconds"):
        bad[0].arguments_as(BaselineArguments)


@pytest.mark.parametrize(
    ("parts", "reason"),
    [
        ([b""], "not a msgpack map"),
        ([b"\xc1"], "not a msgpack map"),
        ([b"\x93\x01\x02\x03"], "not a msgpack map"),
        ([b"\x81\xa2id"], "not a msgpack map"),
        ([b"\x91" * 1000], "not a msgpack map"),
        ([b"\x81\xa1a\x81\x80\x01"], "not a msgpack map"),  # a map for a key, which msgspec before 0.22 lets through
        ([msgpack.packb({"id": 1, "verb": "status"}), b"more"], "one message part, not several"),
        ([b"", msgpack.packb({"id": 1, "verb": "status"}), b"more"], "one message part, not several"),
        ([b"x" * (LARGEST_REQUEST + 1)], f"at most {LARGEST_REQUEST} bytes"),
        ([msgpack.packb({"verb": "status"})], "`id` must be"),
        ([msgpack.packb({"id": 1.5, "verb": "status"})], "`id` must be"),
        ([msgpack.packb({"id": True, "verb": "status"})], "`id` must be"),
        ([msgpack.packb({"id": "x" * 65, "verb": "status"})], "`id` must be"),
        ([msgpack.packb({"id": 1})], "unknown verb of type NoneType"),
        ([msgpack.packb({"id": 1, "verb": ["status"]})], "unknown verb of type list"),
        ([msgpack.packb({"id": 1, "verb": "STATUS"})], "unknown verb 'STATUS'"),
        ([msgpack.packb({"id": 1, "verb": "status", "age": math.nan})], "status: age is not a finite number"),
        ([msgpack.packb({"id": 1, "verb": "status", "age": [math.nan]})], "status: age must be text, a number, true"),
        ([msgpack.packb({"id": 1, "verb": "status", "age": {}})], "status: age must be text, a number, true"),
        ([msgpack.packb({"id": 1, "verb": "status"} | {str(n): n for n in range(17)})], "status: 17 arguments"),
    ],
)
def test_malformed_request_is_answered_with_the_reason(
    server: ControlServer, dealer: Dealer, parts: list[bytes], reason: str
) -> None:
    requests, answer = dealer.ask(server, *parts)
    assert not requests
    assert answer is not None
    assert reason in answer["error"]


def test_non_finite_number_is_never_in_an_answer(server: ControlServer, dealer: Dealer) -> None:
    requests, _ = dealer.ask(server, msgpack.packb({"id": 1, "verb": "selftest"}))
    requests[0].reply(noise_t=[1.0, math.nan])
    assert dealer.answer() == {"id": 1, "error": "internal error: noise_t.1 is not a finite number", "code": 65}


def test_request_is_answered_once(server: ControlServer, dealer: Dealer) -> None:
    requests, _ = dealer.ask(server, msgpack.packb({"id": 1, "verb": "status"}))
    requests[0].reply()
    with pytest.raises(RuntimeError, match="answered already"):
        requests[0].reply()


def test_client_that_has_gone_is_no_error(server: ControlServer, base: str) -> None:
    gone = Dealer(base)
    requests, _ = gone.ask(server, msgpack.packb({"id": 1, "verb": "status"}))
    gone.socket.close()
    requests[0].progress()
    requests[0].reply()


def test_requests_that_arrive_while_answer_is_sent_are_not_lost(server: ControlServer, dealer: Dealer) -> None:
    """ZeroMQ signals edges: the send may swallow the one that announced them."""
    requests, _ = dealer.ask(server, msgpack.packb({"id": 0, "verb": "status"}))
    for number in range(1, 4):
        dealer.socket.send(msgpack.packb({"id": number, "verb": "status"}))
    taken: list[Request] = []
    for _ in range(6000):
        requests[0].progress()
        taken += waiting_at(server)
        if len(taken) == 3:
            break
        threading.Event().wait(0.01)
    assert len(taken) == 3


def test_second_server_is_refused(server: ControlServer, base: str) -> None:
    with pytest.raises(BusError, match="another fmfts-daemon"):
        ControlServer(f"{base}/control")


def test_ten_thousand_random_requests_each_get_one_answer(server: ControlServer, dealer: Dealer) -> None:
    dice = random.Random(1)
    total, batch = 10_000, MOST_UNREAD
    carried_out = refused = 0
    for first in range(0, total, batch):
        batch = min(batch, total - first)
        for _ in range(batch):
            dealer.socket.send(random_request(dice))
        answered = 0
        while answered < batch:
            for each in waiting_at(server):
                assert each.verb in VERBS
                each.reply()
            while dealer.socket.poll(1):
                answer = dealer.answer()
                carried_out += "ok" in answer
                refused += "error" in answer
                answered += 1
    assert carried_out + refused == total
    assert min(carried_out, refused) > total // 10


def test_request_is_walked_for_few_items(
    server: ControlServer, dealer: Dealer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The check walks in Python, and takes microseconds an item."""
    walked: list[object] = []

    def counted(value: object, path: str = "") -> str:
        walked.append(value)
        return not_finite_field(value, path)

    monkeypatch.setattr("fmfts.bus.encoding.not_finite_field", counted)  # the function calls itself for each item
    monkeypatch.setattr("fmfts.bus.control.not_finite_field", counted)
    contents: list[dict[str, Any]] = [
        {"ages": [0] * 900},
        {"ages": [[[[[0]]]]] * 100},
        {str(number): number for number in range(200)},
        {"ages": [0] * 1500},
    ]
    for content in contents:
        requests, answer = dealer.ask(server, msgpack.packb({"id": 1, "verb": "status"} | content))
        assert not requests
        assert answer is not None
        assert "error" in answer
    # The answers, of an id, an error and a code, are walked too.
    assert len(walked) <= 10 * len(contents)


def test_largest_valid_request_has_room(server: ControlServer, dealer: Dealer) -> None:
    arguments = dict.fromkeys(("rest", "bare", "replaced", "restore", "turn", "refine", "undo_drift", "stop"), False)
    largest = {"id": "\U0001f9f2" * 64, "verb": "baseline", "pad": "x" * 32, "duration_s": 60.0, **arguments}
    (request,), _ = dealer.ask(server, msgpack.packb(largest))
    assert request.arguments["pad"] == "x" * 32
    assert len(msgpack.packb(largest)) < LARGEST_REQUEST // 2
