"""A recording that lies about its sizes, or holds odd values, costs little and is refused with one sentence."""

from __future__ import annotations

import re
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import lz4.frame
import msgspec
import pytest
import zstandard
from bus_messages import contact_message
from test_replayed import COUNT, PERIOD_NS, frame, pad, played, recording, state

from drills.lying_mcap import channel, chunk, mcap, message, record, schema
from fmfts.bus.messages import FrameMessage
from fmfts.cli import main as cli
from fmfts.offline.replay import Replay
from fmfts.page.recordings import messages_of, pads_of
from fmfts.recording.container import LARGEST_CHUNK, MOST_UNREAD
from fmfts.recording.file import RecordingError, RecordingWriter, read
from fmfts.recording.repair import repair
from fmfts.recording.source import MOST_FRAMES_OF_A_PAD, Replayed
from fmfts.report.file import lines_of
from fmfts.sensor.source import SourceError

MOST_MEMORY = 8 * LARGEST_CHUNK
HUGE = 1 << 28
NESTED = b'{"v": ' + b"[" * 100_000 + b"]" * 100_000 + b"}"
ON_CONTACT = channel(1, "contact/left")


def read_to_the_end(path: Path) -> None:
    for _ in read(path):
        pass


def shown(path: Path) -> None:
    pads_of(path)
    for _ in messages_of(path, lambda: False):
        pass


READERS: dict[str, Callable[[Path], object]] = {
    "read": read_to_the_end,
    "replay": Replay,
    "page": shown,
    "report": lambda path: list(lines_of(path)),
    "source": lambda path: Replayed({0: pad(path)}),
    "repair": lambda path: repair(path, path.with_suffix(".new")),
}
LYING = {
    "lz4 that holds more than it claims": [chunk(ON_CONTACT, "lz4", stored=lz4.frame.compress(bytes(HUGE)))],
    "zstd that holds more than it claims": [
        chunk(ON_CONTACT, "zstd", stored=zstandard.ZstdCompressor().compress(bytes(HUGE)))
    ],
    "chunk that claims too much": [chunk(bytes(HUGE), "zstd")],
    "chunk that claims more than it holds": [chunk(ON_CONTACT, "lz4", claimed=LARGEST_CHUNK)],
    "unknown compression": [chunk(ON_CONTACT, "brotli")],
    "long topics": [chunk(channel(number, "x" * (1 << 19))) for number in range(200)],
    "long topic": [chunk(channel(1, "x" * (1 << 22)))],
    "many channels": [chunk(b"".join(channel(number, "x") for number in range(5000)))],
    "long schemas": [chunk(schema(number, "x", bytes(1 << 19))) for number in range(200)],
    "record that claims more than its chunk": [chunk(ON_CONTACT + record(5, bytes(30), claimed=1 << 40))],
    "metadata that claims too much": [chunk(record(4, b"\1\0" + bytes(10) + b"\xff" * 4))],
    "chunk that claims more than the file": [record(6, bytes(100), claimed=1 << 60)],
    "large record": [record(6, bytes(LARGEST_CHUNK + 2000))],
    "many empty records": [record(0x7F, b"") * (MOST_UNREAD + 1)],
    "repeated bomb": [chunk(record(0x7F, bytes(LARGEST_CHUNK - 9)))] * 100,
    "nested message": [chunk(ON_CONTACT + message(1, NESTED))],
    "message of another type": [chunk(ON_CONTACT + message(1, b"[1]"))],
    "message that is no text": [chunk(ON_CONTACT + message(1, b"\xff\xfe"))],
}


