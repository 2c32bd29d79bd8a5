"""Plays a recording in place of a device: its frames come at the times of their arrival."""

from __future__ import annotations

import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from fmfts.bus.frame_message import frame_of as frame_of
from fmfts.bus.messages import FrameMessage, StateMessage
from fmfts.common.reading import damage_told, shortened
from fmfts.config import PadConfig, ReplaySource
from fmfts.sensor.chips import CHIPS
from fmfts.sensor.frame import Frame
from fmfts.sensor.source import CannotError, SourceError, SourceState
from fmfts_recording.file import RecordingError, read_in_parts
from fmfts_recording.pad_config import recorded_pad

# After a longer stall of this computer, playing continues at the same frame, later.
LONGEST_STALL_NS = 100_000_000
# The most that one poll reads, and returns for each pad. A recording of another program, or one that was made to
# hold up the other pads, may have seconds of other records between two frames, or all frames at one time.
LONGEST_READING_NS, MOST_FRAMES_OF_A_PAD = 1_000_000, 8
# A message that is played: a frame of 64 sensors has 6 kB, a state 16 kB. Nested values take 150 ns a byte to decode.
LARGEST_PLAYED = 1 << 16
# How many parts of the file a pad's state is looked for in: half a gigabyte, or half a million small messages.
MOST_LOOKED_THROUGH = 8192
# Nine years on the clock of the recording host, which began with its boot. A tenth of `speed` makes it ninety, and sums
# of these numbers still fit into 64 bits.
LATEST_NS, LATEST_US, LAST_SEQUENCE = 1 << 58, 1 << 61, 1 << 61


@dataclass(frozen=True, slots=True)
class _NextFrame:
    """The next frame. recorded_ns: its time on the recording host's clock, continued through all laps."""

    frame: Frame
    recorded_ns: int


class Replayed:
    """A Source of one recording, for those of its pads that the config names; they stay synchronous.

    states: the recorded state of each pad before its first frame, by pad index. If a recording has several runs of the
    daemon, the first run with all these pads is played.
    """

    def __init__(self, pads: Mapping[int, PadConfig]) -> None:
        """Raises SourceError: no recording, no such pad in it, or a pad of another structure than the config's."""
        source = _source_of(next(iter(pads.values())))
        self._path, self._loop, self._speed = Path(source.file), source.loop, source.speed
        self._indices = {_source_of(pad).pad or pad.name: index for index, pad in pads.items()}
        if len(self._indices) < len(pads):
            names = ", ".join(pad.name for pad in pads.values())
            raise SourceError(f"two of the pads {names} are the same pad of {self._path}: set another source.pad")
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
        self._next: _NextFrame | None = None
        self._is_reading = True  # towards the next frame
        self._start_ns = 0
        self._first_ns: int | None = None

    def fileno(self) -> None:
        return None

    def deadline_ns(self) -> int | None:
        if self._is_reading:
            return 0
        return None if self._next is None else self._due_ns(self._next)

    def poll(self, now_ns: int) -> Sequence[Frame]:
        """The frames that are due. The source disconnects where the recording ends or is damaged."""
        until_ns = time.monotonic_ns() + LONGEST_READING_NS
        if self._is_reading:
            self._advance(now_ns, until_ns)
        if self._first_ns is None and self._next is not None:
            self._start_ns, self._first_ns = now_ns, self._next.recorded_ns
        if self._next is not None and (late_ns := now_ns - self._due_ns(self._next)) > LONGEST_STALL_NS:
            self._start_ns += late_ns
        frames: list[Frame] = []
        most = MOST_FRAMES_OF_A_PAD * len(self._indices)
        while self._next is not None and len(frames) < most and (due_ns := self._due_ns(self._next)) <= now_ns:
            frames.append(replace(self._next.frame, host_time_ns=due_ns))
            self._advance(now_ns, until_ns)
        return frames

    def request_selftest(self, pad_index: int) -> None:
        raise CannotError(f"{self.state.description}: there are no chips to test")

    def selftest_result(self, pad_index: int) -> dict[str, object] | None:
        return None

    def close(self) -> None:
        self._played.close()
        self._next, self._is_reading = None, False
        self.state.connected, self.state.reason = False, "closed"

    def _due_ns(self, frame: _NextFrame) -> int:
        return self._start_ns + round((frame.recorded_ns - (self._first_ns or 0)) / self._speed)

    def _advance(self, now_ns: int, until_ns: int) -> None:
        """Read on to the next frame, or until then: the next poll goes on. At least one part is read."""
        self._next, self._is_reading = None, True
        try:
            for one in self._played:
                self.state.connect(now_ns)
                if one is not None:
                    self._next, self._is_reading = one, False
                if one is not None or time.monotonic_ns() >= until_ns:
                    return
            reason = "it is at its end (loop = true in [pad.source] repeats it)"
        except RecordingError as error:
            reason = str(error)
        self._is_reading = False
        self.state.disconnect(reason, now_ns)

    def _frames(self) -> Generator[_NextFrame | None, None, None]:
        """Yields the frames lap by lap, and None after each part that has none; the clocks and numbers of each lap
        continue those of the lap before."""
        later_ns, numbers = 0, dict.fromkeys(self._indices, 0)
        configs = {index: _config_of(state) for index, state in self.states.items()}
        while True:
            first: dict[str, FrameMessage] = {}
            last: dict[str, FrameMessage] = {}
            for message in self._messages():
                if message is None:
                    yield None
                    continue
                last[message.pad] = message
                first.setdefault(message.pad, message)
                index = self._indices[message.pad]
                with damage_told(
                    RecordingError, f"{self._path}: frame {message.sequence} of pad '{message.pad}' is damaged"
                ):
                    frame = replace(
                        frame_of(message, index, CHIPS[configs[index].source.chip]),
                        sequence=message.sequence + numbers[message.pad],
                        device_time_us=message.device_time_us + later_ns // 1000,
                    )
                    recorded_ns = message.host_time_ns + later_ns
                    _require_possible(frame, recorded_ns, len(configs[index].geometry.sensors_mm))
                yield _NextFrame(frame, recorded_ns)
            if not self._loop or not first:
                return
            for name, message in first.items():
                numbers[name] += max(last[name].sequence - message.sequence, 0) + 1
            lasted_ns = max(last[name].host_time_ns - message.host_time_ns for name, message in first.items())
            later_ns += max(lasted_ns, 0) + round(1e9 / min(each.source.rate_hz for each in configs.values()))

    def _messages(self) -> Iterator[FrameMessage | None]:
        """Yields the frames of the pads that are played, and None after each part of the file."""
        for one in read_in_parts(self._path, ("frame", "state"), LARGEST_PLAYED):
            if one is None:
                yield None
                continue
            message = one.message
            if one.pad not in self._indices or message.boot != self._boot:
                continue
            if isinstance(message, FrameMessage):
                yield message
            elif isinstance(message, StateMessage) and message.baseline != self.states[self._indices[one.pad]].baseline:
                self.state.warnings[one.pad] = f"from here on, pad '{one.pad}' was recorded with another baseline"


