"""What the page's server does for recordings: it begins and ends a recorder, and shows files of one folder alone."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest
from bus_messages import contact_message, event_message, status_message

from fmfts_page.recordings import Recordings, RecordingsError, messages_of
from fmfts_recording.file import RecordingWriter


def test_only_files_of_the_folder_can_be_shown(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"")
    (tmp_path / "b.txt").write_bytes(b"")
    recordings = Recordings(tmp_path, None)
    assert recordings.names() == ["a.mcap"]
    assert recordings.path_of("a.mcap") == tmp_path / "a.mcap"
    for name in ("b.txt", "../a.mcap", "/etc/passwd", ""):
        with pytest.raises(RecordingsError):
            recordings.path_of(name)


def test_page_reports_a_recorder_that_ended(tmp_path: Path) -> None:
    recordings = Recordings(tmp_path, f"ipc://{tmp_path}")
    name = recordings.begin()["recording"]
    assert (tmp_path / name).exists()  # the recorder has subscribed: no later message is missing
    assert recordings.under_way == name
    assert recordings.failure() is None
    recorder = recordings._recorder
    assert recorder is not None
    recorder.kill()
    recorder.wait(10.0)
    assert recordings.under_way is None
    assert name in (recordings.failure() or "")
    assert name in (recordings.failure() or ""), "for every page that asks"


def test_recorder_that_cannot_begin_says_why(tmp_path: Path) -> None:
    recordings = Recordings(tmp_path, "nonsense://")
    with pytest.raises(RecordingsError, match="nonsense"):
        recordings.begin()
    assert recordings.under_way is None
    assert recordings.failure() is None


def test_ending_what_was_not_begun_says_so(tmp_path: Path) -> None:
    with pytest.raises(RecordingsError, match="nothing is being recorded"):
        Recordings(tmp_path, None).end()


def test_each_kind_of_message_is_shown_at_its_time(tmp_path: Path) -> None:
    """A contact of a clock that begins at zero, too: it has no other time."""
    writer = RecordingWriter(tmp_path / "a.mcap")
    for kind, message in (
        ("contact", contact_message(pad="demo", t_publish_ns=0)),
        ("status", status_message(pad="demo", t_publish_ns=5)),
        ("event", event_message(pad="demo", t_ns=7)),
    ):
        writer.add(kind, "demo", msgspec.to_builtins(message))
    writer.finish()
    writer.close()
    assert list(messages_of(tmp_path / "a.mcap", lambda: False, since_ns=2**62)) == []
    shown = [(sent_ns, topic) for sent_ns, topic, _ in messages_of(tmp_path / "a.mcap", lambda: False)]
    assert shown == [(0, b"contact/demo"), (5, b"status/demo"), (7, b"event/demo")]
