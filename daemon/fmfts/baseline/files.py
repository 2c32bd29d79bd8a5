"""Where baselines are kept: the one in use, and beside it the good one before."""

from __future__ import annotations

from pathlib import Path

from fmfts import baseline as ambient
from fmfts.baseline import Baseline, BaselineError
from fmfts.pad import Pad
from fmfts.service.state import state_directory, write_atomically

ELSEWHERE = "make it writable for this user, or name another folder with XDG_STATE_HOME (a service: StateDirectory=)"


class StateError(Exception):
    """What must outlive the program cannot be written; the text says where, why, and what to do."""


def path_of(pad_name: str) -> Path:
    """The file of the baseline in use. StateError where there can be none."""
    try:
        return state_directory() / "baseline" / f"{pad_name}.json"
    except OSError as error:
        raise StateError(f"no folder for baselines: {error.filename}: {error.strerror}: {ELSEWHERE}") from error
    except RuntimeError as error:
        raise StateError(f"no folder for baselines: {error}: set HOME or XDG_STATE_HOME") from error


def previous_of(path: Path) -> Path:
    return path.with_suffix(".previous.json")


def stored(pad: Pad) -> Baseline | None:
    """The baseline in use, None where none was recorded. BaselineError where it is damaged or another pad's."""
    path = path_of(pad.name)
    try:
        return ambient.load(path, pad)
    except BaselineError as error:
        previous = previous_of(path)
        if not _is_good(previous, pad):
            raise
        restore = f"fmfts-daemon baseline --restore --pad {pad.name}"
        raise BaselineError(f"{error}; or bring the one before back, from {previous}: {restore}") from error


def store(baseline: Baseline, pad: Pad) -> Path:
    """Write it where the daemon looks for it at its start. StateError where it cannot be written.

    The one before stays beside it as `….previous.json`, unless it is damaged: then the last good one stays there.
    """
    path = path_of(pad.name)
    try:
        path.parent.mkdir(exist_ok=True)
        if _is_good(path, pad):
            write_atomically(previous_of(path), path.read_bytes())
        write_atomically(path, ambient.encode(baseline))
    except OSError as error:
        raise StateError(
            f"pad '{pad.name}': the baseline cannot be written to {path}: {error.strerror}: {ELSEWHERE}"
        ) from error
    return path


def previous(pad: Pad) -> Baseline:
    """The good baseline before the one in use. BaselineError where there is none."""
    path = previous_of(path_of(pad.name))
    baseline = ambient.load(path, pad)
    if baseline is None:
        raise BaselineError(f"pad '{pad.name}': there is no {path}: record a baseline (fmfts-daemon baseline)")
    return baseline


def _is_good(path: Path, pad: Pad) -> bool:
    try:
        return ambient.load(path, pad) is not None
    except BaselineError:
        return False
