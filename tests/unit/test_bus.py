"""Publisher and client over real ZeroMQ sockets."""

from __future__ import annotations

import logging
import math
import select
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

import msgpack
import msgspec
import pytest
import zmq
from bus_messages import BOOT, contact_message, event_message, frame_message, status_message

from drills.strangers import introduce
from fmfts.bus.publisher import BUS_HIGH_MARK, LARGEST_BATCH, LARGEST_SUBSCRIPTION, SUBSCRIPTIONS_OF_A_PEER, Publisher
from fmfts_client import Client, Contact, Endpoints, SchemaError, Subscription

LIVENESS_S = 60.0  # a generous limit for any event that must come
ATTEMPTS = 20


@pytest.fixture
def endpoints(tmp_path: Path) -> Endpoints:
    return Endpoints.from_base(f"ipc://{tmp_path}")


@pytest.fixture
def publisher(endpoints: Endpoints) -> Iterator[Publisher]:
    publisher = Publisher(endpoints, BOOT, pads=["demo", "other"])
    yield publisher
    publisher.close()


def eventually(condition: Callable[[], object]) -> None:
    deadline = time.monotonic() + LIVENESS_S
    while not condition():
        assert time.monotonic() < deadline, "it never happened"
        time.sleep(0.005)


def hears(client: Client, number: int) -> bool:
    client.latest(timeout_s=0.01)
    return client.contact is not None and client.contact.seq == number


def connect(publisher: Publisher, client: Client) -> None:
    """Send until the client receives the newest: a subscription takes a moment to arrive. Then nothing is on the
    way."""
    sent = 0

    def heard() -> bool:
        nonlocal sent
        sent += 1
        publisher.send_contact("demo", contact_message(seq=0, force_n=float(sent)))
        newest = client.latest(timeout_s=0.1)
        return newest is not None and newest.force_n == sent

    eventually(heard)


def handed_out(publisher: Publisher, client: Client, **changes: Any) -> Contact:
    """The contact that the client hands out; sent again if a busy computer made it late."""
    newest: list[Contact] = []

    def heard() -> bool:
        publisher.send_contact("demo", contact_message(**changes))
        newest.extend(filter(None, [client.latest(timeout_s=1.0)]))
        return bool(newest)

    eventually(heard)
    return newest[0]


def test_latest_drains_to_the_newest_contact(publisher: Publisher, endpoints: Endpoints) -> None:
    with Client("demo", endpoints) as client:
        connect(publisher, client)

        def drained() -> bool:
            for seq in range(1, 51):
                publisher.send_contact("demo", contact_message(seq=seq))
            while (newest := client.latest(timeout_s=1.0)) is not None and newest.seq != 50:
                pass
            return newest is not None  # else a busy computer made the last one late

        eventually(drained)
        assert client.latest() is None, "the same contact is not handed out twice"


def test_iteration_gives_every_contact_in_order_and_ends_on_silence(publisher: Publisher, endpoints: Endpoints) -> None:
    with Client("demo", endpoints) as client:
        connect(publisher, client)
        for seq in range(1, 101):
            publisher.send_contact("demo", contact_message(seq=seq))
        received = [contact.seq for contact in islice(client.contacts(timeout_s=LIVENESS_S), 100)]
        assert received == list(range(1, 101))
        assert list(client.contacts(timeout_s=0.3)) == []


def test_pad_whose_name_begins_alike_is_not_mixed_in(publisher: Publisher, endpoints: Endpoints) -> None:
    with Client("demo", endpoints) as client:
        connect(publisher, client)
        publisher.send_contact("demo2", contact_message(pad="demo2", force_n=9.0))
        publisher.send_contact("demo", contact_message(seq=5))
        (heard,) = islice(client.contacts(timeout_s=LIVENESS_S), 1)
        assert (heard.pad, heard.seq) == ("demo", 5)
        assert client.refused == 0


def test_alive_ends_when_nothing_arrives(publisher: Publisher, endpoints: Endpoints) -> None:
    with Client("demo", endpoints) as client:
        assert not client.alive
        connect(publisher, client)
        handed_out(publisher, client)
        assert client.alive
        assert client.valid
        time.sleep(0.35)
        assert not client.alive
        assert not client.valid
        assert client.latest(timeout_s=0.0) is None


