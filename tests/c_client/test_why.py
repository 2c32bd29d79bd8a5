"""`fmfts_why()`: if the C client receives nothing, it gives the same reason as the Python client, over real sockets."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from c_client.built import Talker, build_listener
from fmfts.bus.keys import KeyFolder
from ports import tcp_base
from unit.test_client_why import daemon_of, sooner_or_later, why, why_is


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_listener(tmp_path_factory.mktemp("c"))


def said(program: Path, pad: str, base: str, timeout_ms: int = 1000, key: str = "") -> str:
    with Talker(program, pad, base, environment=os.environ | {"FMFTS_KEY": key}) as client:
        answer = client.why(timeout_ms)
    assert answer["arrives"] == (answer["why"] == "")
    return str(answer["why"])


def says(program: Path, wanted: str, pad: str, base: str, soonest_s: float = 1.0, key: str = "") -> bool:
    return sooner_or_later(wanted, lambda wait_s: said(program, pad, base, round(wait_s * 1e3), key), soonest_s)


def test_c_client_reports_arrival_or_lists_pads(program: Path, tmp_path: Path) -> None:
    base = f"ipc://{tmp_path}"
    with daemon_of(base, "left", "right"):
        assert said(program, "left", base, 20_000) == ""
        it_has = "It has 'left', 'right'"
        assert says(program, f"no pad 'lef' at {base}/bus; did you mean 'left'? {it_has}", "lef", base)
        assert says(program, f"no pad 'thumb' at {base}/bus; {it_has.lower()}", "thumb", base)
        assert why_is(f"no pad 'thumb' at {base}/bus; {it_has.lower()}", "thumb", base)


def test_c_client_says_that_no_daemon_is_there(program: Path, tmp_path: Path) -> None:
    base = f"ipc://{tmp_path}"
    assert says(program, why("left", base, 0.2), "left", base, 0.2)


def test_c_client_names_the_other_schema_version(program: Path, tmp_path: Path) -> None:
    base = f"ipc://{tmp_path}"
    with daemon_of(base, "left", v=2):
        assert says(program, "sends schema version 2, this client reads 1", "left", base)


def test_c_client_names_the_key_that_is_refused(program: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, base = KeyFolder(tmp_path / "keys"), tcp_base()
    for name in ("arm", "gone"):
        folder.add(name, tmp_path / f"{name}.key")
    listed = (tmp_path / "keys" / "clients").read_text()
    (tmp_path / "keys" / "clients").write_text("".join(line for line in listed.splitlines(True) if "gone" not in line))
    KeyFolder(tmp_path / "others").add("thief", tmp_path / "thief.key")
    with daemon_of(base, "left", keys=folder):
        assert said(program, "left", base, 20_000, str(tmp_path / "arm.key")) == ""
        for name, wanted in (
            ("gone", f"the daemon at {base} refuses the key in {tmp_path}/gone.key"),
            ("thief", f"the daemon at {base} has other keys than {tmp_path}/thief.key says, or none: get a new key"),
            ("", f"the daemon at {base} accepts only clients with a key: set FMFTS_KEY to the file of yours"),
        ):
            key = str(tmp_path / f"{name}.key") if name else ""
            monkeypatch.setenv("FMFTS_KEY", key)
            assert why_is(wanted, "left", base), name
            assert says(program, wanted, "left", base, key=key), name
