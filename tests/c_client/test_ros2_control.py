"""The force-torque sensor for ros2_control, compiled against stand-ins for its headers, and fed by a bus."""

from __future__ import annotations

import json
import subprocess
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import msgspec
import pytest
from msgspec.structs import replace

from background import repeating, started
from c_client.built import CLIENT, HERE, need, pkg_config, run
from fmfts.bus.publisher import Publisher
from fmfts_client import Contact, Endpoints
from fmfts_client.wrench import wrench_of
from unit.bus_messages import contact_message

HOST = HERE / "ros2_control"
FORCES = ("tip/force.x", "tip/force.y", "tip/force.z", "tip/torque.x", "tip/torque.y", "tip/torque.z")
HEIGHT_M = 0.012
SENT_S, LINES = 2.5, 300


@pytest.fixture(scope="module")
def host(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ros2_control")
    strict = ["-Wall", "-Wextra", "-Werror", f"-I{HOST}", f"-I{CLIENT}"]
    run([need("gcc"), "-std=c11", "-c", CLIENT / "fmfts.c", f"-I{CLIENT}", "-o", folder / "fmfts.o"])
    sources = [HOST / "host.cpp", folder / "fmfts.o"]
    zmq = pkg_config("--cflags", "--libs", "libzmq")
    run([need("g++"), "-std=c++17", *strict, *sources, *zmq, "-o", folder / "host"])
    return folder / "host"


def told(host: Path, folder: Path, **changed: Any) -> tuple[list[dict[str, Any]], Contact]:
    """The values that ros2_control reads while this contact is repeated, until LINES have come, or of an unusable one
    for SENT_S; and then nothing is sent until it reads nothing."""
    base = f"ipc://{folder}"
    message = contact_message(pad="left", **changed)
    read: list[dict[str, Any]] = []

    def send() -> None:
        now_ns = time.monotonic_ns()
        publisher.send_contact("left", replace(message, t_sample_ns=now_ns, t_publish_ns=now_ns))

    def is_known() -> bool:
        return read[-1]["tip/force.z"] is not None

    pipe = subprocess.PIPE
    with (
        closing(Publisher(Endpoints.from_base(base), "b00t")) as publisher,
        started([host, "left", base], stdin=pipe, stdout=pipe) as process,
    ):
        assert process.stdin is not None
        assert process.stdout is not None
        lines = map(json.loads, process.stdout)
        until_s = time.monotonic() + SENT_S
        with repeating(send, 0.005):
            known = 0
            while known < LINES and (message.health == "ok" or time.monotonic() < until_s):
                read.append(next(lines))
                known += is_known()
        while is_known():
            read.append(next(lines))
        process.stdin.close()
        read += lines
        assert process.wait(60) == 0
    return read, Contact.from_message(msgspec.to_builtins(message))


def test_interfaces_hold_the_wrench_and_nan_in_silence(host: Path, tmp_path: Path) -> None:
    read, contact = told(host, tmp_path, shear_x_n=0.4, shear_x_sd_n=0.1, shear_y_n=-0.3, shear_y_sd_n=0.1)
    assert tuple(read[0]) == FORCES
    wrench = wrench_of(contact, HEIGHT_M)
    known = [list(each.values()) for each in read if each["tip/force.z"] is not None]
    assert known[0] == pytest.approx([*wrench.force_n, *wrench.torque_nm], rel=1e-12)
    assert all(each == known[0] for each in known)
    assert set(read[-1].values()) == {None}, "a silent daemon"


def test_unknown_shear_is_zero_if_so_configured(host: Path, tmp_path: Path) -> None:
    read, contact = told(host, tmp_path, shear_x_n=None, shear_x_sd_n=None, shear_y_n=None, shear_y_sd_n=None)
    wrench = wrench_of(contact, HEIGHT_M, 0.0)
    known = [list(each.values()) for each in read if each["tip/force.z"] is not None]
    assert known[0] == pytest.approx([*wrench.force_n, *wrench.torque_nm], rel=1e-12)


def test_unusable_pad_gives_nan(host: Path, tmp_path: Path) -> None:
    read, _ = told(host, tmp_path, health="disturbed", reason="steel")
    assert all(value is None for each in read for value in each.values())
