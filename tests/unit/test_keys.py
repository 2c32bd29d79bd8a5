"""Who is let in over tcp: real sockets, real handshakes, and those that must get nothing."""

from __future__ import annotations

import asyncio
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgpack
import pytest
import zmq
from bus_messages import BOOT, contact_message

from fmfts.bus.control import CHANGING, ControlServer, Request
from fmfts.bus.gate import Gate
from fmfts.bus.keys import KeyFolder
from fmfts.bus.lock import BusError
from fmfts.bus.publisher import Publisher
from fmfts.cli.main import main
from fmfts.common.exit_codes import USAGE
from fmfts_client import KEY_VARIABLE, BadKeyError, Endpoints, RefusedError, Subscription, UnreachableError, request
from fmfts_client.keys import show_key
from fmfts_page.commands import Commands, RecordBaseline
from fmfts_page.recordings import Recordings
from ports import tcp_base

# A handshake on one machine takes milliseconds; a peer that is shut out stays silent.
HANDSHAKE_S, SILENCE_S = 60.0, 0.7


class Service:
    """The services of a daemon with keys, in turns like its loop."""

    def __init__(self, folder: Path) -> None:
        self.keys = KeyFolder(folder / "keys")
        self.friend = folder / "friend.key"
        self.keys.add("friend", self.friend, may_change=True)
        self.base = tcp_base()
        self.gate = Gate(self.keys)
        key, endpoints = self.keys.server(), Endpoints.from_base(self.base)
        self._publisher = Publisher(endpoints, BOOT, key)
        self._control = ControlServer(endpoints.control, self.keys)
        self.carried_out: list[str] = []
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._turn)
        self._thread.start()

    def _turn(self) -> None:
        while not self._done.wait(0.005):
            self.gate.answer()
            self._publisher.send_contact("demo", contact_message())
            while self._control.serve_one(self._carry_out):
                pass

    def _carry_out(self, request: Request) -> None:
        self.carried_out.append(request.verb)
        request.reply()

    def close(self) -> None:
        self._done.set()
        self._thread.join()
        self._control.close()
        self._publisher.close()
        self.gate.close()


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    service = Service(tmp_path)
    yield service
    service.close()


def hears(base: str, patience_s: float) -> bool:
    with Subscription(("contact",), "demo", base) as messages:
        return messages.receive(patience_s) is not None


def obeyed(base: str, patience_s: float) -> bool:
    try:
        request("selftest", endpoint=base, timeout_s=patience_s)
    except UnreachableError:
        return False
    return True


