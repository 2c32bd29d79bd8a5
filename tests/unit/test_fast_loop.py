"""A frame from its bytes to its message in one call, compared with the way through frames: equal to the last bit."""

from __future__ import annotations

import ctypes
import errno
import os
import select
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from fast_loop_host import TOPIC, Bus, Host, Told, sample_of
from pad_frames import frames_of, with_faults
from test_bridge import PATIENCE_S, board, connected, pad, run  # noqa: F401  (a fixture)
from test_link import hello
from test_pipeline import config_of

from emulator.board import Board
from fmfts.baseline import Baseline
from fmfts.bus.messages import ContactMessage
from fmfts.config import PadConfig
from fmfts.contact.inference import Inference
from fmfts.pipeline import _pad
from fmfts.sensor import Frame
from fmfts.sensor.bridge.bridge import Bridge
from fmfts.sensor.patience import BEHIND, IN_TIME
from fmfts.sensor.wire.framing import encode
from fmfts_simulation.baseline import simulated_baseline

Read = tuple[bytes, int]


def reads_of(frames: Iterable[Frame], seed: int) -> Iterator[Read]:
    """What a busy host reads from a line that loses bytes, and when. The board's clock is 50 ppm off; it stands
    once."""
    draw = np.random.default_rng(seed)
    pending, readable_ns = encode(hello(4)), 0
    for number, frame in enumerate(frames):
        line = encode(sample_of(frame))
        accident = draw.integers(60)
        if accident == 0:
            line = line[:20] + line[25:]
        elif accident == 1:
            line = bytes(draw.integers(0, 256, 9, dtype=np.uint8)) + line
        elif accident == 2:
            line += encode(hello(4))
        pending += line
        sent_ns = 5_000_000_000 + round(frame.device_time_us * 1000 * (1 + 50e-6))
        if number > 900:
            sent_ns += 100_000_000
        readable_ns = max(readable_ns, sent_ns) + round(draw.exponential(80e3))
        if number % 197 == 50:
            readable_ns += 30_000_000 if number < 700 else 450_000_000
        # Several lines in one read, or the beginning of one.
        if accident == 3:
            yield pending[:-13], readable_ns
            pending = pending[-13:]
        elif accident > 8:
            yield pending, readable_ns
            pending = b""


@pytest.fixture
def bus() -> Iterator[Bus]:
    made = Bus()
    yield made
    made.close()


def told(config: PadConfig, baseline: Baseline, reads: Iterable[Read], bus: Bus, may_express: bool) -> Told:
    host = Host(config, baseline, bus, may_express)
    for number, (data, arrival_ns) in enumerate(reads):
        host.take(data, arrival_ns)
        if number % 250 == 249 and host.lent is not None:  # a client asks for the status here
            host.link._decoder._pending = host.end()
            host.begin()
    if host.lent is not None:
        host.end()
    return host.told


def at_no_time(messages: list[ContactMessage]) -> list[ContactMessage]:
    return [msgspec.structs.replace(message, t_publish_ns=0, utc_ns=0) for message in messages]


@pytest.mark.parametrize("faulty", [False, True], ids=["healthy", "with faults"])
def test_fast_loop_publishes_the_same_session(faulty: bool, bus: Bus) -> None:
    config = config_of(4)
    baseline, frames = simulated_baseline(config), frames_of(config, 14 * 110 / 220)
    reads = list(reads_of(with_faults(frames) if faulty else frames, seed=5))
    by_express, by_frames = (told(config, baseline, reads, bus, may) for may in (True, False))
    assert at_no_time(by_express.messages) == at_no_time(by_frames.messages)
    assert by_frames.expressed == 0
    assert by_express.expressed > 0.85 * len(by_frames.messages)
    assert by_express.changes >= 1, "a touch that began or ended"


def settled(bus: Bus, model: Inference | None = None) -> tuple[Host, bytes, int]:
    """A host whose pad is followed, and the next frame's bytes and arrival. model: of that pad, from this frame on."""
    config = config_of(4)
    frames = frames_of(config, 1.0)
    reads = [(encode(hello(4)), 0)] + [(encode(sample_of(f)), f.device_time_us * 1000 + 10**9) for f in frames]
    host = Host(config, simulated_baseline(config), bus)
    for data, arrival_ns in reads[:-1]:
        host.take(data, arrival_ns)
    host.end()
    assert host.told.expressed > 100
    if model is not None:
        memory = host.pipeline.memory
        host.pipeline.model.inference = model
        host.pipeline.use(host.baseline)
        host.pipeline.recall(memory)
    host.begin()
    return host, reads[-1][0], reads[-1][1] + 100_000


