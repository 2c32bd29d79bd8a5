"""`collect --merge` and `--against`: makes a table from a log of forces and a recording of the pad's frames.

The log is another machine's, or what another pad in the same recording read: two pads that press on one thing feel the
same force."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fmfts.bus.frame_message import frame_of
from fmfts.bus.messages import ContactMessage, FrameMessage
from fmfts.cli.verb import WEIGH_FIRST
from fmfts.common.reading import damage_told, digest_of
from fmfts.config import PadConfig
from fmfts.contact.tolerances import MODULUS
from fmfts.sensor import Frame
from fmfts.sensor.chips import CHIPS
from fmfts_collect.alignment import Alignment, align
from fmfts_collect.average import Averaged, RowError, Unmoved, average, require_touched
from fmfts_collect.errors import RefusedError
from fmfts_collect.gauge import Reading
from fmfts_collect.machine_log import Log, Plateau, plateaus, read_log
from fmfts_collect.plan import Press
from fmfts_collect.session import Identity, row_of
from fmfts_collect.settings import CollectingConfig
from fmfts_collect.table import FORMAT, UNTOUCHED, Header, Row, Table
from fmfts_collect.work import averaging_s, unmoved_since_baseline
from fmfts_recording.file import RecordingError, read

SAME_CLOCK = Alignment(lag_s=0.0, rate=0.0, middle_s=0.0, correlation=1.0, even=1.0)
FEWEST_READINGS = 10
ZERO_DRIFT_N = 0.05  # largest believable drift of the log's zero between two pauses


@dataclass(frozen=True, slots=True)
class MeasuredPlateau:
    """A plateau of the log, and the mean field and force in its time; the force is not corrected for the zero."""

    plateau: Plateau
    averaged: Averaged

    @property
    def logged_n(self) -> float:
        assert self.averaged.force_n is not None
        return self.averaged.force_n


def merge(config: CollectingConfig, pad: PadConfig, log_path: Path, recording: Path, output: Path) -> dict[str, Any]:
    """Write the new table `output`; returns its facts. Raises RefusedError where log and recording make no table."""
    if output.exists():
        raise RefusedError(f"{output} exists already: give another file with -o, or remove that one")
    unmoved = unmoved_since_baseline(pad.pad())
    log, frames = read_log(log_path), _frames(recording, pad)
    mounting = unmoved.mounting
    alignment = align(log, frames, (mounting.rest_field_t + mounting.offset_t) * mounting.gain)
    named = _Named(log_path.name, digest_of(log_path)[:12], f"{log_path} and {recording}")
    return _written(config, pad, unmoved, _Heard(log, frames, alignment), named, recording, output)


def against(config: CollectingConfig, pad: PadConfig, other: str, recording: Path, output: Path) -> dict[str, Any]:
    """As `merge`, with the forces that the pad `other` read in the same recording. Its facts have how uncertain the
    scale of those forces is, too, and a warning where nobody can have weighed that pad."""
    if output.exists():
        raise RefusedError(f"{output} exists already: give another file with -o, or remove that one")
    unmoved = unmoved_since_baseline(pad.pad())
    log, scale_sd = _read_by(other, recording)
    heard = _Heard(log, _frames(recording, pad), SAME_CLOCK)
    named = _Named(f"against {other}", digest_of(recording)[:12], f"pad '{other}' in {recording}")
    facts = _written(config, pad, unmoved, heard, named, recording, output)
    told = f"{named.told} knows its forces to {scale_sd:.0%} alone, like a pad that nobody weighed: {WEIGH_FIRST}"
    return facts | {"scale_sd": scale_sd, "warnings": [told] if scale_sd > MODULUS else []}


@dataclass(frozen=True, slots=True)
class _Heard:
    log: Log
    frames: Sequence[Frame]
    alignment: Alignment


class _Named(NamedTuple):
    """The source of the forces: a name and a fingerprint for the table's header, and its name in errors."""

    plan: str
    fingerprint: str
    told: str


