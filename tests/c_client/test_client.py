"""The C client over real ZeroMQ sockets: the newest contact, its age, and what it does not hand out."""

from __future__ import annotations

import os
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from c_client.built import HERE, NEW, NOTHING, SANITIZED, WRONG_VERSION, Talker, build, run
from fmfts.bus.gate import Gate
from fmfts.bus.keys import KeyFolder
from fmfts.bus.publisher import Publisher
from fmfts_client import Endpoints
from ports import tcp_base
from unit.bus_messages import BOOT, contact_message

LIVENESS_S = 10.0  # a generous bound for anything that must happen at all


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("c") / "listen"
    return build(path, "gcc", [HERE / "listen.c", HERE / "shown.c"], *SANITIZED)


@pytest.fixture
def publisher(tmp_path: Path) -> Iterator[Publisher]:
    publisher = Publisher(Endpoints.from_base(f"ipc://{tmp_path}"), BOOT)
    yield publisher
    publisher.close()


@pytest.fixture
def client(program: Path, publisher: Publisher, tmp_path: Path) -> Iterator[Talker]:
    """Connected: it has heard something, and there is nothing more to hear."""
    with Talker(program, "demo", f"ipc://{tmp_path}") as client:
        connect(publisher, client)
        yield client


def eventually(look: Callable[[], dict[str, Any]], wanted: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
    deadline = time.monotonic() + LIVENESS_S
    while not wanted(answer := look()):
        assert time.monotonic() < deadline, answer
    return answer


def connect(publisher: Publisher, client: Talker) -> None:
    """Send until the client hears: a subscription takes a moment to arrive."""

    def heard() -> dict[str, Any]:
        publisher.send_contact("demo", contact_message(seq=0))
        return client.latest(20)

    eventually(heard, lambda answer: answer["result"] == NEW)
    while client.latest(50)["result"] == NEW:
        pass


def send_raw(publisher: Publisher, topic: bytes, *parts: bytes) -> None:
    publisher._bus.zmq.send_multipart([topic, *parts])


def after(client: Talker, publisher: Publisher, seq: int) -> dict[str, Any]:
    """Its answer when it has taken in a good contact `seq`, sent after all the others."""
    publisher.send_contact("demo", contact_message(seq=seq))
    return eventually(lambda: client.latest(200), lambda answer: answer.get("seq") == seq)


def test_latest_drains_to_the_newest_contact_and_gives_it_once(client: Talker, publisher: Publisher) -> None:
    for seq in range(1, 51):
        publisher.send_contact("demo", contact_message(seq=seq))
    seen = [eventually(lambda: client.latest(0), lambda answer: answer["result"] == NEW)["seq"]]
    while seen[-1] != 50:
        seen.append(eventually(lambda: client.latest(100), lambda answer: answer["result"] == NEW)["seq"])
    assert seen == sorted(set(seen))
    answer = client.latest(0)
    assert (answer["result"], answer["alive"], answer["valid"]) == (NOTHING, True, True)


def test_latest_after_a_pause_skips_what_waited(client: Talker, publisher: Publisher) -> None:
    for seq in range(1, 51):
        publisher.send_contact("demo", contact_message(seq=seq))
    time.sleep(0.1)
    assert client.latest(1000)["seq"] == 50


def test_what_waited_too_long_is_not_handed_out_as_new(client: Talker, publisher: Publisher) -> None:
    publisher.send_contact("demo", contact_message(seq=1))
    time.sleep(0.4)
    answer = client.latest(0)
    assert (answer["result"], answer["alive"], answer["valid"]) == (NOTHING, False, False)


def test_daemon_that_speaks_of_old_samples_is_alive_and_the_pad_not_fresh(client: Talker, publisher: Publisher) -> None:
    publisher.send_contact("demo", contact_message(seq=7, t_sample_ns=time.monotonic_ns() - 400_000_000))
    answer = eventually(lambda: client.latest(100), lambda answer: answer.get("seq") == 7)
    assert (answer["alive"], answer["fresh"], answer["valid"]) == (True, False, False)
    assert 0.4 <= answer["sample_age_s"] < LIVENESS_S


def test_timeout_is_waited_for_and_ended_by_what_comes(client: Talker, publisher: Publisher) -> None:
    start = time.monotonic()
    assert client.latest(150)["result"] == NOTHING
    assert time.monotonic() - start >= 0.15
    threading.Timer(0.2, lambda: publisher.send_contact("demo", contact_message(seq=3))).start()
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
def test_message_that_is_none_is_counted_and_explained(
    client: Talker, publisher: Publisher, parts: tuple[bytes, ...], reason: str
) -> None:
    send_raw(publisher, b"contact/demo", *parts)
    answer = after(client, publisher, 5)
    assert answer["refused"] == 1
    assert reason in answer["refusal"]


def test_contact_of_another_pad_under_this_topic_is_refused(client: Talker, publisher: Publisher) -> None:
    publisher.send_contact("demo", contact_message(pad="other"))
    assert "another pad" in after(client, publisher, 5)["refusal"]


def test_other_schema_version_is_said_at_once(client: Talker, publisher: Publisher) -> None:
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


def test_only_a_known_key_hears_over_tcp(program: Path, tmp_path: Path) -> None:
    folder = KeyFolder(tmp_path / "keys")
    folder.add("arm", tmp_path / "arm.key")
    KeyFolder(tmp_path / "others").add("thief", tmp_path / "thief.key")
    base = tcp_base()
    gate, publisher = Gate(folder), Publisher(Endpoints.from_base(base), BOOT, folder.server())
    keys = {name: os.environ | {"FMFTS_KEY": str(tmp_path / f"{name}.key")} for name in ("arm", "thief")}
    try:
        with (
            Talker(program, "demo", base, environment=keys["thief"]) as thief,
            Talker(program, "demo", base, environment=os.environ | {"FMFTS_KEY": ""}) as plain,
            Talker(program, "demo", base, environment=keys["arm"]) as arm,
        ):

            def heard() -> dict[str, Any]:
                gate.answer()
                publisher.send_contact("demo", contact_message())
                return arm.latest(20)

            for _ in range(10):
                eventually(heard, lambda answer: answer["result"] == NEW)
            assert (thief.latest(50)["alive"], plain.latest(50)["alive"]) == (False, False)
    finally:
        publisher.close()
        gate.close()


def far(publisher: Publisher, ahead_s: float, waited_s: float = 0.0, boot: str = BOOT) -> None:
    """A contact, sampled 5 ms before it was sent, by a daemon whose clock is `ahead_s` behind this machine's."""
    sent_ns = time.monotonic_ns() - int((ahead_s + waited_s) * 1e9)
    publisher.send_contact("demo", contact_message(t_publish_ns=sent_ns, t_sample_ns=sent_ns - 5_000_000, boot=boot))


@pytest.mark.parametrize("ahead_s", [3600.0, -3600.0])
def test_clock_of_another_machine_is_learnt_from_what_arrives(program: Path, ahead_s: float) -> None:
    """That machine was started an hour after this one or before it, and later once more."""
    base = tcp_base()
    publisher = Publisher(Endpoints.from_base(base), BOOT)

    def settled(client: Talker, boot: str, ahead_s: float) -> dict[str, Any]:
        def heard() -> dict[str, Any]:
            far(publisher, ahead_s, boot=boot)
            return client.latest(20)

        return eventually(heard, lambda answer: answer.get("boot") == boot)

    try:
        with Talker(program, "demo", base) as client:
            answer = settled(client, BOOT, ahead_s)
            assert answer["valid"]
            assert 0.005 <= answer["sample_age_s"] < 0.3
            assert answer["clock_ahead_s"] == pytest.approx(ahead_s, abs=0.1)  # what a busy machine adds
            while client.latest(50)["result"] == NEW:
                pass
            far(publisher, ahead_s, waited_s=0.4)
            answer = client.latest(200)
            assert (answer["result"], answer["alive"]) == (NOTHING, False)
            assert settled(client, "two", ahead_s + 90_000.0)["restarts"] == 1
            # All that it said before it died, read at once.
            for _ in range(20):
                far(publisher, ahead_s, boot="three")
            time.sleep(0.5)
            assert not client.latest(100)["alive"]
    finally:
        publisher.close()


def refused(program: Path, *words: str, **changes: str) -> str:
    environment = {name: value for name, value in os.environ.items() if name not in ("FMFTS_BUS", "FMFTS_KEY")}
    with Talker(program, *words, environment=environment | changes) as client:
        answer = client.heard()
    assert answer["result"] is None
    return str(answer["why"])


def test_what_cannot_be_connected_to_says_what_to_do(program: Path, tmp_path: Path) -> None:
    for base in ("ipc://relative", "tcp://:5570", "tcp://host:0", "tcp://host:65534", "tcp://host:1x", "http://a:1"):
        assert "is no base" in refused(program, "demo", base), base
    assert "too long" in refused(program, "demo", f"ipc:///{'x' * 105}")
    assert "a pad's name" in refused(program, "x" * 65)
    assert "keys new" in refused(program, "demo", "tcp://192.0.2.1:5570")
    assert "keys new" in refused(program, "demo", FMFTS_BUS="tcp://example.invalid:5570")


def test_key_file_that_is_open_to_others_absent_or_damaged_is_refused(program: Path, tmp_path: Path) -> None:
    key = tmp_path / "arm.key"
    base = "tcp://127.0.0.1:5570"
    assert "cannot be read" in refused(program, "demo", base, FMFTS_KEY=str(key))
    KeyFolder(tmp_path / "keys").add("arm", key)
    key.chmod(0o644)
    assert f"chmod 600 {key}" in refused(program, "demo", base, FMFTS_KEY=str(key))
    key.chmod(0o600)
    key.write_text(key.read_text().replace("secret", "sacred"))
    assert "no usable secret" in refused(program, "demo", base, FMFTS_KEY=str(key))


@pytest.mark.skipif(Path("/run/fmfts").is_dir(), reason="a service runs here, and is found first")
def test_own_directory_is_found_as_the_daemon_finds_it_and_refused_when_others_may_enter(
    program: Path, tmp_path: Path
) -> None:
    surroundings = {name: value for name, value in os.environ.items() if name not in ("FMFTS_BUS", "XDG_RUNTIME_DIR")}
    for variable, directory in (("XDG_RUNTIME_DIR", "fmfts"), ("TMPDIR", f"fmfts-{os.getuid()}")):
        where = tmp_path / variable
        where.mkdir()
        (where / directory).mkdir(mode=0o700)
        publisher = Publisher(Endpoints.from_base(f"ipc://{where / directory}"), BOOT)
        with Talker(program, "demo", environment=surroundings | {variable: str(where)}) as client:
            connect(publisher, client)
        publisher.close()
        (where / directory).chmod(0o750)
        others = {"XDG_RUNTIME_DIR": ""} | {variable: str(where)}
        assert "not a directory of yours alone" in refused(program, "demo", **others)


def test_nothing_is_allocated_in_a_control_loop(tmp_path: Path, publisher: Publisher) -> None:
    program = build(tmp_path / "allocations", "gcc", [HERE / "allocations.c"])
    contacts = 300
    with subprocess.Popen(
        [program, "demo", f"ipc://{tmp_path}", str(contacts)], stdout=subprocess.PIPE, text=True
    ) as loop:
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


def test_program_that_is_told_nothing_ends_well(program: Path, tmp_path: Path) -> None:
    run([program, "demo", f"ipc://{tmp_path}"], stdin=subprocess.DEVNULL)