def test_faulty_frames_stay_in_the_c_loop_and_changes_are_reported(bus: Bus) -> None:
    """An axis that saturates, and a temperature that is missing."""
    host, _, _ = settled(bus)
    before = len(host.told.messages)
    for number, frame in enumerate(frames_of(config_of(4), 1.1)[-23:]):
        counts = frame.counts.copy()
        counts[2, 1] = -4096 if number < 10 else counts[2, 1]
        temperature_c = None if number == 15 else frame.temperature_c
        packet = encode(sample_of(replace(frame, counts=counts, temperature_c=temperature_c)))
        assert bus.loop.take(Host.LINE, packet, frame.device_time_us * 1000 + 10**9)
    host.end()
    told = host.told.messages[before:]
    assert [message.health for message in told] == ["degraded"] * 10 + ["ok"] * 13
    assert [message.temperature_c is None for message in told] == [number == 15 for number in range(23)]
    assert host.told.changes == 2


def test_packet_other_than_the_next_frame_changes_nothing(bus: Bus) -> None:
    host, data, arrival_ns = settled(bus)
    frame = frames_of(config_of(4), 1.0)[-1]
    sample = sample_of(frame)
    unusable = [
        (encode(msgspec.structs.replace(sample, pad_index=1)), arrival_ns),
        (encode(msgspec.structs.replace(sample, sequence=sample.sequence + 1001)), arrival_ns),
        (encode(msgspec.structs.replace(sample, counts=sample.counts[:3], age_us=sample.age_us[:3])), arrival_ns),
        (data[:10] + data[11:], arrival_ns),
        (b"\0", arrival_ns),
        (data, arrival_ns - 30_000_000),  # an early packet, which must be requested
    ]
    line = bytes(host.clock.line)
    for other, at_ns in unusable:
        assert not bus.loop.take(Host.LINE, other, at_ns)
        assert bytes(host.clock.line) == line
        assert not bus.heard()
        number = host.pipeline.messages
        assert host.end() == other
        assert host.pipeline.messages == number
        host.begin()
    assert bus.loop.take(Host.LINE, data[:-1], arrival_ns)  # the beginning of a line is kept
    assert not bus.heard()
    assert bus.loop.take(Host.LINE, data[-1:], arrival_ns)
    assert not bus.loop.take(Host.LINE, data, arrival_ns)  # a number that was already used
    assert len(bus.heard()) == 1


def test_unreported_changes_end_the_fast_loop(bus: Bus) -> None:
    host, _, _ = settled(bus)
    taken = []
    for number, frame in enumerate(frames_of(config_of(4), 1.2)[-43:]):
        counts = frame.counts.copy()
        counts[2, 1] = -4096 if number // 2 % 2 else counts[2, 1]
        packet = encode(sample_of(replace(frame, counts=counts)))
        taken.append(bus.loop.take(Host.LINE, packet, frame.device_time_us * 1000 + 10**9))
    assert taken == [True] * taken.count(True) + [False] * taken.count(False)
    host.end()
    assert host.told.changes == 8


def test_frames_pass_until_there_is_no_room_to_account_for_them(bus: Bus) -> None:
    host, _, arrival_ns = settled(bus)
    passed = 0
    for frame in frames_of(config_of(4), 3.0)[220:]:
        at_ns = max(arrival_ns, frame.device_time_us * 1000 + 10**9)
        if not bus.loop.take(Host.LINE, encode(sample_of(frame)), at_ns):
            break
        passed += 1
    assert host.lent is not None
    frames, *_ = host.lent.end() or (0,)
    assert passed == frames == len(bus.heard()) == 256


def test_loop_refuses_what_it_was_not_made_for(bus: Bus) -> None:
    host, data, arrival_ns = settled(bus)
    pad = host.lent
    assert pad is not None
    with pytest.raises(ValueError, match="no line that could begin"):
        bus.loop.begin(Host.LINE, b"", (pad,))
    with pytest.raises(ValueError, match="no line that takes"):
        bus.loop.take(Host.LINE + 1, data, arrival_ns)
    with pytest.raises(ValueError, match="no line that takes"):
        bus.loop.take(Host.LINE, bytes(5000), arrival_ns)
    assert bus.loop.end(Host.LINE + 1) is None
    with pytest.raises(ValueError, match="begun already"):
        pad.begin(host.clock.line, TOPIC, 0, 0)
    host.end()
    with pytest.raises(ValueError, match="not begun"):
        bus.loop.begin(Host.LINE, b"", (pad,))
    with pytest.raises(TypeError, match="not a Pad"):
        bus.loop.begin(Host.LINE, b"", (host,))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="clock: 8 bytes"):
        pad.begin(bytearray(8), TOPIC, 0, 0)
    pad.begin(host.clock.line, TOPIC, 3, 0)
    with pytest.raises(ValueError, match="at most 3 pads"):
        bus.loop.begin(Host.LINE, b"", (pad,))


class Failing(Inference):
    by = "nothing"

    def __init__(self, error: BaseException) -> None:
        super().__init__(3)
        self._error = error

    def run(self) -> None:
        raise self._error


def test_error_of_a_model_is_left_to_python_which_finds_it_again(bus: Bus) -> None:
    host, data, arrival_ns = settled(bus, Failing(KeyError("the model is odd")))
    assert not bus.loop.take(Host.LINE, data, arrival_ns)
    assert not bus.heard()
    assert host.end() == data
    with pytest.raises(KeyError, match="is odd"):
        host.take(data, arrival_ns)


