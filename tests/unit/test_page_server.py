"""The server of the page: whom it lets in, what it answers to strangers, and what it gives a page to draw."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import io
import json
import random
import re
import signal
import socket
import ssl
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import msgpack
import msgspec
import pytest
import zmq
from bus_messages import contact_message
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.frames import Frame, Opcode
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from fmfts.config import PadConfig, SimulatedSource
from fmfts.config.pad_facts import pad_facts
from fmfts_client import Endpoints
from fmfts_fleet.front import FOLDER as FLEETS
from fmfts_page.browser import may_open
from fmfts_page.commands import Commands
from fmfts_page.feed import KEPT_FOR_A_PAGE, Feed, Viewer
from fmfts_page.files import FOLDER, Files
from fmfts_page.guard import Guard, RefusedAddressError
from fmfts_page.recordings import Recordings
from fmfts_page.server import FRONT, HANDSHAKE_S, OPEN_PAGES, PageServer, RobotView
from fmfts_page.strangers import WAITING
from fmfts_recording.file import RecordingWriter

PATIENCE_S = 60.0

ROOT = Path(__file__).parents[2]


UPGRADE = (
    "GET /socket HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nOrigin: http://127.0.0.1:{port}\r\nUpgrade: websocket\r\n"
    "Connection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
)


def text_frame(text: str) -> bytes:
    return Frame(Opcode.TEXT, text.encode()).serialize(mask=True)


def sent_until_stuck(peer: socket.socket, part: bytes, at_most: int) -> int:
    """Bytes that the other end took, and the kernel's buffers, until nothing moved for a second."""
    peer.settimeout(1.0)
    sent = 0
    with contextlib.suppress(TimeoutError):
        while sent < at_most:
            sent += peer.send(part[sent % len(part) :])
    return sent


class Served:
    """A page's server in a thread, on a bus of its own; `publish` is the daemon."""

    def __init__(self, folder: Path, certificate: Path | None = None, key: Path | None = None) -> None:
        self.folder = folder
        self.guard = Guard("127.0.0.1", certificate, key)
        self.endpoints = Endpoints.from_base(f"ipc://{folder}")
        self.bus: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.PUB)
        self.bus.bind(self.endpoints.bus)
        began = threading.Event()
        self._over = threading.Event()

        async def serve() -> None:
            commands = Commands(self.endpoints, Recordings(folder, f"ipc://{folder}"))
            server = PageServer(self.guard, {FRONT: RobotView(Feed(self.endpoints), commands)})
            running = asyncio.create_task(
                server.run(0, lambda address: (setattr(self, "address", address), began.set()))
            )
            while not self._over.is_set() and not running.done():
                await asyncio.sleep(0.01)
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)

        self._thread = threading.Thread(target=lambda: asyncio.run(serve()))
        self._thread.start()
        assert began.wait(PATIENCE_S)
        self.port = int(self.address.split(":")[2].partition("/")[0])

    address = ""

    @contextmanager
    def page(self, token: str | None = None, **options: object) -> Iterator[ClientConnection]:
        """An open page; it has said its token. options: of the connection, such as another origin."""
        options = {"origin": f"http://127.0.0.1:{self.port}", "proxy": None, **options}
        with connect(f"ws://127.0.0.1:{self.port}/socket", **options) as page:  # type: ignore[arg-type]
            page.send(json.dumps({"token": self.guard.token} if token is None else {"token": token}))
            yield page

    def ask(self, request: bytes) -> bytes:
        """Bytes sent to the port, and all that is answered."""
        with socket.create_connection(("127.0.0.1", self.port), timeout=5.0) as peer:
            peer.sendall(request)
            answer = b""
            try:
                while part := peer.recv(65536):
                    answer += part
            except (ConnectionError, TimeoutError):
                pass
            return answer

    def get(self, path: str, host: str | None = None) -> bytes:
        return self.ask(f"GET {path} HTTP/1.1\r\nHost: {host or f'127.0.0.1:{self.port}'}\r\n\r\n".encode())

    def close(self) -> None:
        self._over.set()
        self._thread.join(PATIENCE_S)
        self.bus.close(0)


@contextmanager
def serving(folder: Path, *tls: Path) -> Iterator[Served]:
    # Signal handlers can be set in the main thread only; here the test ends the server.
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("signal.getsignal", lambda number: signal.SIG_IGN)
        served = Served(folder, *tls)
        try:
            yield served
        finally:
            served.close()


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with serving(tmp_path_factory.mktemp("bus")) as served:
        yield served


