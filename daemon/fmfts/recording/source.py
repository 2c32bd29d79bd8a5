"""A recording in the place of a device: its frames come again in the time in which they once came."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from fmfts.bus.frame_message import frame_of as frame_of
from fmfts.bus.messages import FrameMessage, StateMessage
from fmfts.config import PadConfig, ReplaySource
from fmfts.recording.file import RecordingError, read
from fmfts.sensor.chips import CHIPS
from fmfts.sensor.frame import Frame
from fmfts.sensor.source import SourceError, SourceState

# A recording can wait: what fell due while this computer stood still comes when it goes on.
LONGEST_STALL_NS = 100_000_000


@dataclass(frozen=True, slots=True)
class _Coming:
    """The next frame, its time on the host's clock that it was recorded by counted on through all laps."""

    frame: Frame
    recorded_ns: int


class Replayed:
    """A Source of one recording for those of its pads that a config names; they stay in step. states: by pad index,
    what the recording says of each pad before its first frame.

    Of a file that spans several runs of the daemon, the first that has all these pads is played.
    """

    def __init__(self, pads: Mapping[int, PadConfig]) -> None:
        """SourceError: no recording, no such pad in it, or of another structure than the config's."""
        source = _source_of(next(iter(pads.values())))
        self._path, self._loop, self._speed = Path(source.file), source.loop, source.speed
        self._indices = {_source_of(pad).pad or pad.name: index for index, pad in pads.items()}
        if len(self._indices) < len(pads):
            names = ", ".join(pad.name for pad in pads.values())
            raise SourceError(f"two of the pads {names} are the same pad of {self._path}: say another source.pad")
        try:
            by_name = _first_states(self._path, set(self._indices))
        except RecordingError as error:
            raise SourceError(str(error)) from error
        self.states = {index: by_name[name] for name, index in self._indices.items()}
        self._boot = next(iter(by_name.values())).boot
        for index, pad in pads.items():
            _require_same_structure(pad, self.states[index], self._path)
        self.state = SourceState(description=f"recording {self._path}")
        self._played = self._frames()
        self._next: _Coming | None = None
        self._start_ns: int | None = None
        self._first_ns = 0

    def fileno(self) -> None:
        return None

    def deadline_ns(self) -> int | None:
        if self._start_ns is None:
            return 0
        return None if self._next is None else self._due_ns(self._next)

    def poll(self, now_ns: int) -> Sequence[Frame]:
        """The frames that fell due. At the end of the recording, and where it is damaged, the source disconnects."""
        if self._start_ns is None:
            self._start_ns = now_ns
            self.state.connect(now_ns)
            self._advance(now_ns)
            self._first_ns = 0 if self._next is None else self._next.recorded_ns
        if self._next is not None and (late_ns := now_ns - self._due_ns(self._next)) > LONGEST_STALL_NS:
            self._start_ns += late_ns
        frames = []
        while self._next is not None and (due_ns := self._due_ns(self._next)) <= now_ns:
            frames.append(replace(self._next.frame, host_time_ns=due_ns))
            self._advance(now_ns)
        return frames

    def request_selftest(self, pad_index: int) -> None:
        raise SourceError(f"{self.state.description}: there are no chips to test")

    def selftest_result(self, pad_index: int) -> dict[str, object] | None:
        return None

    def close(self) -> None:
        self._played.close()
        self._next = None
        self.state.connected, self.state.reason = False, "closed"

    def _due_ns(self, coming: _Coming) -> int:
        return (self._start_ns or 0) + round((coming.recorded_ns - self._first_ns) / self._speed)

    def _advance(self, now_ns: int) -> None:
        try:
            self._next = next(self._played, None)
        except RecordingError as error:
            self._next = None
            self.state.disconnect(str(error), now_ns)
            return
        if self._next is None:
            self.state.disconnect("it is at its end (loop = true in [pad.source] begins anew)", now_ns)

    def _frames(self) -> Generator[_Coming, None, None]:
        """Lap by lap; in each the clocks and numbers go on from where the one before ended."""
        later_ns, numbers = 0, dict.fromkeys(self._indices, 0)
        chips = {index: CHIPS[_config_of(state).source.chip] for index, state in self.states.items()}
        while True:
            first: dict[str, FrameMessage] = {}
            last: dict[str, FrameMessage] = {}
            for message in self._messages():
                last[message.pad] = message
                first.setdefault(message.pad, message)
                index = self._indices[message.pad]
                frame = replace(
                    frame_of(message, index, chips[index]),
                    sequence=message.sequence + numbers[message.pad],
                    device_time_us=message.device_time_us + later_ns // 1000,
                )
                yield _Coming(frame, message.host_time_ns + later_ns)
            if not self._loop or not first:
                return
            for name, message in first.items():
                numbers[name] += last[name].sequence - message.sequence + 1
            later_ns += max(last[name].host_time_ns - message.host_time_ns for name, message in first.items())
            later_ns += round(1e9 / min(_config_of(state).source.rate_hz for state in self.states.values()))

    def _messages(self) -> Iterator[FrameMessage]:
        for one in read(self._path):
            message = one.message
            if one.pad not in self._indices or message.boot != self._boot:
                continue
            if isinstance(message, FrameMessage):
                yield message
            elif isinstance(message, StateMessage) and message.baseline != self.states[self._indices[one.pad]].baseline:
                self.state.warnings[one.pad] = f"from here on pad '{one.pad}' had another baseline when it was recorded"


def _source_of(pad: PadConfig) -> ReplaySource:
    assert isinstance(pad.source, ReplaySource)
    return pad.source


def _config_of(state: StateMessage) -> PadConfig:
    return msgspec.convert(state.config, PadConfig)


def _first_states(path: Path, names: set[str]) -> dict[str, StateMessage]:
    of_runs: dict[str, dict[str, StateMessage]] = {}
    for one in read(path):
        if isinstance(one.message, StateMessage):
            states = of_runs.setdefault(one.message.boot, {})
            states.setdefault(one.pad, one.message)
            if names <= states.keys():
                return {name: states[name] for name in names}
    there = sorted({name for states in of_runs.values() for name in states})
    if not there:
        raise SourceError(f"{path} holds no frames of a pad: `fmfts-daemon record` while frames come makes one")
    missing = ", ".join(sorted(names - set(there))) or f"all of {', '.join(sorted(names))} at one time"
    raise SourceError(f"{path} holds no pad {missing}, but {', '.join(there)}: say source.pad = one of these")


def _require_same_structure(pad: PadConfig, state: StateMessage, path: Path) -> None:
    try:
        recorded = _config_of(state)
    except msgspec.ValidationError as error:
        raise SourceError(f"{path}: its configuration of pad '{state.pad}' is not of this version: {error}") from error
    if recorded.pad().geometry_hash != pad.pad().geometry_hash:
        raise SourceError(
            f"pad '{pad.name}': {path} was recorded from a pad of another structure: its [pad.geometry] is "
            f"{msgspec.to_builtins(recorded.geometry)}, its [pad.magnet] {msgspec.to_builtins(recorded.magnet)}"
        )
    for key in ("rate_hz", "chip"):
        theirs = getattr(recorded.source, key)
        if getattr(pad.source, key) != theirs:
            said = f'"{theirs}"' if isinstance(theirs, str) else theirs
            raise SourceError(f"pad '{pad.name}': {path} was recorded with {key} = {said}: say so in [pad.source]")
