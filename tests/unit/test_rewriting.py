"""Keys of [pad.geometry] are changed in a file, and nothing else is."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from fmfts.config.example import EXAMPLE_PATH
from fmfts.config.rewriting import RewritingError, rewrite, with_geometry

VALUES = {"sensors_mm": "[[1, 2, 0], [3, 4, 0]]", "sensors_mirrored": "true"}


def test_shipped_example_keeps_all_other_lines() -> None:
    before = EXAMPLE_PATH.read_text()
    after = with_geometry(before, "demo", VALUES)
    changed = [line for line in after.splitlines() if line not in before.splitlines()]
    assert [line.split(" = ")[0] for line in changed] == ["sensors_mm", "sensors_mirrored"]
    assert "`baseline --rest` tells" in changed[1]
    assert len(before.splitlines()) == len(after.splitlines())
    assert tomllib.loads(after)["pad"][0]["geometry"]["sensors_mirrored"] is True


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
    before, after = tomllib.loads(text), tomllib.loads(with_geometry(text, "a", VALUES))
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


def test_old_file_stays_beside_the_new_one(tmp_path: Path) -> None:
    file = tmp_path / "pad.toml"
    file.write_text("old")
    file.chmod(0o640)
    kept = rewrite(file, "new")
    assert (file.read_text(), kept.read_text()) == ("new", "old")
    assert file.stat().st_mode & 0o777 == 0o640
    assert sorted(tmp_path.iterdir()) == [file, kept]
