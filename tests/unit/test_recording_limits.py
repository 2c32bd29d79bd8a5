"""A recording that lies about its sizes, or holds odd values, costs little and is refused with one sentence."""

from __future__ import annotations

import functools
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

from drills.lying_mcap import attached, channel, chunk, indexed, mcap, message, record, schema
from fmfts.bus.messages import FrameMessage
from fmfts.cli import main as cli
from fmfts.sensor.source import SourceError
from fmfts_page.recordings import messages_of, pads_of
from fmfts_recording import source as played_recording
from fmfts_recording.container import LARGEST_CHUNK, MOST_METADATA, MOST_UNREAD
from fmfts_recording.file import RecordingError, RecordingWriter, read
from fmfts_recording.repair import repair
from fmfts_recording.replay import Replay
from fmfts_recording.source import LARGEST_PLAYED, MOST_FRAMES_OF_A_PAD, Replayed
from fmfts_report.file import NAME, facts_of, lines_of

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
# Made when they are wanted, as two take 256 MiB.
LYING: dict[str, Callable[[], list[bytes]]] = {
    "lz4 that holds more than it claims": lambda: [chunk(ON_CONTACT, "lz4", stored=lz4.frame.compress(bytes(HUGE)))],
    "zstd that holds more than it claims": lambda: [
        chunk(ON_CONTACT, "zstd", stored=zstandard.ZstdCompressor().compress(bytes(HUGE)))
    ],
    "chunk that claims too much": lambda: [chunk(bytes(HUGE), "zstd")],
    "chunk that claims more than it holds": lambda: [chunk(ON_CONTACT, "lz4", claimed=LARGEST_CHUNK)],
    "unknown compression": lambda: [chunk(ON_CONTACT, "brotli")],
    "long topics": lambda: [chunk(channel(number, "x" * (1 << 19)), "") for number in range(40)],
    "long topic": lambda: [chunk(channel(1, "x" * (1 << 22)))],
    "many channels": lambda: [chunk(b"".join(channel(number, "x") for number in range(5000)))],
    "long schemas": lambda: [chunk(schema(number, "x", bytes(1 << 19)), "") for number in range(40)],
    "record that claims more than its chunk": lambda: [chunk(ON_CONTACT + record(5, bytes(30), claimed=1 << 40))],
    "metadata that claims too much": lambda: [chunk(record(4, b"\1\0" + bytes(10) + b"\xff" * 4))],
    "chunk that claims more than the file": lambda: [record(6, bytes(100), claimed=1 << 60)],
    "large record": lambda: [record(6, bytes(LARGEST_CHUNK + 2000))],
    "many empty records": lambda: [record(0x7F, b"") * (MOST_UNREAD + 1)],
    "many metadata entries": lambda: [chunk(channel(1, "contact/left", {str(number): "" for number in range(70_000)}))],
    "repeated bomb": lambda: [chunk(record(0x7F, bytes(LARGEST_CHUNK - 9)))] * 100,
    "nested message": lambda: [chunk(ON_CONTACT + message(1, NESTED))],
    "message of another type": lambda: [chunk(ON_CONTACT + message(1, b"[1]"))],
    "message that is no text": lambda: [chunk(ON_CONTACT + message(1, b"\xff\xfe"))],
}


@functools.cache  # some are read by each reader
def lying(lie: str) -> bytes:
    return mcap(LYING[lie]())[:-8]  # cut off: only such a file can be repaired


