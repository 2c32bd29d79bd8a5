"""`fmfts-daemon baseline`, `selftest` and `probe`: through the running daemon, which owns the devices, or on them."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from fmfts.cli import elsewhere, next_step
from fmfts.cli.verb import (
    AddVerb,
    VerbError,
    configuration,
    configuration_if_any,
    ended_by,
    pad_named,
    seconds,
    with_json,
)
from fmfts.common import exit_codes
from fmfts.common.names import no_such_pad

if TYPE_CHECKING:
    from fmfts.config import Config


def add_to(verb: AddVerb) -> None:
    baseline = verb("baseline", _baseline, "record the baseline of a pad, before loading it")
    kind = baseline.add_mutually_exclusive_group(required=True)
    kind.add_argument("--bare", action="store_true", help="the pad is not mounted: record the ambient field alone")
    kind.add_argument("--rest", action="store_true", help="the pad is mounted and nothing touches it")
    kind.add_argument("--turn", action="store_true", help="turn the unloaded robot: learn the sensors' gains")
    kind.add_argument("--refine", action="store_true", help="press some 30 times anywhere: learn places and gains")
    kind.add_argument(
        "--learn",
        action="store_true",
        help="press some 60 times anywhere: learn the geometry, from a sketch of the board",
    )
    kind.add_argument(
        "--posture", action="store_true", help="move the untouched hand for a minute: learn what that does to the field"
    )
    kind.add_argument("--restore", action="store_true", help="record nothing: bring the last good baseline back")
    kind.add_argument(
        "--undo-drift", action="store_true", help="record nothing: forget the drift followed by [pad.rebaseline]"
    )
    baseline.add_argument("--replaced", action="store_true", help="the pad was replaced since the last baseline")
    baseline.add_argument(
        "--duration-s",
        type=seconds,
        help="duration of the recording: 0.5 to 60 (3; --turn 20; --refine 40; --learn and --posture 60)",
    )
    baseline.add_argument("--no-joints", action="store_true", help="with --posture: nothing publishes joint positions")
    selftest = verb("selftest", _selftest, "measure every axis in a field that the chip makes itself")
    for added in (baseline, selftest):
        added.add_argument("--pad", metavar="NAME", help="needed if there are several")
        with_json(added)
    probe = verb("probe", _probe, "say what is connected, and what is wrong with it")
    probe.add_argument("--pad", metavar="NAME", help="only this pad")
    probe.add_argument(
        "--magnet", action="store_true", help="check channels, axes and scales with a magnet in your hand, in a minute"
    )
    probe.add_argument("--pole", choices=("up", "down"), help="for --magnet: where its north pole points, if you know")
    probe.add_argument("--write", action="store_true", help="for --magnet: write what is found into the configuration")
    with_json(probe)


def _baseline(options: argparse.Namespace) -> int:
    from fmfts.cli.direct import nothing_to_undo, record_baseline, restore_baseline

    if options.learn:
        return _learn(options)
    if options.undo_drift:
        return through_daemon(options, "baseline", {"undo_drift": True}, nothing_to_undo)
    if options.restore:
        return through_daemon(options, "baseline", {"restore": True}, lambda pad, pads, restore: restore_baseline(pad))
    if options.no_joints and not options.posture:
        raise VerbError(exit_codes.USAGE, "--no-joints belongs to --posture: `fmfts-daemon baseline --posture`")
    names = ("bare", "replaced", "turn", "refine", "duration_s", *(("posture", "no_joints") if options.posture else ()))
    arguments = {name: getattr(options, name) for name in names}
    return through_daemon(options, "baseline", arguments, record_baseline)


def _learn(options: argparse.Namespace) -> int:
    from fmfts.cli import direct
    from fmfts.view.facts import print_facts

    config = configuration(options)
    pad = pad_named(config, options.pad)
    with ended_by(*direct.ERRORS):
        facts = direct.learn_baseline(
            pad, config.pad, config.bus.endpoint, replaced=options.replaced, duration_s=options.duration_s
        )
    print_facts(facts, as_json=options.json)
    words = _config_words(options), f" --pad {options.pad}" if options.pad else ""
    _say_next(options, next_step.after_baseline(facts, *words, is_running=False))
    return exit_codes.DONE


def _selftest(options: argparse.Namespace) -> int:
    from fmfts.cli.direct import run_selftest

    return through_daemon(options, "selftest", {}, run_selftest)


def through_daemon(options: argparse.Namespace, verb: str, arguments: dict[str, Any], directly: Any) -> int:
    """Lets the running daemon carry out a verb, because it owns the device; without a daemon, calls `directly`."""
    from fmfts.cli import direct
    from fmfts.config.file import is_named
    from fmfts.view.facts import print_facts

    config = configuration_if_any(options)
    # A file that only lies here may be of another daemon.
    named = config.pad if config is not None and is_named(options.config) else ()
    pad = options.pad or (named[0].name if len(named) == 1 else None)
    with ended_by(*direct.ERRORS):
        facts = direct.ask_daemon(verb, _endpoint_in(config), pad, **arguments)
        is_running = facts is not None
        if facts is None:
            config = config or configuration(options)
            facts = directly(pad_named(config, pad), config.pad, **arguments)
    print_facts(facts, as_json=options.json)
    words = _config_words(options), f" --pad {options.pad}" if options.pad else ""
    if verb == "weigh":
        _say_next(options, next_step.after_weighing(*words, is_running=is_running))
    elif verb == "selftest":
        _say_next(options, next_step.after_selftest(facts, *words))
    else:
        _say_next(options, next_step.after_baseline(facts, *words, is_running=is_running))
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

    if options.magnet:
        checked: int = elsewhere.option("probe --magnet")(options)
        return checked
    if options.pole or options.write:
        raise VerbError(exit_codes.USAGE, "--pole and --write belong to --magnet: `fmfts-daemon probe --magnet`")
    with ended_by(*direct.ERRORS):
        config = configuration_if_any(options)
        facts = direct.probe_running(_endpoint_in(config)) or direct.probe(config or configuration(options))
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
