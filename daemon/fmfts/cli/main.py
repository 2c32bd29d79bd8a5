"""Defines the command `fmfts-daemon`: its verbs, options and exit codes. Each verb imports only what it needs."""

from __future__ import annotations

import argparse
import logging
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fmfts import __version__
from fmfts.cli import calibrate as calibration_verbs
from fmfts.cli import check_config, next_step
from fmfts.cli import collect as collect_verb
from fmfts.cli import demo as demo_verb
from fmfts.cli import init_config as init_verb
from fmfts.cli import keys as keys_verb
from fmfts.cli import pose as pose_verb
from fmfts.cli import record as record_verbs
from fmfts.cli import view as view_verb
from fmfts.cli.verb import (
    AddVerb,
    VerbError,
    configuration,
    configuration_if_any,
    ended_by,
    lacking,
    pad_named,
    seconds,
    serving_base,
)
from fmfts.common import exit_codes
from fmfts.common.names import no_such_pad

if TYPE_CHECKING:
    from fmfts.config import Config

DEFAULT_CONFIG = "default: $FMFTS_CONFIG, or the first of /etc/fmfts/config.toml, ./config.toml or ./pad.toml"
LISTENERS_CONFIG = "the daemon's file, if that sets [bus] endpoint; not needed otherwise"
VERBS = "fmfts.verbs"  # entry points: functions that take an AddVerb
LABORATORY = {"study": "compare methods on this pad", "pad-model": "make a simulated pad by finite elements"}
EPILOG = """\
A new pad: init, check-config, probe, selftest, baseline --bare, baseline --rest, run; then listen and status.
If a daemon runs, probe, selftest and baseline go through it.

exit codes, the same for every verb:
""" + "\n".join(f"{code:5} {meaning}" for code, meaning in exit_codes.MEANING.items())


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb and return its exit code, as EPILOG lists them."""
    from fmfts.service.log import configure

    words = sys.argv[1:] if arguments is None else arguments
    options, surplus = _parser(words[0] if words else None).parse_known_args(words)
    if surplus:
        options.parser.error(_unexpected(surplus, takes_pad=hasattr(options, "pad")))
    command = f"fmfts-daemon {options.verb}"
    if options.verb == "run":
        configure()
    else:
        configure(logging.WARNING, command=command)
    try:
        return _handled(options)
    except VerbError as failure:
        print(f"{command}: {failure}", file=sys.stderr)
        return failure.code
    except KeyboardInterrupt:
        return exit_codes.INTERRUPTED
    except BrokenPipeError:
        # The reader of the output has ended: write nothing more, also not at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return exit_codes.READER_GONE


def _handled(options: argparse.Namespace) -> int:
    try:
        code: int = options.handler(options)
        return code
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] in ("fmfts", "fmfts_client", "fmfts_lab"):
            raise
        raise lacking(error) from error  # installed with --no-deps


def _unexpected(words: Sequence[str], takes_pad: bool) -> str:
    file = next((word for word in words if word.endswith(".toml")), None)
    name = words[0] if takes_pad and len(words) == 1 and not words[0].startswith("-") else None
    meant = f"--config {file}" if file else f"--pad {name}" if name else None
    return f"unexpected: {' '.join(words)}" + (f"; did you mean {meant}?" if meant else "")


def command_line() -> argparse.ArgumentParser:
    """The parser of this package's own verbs: for manual pages and completion."""
    return _parser("run")


