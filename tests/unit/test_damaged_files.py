"""Each reader of a file fails in one way, whatever the damage: `make fuzz-files` tries a million."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from drills.file_fuzz import fuzzed
from drills.file_kinds import Kind, kinds
from fmfts.common.reading import open_regular

INPUTS = 150
NAMES = (
    "baseline", "self-test", "model", "table of presses", "config", "recording", "replay", "played recording",
    "recording of the page", "recording to repair", "report", "labelled data", "machine's log", "plan", "pad model",
    "daemon's key", "list of clients", "client's key",
)  # fmt: skip
KEPT = sorted((Path(__file__).parents[1] / "data" / "harmful").glob("*/*"))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Kind]]:
    folder = tmp_path_factory.mktemp("whole")
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("XDG_STATE_HOME", str(folder))
        yield {kind.name: kind for kind in kinds(folder)}


@pytest.mark.parametrize("name", NAMES)
def test_damaged_file_is_refused_with_its_own_error(name: str, whole: dict[str, Kind], tmp_path: Path) -> None:
    inputs = round(INPUTS * whole[name].cost ** -0.5)
    tried = fuzzed(whole[name], tmp_path, range(inputs), seed=1)
    assert tried.said["refused"] > inputs / 3, tried


def test_every_kind_of_file_is_damaged(whole: dict[str, Kind]) -> None:
    assert tuple(whole) == NAMES


@pytest.mark.parametrize("path", KEPT, ids=[f"{path.parent.name}/{path.name}" for path in KEPT])
def test_harmful_file_that_was_kept_does_no_harm(path: Path, whole: dict[str, Kind], tmp_path: Path) -> None:
    kind = whole[path.parent.name.replace("-", " ")]
    (tmp_path / path.name).write_bytes(path.read_bytes())
    with suppress(kind.error):
        kind.read(tmp_path / path.name)


def test_pipe_in_the_place_of_a_file_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="pipe"):
        open_regular(tmp_path / "pipe")
