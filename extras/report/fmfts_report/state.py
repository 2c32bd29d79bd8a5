"""The files of baselines and self-tests in a report, and a working copy of them."""

from __future__ import annotations

import shutil
from pathlib import Path

from fmfts.baseline.files import other_of, previous_of
from fmfts.common.reading import read_regular
from fmfts.service.state import state_directory

KINDS = ("baseline", "selftest")
SERVICE_STATE = Path("/var/lib/fmfts")
LARGEST_BYTES = 1_000_000


def state_folder() -> Path:
    """The service's folder if this user has none, because the service may have been stopped for the report."""
    folders = state_directory(), SERVICE_STATE
    return next((each for each in folders if any((each / kind).is_dir() for kind in KINDS)), folders[0])


def copy_to(folder: Path) -> None:
    for kind in KINDS:
        if (state_folder() / kind).is_dir():
            shutil.copytree(state_folder() / kind, folder / kind)


def files_of(pad: str) -> dict[str, str]:
    """The texts of this pad's files, by their places."""
    baseline = baseline_file(pad)
    paths = baseline, previous_of(baseline), other_of(baseline), state_folder() / "selftest" / baseline.name
    return {str(path): read_regular(path, LARGEST_BYTES).decode(errors="replace") for path in paths if path.exists()}


def baseline_file(pad: str) -> Path:
    return state_folder() / "baseline" / f"{pad}.json"
