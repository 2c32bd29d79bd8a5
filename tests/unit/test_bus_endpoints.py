"""Where the bus is served: one daemon an endpoint, and nobody else's."""

from __future__ import annotations

import grp
import os
import socket
import stat
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from bus_messages import BOOT
from test_bus import connect

from fmfts.bus.lock import BusError, serving_pid
from fmfts.bus.publisher import Publisher
from fmfts_client import Client, Endpoints
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
        connect(publisher, client)  # and the first still serves


def test_second_daemon_on_a_tcp_port_is_refused_too() -> None:
    base = tcp_base()
    with socket.create_server(("127.0.0.1", int(base.rpartition(":")[2]))):
        assert serving_pid(base) == 0, "somebody, but a port does not say who"
        with pytest.raises(BusError, match=r"Address already in use.*: another program, perhaps another fmfts-daemon"):
            Publisher(Endpoints.from_base(base), "two")
    assert serving_pid(base) is None


def test_daemon_that_one_may_not_see_is_no_absent_one(tmp_path: Path) -> None:
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
