"""The deliberate changes of `make net-catches`: each must still be possible."""

from __future__ import annotations

from pathlib import Path

import pytest

from drills.net_changes import CHANGES, Change

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.summary)
def test_changed_text_occurs_once_in_its_file(change: Change) -> None:
    folder = ROOT if change.path.startswith("extras/") else ROOT / "daemon/fmfts"
    assert (folder / change.path).read_text().count(change.old) == 1
    assert change.new != change.old
