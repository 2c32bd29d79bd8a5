"""Functions that the verbs of `fmfts-daemon` share: --config and --pad, and errors with an exit code."""

from __future__ import annotations

import argparse
import logging
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeVar

from fmfts.common import exit_codes
from fmfts.common.exit_codes import code_of
from fmfts.common.extras import how_to_install
from fmfts.common.names import no_such_pad
from fmfts.common.writing import why_not_written
from fmfts.service import recorded_by

if TYPE_CHECKING:
    from pathlib import Path

    from fmfts.config import Config, PadConfig

# Makes a verb's parser from its name, its handler and a line of help.
AddVerb = Callable[..., argparse.ArgumentParser]
Kind = TypeVar("Kind", bound="Config")

log = logging.getLogger("fmfts")

# The help of --config, where a verb needs a file only to find the daemon.
LISTENERS_CONFIG = "the daemon's file, if that sets [bus] endpoint; not needed otherwise"
WEIGH_FIRST = "weigh that pad (`fmfts-daemon weigh`), and record and collect again"


class VerbError(Exception):
    """Ends the command with the exit code `code`, and prints one sentence."""

    def __init__(self, code: int, sentence: str) -> None:
        super().__init__(sentence)
        self.code = code


def seconds(text: str) -> float:
    """The value of an option in seconds, for argparse. Raises ArgumentTypeError unless it is positive and finite."""
    value = float(text)
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text}: must be more than 0 seconds")
    return value


def with_json(parser: argparse.ArgumentParser) -> None:
    """Options of verbs that print facts."""
    parser.add_argument("--json", action="store_true", help="print facts as JSON")


@contextmanager
def ended_by(*errors: type[Exception]) -> Iterator[None]:
    """Turns these errors into VerbError, with the exit code of their cause (common/exit_codes.py)."""
    try:
        yield
    except errors as error:
        raise VerbError(code_of(error), str(error)) from error


@contextmanager
def written_to(path: object) -> Iterator[None]:
    """Turns an OSError into the VerbError for an output that cannot be written."""
    try:
        yield
    except OSError as error:
        raise not_written(error, path) from error


def not_written(error: OSError, path: object) -> VerbError:
    """The error for an output that cannot be written."""
    return VerbError(code_of(error), f"{path}: {why_not_written(error)}")


def lacking(error: ImportError, extra: str = "") -> VerbError:
    """The error for a missing module that the package or an extra of it installs; the text names the line to run."""
    package = f"'fmfts[{extra}]'" if extra else "fmfts"
    return VerbError(exit_codes.LACKING, f"{error}: it comes with\n    {sys.executable} -m pip install {package}")


def not_installed(what: str, package: str) -> VerbError:
    """The error for a part of another package."""
    return VerbError(exit_codes.LACKING, f"{what} {how_to_install(package)}")


def refuse_options(options: argparse.Namespace, names: Sequence[str], why: str) -> None:
    """Raise VerbError for the first of these options that is given, a number 0 among them."""
    for name in names:
        if getattr(options, name) is not None and getattr(options, name) is not False:
            raise VerbError(exit_codes.USAGE, f"--{name.replace('_', '-')}: {why}")


def say(line: str) -> None:
    """Report progress to a person, beside the output."""
    print(line, file=sys.stderr)


def configuration(options: argparse.Namespace) -> Config:
    """The configuration that `--config` names, or the default one. Raises VerbError."""
    config, path = configuration_and_path(options)
    log.info("configuration: %s", path)
    return config


def configuration_and_path(options: argparse.Namespace) -> tuple[Config, Path]:
    """The configuration and its file."""
    from fmfts.config import Config

    return configuration_as(Config, options)


def configuration_as(kind: type[Kind], options: argparse.Namespace) -> tuple[Kind, Path]:
    """The configuration as another package's kind, and its file."""
    from fmfts.config.file import ConfigError, load_as

    try:
        config, file = load_as(kind, options.config)
    except ConfigError as error:
        raise VerbError(code_of(error), str(error)) from error
    recorded_by.use(file)
    return config, file


def configuration_if_any(options: argparse.Namespace) -> Config | None:
    """The configuration; None if no file is given and none exists in the default places. Raises VerbError."""
    from fmfts.config.file import is_there_any

    return configuration(options) if is_there_any(options.config) else None


def serving_base(options: argparse.Namespace) -> str | None:
    """The endpoint base in the file that `--config` names; None: the default. A listener needs no `--config`."""
    from fmfts_client.endpoints import named_base

    return named_base(None if options.config is None else configuration(options).bus.endpoint)


def pad_named(config: Config, name: str | None) -> PadConfig:
    """The pad of that name; None: the only pad. Raises VerbError where there is none, or more than one."""
    known = {pad.name: pad for pad in config.pad}
    if name is None and len(known) == 1:
        return config.pad[0]
    if name not in known:
        raise VerbError(exit_codes.USAGE, no_such_pad(name, list(known), "the configuration"))
    return known[name]


def configured_pad(options: argparse.Namespace, several: bool = False) -> PadConfig:
    """The pad that `--config` and `--pad` name, with one magnet, or with several if the verb supports that.

    Raises VerbError.
    """
    pad = pad_named(configuration(options), options.pad)
    if pad.other_magnets and not several:
        raise VerbError(
            exit_codes.CONFIG,
            f"pad {pad.name!r} holds {len(pad.other_magnets) + 1} magnets, and this verb is for pads with one: "
            "docs/several.md says what such a pad can do",
        )
    require_known_magnets(pad)
    return pad


def require_known_magnets(pad: PadConfig) -> None:
    """Raise VerbError for a pad with unknown magnets."""
    if not pad.are_magnets_known:
        raise VerbError(
            exit_codes.CONFIG,
            f"the magnets of pad {pad.name!r} are unknown, and this verb is for pads with one that is known: "
            "docs/anyskin.md says what such a pad can do",
        )
