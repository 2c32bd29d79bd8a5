"""The bus's endpoints: one daemon on each, and none of another user."""

from __future__ import annotations

import fcntl
import grp
import os
import pwd
import socket
import stat
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from bus_messages import BOOT
from test_bus import connect

from fmfts.bus.control import ControlServer
from fmfts.bus.lock import BusError, EndpointLock, serving_pid, socket_path
from fmfts.bus.publisher import Publisher
from fmfts_client import Client, EndpointError, Endpoints
from fmfts_client.endpoints import for_client, for_daemon, trusted_owners
from ports import tcp_base


@pytest.fixture
def endpoints(tmp_path: Path) -> Endpoints:
    return Endpoints.from_base(f"ipc://{tmp_path}")


@pytest.fixture
def publisher(endpoints: Endpoints) -> Iterator[Publisher]:
    publisher = Publisher(endpoints, BOOT)
    yield publisher
    publisher.close()


def test_second_daemon_on_an_endpoint_is_refused_by_name(publisher: Publisher, endpoints: Endpoints) -> None:
    with pytest.raises(BusError, match=rf"another fmfts-daemon \(pid {os.getpid()}\) serves ipc://"):
        Publisher(endpoints, "two")
    assert serving_pid(endpoints.bus) == os.getpid()
    with Client("demo", endpoints) as client:
        connect(publisher, client)  # the first daemon still serves


