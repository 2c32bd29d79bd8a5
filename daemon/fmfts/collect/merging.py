"""`collect --merge`: what another machine logged, and what a recording holds of the pad, become a table."""

from __future__ import annotations

import hashlib
from bisect import bisect_left
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fmfts.bus.messages import FrameMessage
from fmfts.collect.average import RowError, average
from fmfts.collect.errors import RefusedError
from fmfts.collect.merge import align, plateaus, read_log
from fmfts.collect.plan import Press
from fmfts.collect.session import Identity, row_of
from fmfts.collect.table import FORMAT, UNTOUCHED, Header, Table
from fmfts.collect.work import unmoved_since_baseline
from fmfts.config import Config, PadConfig
from fmfts.frame_message import frame_of
from fmfts.record.file import RecordingError, read
from fmfts.sensor import Frame


def merge(config: Config, pad: PadConfig, log_path: Path, recording: Path, output: Path) -> dict[str, Any]:
    """Write `output` anew; facts of it. RefusedError where log and recording make no table."""
    if output.exists():
        raise RefusedError(f"{output} exists already: give another file with -o, or remove that one")
    settings, drawing = config.collect, pad.pad()
    unmoved = unmoved_since_baseline(drawing, settings)
    log, frames = read_log(log_path), _frames(recording, pad.name)
    mounting = unmoved.mounting
    alignment = align(log, frames, (mounting.rest_field_t + mounting.offset_t) * mounting.gain)
    times_ns = [frame.host_time_ns for frame in frames]
    fingerprint = hashlib.sha256(log_path.read_bytes()).hexdigest()[:12]
    header = Header(FORMAT, log_path.name, fingerprint, pad.name, drawing.geometry_hash)
    identity = Identity(unmoved.baseline_id, pad.name, "", str(recording))
    refused: list[str] = []
    with Table(output, len(drawing.sensors), header) as table:
        for plateau in plateaus(log, settings.average_s):
            begin, end = (
                bisect_left(times_ns, round((at_s + alignment.lag_s) * 1e9))
                for at_s in (plateau.begun_s, plateau.ended_s)
            )
            try:
                averaged = average(frames[begin:end], (), 0.0)
            except RowError as error:
                refused.append(f"at {plateau.begun_s:.1f} s of the log: {error}")
                continue
            if plateau.untouched:
                unmoved.require(averaged)
            number = UNTOUCHED if plateau.untouched else len(table.done) + 1
            force_n = 0.0 if plateau.untouched else plateau.force_n
            press = Press(number, plateau.x_mm * 1e-3, plateau.y_mm * 1e-3, force_n)
            table.add(row_of(press, averaged, force_n, mounting, identity))
        return {
            "collected": len(table.done),
            "refused": refused,
            "lag_s": alignment.lag_s,
            "correlation": alignment.correlation,
            "table": str(output),
        }


def _frames(recording: Path, pad: str) -> Sequence[Frame]:
    try:
        frames = [
            frame_of(recorded.message)
            for recorded in read(recording)
            if isinstance(recorded.message, FrameMessage) and recorded.pad == pad
        ]
    except RecordingError as error:
        raise RefusedError(str(error)) from error
    if not frames:
        raise RefusedError(f"{recording}: holds no frame of pad '{pad}'")
    return frames
