"""Peers that flood the control socket: the loop gives them a bounded time, each its turn, and each an answer."""

from __future__ import annotations

import select
import time
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgpack
import pytest
import zmq
from bus_messages import BOOT, settle

from fmfts.bus.control import DISCARDED_AT_ONCE, MOST_PARTS, MOST_UNREAD, ControlServer, Request
from fmfts.bus.gate import LARGEST_BATCH, ZAP_ENDPOINT, Gate
from fmfts.bus.keys import KeyFolder
from fmfts.bus.publisher import Publisher
from fmfts.bus.unread import MOST_IN_ALL, MOST_OF_A_PEER, OF_AN_ANSWER, Answer, Unread
from fmfts.runtime.fast_loop import FastLoop
from fmfts.runtime.peers import BUDGET_NS, PAUSES, Peers, Servers
from fmfts.runtime.schedule import NEVER_NS, Schedule
from fmfts_client import Endpoints

REQUEST_NS = BUDGET_NS // 10  # time of a request, by the clock of these tests
PATIENCE_S = 60.0


class Loop:
    """The part of the daemon's loop that serves peers. Its clock moves only when a request is handled."""

    def __init__(self, folder: Path) -> None:
        self.endpoints = Endpoints.from_base(f"ipc://{folder}")
        self.control = ControlServer(self.endpoints.control)
        self._publisher = Publisher(self.endpoints, BOOT, pads=["demo"])
        self._fast_loop = FastLoop(self._publisher)
        self.gate = Gate(KeyFolder(folder / "keys"))
        self._schedule = Schedule([], self._fast_loop)
        self.now_ns = 1
        self.look_ns = 0  # each look at the clock advances it by this
        self.handled: list[str] = []
        self.act: Callable[[Request], None] = lambda request: request.reply()
        self.peers = Peers(
            self._schedule,
            self._fast_loop,
            Servers(self._publisher, self.control, self.gate),
            self._handle,
            self._clock,
        )
        self._sockets: list[zmq.Socket[bytes]] = []

    def _clock(self) -> int:
        self.now_ns += self.look_ns
        return self.now_ns

    def _handle(self, request: Request) -> None:
        self.handled.append(request.arguments.get("who", ""))
        self.now_ns += REQUEST_NS
        self.act(request)

    def turn(self) -> int:
        """One turn of the loop. Returns how many requests it handled."""
        before = len(self.handled)
        self._schedule.wait(0)
        self.peers.serve(called=self._schedule.called)
        return len(self.handled) - before

    def pause(self) -> None:
        self.now_ns = max(self.now_ns, self.peers.due_ns if self.peers.due_ns != NEVER_NS else 0)

    def peer(self, kind: int = zmq.DEALER, high_mark: int = 1000) -> zmq.Socket[bytes]:
        socket: zmq.Socket[bytes] = zmq.Context.instance().socket(kind)
        socket.linger = 0
        socket.sndhwm = socket.rcvhwm = high_mark
        socket.connect(self.endpoints.control)
        self._sockets.append(socket)
        return socket

    def settle(self) -> None:
        settle(f"{self.endpoints.control}-settle")

    def close(self) -> None:
        for socket in self._sockets:
            socket.close()
        self.peers.close()
        self.control.close()
        self.gate.close()
        self._publisher.close()
        self._fast_loop.close()


@pytest.fixture
def loop(tmp_path: Path) -> Iterator[Loop]:
    loop = Loop(tmp_path)
    yield loop
    loop.close()


def asking(who: str, number: int = 1, verb: str = "pads") -> bytes:
    packed: bytes = msgpack.packb({"id": number, "verb": verb, "who": who})
    return packed


def received(socket: zmq.Socket[bytes], loop: Loop) -> dict[str, Any]:
    """The next answer; the loop turns meanwhile."""
    until = time.monotonic() + PATIENCE_S
    while not socket.poll(1):
        loop.pause()
        loop.turn()
        assert time.monotonic() < until
    answer: dict[str, Any] = msgpack.unpackb(socket.recv_multipart()[-1])
    return answer


def test_flood_takes_its_budget_and_then_leaves_the_loop_alone(loop: Loop) -> None:
    flooder = loop.peer()
    for number in range(500):
        flooder.send(asking("flooder", number))
    loop.settle()
    turns = [loop.turn()]
    assert 1 <= turns[0] <= BUDGET_NS // REQUEST_NS
    spent_ns = loop.now_ns - 1
    for _ in range(5):
        assert loop.turn() == 0, "frames have the loop now"
    assert loop.peers.due_ns == loop.now_ns + PAUSES * spent_ns
    assert not loop._schedule.called, "no request wakes the loop in the pause"
    until = time.monotonic() + PATIENCE_S
    while sum(turns) < 500:
        loop.pause()
        turns.append(loop.turn())
        loop.settle()  # a peer whose answers have not left gets more refusals
        assert time.monotonic() < until
    assert max(turns) == BUDGET_NS // REQUEST_NS
    for number in range(500):
        assert msgpack.unpackb(flooder.recv())["id"] == number


