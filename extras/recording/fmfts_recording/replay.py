"""Processes a recording's frames again, and compares the contacts; they are the same bit for bit if nothing changed."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from fmfts.baseline import Baseline
from fmfts.bus.frame_message import early_of, frame_of
from fmfts.bus.messages import ContactMessage, EarlyMessage, FrameMessage, StateMessage
from fmfts.common.reading import damage_told
from fmfts.config import PadConfig
from fmfts.contact import ModelError
from fmfts.contact.no_model import NO_MODEL, no_model_for
from fmfts.contact.shipped import SHIPPED_PATHS
from fmfts.pipeline.configured import (
    AnyModel,
    Pipeline,
    feel_neighbours,
    load_any_model,
    pipeline_of,
)
from fmfts.pipeline.encoded import message_of
from fmfts.pipeline.snapshot import restore
from fmfts_recording.file import RecordingError, is_whole, read
from fmfts_recording.pad_config import recorded_pad

Key = tuple[str, str, int]  # boot, pad, number
# Health of contacts that the source's silence causes, not a frame: a replay repeats them as recorded.
SILENT = ("stale", "disconnected")
# Fields that differ in every run.
FIELDS_OF_A_RUN = ("boot", "t_publish_ns", "utc_ns")


def essence(contact: ContactMessage) -> dict[str, Any]:
    """The fields of a contact that a replay must repeat: all but the run and the time of sending."""
    return {key: value for key, value in msgspec.to_builtins(contact).items() if key not in FIELDS_OF_A_RUN}


@dataclass(slots=True)
class Comparison:
    """Compares recorded contacts with replayed ones. different: (pad, number, names of the fields that differ)."""

    identical: int = 0
    different: list[tuple[str, int, list[str]]] = field(default_factory=list)
    _recorded: dict[Key, ContactMessage] = field(default_factory=dict)  # not replayed yet
    _replayed: dict[Key, ContactMessage] = field(default_factory=dict)  # not recorded yet
    _compared: dict[tuple[str, str], tuple[int, int]] = field(default_factory=dict)  # (boot, pad) → first, last number

    def recorded(self, contact: ContactMessage) -> None:
        self._add(contact, self._recorded, self._replayed)

    def replayed(self, contact: ContactMessage) -> None:
        self._add(contact, self._replayed, self._recorded)

    def _add(
        self, contact: ContactMessage, waiting: dict[Key, ContactMessage], others: dict[Key, ContactMessage]
    ) -> None:
        """Compares the contact with its counterpart, or keeps it until that arrives."""
        key = (contact.boot, contact.pad, contact.seq)
        other = others.pop(key, None)
        if other is None:
            waiting[key] = contact
            return
        first, last = self._compared.get(key[:2], (contact.seq, contact.seq))
        self._compared[key[:2]] = min(first, contact.seq), max(last, contact.seq)
        one, two = essence(contact), essence(other)
        if one == two:
            self.identical += 1
        else:
            # Either may have additional keys: pads with several magnets have more.
            names = [name for name in one | two if name not in one or name not in two or one[name] != two[name]]
            self.different.append((contact.pad, contact.seq, names))

    @property
    def alone(self) -> int:
        """Number of contacts without a counterpart; there are some at both ends of a recording."""
        return len(self._recorded) + len(self._replayed)

    @property
    def unreplayed(self) -> int:
        """Number of recorded contacts, between the first and the last compared one, that the replay did not give."""
        ranges = [(self._compared.get(key[:2]), key[2]) for key in self._recorded]
        return sum(compared is not None and compared[0] < number < compared[1] for compared, number in ranges)

    @property
    def is_the_same(self) -> bool:
        """Were all compared contacts identical, and none missing? False where nothing could be compared."""
        return self.identical > 0 and not self.different and not self.unreplayed


class Replay:
    """A replay of all pads of a recording. model_paths: files of contact models to use besides those that ship.

    Raises RecordingError where the recording has no state, or was made with none of these models.
    """

    def __init__(self, path: Path, model_paths: Sequence[str] = ()) -> None:
        self.path = path
        self.comparison = Comparison()
        self._model_paths = (*SHIPPED_PATHS, *model_paths)
        self._pipelines: dict[str, Pipeline] = {}
        self._boot = ""
        self._first: dict[str, dict[str, StateMessage]] = {}  # boot → pad → first state
        self._silences: dict[tuple[str, str, int], ContactMessage] = {}
        self._digest = hashlib.sha256()
        for one in read(path):
            if isinstance(one.message, StateMessage):
                self._first.setdefault(one.message.boot, {}).setdefault(one.pad, one.message)
            elif isinstance(one.message, ContactMessage) and one.message.health in SILENT:
                self._silences[one.message.boot, one.pad, one.message.seq] = one.message
        if not self._first:
            cut = "" if is_whole(path) else ", up to where it is cut off"
            raise RecordingError(
                f"{path} holds no state of a pad{cut}: make a recording with `fmfts-daemon record` while frames arrive"
            )

    def contacts(self) -> Iterator[ContactMessage]:
        """Yields the contact of each frame, as the pipeline computes it now."""
        for contact in self._contacts():
            self._digest.update(msgspec.json.encode(essence(contact)))
            yield contact

    def _contacts(self) -> Iterator[ContactMessage]:
        for one in read(self.path):
            message = one.message
            if isinstance(message, StateMessage):
                self._put(message)
            elif isinstance(message, FrameMessage | EarlyMessage):
                if one.pad in self._pipelines and (isinstance(message, EarlyMessage) or message.used):
                    yield from self._replayed(self._pipelines[one.pad], message)
            elif isinstance(message, ContactMessage):
                self.comparison.recorded(message)

    def facts(self) -> dict[str, Any]:
        """The result of the comparison; call it after the last contact."""
        compared, whole = self.comparison, is_whole(self.path)
        return {
            "recording": str(self.path) + ("" if whole else " (cut off: its last chunk is missing)"),
            "pads": sorted(self._pipelines),
            "identical": compared.identical,
            "different": len(compared.different),
            "first_differences": [f"{pad} {seq}: {', '.join(names)}" for pad, seq, names in compared.different[:3]],
            "unreplayed": compared.unreplayed,
            "without_their_other": compared.alone,
            "sha256": self._digest.hexdigest(),  # digest of all replayed contacts; the same on every processor
        }

    def _replayed(self, pipeline: Pipeline, message: FrameMessage | EarlyMessage) -> Iterator[ContactMessage]:
        while (silence := self._silences.get((self._boot, message.pad, pipeline.messages + 1))) is not None:
            contact = pipeline.absent(silence.health, silence.reason)
            self.comparison.replayed(contact)
            yield contact
        chip = pipeline.pad.chip
        if isinstance(message, EarlyMessage):
            with damage_told(RecordingError, f"{self.path}: an early sample of pad '{message.pad}' is damaged"):
                answer = pipeline.early(early_of(message, chip))
            if answer is None:
                return
            contact = message_of(answer)
        else:
            with damage_told(
                RecordingError, f"{self.path}: frame {message.sequence} of pad '{message.pad}' is damaged"
            ):
                contact = pipeline.process(frame_of(message, chip=chip))
        self.comparison.replayed(contact)
        yield contact

    def _put(self, state: StateMessage) -> None:
        """Sets the pad's pipeline to a recorded state."""
        if state.boot != self._boot:
            self._boot, self._pipelines = state.boot, {}
            self._build(list(self._first[state.boot].values()))
        pipeline = self._pipelines[state.pad]
        with self._errors_of(state):
            baseline = None if state.baseline is None else msgspec.convert(state.baseline, Baseline)
            if baseline is not None and (pipeline.baseline is None or pipeline.baseline.id != baseline.id):
                pipeline.use(baseline)
            restore(pipeline, state.memory)

    @contextmanager
    def _errors_of(self, state: StateMessage) -> Iterator[None]:
        """Turns errors that a damaged state causes into RecordingError."""
        with damage_told(
            RecordingError,
            f"{self.path}: the state of pad '{state.pad}' is damaged or another version's: replay it with the daemon "
            "that made it",
        ):
            yield

    def _build(self, states: list[StateMessage]) -> None:
        """Makes all pads' pipelines at once, because neighbours use each other's poses from the first frame on."""
        configs = []
        for state in states:
            with self._errors_of(state):
                configs.append(recorded_pad(state.config))
                model = self._model(configs[-1], state)
                self._pipelines[state.pad] = pipeline_of(configs[-1], model, state.boot)
        for config, state in zip(configs, states, strict=True):
            with self._errors_of(state):
                feel_neighbours(config, configs, self._pipelines)
        for state in states:
            self._put(state)

    def _model(self, config: PadConfig, state: StateMessage) -> AnyModel:
        """The contact model with the recorded hash. Never opens a path that is written in the recording."""
        if state.model == NO_MODEL:
            return no_model_for(config.contact.model, 1 + len(config.other_magnets))
        model: AnyModel
        for path in self._model_paths:
            try:
                model = load_any_model(config, path)
            except ModelError:
                continue
            if model.hash == state.model:
                return model
        raise RecordingError(
            f"{self.path}: pad '{state.pad}' was recorded with contact model {state.model}: --model FILE"
        )
