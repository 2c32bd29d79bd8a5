"""The C client over real ZeroMQ sockets: the newest contact, its age, and the contacts that it withholds."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from background import repeating, started
from c_client.built import (
    HERE,
    LIVENESS_S,
    NEW,
    NOTHING,
    WRONG_VERSION,
    Talker,
    build,
    build_listener,
    connect,
    eventually,
    run,
)
from fmfts.bus.publisher import Publisher
from fmfts_client import Client, Endpoints
from unit.bus_messages import BOOT, contact_message


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_listener(tmp_path_factory.mktemp("c"))


@pytest.fixture
def publisher(tmp_path: Path) -> Iterator[Publisher]:
    publisher = Publisher(Endpoints.from_base(f"ipc://{tmp_path}"), BOOT)
    yield publisher
    publisher.close()


@pytest.fixture
def client(program: Path, publisher: Publisher, tmp_path: Path) -> Iterator[Talker]:
    """Connected: it has received something, and nothing more is on the way."""
    with Talker(program, "demo", f"ipc://{tmp_path}") as client:
        connect(publisher, client)
        yield client


def send_raw(publisher: Publisher, topic: bytes, *parts: bytes) -> None:
    publisher._bus.zmq.send_multipart([topic, *parts])


def after(client: Talker, publisher: Publisher, seq: int) -> dict[str, Any]:
    """Its answer after a good contact `seq`, sent after all the others; sent again if it came late."""

    def taken() -> dict[str, Any]:
        publisher.send_contact("demo", contact_message(seq=seq))
        return client.latest(200)

    return eventually(taken, lambda answer: answer.get("seq") == seq)


def of_an_old_sample(client: Talker, publisher: Publisher) -> dict[str, Any]:
    """Its answer, alive, after a contact whose sample is 0.4 s old; sent again if it came late."""

    def given() -> dict[str, Any]:
        publisher.send_contact("demo", contact_message(seq=7, t_sample_ns=time.monotonic_ns() - 400_000_000))
        return client.latest(100)

    return eventually(given, lambda answer: answer.get("seq") == 7 and answer["alive"])


def test_latest_drains_to_the_newest_contact_and_gives_it_once(client: Talker, publisher: Publisher) -> None:
    seen: list[int] = []
    for last in range(50, 1050, 50):
        for seq in range(last - 49, last + 1):
            publisher.send_contact("demo", contact_message(seq=seq))
        while (not seen or seen[-1] != last) and (answer := client.latest(1000))["result"] == NEW:
            seen.append(answer["seq"])
        if seen and seen[-1] == last:
            break  # else a busy computer made the last one late, which is not returned
    assert seen[-1] == last
    assert seen == sorted(set(seen))

    def given_once() -> dict[str, Any]:
        publisher.send_contact("demo", contact_message(seq=51))
        client.latest(200)
        return client.latest(0)

    eventually(given_once, lambda answer: (answer["result"], answer["alive"], answer["valid"]) == (NOTHING, True, True))


@pytest.mark.parametrize(("named", "sd_n", "valid"), [(None, 0.49, True), (None, 0.51, False), (0.1, 0.2, False)])
def test_client_is_valid_up_to_the_named_force_deviation(
    client: Talker, publisher: Publisher, named: float | None, sd_n: float, valid: bool
) -> None:
    if named is not None:
        client.accept(named)

    def given() -> dict[str, Any]:
        publisher.send_contact("demo", contact_message(seq=60, force_sd_n=sd_n))
        return client.latest(100)

    answer = eventually(given, lambda answer: answer.get("seq") == 60 and answer["fresh"] and answer["alive"])
    assert answer["valid"] is valid


@pytest.mark.parametrize(
    ("named", "changes"),
    [
        (None, {}),
        (None, {"force_n": 0.6, "force_sd_n": 0.51}),
        (None, {"force_n": 2.1, "force_sd_n": 0.71}),
        (0.1, {"force_n": 2.1, "force_sd_n": 0.2}),
        (None, {"health": "disturbed", "reason": "steel"}),
        (None, {"health": "disturbed", "reason": 300 * "µ"}),  # cut to what a text of the C client holds
        (None, {"health": "lost", "reason": ""}),
        (None, {"over_range": True, "force_n": None, "force_min_n": 1.5}),
        (None, {"force_n": None, "force_sd_n": None, "x_m": None, "y_m": None}),
        (None, {"x_m": None, "y_m": None}),
        (None, {"contact": None}),
    ],
)
def test_c_client_says_why_a_contact_is_invalid_as_the_python_client_does(
    client: Talker, publisher: Publisher, tmp_path: Path, named: float | None, changes: dict[str, Any]
) -> None:
    if named is not None:
        client.accept(named)
    with Client("demo", f"ipc://{tmp_path}", named) as other:

        def given() -> dict[str, Any]:
            publisher.send_contact("demo", contact_message(seq=61, **changes))
            contact, why = other.latest(0.1), other.why_invalid
            answer = client.latest(100)
            return answer | {"python": why} if contact is not None and contact.seq == 61 else {}

        def is_of_now(answer: dict[str, Any]) -> bool:  # neither program stood still
            return answer.get("seq") == 61 and "nothing arrives" not in (answer["why_invalid"], answer["python"])

        answer = eventually(given, is_of_now)
        assert answer["why_invalid"] == answer["python"].encode()[:255].decode(errors="ignore")
        assert answer["says_valid"] is answer["valid"] is (answer["why_invalid"] == "")


def test_c_client_tells_silence_old_samples_and_refused_messages_apart(client: Talker, publisher: Publisher) -> None:
    time.sleep(0.35)
    assert client.latest()["why_invalid"] == "nothing arrives"
    send_raw(publisher, b"contact/demo", b"\x91\x01")
    refused = eventually(lambda: client.latest(100), lambda answer: answer["refused"] == 1)
    assert refused["why_invalid"].startswith("nothing usable arrives (messages refused: 1): ")
    answer = of_an_old_sample(client, publisher)
    assert answer["why_invalid"] == "the pad was not sampled for 0.3 s or more"


def test_latest_after_a_pause_skips_waiting_messages(client: Talker, publisher: Publisher) -> None:
    def after_a_pause() -> dict[str, Any]:
        while client.latest(50)["result"] == NEW:  # of an attempt whose last messages came after the pause
            pass
        for seq in range(1, 51):
            publisher.send_contact("demo", contact_message(seq=seq))
        time.sleep(0.1)
        return client.latest(1000)

    eventually(after_a_pause, lambda answer: answer.get("seq") == 50)


def test_delayed_message_is_not_returned_as_new(client: Talker, publisher: Publisher) -> None:
    publisher.send_contact("demo", contact_message(seq=1))
    time.sleep(0.4)
    answer = client.latest(0)
    assert (answer["result"], answer["alive"], answer["valid"]) == (NOTHING, False, False)


def test_daemon_that_repeats_old_samples_is_alive_but_not_fresh(client: Talker, publisher: Publisher) -> None:
    answer = of_an_old_sample(client, publisher)
    assert (answer["fresh"], answer["valid"]) == (False, False)
    assert 0.4 <= answer["sample_age_s"] < LIVENESS_S


def test_wait_ends_with_a_message_or_the_timeout(client: Talker, publisher: Publisher) -> None:
    start = time.monotonic()
    assert client.latest(150)["result"] == NOTHING
    assert time.monotonic() - start >= 0.15
    with repeating(lambda: publisher.send_contact("demo", contact_message(seq=3)), 0.2):  # one that comes late is lost
        assert client.latest(-1)["seq"] == 3


def test_pad_whose_name_begins_alike_is_not_mixed_in(client: Talker, publisher: Publisher) -> None:
    publisher.send_contact("demo2", contact_message(pad="demo2", force_n=9.0))
    answer = after(client, publisher, 5)
    assert (answer["pad"], answer["refused"]) == ("demo", 0)


@pytest.mark.parametrize(
    ("parts", "reason"),
    [
        ((b"\xc1",), "not a msgpack map"),
        ((), "two parts"),
        ((b"\x80", b"\x80"), "two parts"),
        ((b"\xc0" * 100_000,), "64 KiB"),
    ],
)
def test_invalid_message_is_counted_and_explained(
    client: Talker, publisher: Publisher, parts: tuple[bytes, ...], reason: str
) -> None:
    send_raw(publisher, b"contact/demo", *parts)
    answer = after(client, publisher, 5)
    assert answer["refused"] == 1
    assert reason in answer["refusal"]


def test_latest_drops_a_refused_message_and_returns_nothing(client: Talker, publisher: Publisher) -> None:
    """As the comments of fmfts.h say: only fmfts_decode() returns FMFTS_REFUSED."""
    send_raw(publisher, b"contact/demo", b"\xc1")
    answer = eventually(lambda: client.latest(200), lambda answer: answer["refused"] == 1)
    assert answer["result"] == NOTHING


def test_contact_of_another_pad_under_this_topic_is_refused(client: Talker, publisher: Publisher) -> None:
    publisher.send_contact("demo", contact_message(pad="other"))
    assert "another pad" in after(client, publisher, 5)["refusal"]


def test_other_schema_version_is_reported_at_once(client: Talker, publisher: Publisher) -> None:
    publisher.send_contact("demo", contact_message(v=2))
    answer = eventually(lambda: client.latest(100), lambda answer: answer["result"] != NOTHING)
    assert answer["result"] == WRONG_VERSION
    assert "version 2" in answer["refusal"]


def test_restart_of_the_daemon_is_survived_and_counted(program: Path, tmp_path: Path) -> None:
    endpoints = Endpoints.from_base(f"ipc://{tmp_path}")
    first = Publisher(endpoints, "first")
    with Talker(program, "demo", f"ipc://{tmp_path}") as client:
        connect(first, client)
        first.close()
        second = Publisher(endpoints, "second")

        def heard() -> dict[str, Any]:
            second.send_contact("demo", contact_message(boot="second"))
            return client.latest(20)

        answer = eventually(heard, lambda answer: answer.get("boot") == "second")
        assert answer["restarts"] == 1
        second.close()


def test_nothing_is_allocated_in_a_control_loop(tmp_path: Path, publisher: Publisher) -> None:
    program = build(tmp_path / "allocations", "gcc", [HERE / "allocations.c"])
    contacts = 300
    with started([program, "demo", f"ipc://{tmp_path}", str(contacts)], stdout=subprocess.PIPE) as loop:
        seq = 0
        while loop.poll() is None:
            seq += 1
            publisher.send_contact("demo", contact_message(seq=seq))
            time.sleep(0.002)
            assert seq < 20_000
        assert loop.stdout is not None
        calls, allocations = map(int, loop.stdout.read().split())
    assert calls >= contacts
    assert allocations == 1, "the one that shows that the counter works"


def test_example_without_contacts_ends_well(program: Path, tmp_path: Path) -> None:
    run([program, "demo", f"ipc://{tmp_path}"], stdin=subprocess.DEVNULL)
