"""Finds and reads the configuration file. Every error names the file, table, key and value, and what is allowed."""

from __future__ import annotations

import errno
import logging
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from fmfts.common.extras import PartError
from fmfts.common.reading import damage_told, read_regular, shortened, unreadable_told
from fmfts.common.toml import LARGEST_BYTES, NotToml, parse
from fmfts.config import Config, ReplaySource, SimulatedSource
from fmfts.config.checks import problems_in
from fmfts.config.conversion import MOST, convert
from fmfts.config.wording import place, value_shown
from fmfts.contact.no_model import NO_MODEL
from fmfts.contact.shipped import SHIPPED_PATHS

ENVIRONMENT = "FMFTS_CONFIG"
OTHER_MAGNET = re.compile(r"other_magnets, value (\d+)")
MOST_PADS = 256
CURLY = "\u201c\u201d\u201e\u2018\u2019"  # a word processor's replacements of " and '
DEFAULT_PATHS = (Path("/etc/fmfts/config.toml"), Path("pad.toml"), Path("config.toml"))  # `init` writes pad.toml
UNREADABLE = {  # what to do
    errno.ENOENT: "correct its name, or let `fmfts-daemon init` write one",
    errno.EACCES: "allow this user to read it (chmod), or name another with --config",
    errno.EINVAL: "name the file in it with --config",
}

log = logging.getLogger(__name__)

Kind = TypeVar("Kind", bound=Config)


class ConfigError(Exception):
    """The configuration cannot be used (exit code 78)."""


class PackageError(ConfigError):
    """Another package, which it needs, cannot be used (exit code 72)."""


def load(path: Path | None = None, environ: Mapping[str, str] = os.environ) -> tuple[Config, Path]:
    """The configuration, and the file that it was read from: `path`, else $FMFTS_CONFIG, else DEFAULT_PATHS in order.

    Relative paths in the file are relative to its folder, and are absolute in the result. Raises ConfigError.
    """
    return load_as(Config, path, environ)


def load_as(kind: type[Kind], path: Path | None = None, environ: Mapping[str, str] = os.environ) -> tuple[Kind, Path]:
    """The same, read as another package's kind of configuration, which knows a table of its own."""
    file = find(path, environ)
    with damage_told(ConfigError, f"{file}: cannot be used"):
        try:
            return _loaded(file, kind), file
        except PartError as error:
            raise PackageError(f"{file}: {error}") from error


def _loaded(file: Path, kind: type[Kind]) -> Kind:
    data = _first_magnet_apart(_read(file))
    if isinstance(pads := data.get("pad"), list) and len(pads) > MOST_PADS:
        raise ConfigError(f"{file}: has {len(pads)} pads, and may have {MOST_PADS}: another daemon serves the others")
    converted = convert(data, kind)
    wrong, config = list(converted.wrong), converted.config
    if config is not None:
        config = _with_absolute_paths(config, file.absolute().parent)
        wrong += [
            f"{place(data, keys)}{value_shown(data, keys)}: {text}"
            for keys, text in problems_in(config)
            if not converted.is_mended(keys)
        ]
    if config is None or wrong:
        raise ConfigError(OTHER_MAGNET.sub(lambda found: f"magnet, value {int(found[1]) + 1}", _told(file, wrong)))
    return config


def _first_magnet_apart(data: dict[str, Any]) -> dict[str, Any]:
    """[[pad.magnet]], several tables, as the first magnet and the others: a pad of one magnet has one table."""
    pads = data.get("pad")
    for pad in pads if isinstance(pads, list) else []:
        if isinstance(pad, dict) and isinstance(magnets := pad.get("magnet"), list) and magnets:
            pad["magnet"], pad["other_magnets"] = magnets[0], magnets[1:]
    return data


def is_named(path: Path | None) -> bool:
    """Whether somebody names the file, as `path` or in $FMFTS_CONFIG. A file in DEFAULT_PATHS may only lie there."""
    return path is not None or bool(os.environ.get(ENVIRONMENT))


def is_there_any(path: Path | None) -> bool:
    """Whether a file is named, or is in the default places."""
    return is_named(path) or any(candidate.exists() for candidate in DEFAULT_PATHS)


