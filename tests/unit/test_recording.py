"""Recordings on a real disk, cut off and damaged as disks and people do it."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from itertools import islice
from pathlib import Path
from typing import Any

import msgspec
import pytest
from bus_messages import contact_message, frame_message
from json_schemas import fits
from mcap.reader import make_reader

from fmfts.bus.messages import ContactMessage
from fmfts.cli import main as cli
from fmfts_client import Message
from fmfts_recording import recorder
from fmfts_recording.file import Recorded, RecordingError, RecordingWriter, is_whole, read
from fmfts_recording.replay import Comparison, Replay
from fmfts_recording.source import frame_of

COUNT = 300


def written(path: Path, finish: bool = True, count: int = COUNT) -> list[ContactMessage]:
    """A recording of `count` contacts in six chunks."""
    contacts = [contact_message(seq=seq) for seq in range(count)]
    writer = RecordingWriter(path)
    for contact in contacts:
        writer.add("contact", "demo", msgspec.to_builtins(contact))
        if (contact.seq + 1) % (count // 6) == 0:
            writer.flush()
    if finish:
        writer.finish()
    writer.close()
    return contacts


def test_written_numbers_are_read_back_exactly(tmp_path: Path) -> None:
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
    assert fits(content, msgspec.json.decode(schema.data))
    assert not fits(content | {"force_n": "much"}, msgspec.json.decode(schema.data))


def test_recording_cut_off_anywhere_gives_every_whole_chunk(tmp_path: Path) -> None:
    contacts = written(tmp_path / "a.mcap", count=60)
    content = (tmp_path / "a.mcap").read_bytes()
    dice, counts = random.Random(1), set()
    for length in sorted(dice.sample(range(60, len(content)), 120)):
        (tmp_path / "cut.mcap").write_bytes(content[:length])
        found = [one.message for one in read(tmp_path / "cut.mcap")]
        assert found == contacts[: len(found)]
        assert len(found) % 10 == 0
        assert not is_whole(tmp_path / "cut.mcap")
        counts.add(len(found))
    assert counts == set(range(0, 61, 10))


def test_flipped_bytes_are_refused_or_change_nothing(tmp_path: Path) -> None:
    contacts = written(tmp_path / "a.mcap", count=30)
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
def test_invalid_recording_is_refused_or_empty(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "x.mcap").write_bytes(content)
    with pytest.raises(RecordingError, match=r"x\.mcap"):
        Replay(tmp_path / "x.mcap")


@pytest.mark.parametrize("content", ["[bus]\nendpoint = 'ipc:///tmp/a'\n", "hello\n"])
def test_file_of_another_kind_is_no_recording(tmp_path: Path, content: str) -> None:
    (tmp_path / "a.toml").write_text(content)
    with pytest.raises(RecordingError, match=r"a\.toml is not a recording: it does not begin as an MCAP file does$"):
        list(read(tmp_path / "a.toml"))


def test_damage_is_named_with_its_place(tmp_path: Path) -> None:
    written(tmp_path / "a.mcap")
    with (tmp_path / "a.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[2]
    content = bytearray((tmp_path / "a.mcap").read_bytes())
    content[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 0xFF
    (tmp_path / "a.mcap").write_bytes(content)
    with pytest.raises(RecordingError, match=r"damaged in the chunk that ends at byte \d+") as damage:
        list(read(tmp_path / "a.mcap"))
    end = int(str(damage.value).split("byte ")[1].split(" ")[0])
    assert end == chunk.chunk_start_offset + chunk.chunk_length
    (tmp_path / "empty.mcap").touch()
    with pytest.raises(RecordingError, match=r"is empty: its recorder has only just begun"):
        list(read(tmp_path / "empty.mcap"))


def test_recording_into_a_folder_that_is_not_there_says_so(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"new/a\.mcap: No such file or directory: make its folder first"):
        RecordingWriter(tmp_path / "new" / "a.mcap")


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
    assert "NotWrittenError" in ended.stderr
    assert "the messages before can be read from it" in ended.stderr
    found = [one.message.seq for one in read(tmp_path / "a.mcap") if isinstance(one.message, ContactMessage)]
    assert found == list(range(len(found)))
    assert 50 <= len(found) < COUNT


def test_frame_round_trip_keeps_all_values() -> None:
    message = frame_message(7)
    frame = frame_of(message)
    assert frame.counts.tolist() == [list(row) for row in message.counts]
    assert (frame.counts.dtype, frame.age_us.dtype) == ("int16", "uint16")
    assert frame.overflow[1, 2]
    assert (frame.sequence, frame.device_time_us) == (message.sequence, message.device_time_us)


TAPS = Path(__file__).parents[1] / "data" / "recordings" / "taps.mcap"


def rewritten(path: Path, change: Callable[[Recorded], dict[str, Any] | None]) -> Path:
    """The first COUNT messages of the taps, each as `change` makes it; left out where that is None."""
    writer = RecordingWriter(path)
    for one in islice(read(TAPS), COUNT):
        body = change(one)
        if body is not None:
            writer.add(one.kind, one.pad, body)
    writer.finish()
    writer.close()
    return path


def whole(one: Recorded) -> dict[str, Any]:
    body: dict[str, Any] = msgspec.to_builtins(one.message)
    return body


@pytest.mark.parametrize(
    "wrong",
    [
        {"config": {}},
        {"config": {"name": 5}},
        {"baseline": {}},
        {"baseline": {"id": "x"}},
        {"memory": b"\xc1"},
        {"model": "0123456789ab"},
    ],
    ids=str,
)
def test_wrong_state_is_refused_with_pad_and_file(tmp_path: Path, wrong: dict[str, Any]) -> None:
    path = rewritten(tmp_path / "a.mcap", lambda one: whole(one) | (wrong if one.kind == "state" else {}))
    with pytest.raises(RecordingError, match=r"a\.mcap.* pad '\w+'"):
        list(Replay(path).contacts())


def test_baseline_of_another_shape_is_refused_with_its_pad_and_file(tmp_path: Path) -> None:
    def of_three_sensors(one: Recorded) -> dict[str, Any]:
        body = whole(one)
        if one.kind == "state":
            body["baseline"]["rest"]["mean_t"] = body["baseline"]["rest"]["mean_t"][:3]
        return body

    with pytest.raises(RecordingError, match=r"a\.mcap.* pad '\w+'"):
        list(Replay(rewritten(tmp_path / "a.mcap", of_three_sensors)).contacts())


@pytest.mark.parametrize(
    ("left_out", "code"),
    [
        pytest.param(lambda one, contacts: False, 0, id="nothing"),
        pytest.param(lambda one, contacts: one.kind == "contact" and contacts < 5, 0, id="contacts at an end"),
        pytest.param(lambda one, contacts: one.kind == "contact", 65, id="every contact"),
        pytest.param(lambda one, contacts: one.kind == "frame", 65, id="every frame"),
    ],
)
def test_replay_that_could_compare_nothing_is_no_success(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], left_out: Callable[[Recorded, int], bool], code: int
) -> None:
    contacts = 0

    def change(one: Recorded) -> dict[str, Any] | None:
        nonlocal contacts
        contacts += one.kind == "contact"
        return None if left_out(one, contacts) else whole(one)

    assert cli.main(["replay", str(rewritten(tmp_path / "a.mcap", change)), "--json"]) == code
    assert msgspec.json.decode(capsys.readouterr().out)["different"] == 0


def test_recorded_contact_that_replay_lacks_is_found() -> None:
    comparison = Comparison()
    for seq in range(10):
        comparison.recorded(contact_message(seq=seq, t_sample_ns=seq))
        if seq not in (0, 4, 9):
            comparison.replayed(contact_message(seq=seq, t_sample_ns=seq))
    assert (comparison.identical, comparison.alone, comparison.unreplayed) == (7, 3, 1)
    assert not comparison.is_the_same


def test_growing_recording_keeps_its_length_at_opening(tmp_path: Path) -> None:
    """A recorder's write comes amid the reading of its chunk: the part that was there is no damaged chunk."""
    contacts = written(tmp_path / "a.mcap")
    content, path = (tmp_path / "a.mcap").read_bytes(), tmp_path / "b.mcap"
    path.write_bytes(content[: len(content) // 2])
    reading = read(path)
    before = [next(reading)]
    with path.open("ab") as file:
        file.write(content[len(content) // 2 :])
    before += list(reading)
    assert 50 <= len(before) < COUNT
    assert [one.message for one in before] == contacts[: len(before)]
    assert len(list(read(path))) == COUNT


def test_recorder_hands_the_signals_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorder, "PATIENCE_S", 0.1)  # nobody sends
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    with (
        closing(recorder.Recorder(tmp_path / "a.mcap", None, f"ipc://{tmp_path}/bus")) as of_nobody,
        pytest.raises(recorder.NothingCameError),
    ):
        of_nobody.run(1.0)
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before


def test_recorder_says_why_a_pad_has_no_frames(tmp_path: Path) -> None:
    """A pad whose first `state` has not come yet is not blamed with what its contacts say of it."""
    with closing(recorder.Recorder(tmp_path / "a.mcap", None, f"ipc://{tmp_path}/bus")) as of_two:
        for pad, health, reason in (("left", "disconnected", "no port"), ("right", "disturbed", "steel")):
            body = {"boot": "b", "seq": 1, "health": health, "reason": reason, "utc_ns": 1}
            of_two._take(Message("contact", pad, body))
        unplugged, early = of_two.without_frames()
    assert unplugged == "no frames of pad 'left' were recorded: disconnected: no port"
    assert early.startswith("no frames of pad 'right' were recorded: its first `state`")
    assert early.endswith("had not come yet: record for longer")
