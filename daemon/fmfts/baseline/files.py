"""The folder of baselines: the one in use, the previous good one, and the last one of another geometry."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from fmfts.baseline import Baseline, BaselineError, encode, load
from fmfts.baseline.file_format import StoredGains
from fmfts.baseline.origin import Origin
from fmfts.baseline.recording import GeometryError
from fmfts.common.reading import damage_told, read_regular
from fmfts.common.writing import why_not_written
from fmfts.pad import Pad
from fmfts.service.recorded_by import sign, signature_of
from fmfts.service.state import state_directory, write_atomically

FORMAT = 1
LARGEST_BYTES = 1_000_000  # of a self-test's file
ELSEWHERE = "name another folder with XDG_STATE_HOME (a service: StateDirectory=)"


class StateError(Exception):
    """A file of state cannot be written; the text says where, why, and what to do."""


def path_of(pad_name: str, kind: str = "baseline", environ: Mapping[str, str] = os.environ) -> Path:
    """The file of the baseline in use, or of another `kind` of state. StateError if there is no folder for it.

    environ: of the program that uses it.
    """
    try:
        return state_directory(environ) / kind / f"{pad_name}.json"
    except OSError as error:
        raise StateError(f"no folder for {kind}s: {error.filename}: {why_not_written(error, ELSEWHERE)}") from error
    except RuntimeError as error:
        raise StateError(f"no folder for {kind}s: {error}: set HOME or XDG_STATE_HOME") from error


def previous_of(path: Path) -> Path:
    return path.with_suffix(".previous.json")


def other_of(path: Path) -> Path:
    """Where the last baseline of another geometry is kept."""
    return path.with_suffix(".other.json")


def stored(pad: Pad, origin: Origin | None = None) -> Baseline | None:
    """The baseline in use, None if none was recorded. BaselineError if it is damaged or belongs to another pad.

    origin: the sensors that there are now, as far as they are known. ForeignError if it was recorded with others.
    """
    path = path_of(pad.name)
    try:
        return load(path, pad, origin)
    except BaselineError as error:
        previous = _before(path, pad)
        if not _is_good(previous, pad, origin):
            raise
        restore = f"`fmfts-daemon baseline --restore --pad {pad.name}`"
        raise BaselineError(f"{error}; or restore the previous one, {previous}: {restore}") from error


def store(
    baseline: Baseline, pad: Pad, environ: Mapping[str, str] = os.environ, signature: bytes | None = None
) -> Path:
    """Write a baseline to the file that the daemon reads at its start. StateError if that fails. environ: the daemon's.

    The one before is kept as `….previous.json`, or as `….other.json` if it is of another geometry. If it is damaged,
    the older file of that name stays. signature: of the file that the baseline comes from; None: it is a new one.
    """
    path = path_of(pad.name, environ=environ)
    try:
        path.parent.mkdir(exist_ok=True)
        if _is_good(path, pad):
            _copy(path, previous_of(path))
        elif _is_of_another_geometry(path, pad):
            if _is_good(other_of(path), pad):
                _copy(other_of(path), previous_of(path))
            _copy(path, other_of(path))
        write_atomically(path, encode(baseline))
        sign(path, signature)
    except OSError as error:
        raise StateError(
            f"pad '{pad.name}': the baseline cannot be written to {path}: {why_not_written(error, ELSEWHERE)}"
        ) from error
    return path


def previous(pad: Pad, origin: Origin | None = None) -> tuple[Baseline, bytes]:
    """The good baseline before the one in use, and its signature.

    BaselineError if there is none, or as from `stored`.
    """
    path = _before(path_of(pad.name), pad)
    baseline = load(path, pad, origin)
    if baseline is None:
        raise BaselineError(f"pad '{pad.name}': there is no {path}: `fmfts-daemon baseline --rest` records a new one")
    return baseline, signature_of(path)


class _TestedSensors(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The file of a self-test: the gains, and their sensors."""

    format: int
    pad: str
    origin: Origin | None
    gains: StoredGains


def store_gains(facts: Mapping[str, Any], pad: Pad, origin: Origin | None) -> Path:
    """Write the gains of a self-test that passed, of the sensors `origin`. StateError if that fails."""
    path = path_of(pad.name, "selftest")
    tested = _TestedSensors(FORMAT, pad.name, origin, StoredGains.of(facts))
    try:
        path.parent.mkdir(exist_ok=True)
        write_atomically(path, msgspec.json.format(msgspec.json.encode(tested), indent=1) + b"\n")
        sign(path)
    except OSError as error:
        raise StateError(
            f"pad '{pad.name}': the self-test cannot be written to {path}: {why_not_written(error, ELSEWHERE)}"
        ) from error
    return path


def stored_gains(pad: Pad, origin: Origin | None) -> StoredGains | None:
    """The gains of the last self-test of these sensors; None if there is none, or if it is of other sensors.

    BaselineError if the file is damaged.
    """
    path = path_of(pad.name, "selftest")
    try:
        text = read_regular(path, LARGEST_BYTES)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise BaselineError(f"pad '{pad.name}': the self-test in {path} cannot be read: {error.strerror}") from error
    with damage_told(
        BaselineError, f"pad '{pad.name}': the self-test in {path} is damaged: run `fmfts-daemon selftest` again"
    ):
        tested = msgspec.json.decode(text, type=_TestedSensors)
    if len(tested.gains.gain) != len(pad.sensors):
        return None
    if tested.origin is not None and origin is not None and not tested.origin.agrees_with(origin):
        return None
    return tested.gains


def _before(path: Path, pad: Pad) -> Path:
    """The file of the baseline that this geometry had before the one in `path`."""
    other = other_of(path)
    return other if _is_of_another_geometry(path, pad) and _is_good(other, pad) else previous_of(path)


def _copy(path: Path, target: Path) -> None:
    write_atomically(target, path.read_bytes())
    sign(target, signature_of(path))


def _is_of_another_geometry(path: Path, pad: Pad) -> bool:
    try:
        load(path, pad)
    except GeometryError:
        return True
    except BaselineError:
        pass
    return False


def _is_good(path: Path, pad: Pad, origin: Origin | None = None) -> bool:
    try:
        return load(path, pad, origin) is not None
    except BaselineError:
        return False
