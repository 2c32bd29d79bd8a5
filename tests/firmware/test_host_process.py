"""The firmware core as a process on a pty: what the bridge source and the demo rely on."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest
from host_board import HELLO, REPLY, ROOT, SELFTEST, STATUS, HostBoard

FIELD = " ".join(str(value) for value in (10, -20, 100, 11, -21, 101, 12, -22, 102, 13, -23, 103))
PAD_0_CHANNEL_0 = 22 + 3


@pytest.fixture(scope="session", autouse=True)
def program() -> None:
    built = subprocess.run(["make", "-C", ROOT / "firmware", "host"], capture_output=True, text=True, timeout=120)
    assert built.returncode == 0, f"fmfts-host does not build:\n{built.stdout}{built.stderr}"


@pytest.fixture
def board() -> Iterator[HostBoard]:
    with HostBoard("--uid", "0102030405060708090a0b0c") as running:
        yield running


def test_streams_220_frames_a_second_without_gaps(board: HostBoard) -> None:
    samples = board.undisturbed(lambda: list(board.samples(3.0)))
    assert [b.sequence - a.sequence for a, b in pairwise(samples)] == [1] * (len(samples) - 1)
    # By the board's clock, ± one conversion at each end: a loaded machine delays packets.
    elapsed_s = (samples[-1].time_us - samples[0].time_us) * 1e-6
    assert elapsed_s > 1.5
    assert len(samples) - 1 == pytest.approx(220 * elapsed_s, abs=2.5)
    assert all(sample.valid == 15 for sample in samples)
    assert board.bad == 0


def test_hello_is_answered_when_asked(board: HostBoard) -> None:
    board.wait_for_sample(lambda s: s.valid == 15)
    board.request(8, 42)
    assert board.wait_for(REPLY)[1:4] == bytes([42, 8, 0])
    hello = board.wait_for(HELLO)
    assert hello[6:18] == bytes(range(1, 13))
    assert hello[PAD_0_CHANNEL_0 + 2 : PAD_0_CHANNEL_0 + 5] == b"H43"


def test_range_request_rescales_the_field_that_was_set(board: HostBoard) -> None:
    assert board.command("noise 0 0") == "ok"
    assert board.command(f"field 0 {FIELD}") == "ok"
    expected = {3: (66, -132, 660), 5: (39, -78, 390)}  # 0.1, −0.2, 1 G at 660 and at 390 LSB/G
    board.wait_for_sample(lambda s: s.valid == 15 and s.counts[0] == expected[3])
    board.request(9, 1, argument=5)
    assert board.wait_for(REPLY)[3] == 0
    sample = board.wait_for_sample(lambda s: s.gain_code == 5 and s.valid == 15)
    assert sample.counts[0] == expected[5]


def test_unplugged_sensor_is_reported_and_found_again(board: HostBoard) -> None:
    assert board.command("fault 0 2 unplugged") == "ok"
    board.wait_for_sample(lambda s: s.valid == 0b1011)
    board.request(15, 1)
    board.wait_for(REPLY)
    assert board.wait_for(STATUS)[29 + 2] == 1
    assert board.command("fault 0 2 none") == "ok"
    board.wait_for_sample(lambda s: s.valid == 15)


@pytest.mark.parametrize(
    ("fault", "valid"), [("wrong-id", 0b1101), ("stuck", 0b1101), ("config-corrupt", 0b1111), ("none", 0b1111)]
)
def test_each_fault_shows_in_the_stream(board: HostBoard, fault: str, valid: int) -> None:
    board.wait_for_sample(lambda s: s.valid == 15)
    assert board.command(f"fault 0 1 {fault}") == "ok"
    board.wait_for_sample(lambda s: s.valid == valid)
    if fault == "config-corrupt":
        while not int.from_bytes(board.wait_for(STATUS)[24:28], "little"):
            pass
        board.wait_for_sample(lambda s: s.valid == 15)


def test_saturated_axis_and_lost_mux_show_in_the_stream(board: HostBoard) -> None:
    assert board.command("fault 0 3 saturate-y") == "ok"
    sample = board.wait_for_sample(lambda s: s.counts[3][1] == -4096)
    assert sample.valid == 15
    assert board.command("mux 0 unplugged") == "ok"
    board.wait_for_sample(lambda s: s.valid == 0)
    assert board.command("mux 0 none") == "ok"
    board.wait_for_sample(lambda s: s.valid == 15)


@pytest.mark.real_time
def test_late_samples_show_the_field_of_their_own_time(board: HostBoard) -> None:
    assert board.process.stdin is not None
    assert board.process.stdout is not None
    assert board.command("noise 0 0") == "ok"
    before = board.wait_for_sample(lambda s: s.valid == 15)
    board.process.send_signal(signal.SIGSTOP)
    time.sleep(1.5)
    board.process.stdin.write(f"field 0 {FIELD}\n")
    board.process.send_signal(signal.SIGCONT)
    assert board.process.stdout.readline() == "ok\n"
    after = board.wait_for_sample(lambda s: s.counts[0] == (66, -132, 660))
    assert after.time_us - before.time_us > 1_500_000


def test_temperature_reaches_the_frame(board: HostBoard) -> None:
    assert board.command("temperature 0 30.5") == "ok"
    board.wait_for_sample(lambda s: s.temperature_raw == 704)


def test_selftest_answers_with_the_straps_counts(board: HostBoard) -> None:
    board.wait_for_sample(lambda s: s.valid == 15)
    board.request(14, 9, pad=0)
    result = board.wait_for(SELFTEST)
    assert result[1:4] == bytes([9, 0x40, 5])
    assert result[4] == 0
    assert int.from_bytes(result[5:7], "little") == pytest.approx(452, abs=3)  # 1.16 G × 390, noise of 0.4 counts


def test_stream_recovers_after_garbage_and_a_truncated_packet(board: HostBoard) -> None:
    board.wait_for_sample(lambda s: s.valid == 15)

    def spoil() -> tuple[int, int]:
        before, bad = board.wait_for_sample(lambda s: True), board.bad
        assert board.command("garbage 500 7") == "ok"
        assert board.command("truncate") == "ok"
        samples = list(board.samples(1.0))
        return samples[-1].sequence - before.sequence - len(samples), board.bad - bad

    lost, bad = board.undisturbed(spoil)
    assert bad >= 2
    assert 1 <= lost <= 3  # the interrupted packet, the next one, and the one that garbage met


def test_reset_restarts_but_a_time_jump_does_not(board: HostBoard) -> None:
    board.wait_for_sample(lambda s: s.sequence > 50)
    assert board.command(f"time {2**32}") == "ok"
    sample = board.wait_for_sample(lambda s: s.time_us > 2**32)
    assert sample.sequence > 50
    board.wait_for_sample(lambda s: s.valid == 15)
    assert board.command("reset") == "ok"
    assert board.wait_for(HELLO)[4] == 3
    assert board.wait_for_sample(lambda s: True).sequence == 0


@pytest.mark.parametrize(
    "line",
    [
        *(
            "",
            "field",
            f"field 1 {FIELD}",
            f"field 0 {FIELD[:-4]}",
            f"field 0 nan{FIELD[2:]}",
            "noise 0 -1",
            "ppm 0 4 0",
        ),
        *("fault 0 0 broken", "mux 0 perhaps", "garbage 99999 1", "time -5", "temperature 0 hot", "jump"),
    ],
)
def test_wrong_command_is_refused_and_changes_nothing(board: HostBoard, line: str) -> None:
    assert board.command(line).startswith("error: ")
    assert board.wait_for_sample(lambda s: True).valid == 15


def test_packets_that_nobody_reads_are_dropped_and_counted() -> None:
    with HostBoard() as board:
        os.close(board.port)
        until = time.monotonic() + 60.0
        while int(board.command("frames 0").removeprefix("ok ")) < 110:  # half a second of its own time
            assert time.monotonic() < until
            time.sleep(0.1)
        board.port = os.open(board.path, os.O_RDWR | os.O_NOCTTY)
        first = board.wait_for_sample(lambda s: True)
        assert first.sequence > 50  # nothing stale: bytes for nobody are gone
        assert board.dropped() > 50


def test_three_pads_stream_side_by_side() -> None:
    with HostBoard("--pads", "3") as board:
        samples = board.undisturbed(lambda: list(board.samples(1.5)))
        for pad in range(3):
            sequences = [sample.sequence for sample in samples if sample.pad == pad]
            assert len(sequences) > 100
            assert sequences == list(range(sequences[0], sequences[0] + len(sequences)))


def test_link_follows_the_process(tmp_path: Path) -> None:
    link = tmp_path / "board"
    with HostBoard("--link", str(link)) as board:
        assert os.readlink(link) == board.path
        board.process.send_signal(signal.SIGTERM)
        assert board.process.wait(60) == 0
    assert not link.is_symlink()


def test_ends_when_its_input_closes() -> None:
    with HostBoard() as board:
        assert board.process.stdin is not None
        board.process.stdin.close()
        assert board.process.wait(60) == 0


def test_does_not_replace_a_file_by_its_link(tmp_path: Path) -> None:
    precious = tmp_path / "notes"
    precious.write_text("kept")
    run = subprocess.run(
        [ROOT / "firmware/build/fmfts-host", "--link", precious], capture_output=True, text=True, input=""
    )
    assert run.returncode == 1
    assert "cannot make the link" in run.stderr
    assert precious.read_text() == "kept"


@pytest.mark.parametrize("arguments", [["--pads", "4"], ["--uid", "12"], ["--speed", "0"], ["extra"], ["--unknown"]])
def test_wrong_option_is_a_usage_error(arguments: list[str]) -> None:
    run = subprocess.run([ROOT / "firmware/build/fmfts-host", *arguments], capture_output=True, text=True, input="")
    assert run.returncode == 2
    assert run.stderr


def test_stepped_board_sends_only_in_its_time() -> None:
    with HostBoard("--stepped") as board:
        assert board.command("run 500000") == "ok"
        assert board.quiet()
        assert list(board.samples(0.3)) == []
        assert board.command("run 50000") == "ok"
        # 50 ms at 220 Hz, ± one conversion at each end
        assert len(board.quiet()) == pytest.approx(11, abs=2)


def test_gliding_field_changes_evenly_and_stays_where_it_arrives() -> None:
    end_ut, glide_ms = 200.0, 200.0
    with HostBoard("--stepped") as board:
        assert board.command("noise 0 0") == "ok"
        assert board.command("run 300000") == "ok"
        assert board.command(f"glide 0 {glide_ms} " + " ".join([str(end_ut)] * 12)) == "ok"
        before = board.quiet()
        assert board.command("run 300000") == "ok"
        first_us, samples = before[-1].time_us, board.quiet()
    assert before[-1].counts[0] == (0, 0, 0)
    counts = [sample.counts[0][0] for sample in samples]
    full = 6.6 * end_ut
    # A frame is newer than its newest conversion by up to a period of 1/220 s, and the glide began as late.
    for sample, count in zip(samples, counts, strict=True):
        expected = full * min((sample.time_us - first_us) * 1e-3 / glide_ms, 1.0)
        assert count == pytest.approx(expected, abs=full * 10.0 / glide_ms)
    steps = [later - earlier for earlier, later in pairwise(counts)]
    assert max(steps) < 2.5 * full / (0.22 * glide_ms)
    assert counts[-10:] == [round(full)] * 10


def test_board_whose_time_runs_is_not_stepped(board: HostBoard) -> None:
    assert board.command("run 1000") == "error: time passes by itself: start with --stepped"


def test_held_board_makes_no_frame_and_keeps_its_count(board: HostBoard) -> None:
    seen = board.wait_for_sample(lambda s: s.sequence > 20)
    assert board.command("hold on") == "ok"
    made = board.command("frames 0")
    *_, last = seen, *board.quiet()
    assert made == f"ok {last.sequence + 1}"
    assert board.command("reset") == "ok"
    assert board.command("frames 0") == made
    assert board.command("hold off") == "ok"
    board.wait_for_sample(lambda s: s.sequence > 3)
    assert int(board.command("frames 0").split()[1]) > last.sequence + 4
