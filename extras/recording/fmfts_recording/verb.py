"""Defines the verbs `record` and `replay`: their options and what they print."""

from __future__ import annotations

import argparse
from contextlib import closing
from pathlib import Path

from fmfts.cli.verb import LISTENERS_CONFIG, AddVerb, ended_by, say, seconds, serving_base
from fmfts.common import exit_codes


def add_record(verb: AddVerb) -> None:
    record = verb(
        "record", _record, "write all messages of a running daemon to a file, with raw frames", LISTENERS_CONFIG
    )
    record.add_argument("output", type=Path, metavar="FILE.mcap", help="a new file")
    record.add_argument("--pad", metavar="NAME", help="only this pad and its neighbours")
    record.add_argument("--seconds", type=seconds, help="end after this time; else Ctrl-C ends it")
    record.add_argument(
        "--ros2", action="store_true", help="contacts and wrenches in ROS 2's encoding, too, for Rerun and rosbag2"
    )
    record.add_argument(
        "--repair",
        action="store_true",
        help="record nothing: give FILE.mcap, which was cut off, an index in a new file",
    )
    record.add_argument("--json", action="store_true", help="print facts as JSON")


def add_replay(verb: AddVerb) -> None:
    replay = verb("replay", _replay, "process a recording's frames again, and compare the contacts")
    replay.add_argument("recording", type=Path, metavar="FILE.mcap")
    replay.add_argument("--model", action="append", default=[], metavar="FILE", help="contact model of the recording")
    replay.add_argument("--contacts", action="store_true", help="print each contact as a line of JSON")
    replay.add_argument("--json", action="store_true", help="print facts as JSON")


def _record(options: argparse.Namespace) -> int:
    from fmfts.view.facts import print_facts
    from fmfts.view.silence import NoSuchPadError
    from fmfts_client import EndpointError, SchemaError
    from fmfts_recording.file import RecordingError
    from fmfts_recording.recorder import Recorder

    if options.repair:
        return _repair(options)
    errors = RecordingError, EndpointError, SchemaError, NoSuchPadError
    base = serving_base(options)
    with ended_by(*errors), closing(Recorder(options.output, options.pad, base, for_ros=options.ros2)) as recorder:
        facts = recorder.run(options.seconds)
    print_facts(facts, as_json=options.json)
    silent = recorder.without_frames()
    for sentence in silent:
        say(f"fmfts-daemon record: {sentence}")
    return exit_codes.UNAVAILABLE if silent and not facts["pads"] else exit_codes.DONE


def _repair(options: argparse.Namespace) -> int:
    from fmfts.view.facts import print_facts
    from fmfts_recording.file import RecordingError
    from fmfts_recording.repair import repair

    path: Path = options.output
    with ended_by(RecordingError):
        facts = repair(path, path.with_suffix(f".repaired{path.suffix}"))
    print_facts(facts, as_json=options.json)
    return 0


def _replay(options: argparse.Namespace) -> int:
    import msgspec

    from fmfts.view.facts import print_facts
    from fmfts_recording.file import RecordingError
    from fmfts_recording.replay import Replay

    with ended_by(RecordingError):
        replay = Replay(options.recording, options.model)
        for contact in replay.contacts():
            if options.contacts:
                print(msgspec.json.encode(contact).decode())
    if not options.contacts:
        print_facts(replay.facts(), as_json=options.json)
    return 0 if replay.comparison.is_the_same else exit_codes.DATA