def _told(file: Path, wrong: Sequence[str]) -> str:
    if len(wrong) == 1:
        return f"{file}: {shortened(wrong[0])}"
    return f"{file}: {len(wrong)} things are wrong:" + "".join(
        f"\n  {number}. {each}" for number, each in enumerate(map(shortened, wrong[:MOST]), 1)
    )


def find(path: Path | None, environ: Mapping[str, str] = os.environ) -> Path:
    """The file that `load` reads. If several of DEFAULT_PATHS exist, logs which one. Raises ConfigError for none."""
    if path is not None:
        return path
    if environ.get(ENVIRONMENT):
        return Path(environ[ENVIRONMENT])
    found = [candidate for candidate in DEFAULT_PATHS if os.path.exists(candidate)]  # False where nobody may look
    if found:
        others = [other for other in found[1:] if not os.path.samefile(other, found[0])]
        if others:
            unread = " and ".join(map(str, others))
            log.warning("%s is used, not %s: to use another file, add --config %s", found[0], unread, others[0])
        return found[0]
    raise ConfigError(
        f"no configuration found: neither --config nor ${ENVIRONMENT} is given, and there is no "
        f"{' or '.join(map(str, DEFAULT_PATHS))}: `fmfts-daemon init` finds the board and writes one; "
        "`fmfts-daemon demo` needs none"
    )


def _read(file: Path) -> dict[str, Any]:
    try:
        with unreadable_told(ConfigError, file, UNREADABLE):
            content = read_regular(file, LARGEST_BYTES + 1)
        text = content.decode("utf-8-sig")  # skips the byte order mark of some editors
    except UnicodeDecodeError as error:
        raise ConfigError(f"{file}: is not UTF-8 text (byte {error.start})") from error
    try:
        return parse(text)
    except NotToml as error:
        raise ConfigError(f"{file}: is not TOML: {error}{_line_shown(text, str(error))}") from error
    except ValueError as error:
        raise ConfigError(f"{file}: is no configuration: {error}") from error


def _line_shown(text: str, error: str) -> str:
    number = re.search(r"at line (\d+)", error)
    if number is None:
        return ""
    line = text.splitlines()[int(number[1]) - 1].partition("#")[0].strip()
    return f": {shortened(line)}{_slip(line)}"


def _slip(line: str) -> str:
    """The probable intention of a line that is not TOML."""
    value = line.partition("=")[2].strip()
    if value.strip(CURLY) != value:
        return f'; quotes are straight: "{value.strip(CURLY)}"'
    if re.fullmatch(r"[-+]?\d+,\d+", value):
        return f"; a decimal number has a point: {value.replace(',', '.')}"
    if value in ("True", "False"):
        return f"; TOML writes {value.lower()}"
    if re.fullmatch(r"[A-Za-z_/~.][\w./~:-]*", value):
        return f'; text stands in quotes: "{value}"'
    return ""


def _with_absolute_paths(config: Kind, folder: Path) -> Kind:
    pads = []
    for pad in config.pad:
        if pad.contact.model not in (NO_MODEL, *SHIPPED_PATHS):
            contact = msgspec.structs.replace(pad.contact, model=str(folder / pad.contact.model))
            pad = msgspec.structs.replace(pad, contact=contact)
        if isinstance(pad.source, ReplaySource):
            source = msgspec.structs.replace(pad.source, file=str(folder / pad.source.file))
            pad = msgspec.structs.replace(pad, source=source)
        if isinstance(pad.source, SimulatedSource) and pad.source.mechanics != "standard":
            simulated = msgspec.structs.replace(pad.source, mechanics=str(folder / pad.source.mechanics))
            pad = msgspec.structs.replace(pad, source=simulated)
        if isinstance(pad.source, SimulatedSource) and pad.source.frames_from is not None:
            fed = msgspec.structs.replace(pad.source, frames_from=str(folder / pad.source.frames_from))
            pad = msgspec.structs.replace(pad, source=fed)
        pads.append(pad)
    bus = config.bus
    if bus.keys is not None:
        bus = msgspec.structs.replace(bus, keys=str(folder / bus.keys))
    return msgspec.structs.replace(config, pad=tuple(pads), bus=bus)