def answered(page: ClientConnection, wanted: str) -> dict[str, object]:
    """The next answer with this key."""
    while True:
        text = page.recv(timeout=PATIENCE_S)
        if isinstance(text, str) and wanted in (answer := json.loads(text)):
            return answer  # type: ignore[no-any-return]


class TestInternalErrors:
    def test_error_of_the_feed_ends_the_server(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
    ) -> None:
        def fail(feed: Feed) -> None:
            raise ValueError("no bus")

        monkeypatch.setattr(Feed, "drain", fail)
        with serving(tmp_path) as served:
            with served.page():
                served._thread.join(PATIENCE_S)
            assert not served._thread.is_alive()
        assert "ValueError: no bus" in caplog.text

    def test_error_while_sending_closes_the_page(
        self, served: Served, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
    ) -> None:
        def fail(viewer: Viewer) -> None:
            raise ValueError("no batch")

        monkeypatch.setattr(Viewer, "batch", fail)
        with served.page() as page:
            page.send(json.dumps({"ask": "ping", "sent_ms": 1.0}))
            with pytest.raises(ConnectionClosed) as closed:
                page.recv(timeout=PATIENCE_S)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1011
        assert "ValueError: no batch" in caplog.text


class TestWhoMay:
    def test_page_is_served_with_a_policy_that_allows_nothing_unsafe(self, served: Served) -> None:
        answer = served.get("/").decode()
        assert answer.startswith("HTTP/1.1 200 OK")
        policy = re.search(r"Content-Security-Policy: (.*)\r", answer)
        assert policy is not None
        assert "default-src 'none'" in policy[1]
        assert "unsafe" not in policy[1]
        assert f"ws://127.0.0.1:{served.port}/socket" in policy[1]

    def test_another_host_name_gets_nothing(self, served: Served) -> None:
        for host in ("evil.example", f"evil.example:{served.port}", "127.0.0.1", f"127.0.0.1:{served.port + 1}"):
            assert served.get("/", host).startswith(b"HTTP/1.1 421")

    def test_no_path_leaves_the_folder(self, served: Served) -> None:
        for path in ("/../guard.py", "/%2e%2e/guard.py", "//etc/passwd", "/vendor/../../guard.py", "/main.js/", "/."):
            assert served.get(path).startswith(b"HTTP/1.1 404")

    @pytest.mark.parametrize("origin", ["http://evil.example", "null", None, "https://127.0.0.1"])
    def test_another_page_may_not_connect(self, served: Served, origin: str | None) -> None:
        with pytest.raises(InvalidStatus, match="403"), served.page(origin=origin):
            pass

    @pytest.mark.parametrize("token", ["", "wrong", "ä"])
    def test_page_without_token_receives_nothing(self, served: Served, token: str) -> None:
        with served.page(token) as page:
            with pytest.raises(ConnectionClosed) as closed:
                page.recv(timeout=PATIENCE_S)
            assert closed.value.rcvd is not None
            assert closed.value.rcvd.code == 4401

    def test_request_before_the_token_is_not_carried_out(self, served: Served, tmp_path: Path) -> None:
        address, origin = f"ws://127.0.0.1:{served.port}/socket", f"http://127.0.0.1:{served.port}"
        with connect(address, proxy=None, origin=origin) as page:  # type: ignore[arg-type]
            page.send(json.dumps({"ask": "record", "id": 1, "on": True}))
            with pytest.raises(ConnectionClosed):
                page.recv(timeout=PATIENCE_S)

    def test_malformed_requests_are_refused_and_the_page_goes_on(self, served: Served) -> None:
        with served.page() as page:
            for text in ("", "{", "[]", '{"ask": "rm"}', '{"ask": "baseline", "id": 1, "pad": "../x", "kind": "bare"}'):
                page.send(text)
                assert "error" in answered(page, "error")
            page.send(json.dumps({"ask": "ping", "sent_ms": 1.0}))
            assert answered(page, "pong")["pong"] == 1.0

    def test_noise_on_the_port_leaves_the_page_served(self, served: Served) -> None:
        chance = random.Random(1)
        for _ in range(100):
            request = bytearray(f"GET /socket HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\n\r\n".encode())
            for _ in range(chance.randint(1, 8)):
                request[chance.randrange(len(request))] = chance.randrange(256)
            with socket.create_connection(("127.0.0.1", served.port)) as peer:
                peer.sendall(bytes(request))
        assert served.get("/").startswith(b"HTTP/1.1 200")

    def test_silent_connections_do_not_block_new_pages(self, served: Served) -> None:
        idle = [socket.create_connection(("127.0.0.1", served.port)) for _ in range(WAITING + 100)]
        assert served.get("/").startswith(b"HTTP/1.1 200")
        for each in idle:
            each.close()

    @pytest.mark.needs("openssl")
    def test_connections_are_counted_before_tls(self, tmp_path: Path) -> None:
        certificate, key = tmp_path / "certificate.pem", tmp_path / "key.pem"
        made = [
            "openssl",
            "req",
            "-x509",
            "-newkey",
            "ec",
            "-pkeyopt",
            "ec_paramgen_curve:P-256",
            "-nodes",
            "-days",
            "1",
        ]
        made += ["-subj", "/CN=robot", "-keyout", str(key), "-out", str(certificate)]
        subprocess.run(made, check=True, capture_output=True)
        trust = ssl.create_default_context(cafile=certificate)
        trust.check_hostname = False
        with serving(tmp_path, certificate, key) as served, ExitStack() as stack:
            silent = [socket.create_connection(("127.0.0.1", served.port)) for _ in range(WAITING + 100)]
            for each in silent:
                stack.enter_context(each)
            silent[0].settimeout(HANDSHAKE_S / 2)
            assert silent[0].recv(1) == b"", "dropped for a newer one, before its time is over"
            origin = Origin(f"https://127.0.0.1:{served.port}")
            page = stack.enter_context(
                connect(f"wss://127.0.0.1:{served.port}/socket", ssl=trust, proxy=None, origin=origin)
            )
            page.send(json.dumps({"token": served.guard.token}))
            page.send(json.dumps({"ask": "ping", "sent_ms": 1.0}))
            assert answered(page, "pong")["pong"] == 1.0

    def test_connections_without_the_token_take_no_page_place(self, served: Served) -> None:
        address, origin = f"ws://127.0.0.1:{served.port}/socket", Origin(f"http://127.0.0.1:{served.port}")
        with ExitStack() as stack:
            for _ in range(OPEN_PAGES + 10):
                stack.enter_context(connect(address, proxy=None, origin=origin))
            with served.page() as page:
                page.send(json.dumps({"ask": "ping", "sent_ms": 1.0}))
                assert answered(page, "pong")["pong"] == 1.0

    def test_surplus_page_is_refused_with_the_reason(self, served: Served) -> None:
        with ExitStack() as stack:
            for _ in range(OPEN_PAGES):
                page = stack.enter_context(served.page())
                page.send(json.dumps({"ask": "ping", "sent_ms": 1.0}))
                answered(page, "pong")
            with served.page() as page, pytest.raises(ConnectionClosed, match="32 pages are open already"):
                answered(page, "pong")

    def test_page_that_reads_no_answers_is_not_read_further(self, served: Served) -> None:
        """The server's memory stays small, so what the page sends stays in the kernel's buffers, which fill."""
        with socket.create_connection(("127.0.0.1", served.port)) as peer:
            peer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            peer.sendall(UPGRADE.format(port=served.port).encode())
            assert b"101 Switching" in peer.recv(4096)
            peer.sendall(text_frame(json.dumps({"token": served.guard.token})))
            answered_at_length = text_frame(json.dumps({"ask": "?" * 15_000})) * 10
            assert sent_until_stuck(peer, answered_at_length, at_most=50_000_000) < 50_000_000
        assert served.get("/").startswith(b"HTTP/1.1 200")


