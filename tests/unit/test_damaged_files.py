"""Each reader of a file fails in one way, whatever the damage: `make fuzz-files` tries a million."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from drills.file_fuzz import Kind, fuzzed, kinds
from fmfts.common.reading import open_regular

INPUTS = 150
NAMES = (
    "baseline", "self-test", "model", "config", "recording", "replay", "labelled data", "machine's log", "plan",
    "pad model", "daemon's key", "client's key", "list of keys",
)  # fmt: skip


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Kind]]:
    folder = tmp_path_factory.mktemp("whole")
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("XDG_STATE_HOME", str(folder))
        yield {kind.name: kind for kind in kinds(folder)}


@pytest.mark.parametrize("name", NAMES)
def test_a_damaged_file_is_refused_with_its_own_error(name: str, whole: dict[str, Kind], tmp_path: Path) -> None:
    said = fuzzed(whole[name], tmp_path, INPUTS, seed=1)
    assert said["refused"] > INPUTS / 3, said


def test_every_kind_of_file_is_damaged(whole: dict[str, Kind]) -> None:
    assert tuple(whole) == NAMES


def test_a_pipe_in_the_place_of_a_file_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="pipe"):
        open_regular(tmp_path / "pipe")
