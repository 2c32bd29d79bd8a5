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
from bus_messages import BOOT

from fmfts.bus.control import MOST_UNREAD, MOST_WAITING, ControlServer, Request
from fmfts.bus.publisher import Publisher
from fmfts.bus.unread import MOST_IN_ALL, MOST_OF_A_PEER, OF_AN_ANSWER, Answer, Unread
from fmfts.runtime.fast_loop import FastLoop
from fmfts.runtime.peers import BUDGET_NS, PAUSES, Peers
from fmfts.runtime.schedule import NEVER_NS, Schedule
from fmfts_client import Endpoints

REQUEST_NS = BUDGET_NS // 10  # what a request takes, by the clock of these tests
PATIENCE_S = 10.0


class Loop:
    """The part of the daemon's loop that serves peers. Its clock moves only when a request is handled."""

    def __init__(self, folder: Path) -> None:
        self.endpoints = Endpoints.from_base(f"ipc://{folder}")
        self.control = ControlServer(self.endpoints.control)
        self._publisher = Publisher(self.endpoints, BOOT)
        self._fast_loop = FastLoop(self._publisher)
        self._schedule = Schedule([], self._fast_loop)
        self.now_ns = 1
        self.handled: list[str] = []
        self.act: Callable[[Request], None] = lambda request: request.reply()
        self.peers = Peers(
            self._schedule, self._fast_loop, self._publisher, self.control, None, self._handle, lambda: self.now_ns
        )
        self._sockets: list[zmq.Socket[bytes]] = []

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
        """Until what was sent has arrived: ZeroMQ's one thread makes there and back in more steps than one way."""
        context = zmq.Context.instance()
        with context.socket(zmq.PAIR) as here, context.socket(zmq.PAIR) as there:
            here.bind(f"{self.endpoints.control}-settle")
            there.connect(f"{self.endpoints.control}-settle")
            for one, other in 5 * [(here, there), (there, here)]:
                one.send(b"")
                other.recv()

    def close(self) -> None:
        for socket in self._sockets:
            socket.close()
        self.peers.close()
        self.control.close()
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
        assert time.monotonic() < until
    assert max(turns) == BUDGET_NS // REQUEST_NS
    for number in range(500):
        assert msgpack.unpackb(flooder.recv())["id"] == number


def test_polite_peer_is_answered_in_the_next_turns_beside_a_flood(loop: Loop) -> None:
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
    # Each flooder, and ZeroMQ's look ahead of one request each, is before it at most twice.
    assert loop.handled.index("polite") - before <= 2 * len(flooders)


def test_what_waits_of_one_peer_is_bounded(loop: Loop) -> None:
    """Its requests wait in its own `send`, and none is lost."""
    peer = loop.peer(high_mark=10)
    sent = 0
    poller = zmq.Poller()
    poller.register(peer, zmq.POLLOUT)
    filler = asking("x" * 15_000)  # so that the kernel holds few
    while poller.poll(200):
        peer.send(filler)
        sent += 1
        assert sent < 10 * MOST_WAITING
    while len(loop.handled) < sent:
        loop.pause()
        loop.turn()
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
        assert "earlier answers to you are still on their way: read each answer" in answer["error"]
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
        held[0].progress()  # as a job that reports, outside of `serve`
    loop.turn()
    assert loop.handled == ["first", "second"]