def _source_of(pad: PadConfig) -> ReplaySource:
    assert isinstance(pad.source, ReplaySource)
    return pad.source


def _config_of(state: StateMessage) -> PadConfig:
    return recorded_pad(state.config)


def _first_states(path: Path, names: set[str]) -> dict[str, StateMessage]:
    states_of_runs: dict[str, dict[str, StateMessage]] = {}
    parts, searched = 0, str(path)
    for one in read_in_parts(path, ("state",)):
        if one is None:
            parts += 1
            if parts > MOST_LOOKED_THROUGH:
                searched = f"the beginning of {path}"
                break
        elif isinstance(one.message, StateMessage):
            states = states_of_runs.setdefault(one.message.boot, {})
            states.setdefault(one.pad, one.message)
            if names <= states.keys():
                return {name: states[name] for name in names}
    present = sorted({name for states in states_of_runs.values() for name in states})
    if not present:
        raise SourceError(
            f"{searched} holds no frames of a pad: make a recording with `fmfts-daemon record` while frames arrive"
        )
    missing = ", ".join(sorted(names - set(present))) or f"all of {', '.join(sorted(names))} at one time"
    raise SourceError(f"{searched} holds no pad {missing}, but {', '.join(present)}: set source.pad to one of these")


def _require_same_structure(pad: PadConfig, state: StateMessage, path: Path) -> None:
    with damage_told(SourceError, f"{path}: its configuration of pad '{state.pad}' is not of this version"):
        recorded = _config_of(state)
        recorded_hash = recorded.pad().geometry_hash
    if recorded_hash != pad.pad().geometry_hash:
        geometry, magnet = (shortened(str(msgspec.to_builtins(each))) for each in (recorded.geometry, recorded.magnet))
        raise SourceError(
            f"pad '{pad.name}': {path} was recorded from a pad of another structure: its [pad.geometry] is "
            f"{geometry}, its [pad.magnet] {magnet}"
        )
    for key in ("rate_hz", "chip"):
        value = getattr(recorded.source, key)
        if getattr(pad.source, key) != value:
            shown = f'"{value}"' if isinstance(value, str) else value
            raise SourceError(f"pad '{pad.name}': {path} was recorded with {key} = {shown}: set it in [pad.source]")


def _require_possible(frame: Frame, recorded_ns: int, sensors: int) -> None:
    """ValueError unless a pad with this many sensors can have given the frame."""
    if len(frame.counts) != sensors:
        raise ValueError(f"it is of {len(frame.counts)} sensors, the pad has {sensors}")
    latest = ((recorded_ns, LATEST_NS), (frame.device_time_us, LATEST_US), (frame.sequence, LAST_SEQUENCE))
    if any(abs(number) > most for number, most in latest):
        raise ValueError("its time or its number is impossible")
