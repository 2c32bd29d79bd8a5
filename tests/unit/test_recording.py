"""Recordings on a real disk, cut off and damaged as disks and people do it."""

from __future__ import annotations

import random
import subprocess
import sys
from pathlib import Path

import jsonschema
import msgspec
import pytest
from bus_messages import contact_message, frame_message
from mcap.reader import make_reader

from fmfts.bus.messages import ContactMessage
from fmfts.record.file import Recorded, RecordingError, RecordingWriter, is_whole, read
from fmfts.record.replay import Replay
from fmfts.sensor.replayed import frame_of

COUNT = 300


def written(path: Path, finish: bool = True) -> list[ContactMessage]:
    """A recording of COUNT contacts in six chunks."""
    contacts = [contact_message(seq=seq) for seq in range(COUNT)]
    writer = RecordingWriter(path)
    for contact in contacts:
        writer.add("contact", "demo", msgspec.to_builtins(contact))
        if contact.seq % 50 == 49:
            writer.flush()
    if finish:
        writer.finish()
    writer.close()
    return contacts


def test_what_was_written_is_read_back_number_for_number(tmp_path: Path) -> None:
    contacts = written(tmp_path / "a.mcap")
    assert list(read(tmp_path / "a.mcap")) == [Recorded("contact", "demo", contact) for contact in contacts]
    assert is_whole(tmp_path / "a.mcap")


def test_other_programs_find_json_that_fits_its_schema(tmp_path: Path) -> None:
    written(tmp_path / "a.mcap")
    with (tmp_path / "a.mcap").open("rb") as file:
        messages = list(make_reader(file).iter_messages(topics=["contact/demo"]))
    assert len(messages) == COUNT
    schema, channel, message = messages[0]
    assert schema is not None
    assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
    content = msgspec.json.decode(message.data)
    jsonschema.validate(content, msgspec.json.decode(schema.data))
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(content | {"force_n": "much"}, msgspec.json.decode(schema.data))


def test_recording_that_is_cut_off_anywhere_gives_every_whole_chunk(tmp_path: Path) -> None:
    contacts = written(tmp_path / "a.mcap")
    content = (tmp_path / "a.mcap").read_bytes()
    dice, counts = random.Random(1), set()
    for length in sorted(dice.sample(range(60, len(content)), 120)):
        (tmp_path / "cut.mcap").write_bytes(content[:length])
        found = [one.message for one in read(tmp_path / "cut.mcap")]
        assert found == contacts[: len(found)]
        assert len(found) % 50 == 0
        assert not is_whole(tmp_path / "cut.mcap")
        counts.add(len(found))
    assert counts == set(range(0, COUNT + 1, 50))


def test_flipped_bytes_are_refused_or_change_nothing(tmp_path: Path) -> None:
    contacts = written(tmp_path / "a.mcap")
    content, dice, refused = (tmp_path / "a.mcap").read_bytes(), random.Random(2), 0
    for _ in range(300):
        damaged = bytearray(content)
        damaged[dice.randrange(len(damaged))] ^= 1 << dice.randrange(8)
        (tmp_path / "b.mcap").write_bytes(damaged)
        try:
            found = [one.message for one in read(tmp_path / "b.mcap")]
        except RecordingError:
            refused += 1
            continue
        assert all(contact in contacts for contact in found)
    assert refused > 100


@pytest.mark.parametrize("content", [b"", b"not a recording", bytes(1000), b"\x89MCAP0\r\n" + b"\x06" + b"\xff" * 8])
def test_what_is_no_recording_is_refused_or_empty(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "x.mcap").write_bytes(content)
    with pytest.raises(RecordingError, match=r"x\.mcap"):
        Replay(tmp_path / "x.mcap")


def test_recording_is_never_written_over(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_text("dear to somebody")
    with pytest.raises(RecordingError, match="File exists"):
        RecordingWriter(tmp_path / "a.mcap")
    assert (tmp_path / "a.mcap").read_text() == "dear to somebody"


FILL_A_DISK = f"""
import resource, signal, sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
import test_recording
from pathlib import Path
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (8000, 8000))
test_recording.written(Path(sys.argv[1]))
"""


def test_full_disk_is_named_and_what_was_recorded_before_is_good(tmp_path: Path) -> None:
    ended = subprocess.run(
        [sys.executable, "-c", FILL_A_DISK, tmp_path / "a.mcap"], capture_output=True, text=True, check=False
    )
    assert "RecordingError" in ended.stderr
    assert "what was recorded before is in it" in ended.stderr
    found = [one.message.seq for one in read(tmp_path / "a.mcap") if isinstance(one.message, ContactMessage)]
    assert found == list(range(len(found)))
    assert 50 <= len(found) < COUNT


def test_frame_comes_back_as_its_source_gave_it() -> None:
    message = frame_message(7)
    frame = frame_of(message)
    assert frame.counts.tolist() == [list(row) for row in message.counts]
    assert (frame.counts.dtype, frame.age_us.dtype) == ("int16", "uint16")
    assert frame.overflow[1, 2]
    assert (frame.sequence, frame.device_time_us) == (message.sequence, message.device_time_us)