def _written(
    config: CollectingConfig,
    pad: PadConfig,
    unmoved: Unmoved,
    heard: _Heard,
    named: _Named,
    recording: Path,
    output: Path,
) -> dict[str, Any]:
    settings, drawing = config.collect, pad.pad()
    log, frames, alignment = heard.log, heard.frames, heard.alignment
    log_plateaus = plateaus(log, settings.settle_s, averaging_s(settings, pad))
    refused: list[str] = []
    measured = list(_measured(log_plateaus, log, frames, alignment, refused))
    identity = Identity(unmoved.baseline_id, pad.name, "", str(recording))
    rows = list(_rows(measured, unmoved, identity, refused))
    collected = sum(row.press != UNTOUCHED for row in rows)
    if not collected:
        raise RefusedError(f"{named.told} make no row of {len(log_plateaus)} plateaus: {_first_of(refused)}")
    header = Header(FORMAT, named.plan, named.fingerprint, pad.name, drawing.geometry_hash)
    with Table(output, len(drawing.sensors), header) as table:
        for row in rows:
            table.add(row)
    return {
        "collected": collected,
        "untouched": len(rows) - collected,
        "refused": refused,
        "lag_s": alignment.lag_s,
        "clock_ppm": alignment.rate * 1e6,
        "correlation": alignment.correlation,
        "table": str(output),
    }


def _measured(
    log_plateaus: Sequence[Plateau], log: Log, frames: Sequence[Frame], alignment: Alignment, refused: list[str]
) -> Iterator[MeasuredPlateau]:
    """Yields the plateaus for which the recording has a steady field; adds the others to `refused`."""
    times_ns = [frame.host_time_ns for frame in frames]
    for plateau in log_plateaus:
        begin, end = (
            bisect_left(times_ns, round(alignment.frame_time_s(at_s) * 1e9))
            for at_s in (plateau.begun_s, plateau.ended_s)
        )
        rows = slice(plateau.first, plateau.end)
        readings = [
            Reading(round(at_s * 1e9), force_n)
            for at_s, force_n in zip(log.time_s[rows].tolist(), log.force_n[rows].tolist(), strict=True)
        ]
        try:
            yield MeasuredPlateau(plateau, average(frames[begin:end], readings, 0.0))
        except RowError as error:
            refused.append(_refusal(plateau, error))


def _rows(
    measured: Sequence[MeasuredPlateau], unmoved: Unmoved, identity: Identity, refused: list[str]
) -> Iterator[Row]:
    """Yields the rows of pauses and presses; adds presses without a known zero to `refused`.

    The presses between two pauses follow when the second pause is found, before its row. Raises RefusedError where the
    pad moved.
    """
    opening: MeasuredPlateau | None = None  # the last pause
    presses: list[MeasuredPlateau] = []
    number = 0
    for each in measured:
        if not _is_pause(each, opening, unmoved):
            presses.append(each)
            continue
        problem = _zero_problem(opening, each)
        refused += [_refusal(press.plateau, problem) for press in presses if problem]
        for press in presses if not problem else ():
            assert opening is not None
            number += 1
            force_n = press.logged_n - _zero_n(opening, each, press.plateau.begun_s)
            yield row_of(_press(number, press.plateau, force_n), press.averaged, force_n, unmoved.mounting, identity)
        yield row_of(_press(UNTOUCHED, each.plateau, 0.0), each.averaged, 0.0, unmoved.mounting, identity)
        opening, presses = each, []
    if measured and opening is None:
        unmoved.require(min(measured, key=lambda each: each.logged_n).averaged)
    refused += [_refusal(press.plateau, "no pause after it gives the log's zero") for press in presses]