def test_daemon_with_old_sample_is_alive_but_not_valid(publisher: Publisher, endpoints: Endpoints) -> None:
    with Client("demo", endpoints) as client:
        connect(publisher, client)
        handed_out(publisher, client, t_sample_ns=time.monotonic_ns() - 400_000_000)
        assert client.alive
        assert not client.fresh
        assert not client.valid


MORE_CERTAIN = "`fmfts-daemon baseline --turn` and `weigh` make it more certain"


@pytest.mark.parametrize(
    ("named", "force_n", "sd_n", "why"),
    [
        ({}, 0.6, 0.49, ""),
        ({}, 0.6, 0.51, "the force is 0.60 ± 0.510 N, less certain than ± 0.500 N: " + MORE_CERTAIN),
        ({}, 2.1, 0.69, ""),  # a pad whose silicone nobody measured knows two newtons to a quarter
        ({}, 2.1, 0.71, "the force is 2.10 ± 0.710 N, less certain than ± 0.700 N: " + MORE_CERTAIN),
        (
            {"largest_force_sd_n": 0.1},
            2.1,
            0.2,
            "the force is 2.10 ± 0.200 N, less certain than ± 0.100 N: " + MORE_CERTAIN,
        ),
    ],
)
def test_client_is_valid_up_to_named_force_deviation_or_says_why_not(
    publisher: Publisher, endpoints: Endpoints, named: dict[str, float], force_n: float, sd_n: float, why: str
) -> None:
    with Client("demo", endpoints, **named) as client:
        connect(publisher, client)
        assert handed_out(publisher, client, force_n=force_n, force_sd_n=sd_n).valid
        assert client.why_invalid == why
        assert client.valid is (why == "")


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"health": "disturbed", "reason": "steel"}, "disturbed: steel"),
        (
            {"health": "fine"},
            "its health 'fine' is not known to this client: install the client of the daemon's version",
        ),
        (
            {"over_range": True, "force_n": None, "force_min_n": 1.5},
            "the pad is pressed harder than its contact model knows",
        ),
        ({"force_n": None, "force_sd_n": None, "x_m": None, "y_m": None}, "the force is not known"),
        ({"x_m": None, "y_m": None}, "the place is not known"),
    ],
)
def test_contact_without_measurement_says_why(changes: dict[str, Any], why: str) -> None:
    contact = Contact.from_message(msgspec.to_builtins(contact_message(**changes)))
    assert not contact.valid
    assert contact.why_invalid() == why


def test_client_explains_silence_and_old_samples(publisher: Publisher, endpoints: Endpoints) -> None:
    with Client("demo", endpoints) as client:
        assert client.why_invalid == "nothing arrives"
        connect(publisher, client)
        old_ns = time.monotonic_ns() - 400_000_000
        handed_out(publisher, client, t_sample_ns=old_ns)
        assert client.why_invalid == "the pad was not sampled for 0.3 s or more"
        unplugged = {"health": "disconnected", "reason": "is the board plugged in?"}
        eventually(lambda: handed_out(publisher, client, t_sample_ns=old_ns, **unplugged).health == "disconnected")
        assert client.why_invalid == "disconnected: is the board plugged in?"


@pytest.mark.parametrize(
    ("body", "why"), [(b"\xc1", "it is no msgpack (FormatError)"), (b"\x91\x01", "not a map but list")]
)
def test_client_counts_refused_messages_apart_from_silence(
    publisher: Publisher, endpoints: Endpoints, body: bytes, why: str
) -> None:
    with Client("demo", endpoints) as client:
        connect(publisher, client)
        for _ in range(3):
            publisher._bus.zmq.send_multipart([b"contact/demo", body])
        eventually(lambda: client.latest(timeout_s=0.5) is not None or client.refused == 3)
        assert client.why_invalid.startswith("nothing usable arrives (messages refused: 3): ")
        assert client.why_invalid.endswith(why)
        handed_out(publisher, client)
        assert client.valid