@pytest.mark.parametrize(
    ("lie", "reader"),
    [
        *((lie, "read") for lie in LYING),
        *(("lz4 that holds more than it claims", reader) for reader in READERS),
        *(("nested message", reader) for reader in READERS if reader != "repair"),  # which copies messages unread
    ],
)
def test_lying_recording_is_refused_and_costs_little(lie: str, reader: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(mcap(LYING[lie])[:-8])  # cut off: only then it can be repaired
    tracemalloc.start()
    try:
        with pytest.raises((RecordingError, SourceError), match=re.escape(str(path))) as refusal:
            READERS[reader](path)
        assert tracemalloc.get_traced_memory()[1] < MOST_MEMORY
    finally:
        tracemalloc.stop()
    assert len(str(refusal.value)) < 2000


def changed(path: Path, change: dict[str, Any], kind: str = "frame") -> Path:
    """A recording of one pad whose frames from the third on, or whose states, are changed."""
    writer = RecordingWriter(path)
    writer.add("state", "left", msgspec.to_builtins(state("left")) | (change if kind == "state" else {}))
    for number in range(COUNT):
        body = msgspec.to_builtins(frame("left", number))
        writer.add("frame", "left", body | (change if kind == "frame" and number >= 2 else {}))
    writer.finish()
    writer.close()
    return path


@pytest.mark.parametrize(
    "change",
    [
        {"host_time_ns": 1 << 63},
        {"host_time_ns": -(1 << 60)},
        {"device_time_us": 1 << 70},
        {"sequence": 1 << 65},
        {"gain_code": 99},
        {"gain_code": -1},
        {"counts": [[1, 2, 3]] * 3},
        {"counts": [[1, 2, 1 << 20]] * 4},
        {"age_us": [1 << 20] * 4},
        {"valid": [True]},
        {"host_time_ns": None},
    ],
    ids=str,
)
def test_impossible_frame_disconnects_its_pad_with_the_reason(change: dict[str, Any], tmp_path: Path) -> None:
    path = changed(tmp_path / "a.mcap", change)
    source = Replayed({0: pad(path)})
    assert [each.sequence for each in played(source, COUNT * PERIOD_NS)] == [0, 1]
    assert not source.state.connected
    assert str(path) in source.state.reason
    assert source.deadline_ns() is None


@pytest.mark.parametrize(
    "change",
    [
        {"config": {"source": 3}},
        {"config": msgspec.to_builtins(pad(Path("b.mcap"))) | {"geometry": {"sensors_mm": [[0, 0, 0]] * 9}}},
        {"config": {"name": "left", "source": {"type": "simulated", "rate_hz": 10**400}}},
    ],
    ids=["other type", "other structure", "huge number"],
)
def test_odd_state_is_refused_with_a_sentence(change: dict[str, Any], tmp_path: Path) -> None:
    path = changed(tmp_path / "a.mcap", change, "state")
    with pytest.raises(SourceError, match=r"a\.mcap"):
        Replayed({0: pad(path)})


def test_check_config_refuses_a_nested_recording_with_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.mcap").write_bytes(mcap(LYING["nested message"]))
    (tmp_path / "config.toml").write_text('[[pad]]\nname = "left"\n[pad.source]\ntype = "replay"\nfile = "a.mcap"\n')
    assert cli.main(["check-config", "--config", str(tmp_path / "config.toml")]) == 78
    said = capsys.readouterr().err
    assert "a.mcap: a message of contact/left is damaged" in said
    assert "Traceback" not in said


def test_frames_of_one_time_are_given_in_parts(tmp_path: Path) -> None:
    path = changed(tmp_path / "a.mcap", {"host_time_ns": 5_000_000_000})
    source, given = Replayed({0: pad(path, loop=True)}), []
    for _ in range(100):
        given.append(source.poll(10**12 + len(given) * 1_000_000))
    assert max(map(len, given)) <= MOST_FRAMES_OF_A_PAD
    assert sum(map(len, given)) > COUNT


def test_frame_behind_other_records_comes_in_a_later_poll(tmp_path: Path) -> None:
    """A recording of another program: between two frames are 20,000 messages that nobody wants."""
    other = msgspec.json.encode(msgspec.structs.replace(contact_message(), pad="other"))
    contents = [channel(1, "state/left") + message(1, msgspec.json.encode(state("left")))]
    contents += [channel(2, "frame/left"), channel(3, "contact/other")]
    contents += [message(2, msgspec.json.encode(frame("left", 0))), message(3, other) * 6000]
    contents += [message(2, msgspec.json.encode(frame("left", 1)))]
    (tmp_path / "a.mcap").write_bytes(mcap([chunk(b"".join(contents))]))
    source, polls, frames = Replayed({0: pad(tmp_path / "a.mcap")}), 0, []
    while len(frames) < 2 and polls < 10_000:
        frames += source.poll(10**12 + len(frames) * PERIOD_NS)
        polls += 1
        assert source.state.connected
        assert source.deadline_ns() is not None
    assert polls > 2
    assert [each.sequence for each in frames] == [0, 1]


def test_whole_recording_is_read_within_the_limits(tmp_path: Path) -> None:
    found = [one.message for one in read(recording(tmp_path / "a.mcap"))]
    assert sum(isinstance(each, FrameMessage) for each in found) == 2 * COUNT
