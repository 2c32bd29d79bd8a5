"""A recording as a source: its frames come once more in their own time, on a clock that the test turns."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from bus_messages import frame_message

from fmfts.bus.messages import FrameMessage, StateMessage
from fmfts.config import GeometryConfig, PadConfig, ReplaySource, SimulatedSource
from fmfts.sensor.source import SourceError
from fmfts.sources import open_sources
from fmfts_recording import source as played_recording
from fmfts_recording.file import RecordingWriter
from fmfts_recording.source import Replayed

COUNT, PERIOD_NS, RATE_HZ, BOOT = 40, 10_000_000, 100, "cafe"
RECORDED = PadConfig(name="left", source=SimulatedSource(rate_hz=RATE_HZ))


@pytest.fixture(autouse=True)
def reading_never_waits_for_the_next_poll(monkeypatch: pytest.MonkeyPatch) -> None:
    """A busy computer may take longer than a poll's millisecond for one frame; the frame would come a poll later."""
    monkeypatch.setattr(played_recording, "LONGEST_READING_NS", 60_000_000_000)


def state(pad: str, config: PadConfig = RECORDED, baseline: dict[str, Any] | None = None) -> StateMessage:
    return StateMessage(
        pad=pad,
        boot=BOOT,
        utc_ns=1,
        config=msgspec.to_builtins(config),
        model="",
        baseline=baseline,
        memory=b"",
    )


def frame(pad: str, number: int) -> FrameMessage:
    return msgspec.structs.replace(
        frame_message(number),
        pad=pad,
        boot=BOOT,
        sequence=number,
        host_time_ns=5_000_000_000 + number * PERIOD_NS,
        device_time_us=(7_000_000_000 + number * PERIOD_NS) // 1000,
    )


def recording(path: Path, pads: tuple[str, ...] = ("left", "right")) -> Path:
    writer = RecordingWriter(path)
    for pad in pads:
        writer.add("state", pad, msgspec.to_builtins(state(pad)))
    for number in range(COUNT):
        for pad in pads:
            writer.add("frame", pad, msgspec.to_builtins(frame(pad, number)))
    writer.finish()
    writer.close()
    return path


def pad(path: Path, name: str = "left", **source: Any) -> PadConfig:
    return PadConfig(name=name, source=ReplaySource(file=str(path), **({"rate_hz": RATE_HZ} | source)))


def played(source: Replayed, until_ns: int, start_ns: int = 10**12) -> list[Any]:
    """All frames up to then, polled each millisecond."""
    return [each for now_ns in range(0, until_ns, 1_000_000) for each in source.poll(start_ns + now_ns)]


def test_frames_come_as_they_were_recorded_at_their_own_pace(tmp_path: Path) -> None:
    source = Replayed({0: pad(recording(tmp_path / "a.mcap"))})
    assert source.deadline_ns() == 0
    frames = played(source, COUNT * PERIOD_NS // 2)
    assert [each.sequence for each in frames] == list(range(COUNT // 2))
    assert [each.host_time_ns for each in frames] == [10**12 + number * PERIOD_NS for number in range(COUNT // 2)]
    np.testing.assert_array_equal(frames[3].counts, np.array(frame("left", 3).counts))
    assert source.deadline_ns() == 10**12 + COUNT // 2 * PERIOD_NS


@pytest.mark.parametrize("speed", [0.5, 4.0])
def test_replay_speed_changes_only_the_times_of_frames(tmp_path: Path, speed: float) -> None:
    source = Replayed({0: pad(recording(tmp_path / "a.mcap"), speed=speed)})
    frames = played(source, round(COUNT * PERIOD_NS / speed) + 1_000_000)
    assert np.diff([each.host_time_ns for each in frames]).tolist() == [PERIOD_NS / speed] * (COUNT - 1)
    assert np.diff([each.device_time_us for each in frames]).tolist() == [PERIOD_NS / 1000] * (COUNT - 1)


def test_end_disconnects_and_a_loop_continues_evenly(tmp_path: Path) -> None:
    path = recording(tmp_path / "a.mcap")
    once, again = Replayed({0: pad(path)}), Replayed({0: pad(path, loop=True)})
    assert len(played(once, 3 * COUNT * PERIOD_NS)) == COUNT
    assert not once.state.connected
    assert "at its end" in once.state.reason
    assert once.deadline_ns() is None
    frames = played(again, 3 * COUNT * PERIOD_NS)
    assert [each.sequence for each in frames] == list(range(3 * COUNT))
    assert set(np.diff([each.host_time_ns for each in frames])) == {PERIOD_NS}
    assert set(np.diff([each.device_time_us for each in frames])) == {PERIOD_NS // 1000}
    assert again.state.connected


def test_recording_waits_while_the_computer_stands_still(tmp_path: Path) -> None:
    source = Replayed({0: pad(recording(tmp_path / "a.mcap"))})
    first = played(source, 10 * PERIOD_NS)
    later = played(source, 5 * PERIOD_NS, start_ns=10**12 + 60_000_000_000)
    assert [each.sequence for each in first + later] == list(range(15))
    assert later[0].host_time_ns == 10**12 + 60_000_000_000


def test_pads_of_one_recording_share_a_source_and_stay_in_step(tmp_path: Path) -> None:
    path = recording(tmp_path / "a.mcap")
    ((source, names),) = open_sources([pad(path), pad(path, name="other", pad="right")])
    assert names == {0: "left", 1: "other"}
    assert isinstance(source, Replayed)
    frames = played(source, 10 * PERIOD_NS)
    assert [(each.pad_index, each.sequence) for each in frames[:4]] == [(0, 0), (1, 0), (0, 1), (1, 1)]


@pytest.mark.parametrize(
    ("changed", "complaint"),
    [
        ({"pad": "up"}, "holds no pad up, but left, right"),
        ({"rate_hz": 220}, "rate_hz = 100: set it"),
        ({"chip": "hmc5883l", "rate_hz": 75}, "rate_hz = 100|chip"),
    ],
)
def test_unsuitable_value_is_refused_with_valid_ones(tmp_path: Path, changed: dict[str, Any], complaint: str) -> None:
    with pytest.raises(SourceError, match=complaint):
        Replayed({0: pad(recording(tmp_path / "a.mcap"), **changed)})


def test_another_structure_is_refused_with_the_recorded_one(tmp_path: Path) -> None:
    path = recording(tmp_path / "a.mcap")
    wider = msgspec.structs.replace(pad(path), geometry=GeometryConfig(sensors_mm=((9, 8, 0), (8, -8, 0), (-8, 8, 0))))
    with pytest.raises(SourceError, match=r"another structure.*8\.0, 8\.0, 0\.0"):
        Replayed({0: wider})


def test_recording_damaged_within_disconnects_its_pad_with_reason(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    writer = RecordingWriter(path)
    writer.add("state", "left", msgspec.to_builtins(state("left")))
    writer.add("frame", "left", msgspec.to_builtins(frame("left", 0)))
    writer.flush()
    good = path.stat().st_size
    for number in range(1, COUNT):
        writer.add("frame", "left", msgspec.to_builtins(frame("left", number)))
    writer.finish()
    writer.close()
    content = bytearray(path.read_bytes())
    content[good + 200] ^= 0xFF
    path.write_bytes(content)
    source = Replayed({0: pad(path)})
    assert [each.sequence for each in played(source, COUNT * PERIOD_NS)] == [0]
    assert not source.state.connected
    assert "damaged" in source.state.reason


def test_file_that_is_no_recording_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(bytes(1000))
    with pytest.raises(SourceError, match="not a recording"):
        Replayed({0: pad(tmp_path / "a.mcap")})
