"""`fmfts-daemon report`: writes one file with all that others need to diagnose a pad."""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import Any

from fmfts.cli.verb import AddVerb, VerbError, ended_by, seconds, with_json
from fmfts.common import exit_codes

SECONDS = 10.0


def add_to(verb: AddVerb) -> None:
    report = verb("report", _report, "write one file to send when something is wrong: facts, frames, registers, log")
    report.add_argument("output", type=Path, nargs="?", metavar="FILE.mcap", help="a new file; default: named by date")
    report.add_argument("--seconds", type=seconds, default=SECONDS, help=f"duration of the frames ({SECONDS:g})")
    report.add_argument("--no-selftest", action="store_true", help="leave it out: it interrupts contacts for a second")
    report.add_argument(
        "--i2c",
        type=int,
        action="append",
        default=[],
        metavar="BUS",
        help="look at this I2C bus, too: 1 for /dev/i2c-1",
    )
    report.add_argument("--show", type=Path, metavar="FILE.mcap", help="write nothing: print all that a report holds")
    with_json(report)


def _report(options: argparse.Namespace) -> int:
    from fmfts.view.progress import progress_bar
    from fmfts_recording.file import CopyWriter, RecordingError
    from fmfts_report.file import write
    from fmfts_report.gather import Gathering, new_name
    from fmfts_report.scrub import of_this_computer

    if options.show is not None:
        return _show(options)
    path: Path = options.output or new_name()
    with ended_by(RecordingError):
        writer = CopyWriter(path)  # checked first: a minute's work must not end with a folder that cannot be written
        try:
            with tempfile.TemporaryDirectory(prefix="fmfts-report-") as folder, progress_bar("report") as show:
                gathering = Gathering(
                    options.config, options.seconds, not options.no_selftest, options.i2c, Path(folder), show
                )
                facts = gathering.facts()
                write(writer, gathering.recording, facts, of_this_computer())
        except BaseException:
            writer.discard()
            raise
        writer.close()
    _tell(path, facts, as_json=options.json)
    return exit_codes.DONE


def _show(options: argparse.Namespace) -> int:
    from fmfts.view.facts import print_facts
    from fmfts_recording.file import RecordingError
    from fmfts_report.file import facts_of, lines_of

    if options.output is not None:
        raise VerbError(exit_codes.USAGE, f"--show {options.show} writes nothing: leave {options.output} out")
    with ended_by(RecordingError):
        if options.json:
            print_facts(facts_of(options.show), as_json=True)
            return exit_codes.DONE
        for line in lines_of(options.show):
            print(line)
    return exit_codes.DONE


def _tell(path: Path, facts: dict[str, Any], *, as_json: bool) -> None:
    from fmfts.view.facts import print_facts

    for sentence in facts["missing"]:
        print(f"left out: {sentence}", file=sys.stderr)
    size = path.stat().st_size
    if as_json:
        print_facts({"report": str(path), "bytes": size, "missing": facts["missing"]}, as_json=True)
        return
    chips = [chip for bus in facts["buses"] for chip in bus.get("chips", ())]
    frames = facts["recorded"].get("frames", {})
    tested = [f"{each['pad']} {'passed' if each.get('passed') else 'failed'}" for each in facts["selftests"]]
    logs = [name for name in ("log_of_service", "log_of_this_run") if facts.get(name)]
    print(f"{path}: {size / 1000:.0f} kB, made through {facts['through']}")
    print(f"frames: {', '.join(f'{count} of {pad}' for pad, count in frames.items()) or 'none'}")
    print(f"chips with registers: {sum(bool(chip['registers']) for chip in chips)}; left out: {len(facts['missing'])}")
    print(f"self-test: {', '.join(tested) or 'none'}")
    print(f"files: {', '.join([*(['configuration'] if facts['configuration'] else []), *facts['state'], *logs])}")
    print(f"machine: {facts['machine']['kernel']}, fmfts {facts['versions']['fmfts']}, packages, adapters, ports")
    print(f"next: read it with `fmfts-daemon report --show {path}`, zip it (GitHub takes no .mcap), and attach it")
    print('to a new issue of the kind "Hardware report". Names of you and of this computer are replaced in it.')
