"""Records the raw frames of a table's rows in DATA.1.mcap (docs/recording.md).

Each time the work is continued, a new file with the next number begins; a file that was cut off can still be read.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Sequence
from pathlib import Path

import msgspec

from fmfts.baseline import Baseline
from fmfts.bus.frame_message import frame_message
from fmfts.bus.messages import StateMessage
from fmfts.config import PadConfig
from fmfts.contact import ContactModel, ModelError, NoContactModel
from fmfts.contact.array_model import ArrayModel
from fmfts.contact.no_model import NO_MODEL, no_model_for
from fmfts.pipeline.configured import load_array_model, load_contact_model, pipeline_of
from fmfts.pipeline.snapshot import state_message
from fmfts.pose.observable import are_observable
from fmfts.sensor import Frame
from fmfts_collect.clock import Clock
from fmfts_collect.errors import RefusedError
from fmfts_recording.file import RecordingError, RecordingWriter


class Frames:
    """A recording of frames; use it as a context manager. The first `add` makes the file."""

    def __init__(self, table: Path, pad: PadConfig, baseline: Baseline, clock: Clock) -> None:
        self.path = _next_path(table)
        self._pad = pad
        self._baseline = baseline
        self._boot = secrets.token_hex(4)
        self._utc_ahead_ns = time.time_ns() - clock.now_ns()
        self._writer: RecordingWriter | None = None

    def __enter__(self) -> Frames:
        return self

    def __exit__(self, *_: object) -> None:
        if self._writer is not None:
            try:
                self._writer.finish()
            finally:
                self._writer.close()

    def add(self, frames: Sequence[Frame]) -> None:
        """Write frames; they are on the disk when this returns. Raises RefusedError where that fails."""
        try:
            if self._writer is None:
                self._writer = RecordingWriter(self.path)
                state = start_of_replay(self._pad, self._baseline, self._boot)
                if state is not None:
                    self._writer.add("state", self._pad.name, msgspec.to_builtins(state, builtin_types=(bytes,)))
            for frame in frames:
                utc_ns = frame.host_time_ns + self._utc_ahead_ns
                message = frame_message(frame, self._pad.name, self._boot, utc_ns)
                self._writer.add("frame", self._pad.name, msgspec.to_builtins(message))
            self._writer.sync()
        except RecordingError as error:
            raise RefusedError(f"{error}: make room, then go on with the same command") from error


def start_of_replay(pad: PadConfig, baseline: Baseline, boot: str) -> StateMessage | None:
    """The state from which a replay starts; without place and force where no contact model fits the pad.

    None for a pad with several magnets that no table of presses fits, and whose sensors are too few to tell poses.
    """
    model = _fitting_array_model(pad) if pad.other_magnets else _fitting_model(pad)
    if model is None:
        return None
    pipeline = pipeline_of(pad, model, boot)
    pipeline.use(baseline)
    return state_message(pipeline, pad, boot)


def _fitting_model(pad: PadConfig) -> ContactModel | NoContactModel:
    for path in () if pad.contact.model == NO_MODEL else (pad.contact.model, "default"):
        try:
            return load_contact_model(pad, path)
        except ModelError:
            continue
    return no_model_for(pad.contact.model)


def _fitting_array_model(pad: PadConfig) -> ArrayModel | NoContactModel | None:
    for path in () if pad.contact.model == NO_MODEL else (pad.contact.model, "default"):
        try:
            return load_array_model(pad, path)
        except ModelError:
            continue
    magnets = 1 + len(pad.other_magnets)
    is_told = are_observable(magnets, len(pad.geometry.sensors_mm))
    return no_model_for(pad.contact.model, magnets) if is_told else None


def _next_path(table: Path) -> Path:
    number = 1
    while (path := table.with_suffix(f".{number}.mcap")).exists():
        number += 1
    return path