class TestFeed:
    def test_page_gets_all_of_its_pad_and_the_newest_of_others(self, served: Served) -> None:
        with served.page() as page:
            page.send(json.dumps({"ask": "watch", "detail": "left"}))
            page.send(json.dumps({"ask": "ping", "sent_ms": 0.0}))
            answered(page, "pong")
            until = time.monotonic() + PATIENCE_S
            subscribed = False
            while not subscribed:  # a subscription takes a moment to arrive
                assert time.monotonic() < until
                served.bus.send_multipart([b"contact/left", msgpack.packb({"seq": -1})])
                with contextlib.suppress(TimeoutError):
                    subscribed = isinstance(page.recv(timeout=0.1), bytes)
            for number in range(50):
                for pad in ("left", "right"):
                    served.bus.send_multipart([f"contact/{pad}".encode(), msgpack.packb({"seq": number})])
            seen: dict[str, list[int]] = {"left": [], "right": []}
            until = time.monotonic() + PATIENCE_S
            while time.monotonic() < until and 49 not in (seen["right"] and seen["left"]):
                batch = page.recv(timeout=PATIENCE_S)
                if isinstance(batch, bytes):
                    values = msgpack.Unpacker(raw=False)
                    values.feed(batch)
                    for topic in values:
                        seen[topic.partition("/")[2]].append(values.unpack()["seq"])
            assert [number for number in seen["left"] if number >= 0] == list(range(50))
            assert seen["right"][-1] == 49
            assert len(seen["right"]) < 50

    def test_without_a_page_nothing_is_subscribed(self, tmp_path: Path) -> None:
        bus: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.XPUB)
        endpoints = Endpoints.from_base(f"ipc://{tmp_path}")
        bus.bind(endpoints.bus)
        feed, viewer = Feed(endpoints), Viewer()
        assert not bus.poll(200)
        feed.add(viewer)
        assert {bus.recv() for _ in range(3)} == {b"\x01contact/", b"\x01event/", b"\x01status/"}
        feed.remove(viewer)
        assert {bus.recv() for _ in range(3)} == {b"\x00contact/", b"\x00event/", b"\x00status/"}
        feed.close()
        bus.close(0)

    def test_browser_that_does_not_read_costs_bounded_memory_and_is_reported(self) -> None:
        viewer = Viewer()
        for number in range(KEPT_FOR_A_PAGE + 10):
            viewer.take(b"contact/left", msgpack.packb({"seq": number}))
        assert viewer.left_out == 10
        assert (
            len(list(msgpack.Unpacker(raw=False).__class__(__import__("io").BytesIO(viewer.batch()))))
            == 2 * KEPT_FOR_A_PAGE
        )

    def test_recording_that_cannot_be_read_leaves_the_bus_shown(self, served: Served, tmp_path: Path) -> None:
        (served.folder / "empty.mcap").write_bytes(b"")
        with served.page() as page:
            page.send(json.dumps({"ask": "replay", "id": 1, "name": "empty.mcap"}))
            assert "empty.mcap is empty" in str(answered(page, "error")["error"])
            until = time.monotonic() + PATIENCE_S
            while time.monotonic() < until:  # the subscription may take a moment
                served.bus.send_multipart((b"contact/left", msgpack.packb({"seq": 1})))
                try:
                    if isinstance(page.recv(timeout=0.1), bytes):
                        return
                except TimeoutError:
                    pass
        raise AssertionError("nothing of the bus arrives any more")

    @pytest.mark.parametrize("first", [0, 300])
    def test_recording_is_shown_in_order_up_to_its_end(self, served: Served, first: int) -> None:
        """From the place in it that the page asks for."""
        began_ns, count = 1_000_000_000, 450
        writer = RecordingWriter(served.folder / f"{first}.mcap")
        for seq in range(count):
            at_ns = began_ns + seq * 1_000_000
            told = contact_message(pad="left", seq=seq, t_sample_ns=at_ns, t_publish_ns=at_ns, utc_ns=at_ns)
            writer.add("contact", "left", msgspec.to_builtins(told))
        writer.finish()
        writer.close()
        with served.page() as page:
            page.send(json.dumps({"ask": "replay", "id": 1, "name": f"{first}.mcap", "from_s": first * 1e-3}))
            done = answered(page, "done")["done"]
            assert done == {"pads": [], "recording": f"{first}.mcap", "lasts_s": pytest.approx((count - 1) * 1e-3)}
            shown: list[tuple[str, Any]] = []
            while not shown or shown[-1][0] != "replayed":
                batch = page.recv(timeout=PATIENCE_S)
                if isinstance(batch, bytes):
                    values = list(msgpack.Unpacker(io.BytesIO(batch)))
                    shown += zip(values[::2], values[1::2], strict=True)
        assert [body["seq"] for topic, body in shown if topic == "contact/left"] == list(range(first, count))
        assert shown[-1][1] == {"why": ""}
        clocks = [body["now_ns"] for topic, body in shown if topic == "clock"]
        assert clocks == sorted(clocks)
        assert clocks[0] > began_ns

    def test_bus_messages_stop_when_a_recording_is_shown(self) -> None:
        viewer = Viewer()
        viewer.take(b"event/left", b"\xc0")
        viewer.take_newest({b"contact/left": b"\xc0"})
        viewer.forget()
        assert viewer.batch() == b""