def test_contact_that_waited_in_a_queue_is_not_the_latest(publisher: Publisher, endpoints: Endpoints) -> None:
    with Client("demo", endpoints) as client:
        connect(publisher, client)

        def waited() -> bool:
            publisher.send_contact("demo", contact_message(seq=1, t_publish_ns=time.monotonic_ns() - 400_000_000))
            assert client.latest(timeout_s=0.1) is None
            return client.contact is not None and client.contact.seq == 1

        eventually(waited)
        assert handed_out(publisher, client, seq=2).seq == 2


@pytest.mark.parametrize(("rate_hz", "freq_ok"), [(100.0, True), (100.0 * 1.05, True), (85.0, False), (120.0, False)])
def test_rate_is_compared_with_the_configured_one(
    publisher: Publisher, endpoints: Endpoints, rate_hz: float, freq_ok: bool
) -> None:
    """The times in the messages are those of a stream at `rate_hz` over the last second and a half."""
    with Client("demo", endpoints) as client:
        connect(publisher, client)
        assert not client.freq_ok, "without a status the configured rate is unknown"
        for attempt in range(ATTEMPTS):
            # A restarted daemon has no history, so the messages before do not count.
            now_ns = time.monotonic_ns() + 200_000_000
            for number in range(int(1.5 * rate_hz)):
                published_ns = now_ns - round((1.5 * rate_hz - 1 - number) / rate_hz * 1e9)
                times = {"t_sample_ns": published_ns - 5_000_000, "t_publish_ns": published_ns}
                publisher.send_contact("demo", contact_message(boot=f"again {attempt}", seq=number, **times))
            publisher.send_status("demo", status_message(rate_nominal_hz=100.0))
            while time.monotonic_ns() < now_ns:
                client.latest(timeout_s=0.01)
            told_hz, is_ok = client.rate_hz, client.freq_ok
            all_came = client.contact is not None and client.contact.seq == number
            if all_came and time.monotonic_ns() < now_ns + 20_000_000:  # else this computer stood still
                break
        assert told_hz == pytest.approx(rate_hz, abs=0.02 * rate_hz), "20 ms of the window may have passed"
        assert is_ok is freq_ok


def test_contacts_of_samples_between_frames_are_not_a_wrong_rate(publisher: Publisher, endpoints: Endpoints) -> None:
    with Client("demo", endpoints) as client:
        connect(publisher, client)
        now_ns = time.monotonic_ns() + 400_000_000
        for number in range(600):  # 1.5 s of 100 frames a second, and three samples after each
            times = {
                "t_sample_ns": now_ns - (600 - number) // 4 * 10**7,
                "t_publish_ns": now_ns - (600 - number) * 2_500_000,
            }
            publisher.send_contact("demo", contact_message(boot="two", seq=number, **times))
            if number % 100 == 99:  # if more are sent at once the publisher drops some, unless ZeroMQ's thread can run
                eventually(lambda last=number: hears(client, last))
        publisher.send_status("demo", status_message(rate_nominal_hz=100.0))
        eventually(lambda: client.latest(timeout_s=0.01) is None and client.status is not None)
        while time.monotonic_ns() < now_ns:
            client.latest(timeout_s=0.01)
        rate_hz, freq_ok, late_s = client.rate_hz, client.freq_ok, (time.monotonic_ns() - now_ns) * 1e-9
        assert rate_hz > 350.0 - 400.0 * late_s, "so much of the window of a second has passed without messages"
        assert freq_ok or late_s > 0.01


