"""Where the C client connects to, and with which key: another machine's daemon and clock, one's own directory."""

from __future__ import annotations

import os
import socket
import time
from pathlib import Path
from typing import Any

import pytest

from c_client.built import NEW, Talker, build_listener, connect, eventually
from fmfts.bus.gate import Gate
from fmfts.bus.keys import KeyFolder
from fmfts.bus.publisher import Publisher
from fmfts_client import Endpoints
from ports import tcp_base
from unit.bus_messages import BOOT, contact_message

LATE = 99  # the number of a contact that comes late


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_listener(tmp_path_factory.mktemp("c"))


def test_only_a_known_key_receives_over_tcp(program: Path, tmp_path: Path) -> None:
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


def far(publisher: Publisher, ahead_s: float, waited_s: float = 0.0, boot: str = BOOT, seq: int = 0) -> None:
    """A contact, sampled 5 ms before it was sent, by a daemon whose clock is `ahead_s` behind this machine's."""
    sent_ns = time.monotonic_ns() - int((ahead_s + waited_s) * 1e9)
    publisher.send_contact(
        "demo", contact_message(t_publish_ns=sent_ns, t_sample_ns=sent_ns - 5_000_000, boot=boot, seq=seq)
    )


@pytest.mark.parametrize("ahead_s", [3600.0, -3600.0])
def test_clock_of_another_machine_is_learned_from_arrivals(program: Path, ahead_s: float) -> None:
    """That machine was started an hour before or after this one, and later restarted."""
    base = tcp_base()
    publisher = Publisher(Endpoints.from_base(base), BOOT)

    def settled(client: Talker, boot: str, ahead_s: float) -> dict[str, Any]:
        def heard() -> dict[str, Any]:
            far(publisher, ahead_s, boot=boot)
            return client.latest(20)

        # The next message that comes soon removes the error that a busy machine adds to the clock's difference.
        def is_settled(answer: dict[str, Any]) -> bool:
            is_new = answer.get("boot") == boot and answer["valid"]
            return is_new and answer["clock_ahead_s"] == pytest.approx(ahead_s, abs=0.1)

        return eventually(heard, is_settled)

    try:
        with Talker(program, "demo", base) as client:
            assert 0.005 <= settled(client, BOOT, ahead_s)["sample_age_s"] < 0.3
            while client.latest(50)["result"] == NEW:
                pass

            def heard_late() -> dict[str, Any]:
                far(publisher, ahead_s, waited_s=0.4, seq=LATE)
                answer = client.latest(50)
                assert answer.get("seq") != LATE
                return answer

            eventually(heard_late, lambda answer: not answer["alive"])
            assert settled(client, "two", ahead_s + 90_000.0)["restarts"] == 1
            # Everything that it sent before it died, read at once.
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


def test_failed_connection_says_what_to_do(program: Path, tmp_path: Path) -> None:
    for base in ("ipc://relative", "tcp://:5570", "tcp://host:0", "tcp://host:65533", "tcp://host:1x", "http://a:1"):
        assert "is no base" in refused(program, "demo", base), base
    assert "too long" in refused(program, "demo", f"ipc:///{'x' * 105}")
    assert "a pad's name" in refused(program, "x" * 65)
    assert "keys new" in refused(program, "demo", "tcp://192.0.2.1:5570")
    assert "keys new" in refused(program, "demo", FMFTS_BUS="tcp://example.invalid:5570")


def test_socket_of_a_directory_means_the_directory(program: Path, tmp_path: Path) -> None:
    folder = tmp_path / "open"
    folder.mkdir()
    with socket.socket(socket.AF_UNIX) as bus:
        bus.bind(str(folder / "bus"))
        folder.chmod(0o777)
        assert f"{folder} may be written to by every user" in refused(program, "demo", f"ipc://{folder}/bus")