def test_polite_peer_is_answered_in_next_turns_beside_flood(loop: Loop) -> None:
    flooders = [loop.peer() for _ in range(8)]
    polite = loop.peer()
    for flooder in flooders:
        for number in range(300):
            flooder.send(asking("flooder", number))
    loop.settle()
    while not loop.handled:
        loop.turn()
    polite.send(asking("polite"))
    loop.settle()
    before = len(loop.handled)
    until = time.monotonic() + PATIENCE_S
    while "polite" not in loop.handled:
        loop.pause()
        loop.turn()
        assert time.monotonic() < until
    # Each flooder, and ZeroMQ's read-ahead of one request each, precedes it at most twice.
    assert loop.handled.index("polite") - before <= 2 * len(flooders)


def test_waiting_messages_of_a_peer_are_bounded(loop: Loop) -> None:
    """Its requests wait in its own `send`, and none is lost."""
    peer = loop.peer(high_mark=10)
    sent = 0
    poller = zmq.Poller()
    poller.register(peer, zmq.POLLOUT)
    filler = asking("x" * 900)
    while poller.poll(200):
        peer.send(filler)
        sent += 1
        assert sent < 500, "there are 10 in the peer, MOST_WAITING in the daemon, and up to 300 in the kernel"
    answers = [received(peer, loop) for _ in range(sent)]
    assert [answer["id"] for answer in answers] == [1] * sent
    assert loop.control._unread.of((b"",)) == 0


def test_peer_that_does_not_read_is_refused_with_a_sentence(loop: Loop) -> None:
    peer, other = loop.peer(high_mark=1), loop.peer()
    loop.act = lambda request: request.reply(facts="x" * 200_000)
    asked = 0
    while not loop.control._unread._kept:
        peer.send(asking("deaf", asked))
        asked += 1
        while loop.control.serve_one(loop._handle):
            pass
        assert asked < 10 * MOST_UNREAD
    (route,) = loop.control._unread._kept
    for _ in range(20):
        peer.send(asking("deaf", asked))
        asked += 1
    while loop.control._unread.of((route,)) < 21:
        loop.pause()
        loop.turn()
    handled = len(loop.handled)
    assert handled <= asked - 20, "no request is handled while answers wait"
    loop.act = lambda request: request.reply()
    other.send(asking("other"))
    assert received(other, loop)["ok"], "nobody else waits for it"
    answers = [received(peer, loop) for _ in range(asked)]
    assert [answer["id"] for answer in answers] == list(range(asked))
    assert ["ok" in answer for answer in answers] == [True] * handled + [False] * (asked - handled)
    for answer in answers[handled:]:
        assert "earlier answers to you were not read yet: read each answer" in answer["error"]
    peer.send(asking("reads again"))
    assert received(peer, loop)["ok"]


@pytest.mark.parametrize("size", [100, 200_000])
def test_answers_that_nobody_reads_are_bounded_and_logged(size: int, caplog: pytest.LogCaptureFixture) -> None:
    tried: deque[Answer] = deque(maxlen=1)
    unread = Unread(lambda answer: bool(tried.append(answer)))
    fitting = MOST_OF_A_PEER // (size + len(b"deaf") + OF_AN_ANSWER)
    for _ in range(fitting + 3):
        unread.keep(((b"deaf",), bytes(size)))
    assert unread.of((b"deaf",)) == fitting
    assert [record.getMessage()[:23] for record in caplog.records] == ["1 answer(s) were droppe"]
    assert not unread.deliver_one()


def test_answers_to_many_peers_are_bounded_in_all() -> None:
    reads = False
    unread = Unread(lambda answer: reads)
    peers = [b"%d" % number for number in range(300)]

    def kept() -> int:
        for peer in peers:
            unread.keep(((peer,), bytes(200_000)))
        return sum(unread.of((peer,)) for peer in peers)

    first = kept()
    assert 0.9 * MOST_IN_ALL < first * 200_000 < MOST_IN_ALL
    reads = True
    while unread.deliver_one():
        pass
    reads = False
    assert kept() == first, "what was delivered counts no more"


