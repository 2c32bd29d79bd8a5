"""Where daemon and clients meet, and which other users may connect."""

from __future__ import annotations

import os
import socket
import tempfile
from pathlib import Path

import pytest

import permitted
from fmfts_client import EndpointError, Endpoints, endpoints
from fmfts_client.endpoints import OVERRIDE, for_client, for_daemon

NOBODY = 65534


@pytest.fixture(autouse=True)
def no_service(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """This machine may run the service; these tests must not see it. Returns where they would look for it."""
    directory = tmp_path / "run-fmfts"
    monkeypatch.setattr(endpoints, "SERVICE_DIRECTORY", directory)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return directory


def test_base_of_a_directory_names_three_sockets() -> None:
    assert Endpoints.from_base("ipc:///run/x") == Endpoints(
        "ipc:///run/x/bus", "ipc:///run/x/control", "ipc:///run/x/frames"
    )


def test_socket_of_a_directory_means_the_directory(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as bus:
        bus.bind(str(tmp_path / "bus"))
        for environ in ({OVERRIDE: f"ipc://{tmp_path}/bus"}, {OVERRIDE: f"ipc://{tmp_path}"}):
            assert for_client(environ=environ) == Endpoints.from_base(f"ipc://{tmp_path}")
    (tmp_path / "folder" / "bus").mkdir(parents=True)
    assert Endpoints.from_base(f"ipc://{tmp_path}/folder/bus").bus == f"ipc://{tmp_path}/folder/bus/bus"


def test_base_of_a_port_names_three_ports() -> None:
    expected = Endpoints("tcp://127.0.0.1:5570", "tcp://127.0.0.1:5571", "tcp://127.0.0.1:5572")
    assert Endpoints.from_base("tcp://127.0.0.1:5570") == expected
    assert Endpoints.from_base("tcp://[::1]:5570").frames == "tcp://[::1]:5572"


@pytest.mark.parametrize(
    "base",
    [
        "",
        "ipc://relative/path",
        "/run/fmfts",
        "tcp://127.0.0.1",
        "tcp://:5570",
        "tcp://h:0",
        "tcp://h:65533",
        "tcp://h:x",
    ],
)
def test_invalid_base_is_refused_with_the_valid_forms(base: str) -> None:
    with pytest.raises(EndpointError, match="give ipc:///absolute/directory or tcp://host:port"):
        Endpoints.from_base(base)


def test_directory_too_long_for_a_socket_is_refused() -> None:
    with pytest.raises(EndpointError, match="too long for a socket"):
        Endpoints.from_base("ipc:///" + "d" * 105)


def test_override_wins_for_daemon_and_client(no_service: Path) -> None:
    no_service.mkdir()
    environ = {"FMFTS_BUS": "ipc:///a/b", "RUNTIME_DIRECTORY": "/run/fmfts", "XDG_RUNTIME_DIR": "/tmp"}
    assert for_daemon("ipc:///configured", environ).bus == for_client(None, environ).bus == "ipc:///a/b/bus"


def test_daemon_serves_where_its_configuration_says() -> None:
    assert for_daemon("tcp://127.0.0.1:5570", {"RUNTIME_DIRECTORY": "/run/fmfts"}).bus == "tcp://127.0.0.1:5570"


def test_service_and_its_clients_meet(no_service: Path) -> None:
    no_service.mkdir()
    assert for_daemon(None, {"RUNTIME_DIRECTORY": f"{no_service}:/run/more"}) == for_client(None, {})


def test_client_in_a_service_ignores_its_own_runtime_directory(no_service: Path) -> None:
    no_service.mkdir()
    assert for_client(None, {"RUNTIME_DIRECTORY": "/run/gripper"}).bus == f"ipc://{no_service}/bus"


def test_daemon_and_client_of_one_user_meet(tmp_path: Path) -> None:
    runtime = tmp_path / "runtime"
    runtime.mkdir()
    for environ in ({}, {"XDG_RUNTIME_DIR": str(runtime)}, {"XDG_RUNTIME_DIR": "/nowhere"}):
        assert for_daemon(None, environ) == for_client(None, environ)
    assert for_client(None, {"XDG_RUNTIME_DIR": str(runtime)}).bus == f"ipc://{runtime}/fmfts/bus"
    assert for_client(None, {}).bus == f"ipc://{tmp_path}/fmfts-{os.getuid()}/bus"


def test_own_directory_is_made_for_the_user_alone(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        for_client(None, {})
    finally:
        os.umask(before)
    assert (tmp_path / f"fmfts-{os.getuid()}").stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("mode", [0o710, 0o701, 0o777, 0o720])
def test_directory_that_others_may_enter_is_refused(tmp_path: Path, mode: int) -> None:
    directory = tmp_path / f"fmfts-{os.getuid()}"
    directory.mkdir()
    directory.chmod(mode)
    with pytest.raises(EndpointError, match="not a directory of yours alone"):
        for_client(None, {})


def test_link_in_place_of_the_directory_is_refused(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    (tmp_path / f"fmfts-{os.getuid()}").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(EndpointError, match="not a directory of yours alone"):
        for_daemon(None, {})


def test_file_in_place_of_the_directory_is_refused(tmp_path: Path) -> None:
    (tmp_path / f"fmfts-{os.getuid()}").touch(mode=0o600)
    with pytest.raises(EndpointError, match=r"cannot use .*File exists"):
        for_daemon(None, {})


def test_directory_of_somebody_else_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Simulates another user's view, so that no second account is needed."""
    owner = os.getuid()
    (tmp_path / f"fmfts-{owner + 1}").mkdir(mode=0o700)
    monkeypatch.setattr(os, "getuid", lambda: owner + 1)
    with pytest.raises(EndpointError, match=rf"owner {owner}, "):
        for_client(None, {})


def test_client_outside_the_services_group_gets_the_reason(no_service: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    no_service.mkdir()
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(EndpointError, match="usermod -aG fmfts"):
        for_client(None, {})


def test_named_folder_that_everybody_may_write_to_is_refused_with_what_to_do(tmp_path: Path) -> None:
    """Even with the sticky bit, as on /tmp: whoever makes the socket first gets the clients."""
    shared = tmp_path / "shared"
    shared.mkdir()
    base = f"ipc://{shared}"
    for mode, may_be_closed in ((0o777, True), (0o1777, False)):
        shared.chmod(mode)
        for find in (for_daemon, for_client):
            for given in ({"FMFTS_BUS": base}, {}):
                with pytest.raises(EndpointError, match=r"every user .*false forces.*mkdir -m 700 ") as refused:
                    find(base if not given else None, given)
                assert ("chmod o-w" in str(refused.value)) is may_be_closed, "/tmp must stay as it is"
    shared.chmod(0o775)
    assert for_daemon(base, {}) == for_client(base, {}) == Endpoints.from_base(base)
    assert for_client(f"{base}/not-there-yet", {}) == Endpoints.from_base(f"{base}/not-there-yet")


@pytest.mark.skipif(not permitted.another_user(), reason="only root can act as another user")
def test_folder_closed_to_this_user_is_named_with_what_to_do() -> None:
    with tempfile.TemporaryDirectory(dir="/tmp") as closed:  # mode 0700
        os.seteuid(NOBODY)
        try:
            for find in (for_daemon, for_client):
                with pytest.raises(EndpointError, match=rf"{closed}/fmfts: Permission denied: .*group, or .*FMFTS_BUS"):
                    find(None, {"FMFTS_BUS": f"ipc://{closed}/fmfts"})
        finally:
            os.seteuid(0)