def _is_pause(measured: MeasuredPlateau, opening: MeasuredPlateau | None, unmoved: Unmoved) -> bool:
    """Whether nothing touches the pad. opening: the last pause. Raises RefusedError where the pad moved since then."""
    if opening is None:
        try:
            unmoved.require(measured.averaged)
        except RefusedError:
            return False
        return True
    if measured.logged_n - opening.logged_n <= ZERO_DRIFT_N:
        unmoved.require(measured.averaged)
        return True
    try:
        require_touched(measured.averaged, opening.averaged)
    except (
        RowError
    ):  # the log shows a force, but the pad feels none: the zero jumped, or the rod presses beside the pad
        return True
    return False


def _zero_problem(opening: MeasuredPlateau | None, closing: MeasuredPlateau) -> str:
    """Why the log's zero, and so the force of presses between these pauses, is not known; "" where it is."""
    if opening is None:
        return "no pause before it gives the log's zero"
    jump_n = closing.logged_n - opening.logged_n
    if abs(jump_n) <= ZERO_DRIFT_N:
        return ""
    return (
        f"by its field the pad is untouched before and after, but the log's force changed by {jump_n:+.3f} N (limit "
        f"{ZERO_DRIFT_N:g} N): was the gauge tared meanwhile, or does the rod press beside the pad?"
    )


def _zero_n(opening: MeasuredPlateau, closing: MeasuredPlateau, at_s: float) -> float:
    """The log's zero at a time between two pauses, interpolated."""
    times_s = [opening.plateau.begun_s, closing.plateau.begun_s]
    return float(np.interp(at_s, times_s, [opening.logged_n, closing.logged_n]))


def _press(number: int, plateau: Plateau, force_n: float) -> Press:
    return Press(number, plateau.x_mm * 1e-3, plateau.y_mm * 1e-3, force_n)


def _refusal(plateau: Plateau, why: object) -> str:
    return f"at {plateau.begun_s:.1f} s of the log: {why}"


def _first_of(refused: Sequence[str]) -> str:
    return refused[0] if refused else "does the log stand still for long enough, and were frames recorded meanwhile?"


def _read_by(other: str, recording: Path) -> tuple[Log, float]:
    """The forces that a pad read, and the median of their deviations as shares. Raises RefusedError."""
    rows, shares = [], []
    try:
        for recorded in read(recording):
            one = recorded.message
            if not isinstance(one, ContactMessage) or recorded.pad != other or one.health != "ok":
                continue
            if one.contact is False:  # null is not "untouched"
                rows.append((one.t_sample_ns * 1e-9, 0.0))
            elif one.contact and one.force_n is not None and one.force_sd_n is not None and not one.over_range:
                rows.append((one.t_sample_ns * 1e-9, one.force_n))
                shares.append(one.force_sd_n / one.force_n)
    except RecordingError as error:
        raise RefusedError(str(error)) from error
    if len(shares) < FEWEST_READINGS:
        raise RefusedError(
            f"{recording}: pad '{other}' reads no force in it: press both pads on one peg, as wide as a finger, "
            "while `fmfts-daemon record` runs, and name the pad that was weighed"
        )
    time_s, force_n = np.array(sorted(rows)).T
    _, first = np.unique(time_s, return_index=True)
    return Log(time_s[first], np.full((len(first), 2), np.nan), force_n[first]), round(float(np.median(shares)), 4)


def _frames(recording: Path, pad: PadConfig) -> Sequence[Frame]:
    chip = CHIPS[pad.source.chip]
    try:
        with damage_told(RecordingError, f"{recording}: a frame of pad '{pad.name}' is damaged"):
            frames = [
                frame_of(recorded.message, chip=chip)
                for recorded in read(recording)
                if isinstance(recorded.message, FrameMessage) and recorded.pad == pad.name
            ]
    except RecordingError as error:
        raise RefusedError(str(error)) from error
    if not frames:
        raise RefusedError(f"{recording}: holds no frame of pad '{pad.name}'")
    return frames