def test_interrupt_during_model_run_is_handled(bus: Bus) -> None:
    _, data, arrival_ns = settled(bus, Failing(KeyboardInterrupt()))
    with pytest.raises(KeyboardInterrupt):
        bus.loop.take(Host.LINE, data, arrival_ns)


def test_board_is_lent_only_while_all_is_well(board: Board) -> None:  # noqa: F811
    """Bytes that C does not handle, and everything but samples, become frames and facts as usual."""
    bridge = Bridge({0: pad(board.link)})
    connected(bridge, board)
    assert not bridge.lendable()  # no frame yet: nothing is known to be healthy
    board.send(board.sample())
    assert len(run(bridge, board, until=lambda: frames, frames=(frames := []))) == 1
    assert bridge.lendable() == {0}
    descriptor, unread = bridge.lend()
    assert (descriptor, unread) == (bridge.fileno(), b"")
    board.send(board.sample())
    wait_for(bridge)
    data, now_ns = os.read(descriptor, 4096), time.monotonic_ns()
    bridge.give_back(data[:10], now_ns, (0, 0, 0))
    assert bridge._link.heard_ns == now_ns
    assert bridge.lendable() == {0}
    assert bridge.lend() == (descriptor, data[:10])
    bridge.give_back(data, 0, (0, 0, 0))
    assert bridge._link.heard_ns == now_ns
    assert not bridge.lendable()  # there is a packet that no other reader handled
    assert len(bridge.poll(time.monotonic_ns())) == 1
    assert bridge.lendable() == {0}
    bridge.request_selftest(0)
    assert not bridge.lendable()  # a request waits: the code that knows it reads the line


def wait_for(bridge: Bridge) -> None:
    assert select.select([bridge.fileno()], [], [], PATIENCE_S)[0]


@pytest.mark.parametrize("answers", [[-1, 1, -1, -1, 1], [1, 1]], ids=["interrupted", "not interrupted"])
def test_interrupted_send_is_repeated(answers: list[int], bus: Bus) -> None:
    sent, left = [], iter(answers)

    def send(socket: int | None, data: int, size: int, flags: int) -> int:
        sent.append((ctypes.string_at(data, size), flags))
        ctypes.set_errno(errno.EINTR)
        return next(left)

    assert passes_through(send, bus)
    assert next(left, None) is None
    parts = [part for part, answer in zip(sent, answers, strict=True) if answer == 1]
    assert [parts[0], parts[1][1]] == [(TOPIC, 3), 1]  # ZMQ_DONTWAIT | ZMQ_SNDMORE, and ZMQ_DONTWAIT


def test_contact_that_cannot_be_sent_is_an_error(bus: Bus) -> None:
    def send(socket: int | None, data: int, size: int, flags: int) -> int:
        ctypes.set_errno(errno.ENOTSOCK)
        return -1

    with pytest.raises(OSError, match="non-socket"):
        passes_through(send, bus)


def test_eleven_ready_pads_are_each_reported_once_in_order() -> None:
    """Eight are sent together, and a pad that has two frames sends the first one before: ten follow without a stop."""
    config, epoll = config_of(4), select.epoll()
    baseline, frames, bus = simulated_baseline(config), frames_of(config, 1.0), Bus(epoll.fileno())
    ends = [os.pipe2(os.O_NONBLOCK) for _ in range(11)]
    hosts = [Host(config, baseline, bus, line=readable) for readable, _ in ends]
    lines = [encode(sample_of(frame)) for frame in frames]
    begun_ns = time.monotonic_ns() - frames[-1].device_time_us * 1000
    for host in hosts:
        host.take(encode(hello(4)), 0)
        for frame, line in zip(frames[:-2], lines, strict=False):
            host.take(line, begun_ns + frame.device_time_us * 1000)
    told = [host.told.messages[-1].seq if host.lent is None else host.pipeline.messages for host in hosts]
    for number, (readable, writable) in enumerate(ends):
        os.write(writable, lines[-2] + (lines[-1] if number == 1 else b""))
        epoll.register(readable, select.EPOLLIN)
    assert bus.loop.wait(time.monotonic_ns() + 100_000_000) == []
    for host in hosts:
        host.end()
    for number, host in enumerate(hosts):
        seqs = [message.seq for message in host.told.messages]
        assert seqs == list(range(1, len(seqs) + 1))
        assert seqs[-1] == len(frames) - (0 if number == 1 else 1)
        assert seqs[-1] > told[number]
    for end in (end for pair in ends for end in pair):
        os.close(end)
    epoll.close()
    bus.close()


def passes_through(send: Callable[..., int], bus: Bus) -> bool:
    """The next frame of a host, by another `zmq_send`."""
    host, data, arrival_ns = settled(bus)
    assert host.lent is not None
    kind = ctypes.CFUNCTYPE(
        ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int, use_errno=True
    )
    function = kind(send)
    loop = _pad.Loop(-1, ctypes.cast(function, ctypes.c_void_p).value or 0, 0, IN_TIME, BEHIND)
    loop.begin(Host.LINE, b"", (host.lent,))
    return loop.take(Host.LINE, data, arrival_ns)
