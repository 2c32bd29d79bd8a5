"""Keys of [pad.geometry] are changed in a file, and nothing else is."""

from __future__ import annotations

from pathlib import Path

import pytest

from fmfts.common.toml import parse
from fmfts.config.example import EXAMPLE_PATH
from fmfts.config.file import load
from fmfts_magnet.rewriting import RewritingError, rewrite, with_geometry

VALUES = {"sensors_mm": "[[1, 2, 0], [3, 4, 0]]", "sensors_mirrored": "true"}


def test_shipped_example_keeps_all_other_lines() -> None:
    before = EXAMPLE_PATH.read_text()
    after = with_geometry(before, "demo", VALUES)
    changed = [line for line in after.splitlines() if line not in before.splitlines()]
    assert [line.split(" = ")[0] for line in changed] == ["sensors_mm", "sensors_mirrored"]
    assert "`baseline --rest` tells" in changed[1]
    assert len(before.splitlines()) == len(after.splitlines())
    assert parse(after)["pad"][0]["geometry"]["sensors_mirrored"] is True


@pytest.mark.parametrize(
    "text",
    [
        '[[pad]]\nname = "a"\n[pad.source]\ntype = "x"\n\n# the other\n[[pad]]\nname = "b"\n[bus]\nendpoint = "c"\n',
        '[[pad]]\nname = "a"\n[pad.geometry]   # mine\n[[pad]]\nname = "b"\n[pad.geometry]\nsensors_mm = []\n',
        '[[pad]]\nname = "a"\n[pad.geometry]\nsensors_mm = [\n  [0, 0, 0],  # first\n]\nsensors_mirrored = false\n'
        '[[pad]]\nname = "b"\n',
    ],
)  # fmt: skip
def test_only_the_named_pad_changes(text: str) -> None:
    before, after = parse(text), parse(with_geometry(text, "a", VALUES))
    assert after["pad"][0]["geometry"] == {"sensors_mm": [[1, 2, 0], [3, 4, 0]], "sensors_mirrored": True}
    del after["pad"][0]["geometry"]
    before["pad"][0].pop("geometry", None)
    assert after == before


@pytest.mark.parametrize(
    "text",
    ['pad = [{name = "a", geometry = {sensors_mm = []}}]\n', '[[pad]]\nname = "a"\ngeometry.sensors_mm = []\n'],
)
def test_unusual_file_is_refused_with_the_lines_to_write(text: str) -> None:
    with pytest.raises(RewritingError, match=r"write this by hand: sensors_mm = \[\[1, 2, 0\]"):
        with_geometry(text, "a", VALUES)


BOARD = """[[pad]]
name = "a"
[pad.source]
type = "anyskin"
port = "/dev/ttyACM0"
[pad.geometry]
board = "anyskin5"   # or another
sensors_mirrored = false
[pad.contact]
model = "none"
"""
PLACES = {"sensors_mm": "[[0, 0, 0], [0, 7, 0], [-7, 0, 0], [0, -7, 0], [7, 0, 0]]", "sensor_rotations_deg": "[]"}


def test_places_replace_the_board_name_and_load(tmp_path: Path) -> None:
    file = tmp_path / "pad.toml"
    file.write_text(BOARD)
    rewrite(file, with_geometry(BOARD, "a", PLACES))
    assert "board" not in file.read_text()
    assert load(file)[0].pad[0].geometry.sensors_mm[1] == (0, 7, 0)


def test_board_name_replaces_places_and_loads(tmp_path: Path) -> None:
    file = tmp_path / "pad.toml"
    file.write_text(with_geometry(BOARD, "a", PLACES))
    rewrite(file, with_geometry(file.read_text(), "a", {"board": '"reskin5"'}))
    assert "sensors_mm" not in file.read_text()
    assert load(file)[0].pad[0].geometry.board == "reskin5"


def test_another_board_name_keeps_its_comment() -> None:
    text = with_geometry(BOARD, "a", {"board": '"reskin5_back"'})
    assert [line for line in text.splitlines() if "reskin5_back" in line] == [
        'board = "reskin5_back"'.ljust(30) + " # or another"
    ]


def test_text_that_the_daemon_refuses_is_not_written(tmp_path: Path) -> None:
    file = tmp_path / "pad.toml"
    file.write_text(BOARD)
    with pytest.raises(RewritingError, match=r"would be refused: .*/pad\.toml: .*at least 3 sensors are needed"):
        rewrite(file, with_geometry(BOARD, "a", {"sensors_mm": "[[0, 0, 0]]", "sensor_rotations_deg": "[]"}))
    assert file.read_text() == BOARD
    assert list(tmp_path.iterdir()) == [file]


def test_old_files_stay_beside_the_new_one(tmp_path: Path) -> None:
    file = tmp_path / "pad.toml"
    file.write_text(BOARD)
    file.chmod(0o640)
    texts = [BOARD + f"# {number}\n" for number in (1, 2)]
    kept = [rewrite(file, text) for text in texts]
    assert [each.name for each in kept] == ["pad.toml.bak", "pad.toml.bak2"]
    assert [each.read_text() for each in (file, *kept)] == [texts[1], BOARD, texts[0]]
    assert file.stat().st_mode & 0o777 == 0o640
    assert sorted(tmp_path.iterdir()) == [file, *kept]
