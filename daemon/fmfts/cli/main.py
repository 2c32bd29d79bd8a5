"""Defines the command `fmfts-daemon`: its verbs, options and exit codes. Each verb imports only what it needs."""

from __future__ import annotations

import argparse
import logging
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from itertools import takewhile
from pathlib import Path
from typing import Any

from fmfts import __version__
from fmfts.cli import check_config, elsewhere, on_device
from fmfts.cli import init_config as init_verb
from fmfts.cli import keys as keys_verb
from fmfts.cli import weigh as weigh_verb
from fmfts.cli.verb import (
    LISTENERS_CONFIG,
    VerbError,
    configuration,
    ended_by,
    lacking,
    seconds,
    serving_base,
    with_json,
)
from fmfts.common import exit_codes
from fmfts.common.writing import FULL, why_not_written

DEFAULT_CONFIG = "default: $FMFTS_CONFIG, or the first of /etc/fmfts/config.toml, ./pad.toml or ./config.toml"
EPILOG = """\
A new pad: init, check-config, probe, selftest, baseline --bare, --rest, --turn (for a robot that turns), weigh,
run; then listen and status. If a daemon runs, probe, selftest, baseline and weigh go through it.

exit codes, the same for every verb:
""" + "\n".join(f"{code:5} {meaning}" for code, meaning in exit_codes.MEANING.items())


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb and return its exit code, as EPILOG lists them."""
    from fmfts.service.log import configure

    words = sys.argv[1:] if arguments is None else arguments
    options, surplus = _parser(words[0] if words else None).parse_known_args(words)
    if surplus and options.handler is not elsewhere.refuse:
        options.parser.error(_unexpected(surplus, takes_pad=hasattr(options, "pad")))
    command = f"fmfts-daemon {options.verb}"
    if options.verb == "run":
        configure()
    else:
        configure(logging.WARNING, command=command)
    try:
        return _handled(options)
    except VerbError as failure:
        for handler in logging.getLogger().handlers:
            handler.flush()  # a thread writes the log, whose last line must say why this ended
        print(f"{command}: {failure}", file=sys.stderr)
        return failure.code
    except KeyboardInterrupt:
        return exit_codes.INTERRUPTED
    except BrokenPipeError:
        _write_no_more()
        return exit_codes.READER_GONE
    except OSError as error:
        if error.errno not in FULL or error.filename is not None:
            raise
        _write_no_more()
        print(f"{command}: its output, or a file that it writes: {why_not_written(error)}", file=sys.stderr)
        return exit_codes.UNWRITABLE


def _write_no_more() -> None:
    """Nobody takes the output any more: write nothing, also not at exit."""
    if sys.stdout is not None:  # None: closed from the beginning (>&-)
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _handled(options: argparse.Namespace) -> int:
    try:
        code: int = options.handler(options)
        if sys.stdout is not None:
            sys.stdout.flush()
        return code
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith("fmfts"):
            raise
        package = options.handler.__module__.partition(".")[0].removeprefix("fmfts_")
        raise lacking(error, package if package in elsewhere.EXTRAS else "") from error  # installed with --no-deps


def _unexpected(words: Sequence[str], takes_pad: bool) -> str:
    file = next((word for word in words if word.endswith(".toml")), None)
    name = words[0] if takes_pad and len(words) == 1 and not words[0].startswith("-") else None
    meant = f"--config {file}" if file else f"--pad {name}" if name else None
    return f"unexpected: {' '.join(words)}" + (f"; did you mean {meant}?" if meant else "")


def command_line() -> argparse.ArgumentParser:
    """The parser of the verbs that are installed: for manual pages and completion."""
    return _parser(None, only_installed=True)


def _parser(requested: str | None, only_installed: bool = False) -> argparse.ArgumentParser:
    """The parser of all verbs. requested: the first word of the command line; None where there is none."""
    parser = argparse.ArgumentParser(
        prog="fmfts-daemon",
        description="Contact location and force from a magnet pad.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=_Version)
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB", parser_class=_Verb)

    def verb(name: str, handler: Any, text: str, default_config: str = DEFAULT_CONFIG) -> argparse.ArgumentParser:
        added = verbs.add_parser(name, help=text, description=text)
        added.set_defaults(handler=handler, parser=added)
        added.add_argument("--config", type=Path, metavar="FILE", help=default_config)
        return added

    verb("run", _run, "read the pads and publish contacts until stopped")
    on_device.add_to(verb)
    weigh_verb.add_to(verb)
    state = verb("status", _status, "ask a running daemon how its pads are", LISTENERS_CONFIG)
    state.add_argument("--pad", metavar="NAME", help="only this pad")
    with_json(state)
    with_json(verb("check-config", check_config.run, "read the configuration and say what is wrong with it"))
    listen = verb("listen", _listen, "show the contacts of a running daemon", LISTENERS_CONFIG)
    listen.add_argument("--pad", metavar="NAME", help="only this pad")
    listen.add_argument("--seconds", type=seconds, help="end after this time, with a summary")
    with_json(listen)
    init_verb.add_to(verb)
    keys_verb.add_to(verb)
    if requested not in verbs.choices:
        elsewhere.add_to(verb, only_installed)
        if requested is not None and not requested.startswith("-") and requested not in verbs.choices:
            parser.error(_no_such_verb(requested, list(verbs.choices)))
    return parser


def _no_such_verb(word: str, verbs: Sequence[str]) -> str:
    from difflib import get_close_matches

    near = get_close_matches(word.lower(), verbs, n=1)
    return f"there is no verb {word!r}; " + (
        f"did you mean {near[0]}?" if near else f"the verbs are {', '.join(verbs)}"
    )


class _Verb(argparse.ArgumentParser):
    """Names the probably intended option for a mistyped one, before argparse reports a missing one.

    Its help marks the options that need a missing package.
    """

    def format_help(self) -> str:
        elsewhere.mark_absent(self)
        return super().format_help()

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        # Some verbs pass the rest of the line on: those words are not their options.
        if not any(action.nargs in (argparse.PARSER, argparse.REMAINDER) for action in self._actions):
            for word in takewhile(lambda word: word != "--", args or ()):
                if word.startswith("--"):
                    self._require_option(word.partition("=")[0])
        return super().parse_known_args(args, namespace)

    def _require_option(self, option: str) -> None:
        known = [word for action in self._actions for word in action.option_strings]
        if any(word.startswith(option) for word in known):  # argparse takes the beginning of an option, too
            return
        from difflib import get_close_matches

        for near in get_close_matches(option, known, n=1):
            self.error(f"there is no option {option}; did you mean {near}?")


class _Version(argparse.Action):
    def __init__(self, **rest: Any) -> None:
        super().__init__(nargs=0, help="versions of package, wire and message schema", **rest)

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        from fmfts.sensor.wire.codec import VERSION as WIRE_VERSION
        from fmfts_client import SCHEMA_VERSION

        print(f"fmfts-daemon {__version__} (wire {WIRE_VERSION}, schema {SCHEMA_VERSION})")
        parser.exit()


def _run(options: argparse.Namespace) -> int:
    from fmfts.baseline.files import StateError
    from fmfts.bus.lock import BusError
    from fmfts.contact import ModelError
    from fmfts.runtime.daemon import Daemon
    from fmfts.sensor import SourceError
    from fmfts.service.realtime import RealtimeError
    from fmfts_client.endpoints import EndpointError

    config = configuration(options)
    errors = BusError, EndpointError, ModelError, SourceError, StateError, RealtimeError
    with ended_by(*errors), Daemon(config) as daemon:
        daemon.run()
    return 0


def _status(options: argparse.Namespace) -> int:
    from fmfts.bus.lock import BusError, serving_pid, socket_path
    from fmfts.view.status import status
    from fmfts_client.endpoints import EndpointError, for_client

    base, is_served = serving_base(options), True
    with suppress(BusError, EndpointError):  # `status` reports the second
        control = for_client(base).control
        is_served = socket_path(control) is None or serving_pid(control) is not None
    return status(options.pad, as_json=options.json, endpoint=base, is_served=is_served)


def _listen(options: argparse.Namespace) -> int:
    from fmfts.view.listen import listen

    return listen(options.pad, options.seconds, as_json=options.json, endpoint=serving_base(options))
