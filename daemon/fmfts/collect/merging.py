"""`collect --merge`: what another machine logged, and what a recording holds of the pad, become a table."""

from __future__ import annotations

import hashlib
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fmfts.bus.frame_message import frame_of
from fmfts.bus.messages import FrameMessage
from fmfts.collect.alignment import Alignment, align
from fmfts.collect.average import Averaged, RowError, Unmoved, average, require_touched
from fmfts.collect.errors import RefusedError
from fmfts.collect.gauge import Reading
from fmfts.collect.machine_log import Log, Plateau, plateaus, read_log
from fmfts.collect.plan import Press
from fmfts.collect.session import Identity, row_of
from fmfts.collect.table import FORMAT, UNTOUCHED, Header, Row, Table
from fmfts.collect.work import averaging_s, unmoved_since_baseline
from fmfts.config import Config, PadConfig
from fmfts.recording.file import RecordingError, read
from fmfts.sensor import Frame
from fmfts.sensor.chips import CHIPS

ZERO_DRIFT_N = 0.05  # of the log from one pause to the next, its rod up; more is a press, or no zero to believe


@dataclass(frozen=True, slots=True)
class Stand:
    """A plateau and what was heard meanwhile; force_n of `heard` is by the log's own zero."""

    plateau: Plateau
    heard: Averaged

    @property
    def logged_n(self) -> float:
        assert self.heard.force_n is not None
        return self.heard.force_n


def merge(config: Config, pad: PadConfig, log_path: Path, recording: Path, output: Path) -> dict[str, Any]:
    """Write `output` anew; facts of it. RefusedError where log and recording make no table."""
    if output.exists():
        raise RefusedError(f"{output} exists already: give another file with -o, or remove that one")
    settings, drawing = config.collect, pad.pad()
    unmoved = unmoved_since_baseline(drawing, settings)
    log, frames = read_log(log_path), _frames(recording, pad)
    mounting = unmoved.mounting
    alignment = align(log, frames, (mounting.rest_field_t + mounting.offset_t) * mounting.gain)
    found = plateaus(log, settings.settle_s, averaging_s(settings, pad))
    refused: list[str] = []
    stands = list(_heard(found, log, frames, alignment, refused))
    identity = Identity(unmoved.baseline_id, pad.name, "", str(recording))
    rows = list(_rows(stands, unmoved, identity, refused))
    collected = sum(row.press != UNTOUCHED for row in rows)
    if not collected:
        raise RefusedError(f"{log_path} and {recording} make no row of {len(found)} plateaus: {_first_of(refused)}")
    fingerprint = hashlib.sha256(log_path.read_bytes()).hexdigest()[:12]
    header = Header(FORMAT, log_path.name, fingerprint, pad.name, drawing.geometry_hash)
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


def _heard(
    found: Sequence[Plateau], log: Log, frames: Sequence[Frame], alignment: Alignment, refused: list[str]
) -> Iterator[Stand]:
    """The plateaus of which the recording has a steady field; `refused` gets the others."""
    times_ns = [frame.host_time_ns for frame in frames]
    for plateau in found:
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
            yield Stand(plateau, average(frames[begin:end], readings, 0.0))
        except RowError as error:
            refused.append(_told(plateau, error))


def _rows(stands: Sequence[Stand], unmoved: Unmoved, identity: Identity, refused: list[str]) -> Iterator[Row]:
    """Each pause's and each press's, in their order; `refused` gets the others. RefusedError where the pad moved."""
    opening: Stand | None = None
    presses: list[Stand] = []
    number = 0
    for stand in stands:
        if not _is_pause(stand, opening, unmoved):
            presses.append(stand)
            continue
        why = _no_zero(opening, stand)
        refused += [_told(press.plateau, why) for press in presses if why]
        for press in presses if not why else ():
            assert opening is not None
            number += 1
            force_n = press.logged_n - _zero_n(opening, stand, press.plateau.begun_s)
            yield row_of(_press(number, press.plateau, force_n), press.heard, force_n, unmoved.mounting, identity)
        yield row_of(_press(UNTOUCHED, stand.plateau, 0.0), stand.heard, 0.0, unmoved.mounting, identity)
        opening, presses = stand, []
    if stands and opening is None:
        unmoved.require(min(stands, key=lambda stand: stand.logged_n).heard)
    refused += [_told(press.plateau, "no pause follows that tells the log's zero") for press in presses]


def _is_pause(stand: Stand, opening: Stand | None, unmoved: Unmoved) -> bool:
    """Whether nothing touches the pad; opening: the pause before. RefusedError where the pad moved meanwhile."""
    if opening is None:
        try:
            unmoved.require(stand.heard)
        except RefusedError:
            return False
        return True
    if stand.logged_n - opening.logged_n <= ZERO_DRIFT_N:
        unmoved.require(stand.heard)
        return True
    try:
        require_touched(stand.heard, opening.heard)
    except RowError:  # the zero has jumped, or the rod presses beside the pad: the log's force is none of the pad's
        return True
    return False


def _no_zero(opening: Stand | None, closing: Stand) -> str:
    """Why presses between these pauses have no force, "" where they have."""
    if opening is None:
        return "no pause before it tells the log's zero"
    jump_n = closing.logged_n - opening.logged_n
    if abs(jump_n) <= ZERO_DRIFT_N:
        return ""
    return (
        f"untouched before and after, by its field, the pad is pressed with {jump_n:+.3f} N more by the log (limit "
        f"{ZERO_DRIFT_N:g} N): was the gauge tared meanwhile, or does the rod press beside the pad?"
    )


def _zero_n(opening: Stand, closing: Stand, at_s: float) -> float:
    """The log's zero drifts evenly from pause to pause."""
    times_s = [opening.plateau.begun_s, closing.plateau.begun_s]
    return float(np.interp(at_s, times_s, [opening.logged_n, closing.logged_n]))


def _press(number: int, plateau: Plateau, force_n: float) -> Press:
    return Press(number, plateau.x_mm * 1e-3, plateau.y_mm * 1e-3, force_n)


def _told(plateau: Plateau, why: object) -> str:
    return f"at {plateau.begun_s:.1f} s of the log: {why}"


def _first_of(refused: Sequence[str]) -> str:
    return refused[0] if refused else "does the log stand still for long enough, and were frames recorded meanwhile?"


def _frames(recording: Path, pad: PadConfig) -> Sequence[Frame]:
    chip = CHIPS[pad.source.chip]
    try:
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