def _parser(requested: str | None) -> argparse.ArgumentParser:
    """The parser of all verbs. requested: the first word of the command line; None where there is none."""
    parser = argparse.ArgumentParser(
        prog="fmfts-daemon",
        description="Contact location and force from a magnet pad.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=_Version)
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")

    def verb(name: str, handler: Any, text: str, default_config: str = DEFAULT_CONFIG) -> argparse.ArgumentParser:
        added = verbs.add_parser(name, help=text, description=text)
        added.set_defaults(handler=handler, parser=added)
        added.add_argument("--config", type=Path, metavar="FILE", help=default_config)
        return added

    def facts(added: argparse.ArgumentParser) -> None:
        added.add_argument("--json", action="store_true", help="print facts as JSON")

    verb("run", _run, "read the pads and publish contacts until stopped")
    baseline = verb("baseline", _baseline, "record the baseline of a pad, before loading it")
    kind = baseline.add_mutually_exclusive_group(required=True)
    kind.add_argument("--bare", action="store_true", help="the pad is not mounted: record the ambient field alone")
    kind.add_argument("--rest", action="store_true", help="the pad is mounted and nothing touches it")
    kind.add_argument("--turn", action="store_true", help="turn the unloaded robot: learn the sensors' gains")
    kind.add_argument("--refine", action="store_true", help="press some 30 times anywhere: learn places and gains")
    kind.add_argument("--restore", action="store_true", help="record nothing: bring the last good baseline back")
    kind.add_argument(
        "--undo-drift", action="store_true", help="record nothing: forget the drift followed by [pad.rebaseline]"
    )
    baseline.add_argument("--replaced", action="store_true", help="the pad was replaced since the last baseline")
    baseline.add_argument(
        "--duration-s", type=seconds, help="duration of the recording: 0.5 to 60 (3; --turn 20; --refine 40)"
    )
    selftest = verb("selftest", _selftest, "measure every axis in a field that the chip makes itself")
    for added in (baseline, selftest):
        added.add_argument("--pad", metavar="NAME", help="needed if there are several")
        facts(added)
    probe = verb("probe", _probe, "say what is connected, and what is wrong with it")
    probe.add_argument("--pad", metavar="NAME", help="only this pad")
    facts(probe)
    facts(verb("status", _status, "ask a running daemon how its pads are", LISTENERS_CONFIG))
    facts(verb("check-config", check_config.run, "read the configuration and say what is wrong with it"))
    listen = verb("listen", _listen, "show the contacts of a running daemon", LISTENERS_CONFIG)
    listen.add_argument("--pad", metavar="NAME", help="only this pad")
    listen.add_argument("--seconds", type=seconds, help="end after this time, with a summary")
    facts(listen)
    view_verb.add_to(verb, LISTENERS_CONFIG)
    demo_verb.add_to(verb)
    init_verb.add_to(verb)
    keys_verb.add_to(verb)
    record_verbs.add_to(verb, LISTENERS_CONFIG)
    pose_verb.add_to(verb)
    calibration_verbs.add_to(verb)
    collect_verb.add_to(verb)
    if requested not in verbs.choices:
        _add_laboratory(verb)
    return parser


def _add_laboratory(verb: AddVerb) -> None:
    """Adds the verbs of another package (lab/). Called only if the command line names none of this package's verbs."""
    from importlib.metadata import entry_points

    installed = {point.name: point for point in entry_points(group=VERBS)}
    for name, text in LABORATORY.items():
        if name in installed:
            installed.pop(name).load()(verb)
        else:
            verb(name, _without_laboratory, f"{text} (not installed)").add_argument("rest", nargs=argparse.REMAINDER)
    for point in installed.values():
        point.load()(verb)


def _without_laboratory(options: argparse.Namespace) -> int:
    raise VerbError(
        exit_codes.UNAVAILABLE,
        f"{options.verb} belongs to the laboratory, a separate package; install it in a checkout of fmfts with\n"
        f"    {sys.executable} -m pip install ./clients/python . ./lab",
    )


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


def _baseline(options: argparse.Namespace) -> int:
    from fmfts.cli.direct import nothing_to_undo, record_baseline, restore_baseline

    if options.undo_drift:
        return _through_daemon(options, "baseline", {"undo_drift": True}, nothing_to_undo)
    if options.restore:
        return _through_daemon(options, "baseline", {"restore": True}, lambda pad, pads, restore: restore_baseline(pad))
    names = ("bare", "replaced", "turn", "refine", "duration_s")
    arguments = {name: getattr(options, name) for name in names}
    return _through_daemon(options, "baseline", arguments, record_baseline)


def _selftest(options: argparse.Namespace) -> int:
    from fmfts.cli.direct import run_selftest

    return _through_daemon(options, "selftest", {}, run_selftest)


def _through_daemon(options: argparse.Namespace, verb: str, arguments: dict[str, Any], directly: Any) -> int:
    """Lets the running daemon carry out a verb, because it owns the device; without a daemon, calls `directly`."""
    from fmfts.cli import direct
    from fmfts.view.facts import print_facts

    config = configuration_if_any(options)
    pad = options.pad or (config.pad[0].name if config is not None and len(config.pad) == 1 else None)
    with ended_by(*direct.ERRORS):
        facts = direct.ask_daemon(verb, _endpoint_in(config), pad, **arguments)
        through_daemon = facts is not None
        if facts is None:
            config = config or configuration(options)
            facts = directly(pad_named(config, pad), config.pad, **arguments)
    print_facts(facts, as_json=options.json)
    words = _config_words(options), f" --pad {options.pad}" if options.pad else ""
    if verb == "selftest":
        _say_next(options, next_step.after_selftest(facts, *words))
    else:
        _say_next(options, next_step.after_baseline(facts, *words, is_running=through_daemon))
    return exit_codes.DONE if facts.get("passed", True) else exit_codes.FAULTY


def _endpoint_in(config: Config | None) -> str | None:
    return None if config is None else config.bus.endpoint


def _config_words(options: argparse.Namespace) -> str:
    return "" if options.config is None else f" --config {options.config}"


def _say_next(options: argparse.Namespace, sentence: str) -> None:
    if sentence and not options.json:
        print(f"next: {sentence}")


def _probe(options: argparse.Namespace) -> int:
    from fmfts.cli import direct
    from fmfts.view.facts import print_facts

    with ended_by(*direct.ERRORS):
        config = configuration_if_any(options)
        facts = direct.ask_daemon("probe", _endpoint_in(config))
        facts = facts or direct.probe(config or configuration(options))
    words = _config_words(options)
    if options.pad is not None:
        known = {pad["pad"]: pad for pad in facts["pads"]}
        if options.pad not in known:
            raise VerbError(exit_codes.USAGE, no_such_pad(options.pad, list(known), "this computer"))
        facts, words = {"pads": [known[options.pad]]}, f"{words} --pad {options.pad}"
    print_facts(facts, as_json=options.json)
    _say_next(options, next_step.after_probe(facts, words))
    if not all(pad["connected"] for pad in facts["pads"]):
        return exit_codes.UNAVAILABLE
    return exit_codes.DONE if all(pad["sound"] for pad in facts["pads"]) else exit_codes.FAULTY


def _status(options: argparse.Namespace) -> int:
    from fmfts.view.status import status

    return status(as_json=options.json, endpoint=serving_base(options))


def _listen(options: argparse.Namespace) -> int:
    from fmfts.view.listen import listen

    return listen(options.pad, options.seconds, as_json=options.json, endpoint=serving_base(options))