def test_client_with_may_change_key_receives_and_commands(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(KEY_VARIABLE, str(service.friend))
    assert hears(service.base, HANDSHAKE_S)
    assert obeyed(service.base, HANDSHAKE_S)


def test_plain_client_gets_nothing(service: Service) -> None:
    assert not hears(service.base, SILENCE_S)
    assert not obeyed(service.base, SILENCE_S)
    assert service.carried_out == []


def test_unknown_key_gets_nothing(service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It knows the daemon's public key, and holds a pair that nobody entered."""
    service.keys.add("stranger", tmp_path / "stranger.key")
    service.keys.forget("stranger")
    monkeypatch.setenv(KEY_VARIABLE, str(tmp_path / "stranger.key"))
    assert not hears(service.base, SILENCE_S)
    assert not obeyed(service.base, SILENCE_S)
    assert service.carried_out == []
    assert service.gate.refused > 0


def test_request_ends_though_its_key_was_refused_before_it_was_sent(
    service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a computer that is busy: then nobody takes what is sent."""
    service.keys.add("stranger", tmp_path / "stranger.key")
    service.keys.forget("stranger")
    monkeypatch.setenv(KEY_VARIABLE, str(tmp_path / "stranger.key"))
    packed = msgpack.packb

    def when_refused(message: dict[str, Any]) -> bytes:
        until_s = time.monotonic() + HANDSHAKE_S
        while not service.gate.refused and time.monotonic() < until_s:
            time.sleep(0.01)
        time.sleep(1.0)  # until the client has learned of that, and has given up
        return bytes(packed(message))

    monkeypatch.setattr("fmfts_client.control.msgpack.packb", when_refused)
    for _ in range(3):  # timing decides whether a message waits
        with pytest.raises(UnreachableError, match="no answer from"):
            request("selftest", endpoint=service.base, timeout_s=SILENCE_S)
    assert service.gate.refused > 0


def test_key_that_is_entered_while_the_daemon_runs_is_let_in(
    service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    service.keys.add("late", tmp_path / "late.key")
    monkeypatch.setenv(KEY_VARIABLE, str(tmp_path / "late.key"))
    assert hears(service.base, HANDSHAKE_S)


def test_list_that_cannot_be_read_lets_nobody_in(
    service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "keys" / "clients").write_text("not a key\n")
    monkeypatch.setenv(KEY_VARIABLE, str(service.friend))
    assert not hears(service.base, SILENCE_S)


def refusal(service: Service, verb: str, name: str, monkeypatch: pytest.MonkeyPatch) -> str:
    """The refusal that a client gets for `verb`; "" if the daemon obeys."""
    monkeypatch.setenv(KEY_VARIABLE, str(service.friend.with_name(f"{name}.key")))
    try:
        request(verb, endpoint=service.base, timeout_s=HANDSHAKE_S)
    except RefusedError as error:
        return str(error)
    return ""


def test_new_key_receives_and_asks_but_changes_nothing(
    service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    service.keys.add("guest", tmp_path / "guest.key")
    for verb in sorted(CHANGING):
        said = refusal(service, verb, "guest", monkeypatch)
        assert "the key of client 'guest' is read-only" in said
        assert "fmfts-daemon keys set guest --may-change" in said
    assert [refusal(service, verb, "guest", monkeypatch) for verb in ("pads", "status", "probe")] == ["", "", ""]
    assert hears(service.base, HANDSHAKE_S)
    assert refusal(service, "selftest", "friend", monkeypatch) == ""
    assert service.carried_out == ["pads", "status", "probe", "selftest"]


def test_page_shows_the_refusal(service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    service.keys.add("guest", tmp_path / "guest.key")
    monkeypatch.setenv(KEY_VARIABLE, str(tmp_path / "guest.key"))
    said: list[dict[str, Any]] = []
    page = Commands(Endpoints.from_base(service.base), Recordings(tmp_path, None))
    asyncio.run(page.carry_out(RecordBaseline(id=1, pad="demo", kind="rest"), said.append))
    assert "fmfts-daemon keys set guest --may-change" in said[0]["error"]


def test_right_that_is_granted_counts_from_the_next_request(
    service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    service.keys.add("guest", tmp_path / "guest.key")
    assert "read-only" in refusal(service, "baseline", "guest", monkeypatch)
    service.keys.grant("guest", may_change=True)
    assert refusal(service, "baseline", "guest", monkeypatch) == ""
    service.keys.grant("guest", may_change=False)
    assert "read-only" in refusal(service, "baseline", "guest", monkeypatch)


def connected(service: Service) -> zmq.Socket[bytes]:
    """A client with a connection of its own, which has had an answer."""
    socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
    socket.setsockopt(zmq.LINGER, 0)
    show_key(socket, service.base, service.friend)
    socket.connect(Endpoints.from_base(service.base).control)
    assert answered(socket, "pads")["ok"]
    return socket


def answered(socket: zmq.Socket[bytes], verb: str) -> dict[str, Any]:
    socket.send(msgpack.packb({"id": 1, "verb": verb}))
    assert socket.poll(round(HANDSHAKE_S * 1e3))
    answer: dict[str, Any] = msgpack.unpackb(socket.recv())
    return answer


def test_forgotten_client_gets_no_more_answers(service: Service) -> None:
    with connected(service) as socket:
        service.keys.forget("friend")
        for verb in ("status", "baseline"):
            assert "your key is not on the daemon's list any more" in answered(socket, verb)["error"]
    assert service.carried_out == ["pads"]


def test_damaged_key_list_refuses_connected_clients(service: Service, tmp_path: Path) -> None:
    with connected(service) as socket:
        (tmp_path / "keys" / "clients").write_text("not a key\n")
        assert "the daemon cannot read its list of keys" in answered(socket, "baseline")["error"]
    assert service.carried_out == ["pads"]


def test_keys_verb_says_who_may_change_what(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "config.toml").write_text(
        '[bus]\nkeys = "keys"\n[[pad]]\nname = "a"\n[pad.source]\ntype = "simulated"\n'
    )

    def said(*words: str, code: int = 0) -> str:
        assert main(["keys", *words, "--config", "config.toml"]) == code
        captured = capsys.readouterr()
        return captured.out + captured.err

    assert "it is read-only; `fmfts-daemon keys set arm --may-change`" in said("new", "arm")
    assert "read-only" in said("new", "leg", "--read-only")
    assert "read-only" not in said("new", "head", "--may-change")
    assert said("list") == "arm  read-only\nleg  read-only\nhead  may-change\n"
    said("set", "arm", "--may-change")
    said("set", "head", "--read-only")
    assert said("list") == "arm  may-change\nleg  read-only\nhead  read-only\n"
    assert "say --read-only or --may-change" in said("set", "arm", code=USAGE)
    assert "belong to new and set" in said("forget", "arm", "--may-change", code=USAGE)
    assert "no client 'tail'" in said("set", "tail", "--may-change", code=USAGE)


class Tap:
    """Stands between a client and the daemon, and keeps what the client said."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.said = bytearray()
        self.answered = 0
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    @property
    def address(self) -> str:
        return f"tcp://127.0.0.1:{self._listener.getsockname()[1]}"

    def _serve(self) -> None:
        client, _ = self._listener.accept()
        with client, socket.create_connection(("127.0.0.1", self._port)) as server:
            back = threading.Thread(target=self._carry_back, args=(server, client))
            back.start()
            while data := client.recv(65536):
                self.said += data
                server.sendall(data)
            server.shutdown(socket.SHUT_RDWR)
            back.join()

    def _carry_back(self, server: socket.socket, client: socket.socket) -> None:
        while data := server.recv(65536):
            self.answered += len(data)
            client.sendall(data)

    def close(self) -> None:
        """Close after the client has gone."""
        self._thread.join()
        self._listener.close()


def test_replayed_handshake_gets_nothing(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    """All that a good client ever said, said again word for word: its request is not carried out a second time."""
    monkeypatch.setenv(KEY_VARIABLE, str(service.friend))
    good = Endpoints.from_base(service.base)
    port = int(good.control.rpartition(":")[2])
    tap = Tap(port)
    request("selftest", endpoint=Endpoints(good.bus, tap.address, good.frames), timeout_s=HANDSHAKE_S)
    assert service.carried_out == ["selftest"]
    assert b"selftest" not in tap.said, "what passes over the network is encrypted"
    heard = 0
    with socket.create_connection(("127.0.0.1", port)) as thief:
        thief.settimeout(SILENCE_S)
        thief.sendall(bytes(tap.said))
        try:
            while data := thief.recv(65536):
                heard += len(data)
        except (TimeoutError, ConnectionError):
            pass
    assert service.carried_out == ["selftest"]
    assert heard < tap.answered, "no more than the daemon's half of a handshake"
    tap.close()


def test_changing_verbs_need_a_key_over_tcp_on_this_machine_too() -> None:
    base = tcp_base()
    server = ControlServer(Endpoints.from_base(base).control)
    done = threading.Event()

    def loop() -> None:
        while not done.wait(0.005):
            while server.serve_one(Request.reply):
                pass

    thread = threading.Thread(target=loop)
    thread.start()
    try:
        for verb in sorted(CHANGING):
            with pytest.raises(RefusedError, match="over tcp without keys"):
                request(verb, endpoint=base)
        assert request("pads", endpoint=base) == {}
    finally:
        done.set()
        thread.join()
        server.close()


def test_client_on_a_network_says_that_it_needs_a_key() -> None:
    with pytest.raises(BadKeyError, match="keys new NAME"):
        Subscription(("contact",), "demo", "tcp://192.0.2.1:5570")
    with pytest.raises(BadKeyError, match=KEY_VARIABLE):
        request("pads", endpoint="tcp://192.0.2.1:5570")


def test_secret_keys_are_private_and_never_printed(tmp_path: Path) -> None:
    folder = KeyFolder(tmp_path / "keys")
    folder.add("friend", tmp_path / "friend.key")
    for path in (tmp_path / "friend.key", tmp_path / "keys" / "server.key"):
        assert path.stat().st_mode & 0o777 == 0o600
    assert folder.server().secret.decode() not in repr(folder.server())
    (tmp_path / "keys" / "server.key").chmod(0o644)
    with pytest.raises(BusError, match=r"open to others .mode 0644.: chmod 600"):
        folder.server()


def test_key_is_never_written_over(tmp_path: Path) -> None:
    folder = KeyFolder(tmp_path / "keys")
    folder.add("one", tmp_path / "one.key")
    server, written = folder.server(), (tmp_path / "one.key").read_bytes()
    with pytest.raises(BusError, match="File exists"):
        folder.add("two", tmp_path / "one.key")
    with pytest.raises(BusError, match="already"):
        folder.add("one", tmp_path / "other.key")
    assert (folder.server(), (tmp_path / "one.key").read_bytes()) == (server, written)
    assert list(folder.clients()) == ["one"]


def test_libzmq_is_built_with_curve() -> None:
    assert zmq.has("curve")


def test_closed_gate_frees_its_endpoint_at_once(tmp_path: Path) -> None:
    keys = KeyFolder(tmp_path / "keys")
    for _ in range(300):
        Gate(keys).close()