def test_peer_that_reads_slowly_loses_no_answer() -> None:
    unread = Unread(lambda answer: True)
    unread.keep(((b"slow",), bytes(200_000)))
    for _ in range(2 * MOST_OF_A_PEER // 200_000):
        unread.keep(((b"slow",), bytes(200_000)))
        assert unread.deliver_one()
        assert unread.of((b"slow",)) == 1


def test_each_peer_with_unread_answers_has_its_turn() -> None:
    sent: list[Answer] = []

    def is_sent(answer: Answer) -> bool:
        if answer[0][0].startswith(b"deaf"):
            return False
        sent.append(answer)
        return True

    unread = Unread(is_sent)
    for number in range(40):
        unread.keep(((b"deaf %d" % number,), b""))
    for number in range(3):
        unread.keep(((b"reads",), b"%d" % number))
    for _ in range(20):
        unread.deliver_one()
    assert [payload for _, payload in sent] == [b"0", b"1", b"2"]
    assert unread.of((b"reads",)) == 0


def test_req_socket_gets_the_final_answer_and_no_progress(loop: Loop) -> None:
    def act(request: Request) -> None:
        for share in range(3):
            request.progress(share=share)
        request.reply(done=True)

    loop.act = act
    asker = loop.peer(zmq.REQ)
    for number in range(3):
        asker.send(asking("req", number, "baseline"))
        assert received(asker, loop) == {"id": number, "ok": True, "done": True}
        assert not asker.poll(10)


def test_request_that_a_send_has_hidden_is_served(loop: Loop) -> None:
    """ZeroMQ signals edges, and a send consumes them: the loop must look again without a signal."""
    first, second = loop.peer(), loop.peer()
    held: list[Request] = []
    loop.act = held.append
    first.send(asking("first"))
    until = time.monotonic() + PATIENCE_S
    while not held:
        loop.pause()
        loop.turn()
        assert time.monotonic() < until
    loop.pause()
    loop.turn()
    assert select.select([loop.peers._doors], [], [], 0)[0] == []
    second.send(asking("second"))
    assert select.select([loop.peers._doors], [], [], PATIENCE_S)[0]
    while select.select([loop.peers._doors], [], [], 0)[0]:
        held[0].progress()  # like a job that reports, outside of `serve`
    loop.turn()
    assert loop.handled == ["first", "second"]


def test_parts_of_a_message_are_dropped_within_the_budget(loop: Loop) -> None:
    parts = 20 * DISCARDED_AT_ONCE
    peer = loop.peer()
    peer.send_multipart([b"x"] * (MOST_PARTS - 1 + parts))
    peer.send(asking("after it"))
    loop.settle()
    loop.look_ns = BUDGET_NS // 5
    turns = 0
    while not loop.handled:
        loop.pause()
        loop.turn()
        turns += 1
        assert turns < 100
    assert turns >= 5, "each drops a few batches of the twenty"
    assert msgpack.unpackb(peer.recv())["error"] == "a request is one message part, not several"
    assert msgpack.unpackb(peer.recv())["ok"]


def test_one_long_request_gives_frames_four_times_as_long(loop: Loop) -> None:
    def act(request: Request) -> None:
        loop.now_ns += 1_000 * BUDGET_NS

    loop.act = act
    loop.peer().send(asking("slow"))
    loop.settle()
    assert loop.turn() == 1
    assert loop.peers.due_ns - loop.now_ns == PAUSES * (1_000 * BUDGET_NS + REQUEST_NS)


def test_new_connections_and_subscriptions_share_the_budget(loop: Loop) -> None:
    """Whatever else floods, each turn takes one of each and a request."""
    knocks = LARGEST_BATCH // 2
    with (
        zmq.Context.instance().socket(zmq.DEALER) as knocking,
        zmq.Context.instance().socket(zmq.SUB) as subscriber,
    ):
        knocking.linger = subscriber.linger = 0
        knocking.connect(ZAP_ENDPOINT)
        for _ in range(knocks):
            knocking.send_multipart([b"", b"1.0", b"1", b"fmfts", b"somewhere", b"", b"NULL"])
        subscriber.connect(loop.endpoints.frames)
        for number in range(10):
            subscriber.subscribe(f"frame/{number}")
        subscriber.subscribe("frame/demo")
        for number in range(3):
            loop.peer().send(asking("peer", number))
        loop.settle()
        loop.look_ns = BUDGET_NS
        assert [loop.turn(), loop.pause(), loop.turn()] == [1, None, 1]
        assert loop.gate.refused == 2
        assert not loop._publisher._subscriptions, "two of eleven were looked at"
        for _ in range(knocks):
            loop.pause()
            loop.turn()
        assert loop.gate.refused == knocks
        assert loop._publisher._subscriptions == {b"frame/demo"}
