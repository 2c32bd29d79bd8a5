"""Sets and models that another package makes and judges, found before anything heavy is imported."""

from __future__ import annotations

import argparse
from collections.abc import Container, Mapping
from pathlib import Path
from typing import Protocol

from fmfts.cli.verb import VerbError, not_installed
from fmfts.common import exit_codes
from fmfts.common.extras import entry_points_of
from fmfts.common.reading import read_regular

CALIBRATIONS = "fmfts.calibrations"  # entry points: modules like Calibration, by their package's extra
HEADER_BYTES, MARK_WITHIN = 10_000, 64
OF_PRESSES = ("place_sd_mm", "scale_sd")  # options of `calibrate --correct`: how well the few presses are known
# Columns of a set, and marks at the beginning of a model, that only another package can read; and its extra.
OF_COLUMN = dict.fromkeys(("force_z_n", "depth_mm", "shear_n"), "skin")
OF_MARK = dict.fromkeys((b"fmfts field response", b"fmfts force model"), "skin")


class Calibration(Protocol):
    """How another package makes and judges contact models of its own kind. noise_t: of one frame's field values."""

    def is_set(self, data: Path) -> bool: ...

    def is_model(self, model: Path) -> bool: ...

    def calibrate(self, options: argparse.Namespace, noise_t: float) -> int: ...

    def evaluate(self, options: argparse.Namespace, noise_t: float) -> int: ...


def calibration_of_set(data: Path) -> Calibration | None:
    """The package that makes models of such a set; None: this one. Raises VerbError like `view`."""
    installed = _calibrations()
    if (found := next((one for one in installed.values() if one.is_set(data)), None)) is not None:
        return found
    columns = columns_of(data)
    _require_installed({name: extra for name, extra in OF_COLUMN.items() if name in columns}, installed, data)
    return None


def calibration_of_model(model: Path) -> Calibration | None:
    """The package that judges such a model; None: this one. Raises VerbError like `view`."""
    installed = _calibrations()
    if (found := next((one for one in installed.values() if one.is_model(model)), None)) is not None:
        return found
    marks = {mark.decode(): extra for mark, extra in OF_MARK.items() if begins_with(model, mark)}
    _require_installed(marks, installed, model)
    return None


def _calibrations() -> dict[str, Calibration]:
    return {point.name: point.load() for point in entry_points_of(CALIBRATIONS)}


def _require_installed(extras: Mapping[str, str], installed: Container[str], file: Path) -> None:
    for what, extra in extras.items():
        if extra not in installed:
            raise not_installed(f"{file}: who reads {what}", extra)


def require_one_file(options: argparse.Namespace) -> None:
    """Raise VerbError for options of `calibrate` and `evaluate` that are for sets with forces in three directions."""
    if options.sessions:
        raise VerbError(exit_codes.USAGE, f"{options.sessions[0]}: several files are for sets with forces (force_z_n)")
    if getattr(options, "route", None) is not None:
        raise VerbError(exit_codes.USAGE, f"--route: {options.data} has no forces in three directions (force_z_n)")


def columns_of(data: Path) -> set[str]:
    """Column names of a CSV file; empty if it cannot be read: the reader that follows reports why."""
    try:
        header = read_regular(data, HEADER_BYTES).split(b"\n", 1)[0].decode("utf-8-sig")
    except (OSError, UnicodeDecodeError):
        return set()
    return {name.strip(' "\r') for name in header.split(",")}


def begins_with(model: Path, mark: bytes) -> bool:
    """Whether the first bytes have the mark; False where the file cannot be read."""
    try:
        return mark in read_regular(model, MARK_WITHIN)
    except OSError:
        return False
