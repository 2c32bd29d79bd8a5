"""`record` and `replay` as a person uses them, beside a daemon that runs."""

from __future__ import annotations

import json
import os
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader

from end_to_end.processes import RunningDaemon, run_command
from fmfts.bus.messages import ContactMessage
from fmfts.common import exit_codes
from fmfts.config.example import ARRAY_PATH
from fmfts_client import Subscription
from fmfts_recording.file import HEADER_BYTES, is_whole, read

TAPPED = """
[[pad]]
name = "left"
[pad.source]
type = "simulated"
rate_hz = 100
[pad.scene]
neighbours = ["right"]
[[pad]]
name = "right"
[pad.source]
type = "simulated"
rate_hz = 100
seed = 2
[pad.scene]
neighbours = ["left"]
[pad.placement]
position_mm = [45, 0, 0]
[[pad]]
name = "far"
[pad.source]
type = "simulated"
rate_hz = 100
seed = 3
"""


def beside(x_mm: int, neighbours: list[str]) -> str:
    """Facts that each pad of AMONG_ARRAYS shares, after its magnets: its place, and its neighbours."""
    return f"\n[pad.scene]\nneighbours = {neighbours}\n[pad.placement]\nposition_mm = [{x_mm}, 0, 0]\n"


def array(name: str, x_mm: int, neighbours: list[str]) -> str:
    text = ARRAY_PATH.read_text().replace('name = "array"', f'name = "{name}"')
    return text.replace("fingers = 1 ", "rate_hz = 75\nfingers = 2 ") + beside(x_mm, neighbours)


AMONG_ARRAYS = (
    array("array", 0, ["one", "other"])
    + array("other", 45, ["array"])
    + '[[pad]]\nname = "one"\n[pad.source]\ntype = "simulated"\nrate_hz = 75\n'
    + beside(-45, ["array"])
)
PATIENCE_S = 60.0  # for two seconds of work, and three processes, on a busy computer


@pytest.fixture(scope="module")
def daemon(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningDaemon]:
    with RunningDaemon(tmp_path_factory.mktemp("daemon"), TAPPED) as daemon:
        yield daemon