def test_shape_of_a_pad_is_reported_in_metres() -> None:
    facts = pad_facts(PadConfig(name="left", source=SimulatedSource()))
    assert facts["sensors_m"][0] == [0.008, 0.008, 0.0]
    assert facts["rest_position_m"] == [0.0, 0.0, 0.012]
    assert (facts["magnet_diameter_m"], facts["magnet_length_m"]) == (0.002, 0.002)
    assert facts["placement_rotation"] == [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]


class TestAddress:
    def test_off_this_machine_only_with_tls(self) -> None:
        with pytest.raises(RefusedAddressError, match="--certificate"):
            Guard("0.0.0.0")
        with pytest.raises(RefusedAddressError, match="both"):
            Guard("127.0.0.1", certificate=Path("a.pem"))

    def test_key_that_others_may_read_is_refused(self, tmp_path: Path) -> None:
        for name in ("a.pem", "b.pem"):
            (tmp_path / name).write_text("")
            (tmp_path / name).chmod(0o644)
        with pytest.raises(RefusedAddressError, match="chmod 600"):
            Guard("0.0.0.0", tmp_path / "a.pem", tmp_path / "b.pem").tls()

    def test_token_is_behind_the_hash_where_no_server_sees_it(self) -> None:
        guard = Guard("127.0.0.1")
        assert guard.address(8710) == f"http://127.0.0.1:8710/#{guard.token}"
        assert len(guard.token) >= 32
        assert Guard("127.0.0.1").token != guard.token

    def test_browser_is_opened_only_where_there_is_desktop_and_it_is_wanted(self) -> None:
        assert may_open({"DISPLAY": ":0"}, "linux")
        assert not may_open({}, "linux")
        assert not may_open({"DISPLAY": ":0", "BROWSER": "none"}, "linux")


