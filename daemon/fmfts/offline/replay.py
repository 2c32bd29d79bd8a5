"""A recording's frames through the pipeline once more: the same contacts, bit for bit, where nothing else changed."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from fmfts.baseline import Baseline, BaselineError
from fmfts.bus.messages import ContactMessage, FrameMessage, StateMessage
from fmfts.config import PadConfig
from fmfts.contact import ContactModel, ModelError
from fmfts.contact.shipped import SHIPPED_PATHS
from fmfts.pipeline.configured import model_of
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.pipeline.snapshot import restore
from fmfts.pose import SOLVER
from fmfts.recording.file import RecordingError, is_whole, read
from fmfts.recording.source import frame_of
from fmfts.scene.tracking import around, choose
from fmfts.sensor.chips import CHIPS

Key = tuple[str, str, int]  # boot, pad, number
# What is said while no frame can be used comes of the source's silence, which is no frame: it is taken as it was.
SILENT = ("stale", "disconnected")
# What arithmetic on a state says where it is not one.
OF_A_WRONG_VALUE = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError)
# A contact's own time of leaving.
OF_THE_MOMENT = ("boot", "t_publish_ns", "utc_ns")


def essence(contact: ContactMessage) -> dict[str, Any]:
    """All of it but the run and the moment of sending."""
    return {key: value for key, value in msgspec.to_builtins(contact).items() if key not in OF_THE_MOMENT}


@dataclass(slots=True)
class Comparison:
    """Recorded contacts beside replayed ones. different: pad, number, and the fields of the first few that differ."""

    identical: int = 0
    different: list[tuple[str, int, list[str]]] = field(default_factory=list)
    _recorded: dict[Key, ContactMessage] = field(default_factory=dict)  # without their other, up to now
    _replayed: dict[Key, ContactMessage] = field(default_factory=dict)
    _compared: dict[tuple[str, str], tuple[int, int]] = field(default_factory=dict)  # boot, pad: first and last number

    def recorded(self, contact: ContactMessage) -> None:
        self._add(contact, self._recorded, self._replayed)

    def replayed(self, contact: ContactMessage) -> None:
        self._add(contact, self._replayed, self._recorded)

    def _add(
        self, contact: ContactMessage, waiting: dict[Key, ContactMessage], others: dict[Key, ContactMessage]
    ) -> None:
        """They are compared when both are there."""
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
            self.different.append((contact.pad, contact.seq, [name for name in one if one[name] != two[name]]))

    @property
    def alone(self) -> int:
        """Contacts of one kind without their other: at both ends of a recording there are some."""
        return len(self._recorded) + len(self._replayed)

    @property
    def unreplayed(self) -> int:
        """Recorded contacts between the first and the last that were compared that no frame gave again."""
        ranges = [(self._compared.get(key[:2]), key[2]) for key in self._recorded]
        return sum(compared is not None and compared[0] < number < compared[1] for compared, number in ranges)

    @property
    def is_the_same(self) -> bool:
        """False also where nothing could be compared."""
        return self.identical > 0 and not self.different and not self.unreplayed


class Replay:
    """The pads of a recording. model_paths: where to look for contact models besides those that ship.

    RecordingError where it holds no state, or another model than these made it.
    """

    def __init__(self, path: Path, model_paths: Sequence[str] = ()) -> None:
        self.path = path
        self.comparison = Comparison()
        self._model_paths = (*SHIPPED_PATHS, *model_paths)
        self._pipelines: dict[str, PadPipeline] = {}
        self._boot = ""
        self._first: dict[str, dict[str, StateMessage]] = {}  # boot → pad → its first state
        self._silences: dict[tuple[str, str, int], ContactMessage] = {}
        self.solvers: set[str] = set()
        self._digest = hashlib.sha256()
        for one in read(path):
            if isinstance(one.message, StateMessage):
                self._first.setdefault(one.message.boot, {}).setdefault(one.pad, one.message)
                self.solvers.add(one.message.solver)
            elif isinstance(one.message, ContactMessage) and one.message.health in SILENT:
                self._silences[one.message.boot, one.pad, one.message.seq] = one.message
        if not self._first:
            cut = "" if is_whole(path) else ", as far as it goes before it is cut off"
            raise RecordingError(
                f"{path} holds no state of a pad{cut}: `fmfts-daemon record` while frames come makes one"
            )

    def contacts(self) -> Iterator[ContactMessage]:
        """What the pipeline makes of each frame."""
        for contact in self._contacts():
            self._digest.update(msgspec.json.encode(essence(contact)))
            yield contact

    def _contacts(self) -> Iterator[ContactMessage]:
        for one in read(self.path):
            message = one.message
            if isinstance(message, StateMessage):
                self._put(message)
            elif isinstance(message, FrameMessage) and message.used and one.pad in self._pipelines:
                yield from self._replayed(self._pipelines[one.pad], message)
            elif isinstance(message, ContactMessage):
                self.comparison.recorded(message)

    def facts(self) -> dict[str, Any]:
        """Of the comparison, after the last contact."""
        compared, whole = self.comparison, is_whole(self.path)
        return {
            "recording": str(self.path) + ("" if whole else " (cut off: its last chunk is missing)"),
            "pads": sorted(self._pipelines),
            "identical": compared.identical,
            "different": len(compared.different),
            "first_differences": [f"{pad} {seq}: {', '.join(names)}" for pad, seq, names in compared.different[:3]],
            "unreplayed": compared.unreplayed,
            "without_their_other": compared.alone,
            "recorded_with": sorted(self.solvers),
            "replayed_with": SOLVER,
            "sha256": self._digest.hexdigest(),  # of all that was replayed, the same on every processor
        }

    def _replayed(self, pipeline: PadPipeline, message: FrameMessage) -> Iterator[ContactMessage]:
        while (silence := self._silences.get((self._boot, message.pad, pipeline.messages + 1))) is not None:
            contact = pipeline.absent(silence.health, silence.reason)
            self.comparison.replayed(contact)
            yield contact
        contact = pipeline.process(frame_of(message, chip=pipeline.pad.chip))
        self.comparison.replayed(contact)
        yield contact

    def _put(self, state: StateMessage) -> None:
        """From here on as the daemon stood there."""
        if state.boot != self._boot:
            self._boot, self._pipelines = state.boot, {}
            self._build(list(self._first[state.boot].values()))
        pipeline = self._pipelines[state.pad]
        with self._believed(state):
            baseline = None if state.baseline is None else msgspec.convert(state.baseline, Baseline)
            if baseline is not None and (pipeline.baseline is None or pipeline.baseline.id != baseline.id):
                pipeline.use(baseline)
            restore(pipeline, state.memory)

    @contextmanager
    def _believed(self, state: StateMessage) -> Iterator[None]:
        """While work is done with what a state says, which may be anything."""
        try:
            yield
        except (msgspec.MsgspecError, BaselineError, *OF_A_WRONG_VALUE) as error:
            raise RecordingError(
                f"{self.path}: the state of pad '{state.pad}' is damaged or another version's: "
                f"{type(error).__name__}: {error}: replay it with the daemon that made it"
            ) from error

    def _build(self, states: list[StateMessage]) -> None:
        """All pads at once: neighbours count with each other from their first frame on."""
        configs = []
        for state in states:
            with self._believed(state):
                configs.append(msgspec.convert(state.config, PadConfig))
                self._pipelines[state.pad] = self._pipeline(configs[-1], state)
        for config, state in zip(configs, states, strict=True):
            with self._believed(state):
                for neighbour in around(config, configs):
                    if neighbour.is_felt:
                        self._pipelines[config.name].feel(self._pipelines[neighbour.name], neighbour.placement)
        for state in states:
            self._put(state)

    def _pipeline(self, config: PadConfig, state: StateMessage) -> PadPipeline:
        scene = choose(config.scene, config.magnet, CHIPS[config.source.chip])
        return PadPipeline(config.pad(), self._model(config, state), state.boot, config.source.rate_hz, scene.tracking)

    def _model(self, config: PadConfig, state: StateMessage) -> ContactModel:
        """By its hash: no path that stands in a recording is ever opened."""
        for path in self._model_paths:
            try:
                model = model_of(config, path)
            except ModelError:
                continue
            if model.hash == state.model:
                return model
        raise RecordingError(
            f"{self.path}: pad '{state.pad}' was recorded with contact model {state.model}: --model FILE"
        )
