"""Two configurations with a pad of one name share its state: the second to record says whose baseline it replaces."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from fmfts.cli.main import main
from fmfts.service import recorded_by

CONFIG = '[[pad]]\nname = "left"\n[pad.source]\ntype = "simulated"\nfinger = "none"\n'
OTHER_GEOMETRY = "[pad.geometry]\nsensors_mm = [[9, 9, 0], [9, -9, 0], [-9, 9, 0], [-9, -9, 0]]\n"


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("FMFTS_BUS", f"ipc://{tmp_path}")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setattr(recorded_by, "_in_use", [])
    (tmp_path / "one.toml").write_text(CONFIG)
    (tmp_path / "two.toml").write_text(CONFIG + OTHER_GEOMETRY)
    return tmp_path


def warnings(capsys: pytest.CaptureFixture[str], *words: str | Path) -> list[str]:
    assert main([*map(str, words), "--json"]) == 0
    facts: dict[str, Any] = json.loads(capsys.readouterr().out)
    return [each for each in facts["warnings"] if "recorded" in each or "of 20" in each]


def test_baseline_names_the_other_file_whose_baseline_it_replaces(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bare = "baseline", "--bare", "--duration-s", "0.5", "--config"
    kept = place / "fmfts" / "baseline" / "left.json"
    assert warnings(capsys, *bare, place / "one.toml") == []
    assert warnings(capsys, *bare, place / "one.toml") == []
    (place / "link.toml").symlink_to("one.toml")
    assert warnings(capsys, *bare, place / "link.toml") == [], "another name of the same file"
    utc = json.loads(kept.read_text())["bare"]["utc"]
    assert warnings(capsys, *bare, place / "two.toml") == [
        f"replaces the baseline of {utc} that {place / 'one.toml'} recorded: rename one of the two pads, or set "
        "XDG_STATE_HOME to keep both"
    ]
    kept.with_suffix(".config").unlink()  # as an older version left it
    utc = json.loads(kept.read_text())["bare"]["utc"]
    assert warnings(capsys, *bare, place / "two.toml") == [f"replaces the baseline of {utc}"]
    assert warnings(capsys, *bare, place / "two.toml") == []


def test_selftest_names_the_other_file_whose_self_test_it_replaces(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert warnings(capsys, "selftest", "--config", place / "one.toml") == []
    (replaced,) = warnings(capsys, "selftest", "--config", place / "two.toml")
    assert replaced.startswith("replaces the self-test of 20")
    assert f" that {place / 'one.toml'} recorded: " in replaced


@pytest.mark.parametrize("content", [b"", b"\xff{", b"[]", b'{"rest": 1}', b"{}"])
def test_damaged_state_gives_no_warning(place: Path, content: bytes) -> None:
    recorded_by.use(place / "one.toml")
    (place / "left.json").write_bytes(content)
    assert recorded_by.foreign(place / "left.json", "baseline") == []


def test_process_without_a_configuration_file_signs_nothing(place: Path) -> None:
    state = place / "left.json"
    recorded_by.use(place / "one.toml")
    recorded_by.sign(state)
    assert (place / "left.config").read_text() == f"{place / 'one.toml'}\n"
    recorded_by._in_use.clear()
    recorded_by.sign(state)
    assert not (place / "left.config").exists()


def kept_of(place: Path, words: str, configuration: str) -> tuple[str, str]:
    """The id of the baseline in use after `fmfts-daemon baseline …`, and the name of the file that recorded it."""
    assert main(["baseline", *words.split(), "--config", str(place / configuration)]) == 0
    kept = place / "fmfts" / "baseline" / "left.json"
    return json.loads(kept.read_text())["id"], Path(kept.with_suffix(".config").read_text().strip()).name


def test_restored_baseline_keeps_the_name_of_the_file_that_recorded_it(place: Path) -> None:
    (place / "copy.toml").write_text(CONFIG)
    bare = "--bare --duration-s 0.5"
    first, second = kept_of(place, bare, "one.toml"), kept_of(place, bare, "copy.toml")
    assert (first[1], second[1]) == ("one.toml", "copy.toml")
    assert kept_of(place, "--restore", "copy.toml") == first
    assert kept_of(place, "--restore", "one.toml") == second


def test_baseline_of_another_geometry_is_kept_and_comes_back(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bare = "--bare --duration-s 0.5"
    older, first = kept_of(place, bare, "one.toml"), kept_of(place, bare, "one.toml")
    other = kept_of(place, bare, "two.toml")
    assert main(["baseline", "--turn", "--config", str(place / "one.toml")]) == 65
    said = capsys.readouterr().err
    assert "was recorded with another geometry" in said
    assert "left.other.json: `fmfts-daemon baseline --restore --pad left`" in said
    assert kept_of(place, "--restore", "one.toml") == first, "the newest of this geometry, not the one before it"
    assert kept_of(place, "--restore", "two.toml") == other
    newest = kept_of(place, bare, "one.toml")
    assert newest[0] not in (older[0], first[0])
    assert kept_of(place, "--restore", "one.toml") == first, "a new recording loses none of its own geometry"