def test_daemon_that_starts_while_another_program_looks_is_not_refused(
    endpoints: Endpoints, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`status` holds the lock for a moment. The moment ends when the new daemon waits."""
    path = socket_path(endpoints.control)
    assert path is not None
    with path.with_name(f"{path.name}.lock").open("w") as looking:
        fcntl.flock(looking, fcntl.LOCK_SH)
        monkeypatch.setattr("time.sleep", lambda _: fcntl.flock(looking, fcntl.LOCK_UN))
        EndpointLock(endpoints.control).release()


def test_second_daemon_on_a_tcp_port_is_refused_too() -> None:
    base = tcp_base()
    with socket.create_server(("127.0.0.1", int(base.rpartition(":")[2]))):
        assert serving_pid(base) == 0, "somebody, but a port does not say who"
        with pytest.raises(BusError, match=r"Address already in use.*: another program, perhaps another fmfts-daemon"):
            Publisher(Endpoints.from_base(base), "two")
    assert serving_pid(base) is None


def test_daemon_without_permission_is_not_reported_absent(tmp_path: Path) -> None:
    (tmp_path / "bus.lock").touch(mode=0o600)
    script = (
        "import os, sys; from fmfts.bus.lock import BusError, serving_pid\n"
        "os.geteuid() or os.seteuid(65534)\n"
        "try: print(serving_pid(sys.argv[1]))\n"
        "except BusError as error: print(error)"
    )
    if os.geteuid() != 0:
        (tmp_path / "bus.lock").chmod(0)
    run = subprocess.run([sys.executable, "-c", script, f"ipc://{tmp_path}/bus"], capture_output=True, text=True)
    assert "bus.lock: Permission denied" in run.stdout, run.stderr


def test_endpoint_is_free_again_after_close_and_after_a_kill(endpoints: Endpoints) -> None:
    Publisher(endpoints, "one").close()
    assert serving_pid(endpoints.bus) is None
    script = (
        "import sys, time; from fmfts.bus.publisher import Publisher; from fmfts_client import Endpoints\n"
        "Publisher(Endpoints.from_base(sys.argv[1]), 'x'); print('up', flush=True); time.sleep(60)"
    )
    base = endpoints.bus.removesuffix("/bus")
    with subprocess.Popen([sys.executable, "-c", script, base], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        assert serving_pid(endpoints.bus) == process.pid
        process.kill()
    assert serving_pid(endpoints.bus) is None
    Publisher(endpoints, "two").close()


def test_frames_endpoint_taken_leaves_the_bus_free(endpoints: Endpoints) -> None:
    holder = Publisher(Endpoints(endpoints.control, endpoints.control, endpoints.frames), "one")
    with pytest.raises(BusError):
        Publisher(endpoints, "two")
    assert serving_pid(endpoints.bus) is None
    holder.close()


def test_sockets_are_for_owner_and_group_only(publisher: Publisher, endpoints: Endpoints) -> None:
    for endpoint in (endpoints.bus, endpoints.frames):
        found = Path(endpoint.removeprefix("ipc://")).stat()
        assert stat.S_IMODE(found.st_mode) == 0o660
        if os.geteuid() == 0 and "fmfts" in [group.gr_name for group in grp.getgrall()]:
            assert found.st_gid == grp.getgrnam("fmfts").gr_gid


@pytest.mark.parametrize("base", ["tcp://0.0.0.0:5570", "tcp://*:5570", "tcp://192.0.2.1:5570", "tcp://eth0:5570"])
def test_endpoint_open_to_the_network_is_refused(base: str) -> None:
    with pytest.raises(BusError, match="open to the network"):
        Publisher(Endpoints.from_base(base), BOOT)


def test_directory_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    with pytest.raises(BusError, match="missing/fmfts: No such file"):
        Publisher(Endpoints.from_base(f"ipc://{tmp_path}/missing/fmfts"), BOOT)


def test_folder_that_the_daemon_makes_is_closed_to_others(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        Publisher(Endpoints.from_base(f"ipc://{tmp_path}/made"), BOOT).close()
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "made").stat().st_mode) == 0o750


def test_link_in_place_of_the_lock_is_not_followed(tmp_path: Path) -> None:
    """In a folder of the group's, a member could have the daemon empty another file of its user."""
    (tmp_path / "precious").write_text("kept")
    (tmp_path / "bus.lock").symlink_to(tmp_path / "precious")
    with pytest.raises(BusError, match=r"bus\.lock: "):
        Publisher(Endpoints.from_base(f"ipc://{tmp_path}"), BOOT)
    assert (tmp_path / "precious").read_text() == "kept"


def test_root_is_trusted_by_every_user(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "getuid", lambda: 4711)
    assert trusted_owners() >= {4711, 0}
    assert 4712 not in trusted_owners()


def of_another_user(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Root gives it away; so this process sees it as another user would."""
    if os.geteuid() == 0:
        os.chown(folder, 65534, -1)
    else:
        mine = os.getuid()
        monkeypatch.setattr(os, "getuid", lambda: mine + 1)


def test_daemon_refuses_a_folder_of_another_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "bus"
    folder.mkdir(mode=0o755)
    of_another_user(folder, monkeypatch)
    endpoints = Endpoints.from_base(f"ipc://{folder}")
    for serve in (lambda: Publisher(endpoints, BOOT), lambda: ControlServer(endpoints.control)):
        with pytest.raises(BusError, match=r"bus belongs to user .*user could replace the sockets.*mkdir -m 750"):
            serve()
    assert not list(folder.iterdir()), "nothing was put there"


def test_daemon_refuses_a_folder_that_others_may_write_to(tmp_path: Path) -> None:
    folder = tmp_path / "bus"
    folder.mkdir()
    folder.chmod(0o1777)
    with pytest.raises(BusError, match="another user could replace the sockets"):
        Publisher(Endpoints.from_base(f"ipc://{folder}"), BOOT)
    folder.chmod(0o2770)  # the folder may be meant for the group
    Publisher(Endpoints.from_base(f"ipc://{folder}"), BOOT).close()


@pytest.mark.parametrize("nested", [False, True])
def test_folder_of_a_stranger_in_a_shared_place_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, nested: bool
) -> None:
    shared = tmp_path / "shared"
    folder = shared / "fmfts"
    folder.mkdir(parents=True, mode=0o755)
    base = f"ipc://{folder}" + "/inside" * nested
    (folder / "inside").mkdir()
    shared.chmod(0o755)
    of_another_user(folder, monkeypatch)
    for find in (for_client, for_daemon):
        assert find(base, {}) == Endpoints.from_base(base), "only its owner could make it there: it was meant"
    shared.chmod(0o1777)
    for find in (for_client, for_daemon):
        with pytest.raises(EndpointError, match=r"fmfts belongs to user .*any user may make .*in your home"):
            find(base, {})


def test_link_of_a_stranger_in_a_shared_place_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Even if it leads to a trusted folder: it may lead elsewhere later."""
    if os.geteuid() != 0:
        pytest.skip("needs a link of another user")
    mine, shared = tmp_path / "mine", tmp_path / "shared"
    for folder in (mine, shared):
        folder.mkdir()
    (shared / "link").symlink_to(mine)
    os.lchown(shared / "link", 65534, -1)
    shared.chmod(0o1777)
    with pytest.raises(EndpointError, match="link belongs to user"):
        for_client(f"ipc://{shared}/link", {})


def test_service_user_may_own_a_folder_in_a_shared_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A client of the group `fmfts` talks to the service, whose user the folder belongs to."""
    folder = tmp_path / "fmfts"
    folder.mkdir()
    tmp_path.chmod(0o1777)
    of_another_user(folder, monkeypatch)
    owner = folder.stat().st_uid
    monkeypatch.setattr(pwd, "getpwnam", lambda name: pwd.struct_passwd((name, "x", owner, owner, "", "/", "/")))
    assert for_client(f"ipc://{folder}", {}) == Endpoints.from_base(f"ipc://{folder}")


def test_missing_folder_in_a_shared_place_is_refused(tmp_path: Path) -> None:
    """Clients would trust whoever makes it first. A daemon makes it itself, and looks whose it is."""
    shared = tmp_path / "shared"
    shared.mkdir()
    (tmp_path / "link").symlink_to(shared / "robot")
    bases = [f"ipc://{shared}/robot", f"ipc://{shared}/robot/inside", f"ipc://{tmp_path}/link"]
    for base in bases:
        assert for_client(base, {}) == Endpoints.from_base(base), "nobody else can make it there"
    shared.chmod(0o1777)
    for base in bases:
        with pytest.raises(EndpointError, match=r"not there.*any user may make .*start the daemon first, or name"):
            for_client(base, {})
        assert for_daemon(base, {}) == Endpoints.from_base(base)
    (shared / "robot").mkdir()
    assert for_client(bases[0], {}) == Endpoints.from_base(bases[0])


def test_closed_folder_of_a_stranger_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It may be open when ZeroMQ tries again."""
    folder = tmp_path / "robot"
    folder.mkdir()
    tmp_path.chmod(0o1777)
    of_another_user(folder, monkeypatch)
    with pytest.raises(EndpointError, match="robot belongs to user"):
        for_client(f"ipc://{folder}/not-seen", {})
