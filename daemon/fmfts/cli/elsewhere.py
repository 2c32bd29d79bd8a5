"""The parts of other packages in `fmfts-daemon`; the verb of a missing package says how to install it."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Container, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from fmfts.cli.verb import AddVerb, VerbError
from fmfts.common import exit_codes
from fmfts.common.extras import LABORATORY, added, entry_points_of, how_to_install
from fmfts.common.kind_of_file import begins_with, columns_of

if TYPE_CHECKING:
    from fmfts.config import Config

VERBS = "fmfts.verbs"  # entry points: functions that take an AddVerb
VIEWS = "fmfts.views"  # functions that `view` calls, by their package's extra
LAYOUTS = "fmfts.layouts"  # paths, by the program that reads them
CONFIGURATIONS = "fmfts.configurations"  # by the name of the table that it reads: a subclass of Config
CALIBRATIONS = "fmfts.calibrations"  # modules like Calibration, by their package's extra
PACKAGES = ("fmfts_lab", "fmfts_collect", "fmfts_fleet", "fmfts_foxglove", "fmfts_skin")
# Each verb's line of help, and its package: the laboratory, or an extra of this one.
OF_VERB = {
    "collect": ("press a plan of places and forces, and write the calibration data", "collect"),
    "study": ("compare methods on this pad", LABORATORY),
    "pad-model": ("make a simulated pad by finite elements", LABORATORY),
}
# Columns of a set, and marks at the beginning of a model, that only another package can read; and its extra.
OF_COLUMN = dict.fromkeys(("force_z_n", "depth_mm", "shear_n"), "skin")
OF_MARK = dict.fromkeys((b"fmfts field response", b"fmfts force model"), "skin")


class Calibration(Protocol):
    """How another package makes and judges contact models of its own kind. noise_t: of one frame's field values."""

    def is_set(self, data: Path) -> bool: ...

    def is_model(self, model: Path) -> bool: ...

    def calibrate(self, options: argparse.Namespace, noise_t: float) -> int: ...

    def evaluate(self, options: argparse.Namespace, noise_t: float) -> int: ...


def add_to(verb: AddVerb, only_installed: bool = False) -> None:
    """Add their verbs. Called only if the command line names none of this package's: a look for packages takes time."""
    installed = {point.name: point for point in entry_points_of(VERBS)}
    for name, (text, _) in OF_VERB.items():
        if name in installed:
            installed.pop(name).load()(verb)
        elif not only_installed:
            verb(name, refuse, f"{text} (not installed)").add_argument("rest", nargs=argparse.REMAINDER)
    for point in installed.values():
        point.load()(verb)


def refuse(options: argparse.Namespace) -> int:
    """The handler of a verb whose package is not installed."""
    raise not_installed(options.verb, OF_VERB[options.verb][1])


def not_installed(what: str, package: str) -> VerbError:
    return VerbError(exit_codes.UNAVAILABLE, f"{what} {how_to_install(package)}")


def view(package: str, what: str) -> Callable[..., Any]:
    """An extra's function for the verb `view`, named by `what`. Raises VerbError if it is not installed."""
    viewing: Callable[..., Any] = _required(VIEWS, package, what)
    return viewing


def layout(package: str) -> Path:
    """A layout for the program of this name. Raises VerbError like `view`."""
    path: Path = _required(LAYOUTS, package, f"layout {package}")
    return path


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


def _required(group: str, package: str, what: str) -> Any:
    found = added(group, package)
    if found is None:
        raise not_installed(what, package)
    return found


def configuration_with(table: str) -> type[Config] | None:
    """The configuration of the package that reads this table of the file; None where it is not installed."""
    kind: type[Config] | None = added(CONFIGURATIONS, table)
    return kind