def recorder(daemon: RunningDaemon, output: Path, *options: str) -> subprocess.Popen[str]:
    """One that has begun to write."""
    words = [sys.executable, "-m", "fmfts", "record", output, "--json", *options]
    process = subprocess.Popen(words, env=daemon.environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    until = time.monotonic() + PATIENCE_S
    while not (output.exists() and output.stat().st_size > HEADER_BYTES and sum(1 for _ in read(output)) > 100):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < until
        time.sleep(0.1)
    return process


def chunks_s(output: Path) -> list[float]:
    """How much time each complete chunk covers."""
    spans = []
    with output.open("rb") as file, suppress(EndOfFile, struct.error):  # the file is being written
        for record in StreamReader(file, emit_chunks=True).records:
            if isinstance(record, Chunk):
                spans.append((record.message_end_time - record.message_start_time) * 1e-9)
    return spans


def contacts(output: Path) -> list[tuple[str, int]]:
    """Pad and number of each message that the file has by now."""
    return [(one.pad, one.message.seq) for one in read(output) if isinstance(one.message, ContactMessage)]


@pytest.mark.parametrize(
    ("options", "pads"),
    [
        pytest.param((), ["far", "left", "right"], id="all"),
        pytest.param(("--pad", "left"), ["left", "right"], id="one that has a neighbour"),
        pytest.param(("--pad", "far"), ["far"], id="one alone, whose frames were judged in C"),
    ],
)
def test_replay_of_a_recording_begun_in_the_middle_is_identical(
    daemon: RunningDaemon, tmp_path: Path, options: tuple[str, ...], pads: list[str]
) -> None:
    replays_identically(daemon, tmp_path / "a.mcap", options, pads)
    assert not encoded_for_ros(tmp_path / "a.mcap")


def test_record_writes_ros_contacts_on_request(daemon: RunningDaemon, tmp_path: Path) -> None:
    replays_identically(daemon, tmp_path / "a.mcap", ("--pad", "far", "--ros2"), ["far"])
    assert encoded_for_ros(tmp_path / "a.mcap") == {"tf", "ros/far/contact", "ros/far/wrench"}


def encoded_for_ros(recording: Path) -> set[str]:
    with recording.open("rb") as file:
        messages = make_reader(file).iter_messages()
        return {channel.topic for _, channel, _ in messages if channel.message_encoding == "cdr"}


@pytest.mark.slow  # two pads of several magnets take most of a processor, before the other tests
def test_replay_of_pads_beside_one_with_several_magnets_is_identical(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    with RunningDaemon(tmp_path_factory.mktemp("daemon"), AMONG_ARRAYS) as daemon:
        replays_identically(daemon, tmp_path / "a.mcap", ("--pad", "one"), ["array", "one", "other"], 150)


def wait_for_contacts(daemon: RunningDaemon, pad: str, count: int) -> None:
    """Until this many more have come; reading the recording each time would take ever longer."""
    with Subscription(("contact",), pad, daemon.base) as messages:
        for _ in range(count):
            assert messages.receive(PATIENCE_S) is not None


def replays_identically(
    daemon: RunningDaemon, output: Path, options: tuple[str, ...], pads: list[str], contacts_a_pad: int = 200
) -> None:
    process = recorder(daemon, output, *options)
    wait_for_contacts(daemon, pads[0], contacts_a_pad)  # 200: two seconds, if nothing is late
    process.send_signal(signal.SIGTERM)
    said, complaint = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, complaint
    assert json.loads(said)["pads"] == pads
    replayed = daemon.command("replay", output, "--json")
    assert replayed.returncode == 0, replayed
    facts = json.loads(replayed.stdout)
    assert facts["different"] == 0
    assert facts["identical"] > 100
    assert is_whole(output)


@pytest.mark.real_time  # a late computer drops frames
def test_recorder_that_is_killed_leaves_a_recording(daemon: RunningDaemon, tmp_path: Path) -> None:
    """All but its last chunk, each of which covers a second. The writer alone would keep four in memory."""
    process = recorder(daemon, tmp_path / "a.mcap", "--pad", "far")
    until = time.monotonic() + PATIENCE_S
    while len(spans := chunks_s(tmp_path / "a.mcap")) < 3:
        assert time.monotonic() < until, spans
        time.sleep(0.1)
    before = contacts(tmp_path / "a.mcap")
    process.kill()
    process.communicate()
    assert not is_whole(tmp_path / "a.mcap")
    kept = contacts(tmp_path / "a.mcap")
    assert kept[: len(before)] == before
    assert [number for _, number in kept] == list(range(kept[0][1], kept[0][1] + len(kept))), "none is missing within"
    assert sorted(spans)[len(spans) // 2] < 2.0
    replayed = daemon.command("replay", tmp_path / "a.mcap", "--json")
    assert replayed.returncode == 0, replayed
    facts = json.loads(replayed.stdout)
    assert "cut off" in facts["recording"]
    assert (facts["different"], facts["identical"] > 10) == (0, True)


INTERRUPTED = """
import os, signal, sys
from fmfts.cli import main as cli
from fmfts_recording.file import RecordingWriter
add, write, contacts = RecordingWriter.add, os.write, 0
def counted(self, kind, *what):
    global contacts
    contacts += kind == "contact"
    add(self, kind, *what)
def interrupted(descriptor, data):
    count = write(descriptor, data)
    if len(data) > 10_000 and contacts > 100:
        os.kill(os.getpid(), signal.SIGINT)
    return count
RecordingWriter.add, os.write = counted, interrupted
sys.exit(cli.main(["record", sys.argv[1]]))
"""


def test_interrupt_during_chunk_write_duplicates_no_message(daemon: RunningDaemon, tmp_path: Path) -> None:
    output = tmp_path / "a.mcap"
    words = [sys.executable, "-c", INTERRUPTED, output]
    ended = subprocess.run(words, env=daemon.environment, capture_output=True, text=True, timeout=300, check=False)
    assert ended.returncode == 0, ended
    assert is_whole(output)
    recorded = contacts(output)
    assert len(recorded) == len(set(recorded)) > 100


def test_full_disk_ends_the_recorder_with_a_sentence(daemon: RunningDaemon, tmp_path: Path) -> None:
    """The daemon and its other listeners do not notice. The limit must hold a first chunk, even a slow machine's."""
    limited = f"ulimit -f 400; trap '' XFSZ; exec {sys.executable} -m fmfts record {tmp_path / 'a.mcap'}"
    ended = subprocess.run(
        ["bash", "-c", limited], env=daemon.environment, capture_output=True, text=True, timeout=300, check=False
    )
    assert ended.returncode == 73, ended
    assert "File too large" in ended.stderr
    assert "Traceback" not in ended.stderr
    assert sum(1 for _ in read(tmp_path / "a.mcap")) > 50
    daemon.wait_for(lambda contact: contact.health == "ok")


@pytest.mark.parametrize("options", [(), ("--seconds", "0.5")])
def test_recorder_without_a_daemon_says_so(tmp_path: Path, options: tuple[str, ...]) -> None:
    words = ("record", tmp_path / "a.mcap", *options)
    ended = run_command(*words, environment=os.environ | {"FMFTS_BUS": f"ipc://{tmp_path}"})
    assert ended.returncode == 69
    assert "nothing was recorded: is fmfts-daemon running" in ended.stderr
    assert not (tmp_path / "a.mcap").exists(), "the next attempt wants its name"


@pytest.mark.parametrize("is_alone", [True, False])
def test_record_says_why_a_pad_sent_no_frames(tmp_path: Path, is_alone: bool) -> None:
    absent = f'[[pad]]\nname = "lost"\n[pad.source]\ntype = "bridge"\nport = "{tmp_path}/no-port"\n'
    there = '[[pad]]\nname = "left"\n[pad.source]\ntype = "simulated"\nfinger = "none"\n'
    with RunningDaemon(tmp_path, absent if is_alone else absent + there) as daemon:
        daemon.wait_for(lambda contact: contact.health == ("disconnected" if is_alone else "ok"))
        ended = daemon.command("record", tmp_path / "a.mcap", "--seconds", "2")
    assert ended.returncode == (exit_codes.UNAVAILABLE if is_alone else exit_codes.DONE), ended
    (sentence,) = ended.stderr.splitlines()
    assert sentence.startswith("fmfts-daemon record: no frames of pad 'lost' were recorded: disconnected: ")
    assert f"{tmp_path}/no-port: the port does not exist" in sentence


def test_recording_of_pad_that_is_not_there_names_those_that_are(daemon: RunningDaemon, tmp_path: Path) -> None:
    ended = daemon.command("record", tmp_path / "a.mcap", "--pad", "lift", "--seconds", "0.5")
    assert ended.returncode == 2
    assert "no pad 'lift' here; this daemon has 'left', 'right', 'far'; did you mean 'left'?" in ended.stderr
    assert not (tmp_path / "a.mcap").exists()