def test_restart_of_the_daemon_is_survived_and_noticed(endpoints: Endpoints) -> None:
    with Client("demo", endpoints) as client:
        first = Publisher(endpoints, "one")
        connect(first, client)
        first.close()
        second = Publisher(endpoints, "two")

        def heard() -> bool:
            second.send_contact("demo", contact_message(boot="two"))
            client.latest(timeout_s=0.02)
            return client.restarts == 1

        eventually(heard)
        second.close()
        assert client.contact is not None
        assert client.contact.boot == "two"


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"\xc1",
        b"\x93\x01\x02\x03",
        msgpack.packb({"v": 1, "pad": "demo"}),
        msgpack.packb({"v": 1, "pad": "other"}),
        msgpack.packb({1: 2}),
        b"\x81" * 5000,
        b"\x91" * 5000,
        b"\x82\xa1v\x01\xa3pad" + b"\x91" * 1015 + b"\xc0",  # msgpack decodes it, and Python's repr does not show it
    ],
)
def test_message_that_makes_no_sense_is_counted_and_skipped(
    publisher: Publisher, endpoints: Endpoints, payload: bytes
) -> None:
    with Client("demo", endpoints) as client:
        connect(publisher, client)
        publisher._bus.zmq.send_multipart([b"contact/demo", payload])
        publisher._bus.zmq.send_multipart([b"contact/demo"])
        assert handed_out(publisher, client, seq=9).seq == 9
        assert client.refused == 2
        assert client.refusal


def test_another_schema_version_is_an_error_at_once(publisher: Publisher, endpoints: Endpoints) -> None:
    with Client("demo", endpoints) as client:
        connect(publisher, client)
        publisher.send_contact("demo", contact_message(v=2))
        with pytest.raises(SchemaError, match="sends schema version 2, this client reads 1"):
            client.latest(timeout_s=LIVENESS_S)


def test_non_finite_number_is_published_as_lost(
    publisher: Publisher, endpoints: Endpoints, caplog: pytest.LogCaptureFixture
) -> None:
    with Client("demo", endpoints) as client, caplog.at_level(logging.ERROR):
        connect(publisher, client)
        sent = publisher.send_contact("demo", contact_message(force_n=math.nan, temperature_c=math.inf))
        contact = next(client.contacts(timeout_s=LIVENESS_S))
        assert (sent.health, sent.force_n, sent.reason) == ("lost", None, contact.reason)
        assert (contact.health, contact.contact, contact.force_n, contact.x_m) == ("lost", None, None, None)
        assert "force_n" in contact.reason or "temperature_c" in contact.reason
        assert not client.valid
        publisher.send_status("demo", status_message(rate_hz=math.nan))
        assert publisher.refused == 2
        assert "contact model" in caplog.text


def test_events_and_status_arrive_by_topic(publisher: Publisher, endpoints: Endpoints) -> None:
    with Subscription(("event", "status"), endpoint=endpoints) as subscription:

        def heard() -> bool:
            publisher.send_event("demo", event_message())
            return subscription.receive(0.02) is not None

        eventually(heard)
        publisher.send_contact("demo", contact_message())
        publisher.send_status("demo", status_message())
        kinds: list[str] = []
        while not kinds or kinds[-1] != "status":
            message = subscription.receive(LIVENESS_S)
            assert message is not None
            kinds.append(message.kind)
        assert "contact" not in kinds


def test_slow_subscriber_neither_blocks_the_publisher_nor_others(publisher: Publisher, endpoints: Endpoints) -> None:
    with zmq.Context() as context, ExitStack() as stack, Client("demo", endpoints) as client:
        slow = stack.enter_context(context.socket(zmq.SUB))
        slow.linger = 0
        slow.rcvhwm = 1
        slow.subscribe("contact/")
        slow.connect(endpoints.bus)
        connect(publisher, client)
        eventually(lambda: publisher.send_contact("demo", contact_message(seq=0)) or slow.poll(10))
        list(client.contacts(timeout_s=0.2))
        sent = 2 * BUS_HIGH_MARK * 15  # far beyond what sockets and kernel hold for the slow one
        received = 0
        begun = time.monotonic()
        for seq in range(1, sent + 1):
            publisher.send_contact("demo", contact_message(seq=seq))
            if seq % 64 == 0:
                received += sum(1 for _ in zip(range(64), client.contacts(timeout_s=LIVENESS_S), strict=False))
        assert time.monotonic() - begun < LIVENESS_S, "sending waited for the slow one"
        assert received == sent, "the one that keeps up loses nothing"


