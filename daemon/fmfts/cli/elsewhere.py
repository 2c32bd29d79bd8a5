"""The parts of other packages in `fmfts-daemon`; the verb of a missing package says how to install it."""

from __future__ import annotations

import argparse
import logging
from typing import TYPE_CHECKING, Any

from fmfts.cli.verb import AddVerb, VerbError, not_installed
from fmfts.common.exit_codes import code_of
from fmfts.common.extras import LABORATORY, PartError, added, entry_points_of, how_to_install, loaded

if TYPE_CHECKING:
    from fmfts.config import Config

log = logging.getLogger(__name__)

VERBS = "fmfts.verbs"  # entry points: functions that take an AddVerb
VIEWS = "fmfts.views"  # functions that `view` calls, by their package's extra
CONFIGURATIONS = "fmfts.configurations"  # by the name of the table that it reads: a subclass of Config
OPTIONS = "fmfts.options"  # parts that options of this package's verbs need, by the package's extra
# Each verb's line of help, and its package: the laboratory, or an extra of this one.
OF_VERB = {
    "collect": ("press a plan of places and forces, and write the calibration data", "collect"),
    "study": ("compare methods on this pad", LABORATORY),
    "pad-model": ("make a simulated pad by finite elements", LABORATORY),
    "calibrate": ("make a contact model from a CSV file of labelled fields", "calibrate"),
    "evaluate": ("compare a contact model's answers with a CSV file of labelled fields", "calibrate"),
    "pose": ("solve the magnet's pose for every row of a CSV file of fields", "calibrate"),
    "demo": ("show a simulated pad in this terminal", "simulation"),
    "view": ("show a running daemon on a page in a browser", "page"),
    "record": ("write all messages of a running daemon to a file, with raw frames", "recording"),
    "replay": ("process a recording's frames again, and compare the contacts", "recording"),
    "report": ("write one file to send when something is wrong: facts, frames, registers, log", "report"),
}
# The group of entry points and the package's extra that an option needs.
OF_OPTION = {
    "init --learn": (OPTIONS, "calibrate"),
    "baseline --learn": (OPTIONS, "calibrate"),
    "probe --magnet": (OPTIONS, "magnet"),
    "view --foxglove": (VIEWS, "foxglove"),
    "view --robot": (VIEWS, "fleet"),
}
EXTRAS = {package for _, package in OF_VERB.values()} - {LABORATORY}
ABSENT = " (not installed)"  # at the end of a line of help


def add_to(verb: AddVerb, only_installed: bool = False) -> None:
    """Add their verbs. Called only if the command line names none of this package's: a look for packages takes time."""
    installed = {point.name: point for point in entry_points_of(VERBS)}
    for name, (text, _) in OF_VERB.items():
        point = installed.pop(name, None)
        if point is not None and (add := _loaded(point)) is not None:
            add(verb)
        elif point is not None or not only_installed:
            verb(name, refuse, f"{text}{ABSENT}").add_argument("rest", nargs=argparse.REMAINDER)
    for point in installed.values():
        if (add := _loaded(point)) is not None:
            add(verb)


def _loaded(point: Any) -> Any:
    """None if the package is of another version, or lacks another package: the verbs of others stay usable."""
    try:
        return loaded(point)
    except PartError as error:
        log.warning("the verb %r is left out: %s", point.name, error)
        return None


def refuse(options: argparse.Namespace) -> int:
    """The handler of a verb whose package is not installed."""
    raise not_installed(options.verb, OF_VERB[options.verb][1])


def option(what: str) -> Any:
    """The part of another package that an option of OF_OPTION needs. Raises VerbError if it is not installed."""
    group, package = OF_OPTION[what]
    found = _added(group, package, what)
    if found is None:
        raise not_installed(what, package)
    return found


def require(what: str) -> None:
    """Raise VerbError if the package of an option of OF_OPTION is not installed. Loads nothing of it."""
    group, package = OF_OPTION[what]
    if not _is_installed(group, package):
        raise not_installed(what, package)


def mark_absent(verb: argparse.ArgumentParser) -> None:
    """Let the help of a verb's options say which of them need a package that is not installed."""
    name = verb.prog.split()[-1]
    for action in verb._actions:
        for word in action.option_strings:
            needed = OF_OPTION.get(f"{name} {word}")
            if needed is not None and action.help and not _is_installed(*needed):
                action.help = action.help.removesuffix(ABSENT) + ABSENT


def _is_installed(group: str, package: str) -> bool:
    return any(point.name == package for point in entry_points_of(group))


def _added(group: str, package: str, what: str) -> Any:
    try:
        return added(group, package)
    except PartError as error:
        raise VerbError(code_of(error), f"{what}: {error}; it {how_to_install(package)}") from error


def configuration_with(table: str) -> type[Config] | None:
    """The configuration of the package that reads this table of the file; None where it is not installed."""
    kind: type[Config] | None = _added(CONFIGURATIONS, table, f"[{table}]")
    return kind