@pytest.mark.parametrize(
    ("lie", "reader"),
    [
        *((lie, "read") for lie in LYING),
        *(("lz4 that holds more than it claims", reader) for reader in READERS),
        *(("nested message", reader) for reader in READERS if reader != "repair"),  # which copies messages unread
    ],
)
def test_recording_with_false_sizes_is_refused_cheaply(lie: str, reader: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(lying(lie))
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
    (tmp_path / "a.mcap").write_bytes(mcap([chunk(channel(1, "state/left") + message(1, NESTED))]))
    (tmp_path / "config.toml").write_text('[[pad]]\nname = "left"\n[pad.source]\ntype = "replay"\nfile = "a.mcap"\n')
    assert cli.main(["check-config", "--config", str(tmp_path / "config.toml")]) == 78
    said = capsys.readouterr().err
    assert "a.mcap: a message of state/left is damaged" in said
    assert "Traceback" not in said


def test_frames_of_one_time_are_given_in_parts(tmp_path: Path) -> None:
    path = changed(tmp_path / "a.mcap", {"host_time_ns": 5_000_000_000})
    source, given = Replayed({0: pad(path, loop=True)}), []
    for _ in range(100):
        given.append(source.poll(10**12 + len(given) * 1_000_000))
    assert max(map(len, given)) <= MOST_FRAMES_OF_A_PAD
    assert sum(map(len, given)) > COUNT


OTHER = msgspec.json.encode(frame("other", 0))
# What is between two frames, inside a chunk or between chunks; and the least number of polls that read it, if each ends
# as soon as it may.
BETWEEN: dict[str, tuple[bytes, bytes, int]] = {
    "messages": (message(3, msgspec.json.encode(contact_message(pad="other"))) * 6000, b"", 6000 // 64),
    "empty records": (record(0x7F, b"") * 20_000, b"", 20_000 // 64),
    "large messages": (message(4, OTHER.ljust(300_000)) * 20, b"", 20 * 300_000 >> 16),
    "large records": (record(0x7F, bytes(300_000)) * 20, b"", 20 * 300_000 >> 16),
    "channels": (channel(5, "x", dict.fromkeys(map(str, range(MOST_METADATA)), "")) * 60, b"", 60),
    "records outside of chunks": (b"", record(0x7F, b"") * MOST_UNREAD, MOST_UNREAD // 64),
}


@pytest.mark.parametrize("between", BETWEEN)
def test_records_between_two_frames_are_read_in_parts(
    between: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(played_recording, "LONGEST_READING_NS", 0)
    inside, outside, fewest_polls = BETWEEN[between]
    begin = channel(1, "state/left") + message(1, msgspec.json.encode(state("left")))
    begin += channel(2, "frame/left") + channel(3, "contact/other") + channel(4, "frame/other")
    frames = [message(2, msgspec.json.encode(frame("left", number))) for number in range(3)]
    (tmp_path / "a.mcap").write_bytes(mcap([chunk(begin + frames[0] + inside), outside, chunk(frames[1] + frames[2])]))
    source, polls, given = Replayed({0: pad(tmp_path / "a.mcap")}), 0, []
    while len(given) < 2 and polls < 10_000:
        given += source.poll(10**12 + len(given) * PERIOD_NS)
        polls += 1
        assert source.state.connected
        assert source.deadline_ns() is not None
    assert [each.sequence for each in given] == [0, 1]
    assert polls >= fewest_polls


def test_message_longer_than_any_frame_is_not_decoded(tmp_path: Path) -> None:
    content = channel(1, "state/left") + message(1, msgspec.json.encode(state("left"))) + channel(2, "frame/left")
    content += message(2, b"x" * (LARGEST_PLAYED + 1)) + message(1, b"x" * (LARGEST_PLAYED + 1))
    content += message(2, msgspec.json.encode(frame("left", 0)).ljust(LARGEST_PLAYED))
    (tmp_path / "a.mcap").write_bytes(mcap([chunk(content)]))
    source = Replayed({0: pad(tmp_path / "a.mcap")})
    assert [each.sequence for each in played(source, PERIOD_NS)] == [0]
    assert "it is at its end" in source.state.reason


def test_state_is_sought_in_the_beginning_of_a_file_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    named = channel(1, "state/left") + message(1, msgspec.json.encode(state("left"))) + channel(2, "frame/right")
    for name, frames in (("near", 0), ("far", 64)):
        late = channel(3, "state/right") + message(3, msgspec.json.encode(state("right")))
        damaged = message(2, b"x") * frames  # frames are not decoded there
        (tmp_path / name).write_bytes(mcap([chunk(named + damaged + late)]))
    Replayed({0: pad(tmp_path / "far", "right")}).close()
    monkeypatch.setattr(played_recording, "MOST_LOOKED_THROUGH", 4)
    Replayed({0: pad(tmp_path / "near", "right")}).close()
    with pytest.raises(SourceError, match=r"the beginning of .*far holds no pad right, but left"):
        Replayed({0: pad(tmp_path / "far", "right")})


def test_channel_with_the_most_metadata_is_read(tmp_path: Path) -> None:
    described = channel(1, "contact/left", {str(number): "é" for number in range(MOST_METADATA)})
    (tmp_path / "a.mcap").write_bytes(
        mcap([chunk(described + message(1, msgspec.json.encode(contact_message(pad="left"))))])
    )
    assert len(list(read(tmp_path / "a.mcap"))) == 1


def test_report_behind_many_chunks_is_found(tmp_path: Path) -> None:
    chunks = [chunk(b"", ""), indexed(1)] * (MOST_UNREAD + 800)
    path = tmp_path / "a.mcap"
    path.write_bytes(mcap(chunks))
    with pytest.raises(RecordingError, match="is a recording, and no report"):
        list(lines_of(path))
    path.write_bytes(mcap([*chunks, attached(NAME, b'{"version": "1.2.3"}')]))
    assert facts_of(path) == {"version": "1.2.3"}


def test_whole_recording_is_read_within_the_limits(tmp_path: Path) -> None:
    found = [one.message for one in read(recording(tmp_path / "a.mcap"))]
    assert sum(isinstance(each, FrameMessage) for each in found) == 2 * COUNT


def test_repair_of_a_recording_without_a_whole_message_leaves_no_file(tmp_path: Path) -> None:
    cut, new = tmp_path / "cut.mcap", tmp_path / "new.mcap"
    cut.write_bytes(mcap([chunk(channel(1, "contact/left"))])[:-8])
    with pytest.raises(RecordingError, match=r"cut\.mcap holds no whole message, up to where it is cut off"):
        repair(cut, new)
    assert not new.exists()
