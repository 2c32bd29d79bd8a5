"""`Client.why()`: the reason that a client gets if it receives nothing, over real sockets."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import pytest

from background import repeating
from fmfts.bus.gate import Gate
from fmfts.bus.keys import KeyFolder
from fmfts.bus.publisher import Publisher
from fmfts_client import Client, Endpoints
from fmfts_client.diagnosis import nearest_name
from ports import tcp_base
from unit.bus_messages import BOOT, contact_message


@contextmanager
def daemon_of(base: str, *pads: str, v: int = 1, keys: KeyFolder | None = None) -> Iterator[None]:
    """A daemon's bus with contacts of `pads`, fifty a second; with `keys`, only for clients on its list."""
    gate = None if keys is None else Gate(keys)
    publisher = Publisher(Endpoints.from_base(base), BOOT, None if keys is None else keys.server())

    def turn() -> None:
        if gate is not None:
            gate.answer()
        for pad in pads:
            publisher.send_contact(pad, msgspec.structs.replace(contact_message(pad=pad), v=v))

    try:
        with repeating(turn, 0.02):
            yield
    finally:
        publisher.close()
        if gate is not None:
            gate.close()


def why(pad: str, base: str, timeout_s: float = 1.0) -> str:
    with Client(pad, base) as client:
        return client.why(timeout_s)


def sooner_or_later(wanted: str, asked: Callable[[float], str], soonest_s: float = 1.0) -> bool:
    """Whether the answer contains this. It listens for longer if not: a busy computer may receive nothing for a
    second."""
    for factor in (1, 4, 20):
        if wanted in (said := asked(factor * soonest_s)):
            return True
        print(said)
    return False


def why_is(wanted: str, pad: str, base: str, soonest_s: float = 1.0) -> bool:
    return sooner_or_later(wanted, lambda timeout_s: why(pad, base, timeout_s), soonest_s)


def test_why_is_empty_while_contacts_of_the_pad_arrive(tmp_path: Path) -> None:
    base = f"ipc://{tmp_path}"
    with daemon_of(base, "left", "right"):
        assert why("left", base, timeout_s=20.0) == ""


def test_why_names_the_pads_that_are_there_and_the_nearest(tmp_path: Path) -> None:
    base = f"ipc://{tmp_path}"
    with daemon_of(base, "left", "right"):
        assert why_is(f"no pad 'lef' at {base}/bus; did you mean 'left'? It has 'left', 'right'", "lef", base)


def test_why_says_that_no_daemon_is_there(tmp_path: Path) -> None:
    base = f"ipc://{tmp_path}"
    assert why_is(f"no daemon at {base}/bus: is fmfts-daemon running", "left", base, 0.2)


def test_why_says_that_no_daemon_is_there_over_tcp() -> None:
    base = tcp_base()
    assert why_is(f"no daemon at {base}: is fmfts-daemon running", "left", base, 0.2)


def test_why_names_the_other_schema_version(tmp_path: Path) -> None:
    base = f"ipc://{tmp_path}"
    with daemon_of(base, "left", v=2):
        assert why_is("sends schema version 2, this client reads 1", "left", base)


def test_why_names_the_key_that_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, base = KeyFolder(tmp_path / "keys"), tcp_base()
    folder.add("arm", tmp_path / "arm.key")
    folder.add("gone", tmp_path / "gone.key")
    listed = (tmp_path / "keys" / "clients").read_text()
    (tmp_path / "keys" / "clients").write_text("".join(line for line in listed.splitlines(True) if "gone" not in line))
    KeyFolder(tmp_path / "others").add("thief", tmp_path / "thief.key")
    with daemon_of(base, "left", keys=folder):
        monkeypatch.setenv("FMFTS_KEY", str(tmp_path / "arm.key"))
        assert why("left", base, timeout_s=20.0) == ""
        monkeypatch.setenv("FMFTS_KEY", str(tmp_path / "gone.key"))
        assert why_is(f"the daemon at {base} refuses the key in {tmp_path}/gone.key", "left", base)
        monkeypatch.setenv("FMFTS_KEY", str(tmp_path / "thief.key"))
        assert why_is(f"has other keys than {tmp_path}/thief.key", "left", base)
        monkeypatch.delenv("FMFTS_KEY")
        assert why_is(f"the daemon at {base} accepts only clients with a key: set FMFTS_KEY", "left", base)


@pytest.mark.parametrize(
    ("wanted", "names", "nearest"),
    [("lef", ["right", "left"], "left"), ("Left", ["left"], "left"), ("thumb", ["left"], None), ("x", [], None)],
)
def test_nearest_name_is_the_one_with_the_fewest_edits(wanted: str, names: list[str], nearest: str | None) -> None:
    assert nearest_name(wanted, names) == nearest