def test_key_file_open_to_others_absent_or_damaged_is_refused(program: Path, tmp_path: Path) -> None:
    key = tmp_path / "arm.key"
    base = "tcp://127.0.0.1:5570"
    assert "cannot be read" in refused(program, "demo", base, FMFTS_KEY=str(key))
    KeyFolder(tmp_path / "keys").add("arm", key)
    key.chmod(0o644)
    assert f"chmod 600 {key}" in refused(program, "demo", base, FMFTS_KEY=str(key))
    key.chmod(0o600)
    KeyFolder(tmp_path / "keys").add("leg", tmp_path / "leg.key")
    mine, other = key.read_text().splitlines(), (tmp_path / "leg.key").read_text().splitlines()
    key.write_text("\n".join([*mine[:3], other[3], ""]))
    assert "are no pair" in refused(program, "demo", base, FMFTS_KEY=str(key))
    key.write_text("\n".join(mine) + "x" * 5000)
    assert "is not the file of a key" in refused(program, "demo", base, FMFTS_KEY=str(key))
    key.unlink()
    os.mkfifo(key, 0o600)
    assert "is not the file of a key" in refused(program, "demo", base, FMFTS_KEY=str(key))
    key.unlink()
    key.touch(0o600)
    key.write_text("\n".join(mine).replace("secret", "sacred"))
    assert "no usable secret" in refused(program, "demo", base, FMFTS_KEY=str(key))


@pytest.mark.skipif(Path("/run/fmfts").is_dir(), reason="a service runs here, and is found first")
def test_own_directory_is_found_and_refused_if_others_may_enter(program: Path, tmp_path: Path) -> None:
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


def test_folder_that_everybody_may_write_to_is_refused(program: Path, tmp_path: Path) -> None:
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o1777)
    assert refused(program, "demo", f"ipc://{shared}").endswith("yours alone (mkdir -m 700)"), "/tmp must stay as it is"
    shared.chmod(0o777)
    assert "or chmod o-w it" in refused(program, "demo", f"ipc://{shared}")


def test_missing_folder_in_a_shared_place_is_refused(program: Path, tmp_path: Path) -> None:
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o1777)
    (tmp_path / "link").symlink_to(shared / "robot")
    for folder in ("robot", "robot/inside"):
        said = refused(program, "demo", f"ipc://{shared}/{folder}")
        assert "is not there" in said
        assert "start the daemon first, or name" in said
    assert "leads to no folder" in refused(program, "demo", f"ipc://{tmp_path}/link")


@pytest.mark.skipif(os.geteuid() != 0, reason="needs a folder of another user")
@pytest.mark.parametrize("how", ["its folder", "a folder in it", "not seen in it", "a link to it", "its link"])
def test_folder_of_a_stranger_in_a_shared_place_is_refused(program: Path, tmp_path: Path, how: str) -> None:
    shared, mine = tmp_path / "shared", tmp_path / "mine"
    folder = shared / "robot"
    (folder / "inside").mkdir(parents=True)
    (mine / "robot").mkdir(parents=True)
    (mine / "link").symlink_to(folder)
    (shared / "link").symlink_to(mine / "robot")
    for stranger in (folder, shared / "link"):
        os.chown(stranger, 65534, -1, follow_symlinks=False)
    shared.chmod(0o1777)
    named = {
        "its folder": folder, "a folder in it": folder / "inside", "not seen in it": folder / "missing",
        "a link to it": mine / "link", "its link": shared / "link",
    }[how]  # fmt: skip
    said = refused(program, "demo", f"ipc://{named}")
    assert "belongs to user 65534" in said
    assert "any user may make such a folder" in said


@pytest.mark.skipif(os.geteuid() != 0, reason="needs a folder of another user")
def test_missing_folder_in_a_private_place_is_accepted(program: Path, tmp_path: Path) -> None:
    folder = tmp_path / "robot"
    folder.mkdir(mode=0o755)
    publisher = Publisher(Endpoints.from_base(f"ipc://{folder}"), BOOT)
    os.chown(folder, 65534, -1)
    with Talker(program, "demo", f"ipc://{folder}/") as client:
        connect(publisher, client)
    publisher.close()