class TestFiles:
    @pytest.mark.parametrize("path", [FOLDER / "index.html", FLEETS / "fleet.html"], ids=lambda path: path.name)
    def test_page_has_no_inline_script_or_style(self, path: Path) -> None:
        page = path.read_text()
        assert not re.search(r"<script(?![^>]*src=)|<style|\sstyle=|\son\w+=", page)

    def test_every_file_that_page_names_is_there_and_none_is_elsewhere(self) -> None:
        for file in [*FOLDER.glob("*.*"), *FLEETS.glob("*.*")]:
            folders = {FOLDER, file.parent}  # the front page is served beside the robot's files
            named = re.findall(
                r"""(?:src|href|from|import)\s*=?\s*["']([^"'#]+\.(?:js|css|svg|json))["']""", file.read_text()
            )
            assert all(any((folder / name).exists() for folder in folders) for name in named), file
            assert "https://" not in file.read_text(), file

    def test_page_advice_is_the_manuals(self) -> None:
        manual = (ROOT / "docs/troubleshooting.md").read_text()
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", manual)
        advice = json.loads((FOLDER / "advice.json").read_text())
        rows = dict(re.findall(r"^\| `(\w+)` \| .*? \| (.*) \|$", plain[plain.index("## `health`") :], re.MULTILINE))
        assert {name: text for name, text in advice["health"].items() if name != "silent"} == rows
        for sentence in (advice["health"]["silent"], *advice["reasons"].values()):
            assert f"| {sentence} |" in plain
        for reason in advice["reasons"]:
            assert f'`reason` is "{reason}"' in plain

    def test_vendored_libraries_are_those_of_the_table(self) -> None:
        table = (ROOT / "docs/dependencies.md").read_text()
        for file in (FOLDER / "vendor").glob("*.*s"):
            assert hashlib.sha256(file.read_bytes()).hexdigest() in table, file.name

    def test_unknown_path_is_no_file(self) -> None:
        files = Files("ws://x", {"/": "fleet.html", "/robot/arm/": "index.html"}, (FOLDER, FLEETS))
        assert files.answer("/nothing").status_code == 404
        assert files.answer("/robot/leg/").status_code == 404

    def test_each_place_has_its_page_and_may_connect_to_its_own_socket_alone(self) -> None:
        fronts = {
            "/": FLEETS / "fleet.html",
            "/robot/arm/": FOLDER / "index.html",
            "/robot/arm-2/": FOLDER / "index.html",
        }
        files = Files("ws://x", {place: front.name for place, front in fronts.items()}, (FOLDER, FLEETS))
        for place, front in fronts.items():
            answer = files.answer(place)
            assert answer.body == front.read_bytes()
            assert f"connect-src 'self' ws://x{place}socket;" in answer.headers["Content-Security-Policy"]
            assert files.answer(f"{place}vendor/msgpack.min.js").status_code == 200