def test_frames_are_wanted_while_somebody_subscribes(publisher: Publisher, endpoints: Endpoints) -> None:
    assert not publisher.frames_wanted("demo", time.monotonic_ns())
    with Subscription(("frame",), "demo", endpoints) as subscription:
        eventually(lambda: publisher.frames_wanted("demo", time.monotonic_ns()))
        assert not publisher.frames_wanted("other", time.monotonic_ns())
        for sequence in range(3000):
            publisher.send_frame("demo", frame_message(sequence))
        received: list[int] = []
        while len(received) < 3000 and (message := subscription.receive(LIVENESS_S)) is not None:
            received.append(message.body["sequence"])
        assert received == list(range(3000)), "a recording loses nothing"
    eventually(lambda: not publisher.frames_wanted("demo", time.monotonic_ns()))


@pytest.mark.parametrize("pattern", ["frame/demo{}", "frame/{}", "state/{}", "{}"])
def test_peer_with_thousands_of_subscriptions_costs_frame_no_more(
    publisher: Publisher, endpoints: Endpoints, pattern: str
) -> None:
    prefixes = [pattern.format(f"-{number}") for number in range(20 * LARGEST_BATCH)]
    with zmq.Context() as context, context.socket(zmq.SUB) as peer:
        peer.linger = 0
        peer.sndhwm = 0  # otherwise it loses subscriptions
        peer.connect(endpoints.frames)
        for prefix in [*prefixes, "frame/demo"]:
            peer.subscribe(prefix)
        eventually(publisher._frames.readable)
        looks = []
        eventually(lambda: looks.append(1) or publisher.frames_wanted("demo", time.monotonic_ns()))
        assert len(looks) > len(prefixes) // LARGEST_BATCH, "each look takes a batch"
        assert publisher._subscriptions == {b"frame/demo"}


def test_subscriptions_cost_the_loop_nothing(publisher: Publisher, endpoints: Endpoints) -> None:
    with Client("demo", endpoints) as client:
        connect(publisher, client)
        assert not publisher._bus.readable()


@contextmanager
def stranger(endpoint: str) -> Iterator[socket.socket]:
    """A subscriber that speaks ZeroMQ by itself."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as peer:
        peer.settimeout(LIVENESS_S)
        peer.connect(endpoint.removeprefix("ipc://"))
        introduce(peer)
        yield peer


def subscription_to(topic: bytes) -> bytes:
    return bytes([0, 1 + len(topic)]) + b"\x01" + topic


@pytest.mark.parametrize("door", ["bus", "frames"])
def test_subscription_longer_than_any_topic_is_hung_up_on(
    publisher: Publisher, endpoints: Endpoints, door: str
) -> None:
    with stranger(getattr(endpoints, door)) as peer:
        peer.sendall(subscription_to(b"x" * (LARGEST_SUBSCRIPTION - 1)) + subscription_to(b""))

        def hears() -> bool:
            publisher.send_contact("demo", contact_message())
            publisher.send_frame("demo", frame_message())
            return bool(select.select([peer], [], [], 0.02)[0] and peer.recv(1 << 16))

        eventually(hears)
        peer.sendall(subscription_to(b"x" * LARGEST_SUBSCRIPTION))
        while peer.recv(1 << 16):  # messages on their way, then the end
            pass


def test_longest_topic_can_be_subscribed_to(endpoints: Endpoints) -> None:
    longest = "x" * 32
    publisher = Publisher(endpoints, BOOT, pads=[longest])
    with Client(longest, endpoints) as client, Subscription(("state",), longest, endpoints):
        eventually(lambda: publisher.frames_wanted(longest, time.monotonic_ns()) or publisher.state_wanted(longest))

        def heard() -> bool:
            publisher.send_contact(longest, contact_message(pad=longest))
            return client.latest(timeout_s=0.02) is not None

        eventually(heard)
    publisher.close()


def test_subscriptions_of_a_peer_wait_in_its_own_send(publisher: Publisher) -> None:
    """libzmq handles in one send all that waits in this process."""
    for door in publisher.sockets:
        assert door.zmq.getsockopt(zmq.RCVHWM) == SUBSCRIPTIONS_OF_A_PEER
