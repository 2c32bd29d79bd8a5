"""A killed collector leaves no rod on the pad: its guard lifts it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from emulator.gcode_machine import GcodeMachine
from emulator.priority import put_ahead
from fmfts_collect import guard
from fmfts_collect.guard import HANG_S

pytestmark = pytest.mark.real_time  # a machine whose move ends two seconds late counts as stalled

PATIENCE_S = 60.0
# A collector without its measurements: homed, guarded, the rod pressed down.
COLLECTOR = """
import sys, time
from fmfts_collect.clock import Monotonic
from fmfts_collect.errors import CollectError
from fmfts_collect.stage import Stage
from fmfts_collect.watch import Limits, Watch
from fmfts_collect.settings import StageConfig

class Silence:
    description, counts = "nobody", None
    def poll(self, now_ns): return []

port, dialect, how = sys.argv[1:]
stage = Stage(
    StageConfig(port=port, dialect=dialect, travel_mm=((80, 120), (80, 120), (5, 40)), force_limit_n=4.5,
                origin_mm=(100, 100), clear_z_mm=12.0, press_mm_per_s=0.1),
    Watch(Silence(), None, Limits(None, 1000.0)), 0.05,
)
stage.begin()
stage._machine.move(z=9.0, mm_per_s=20.0)
print("down", flush=True)
if how == "ends":
    stage.close()
elif how == "crashes":
    import os
    os.abort()
elif how == "hangs":
    stage._down = True
    try:
        stage._watch.wait(60.0)
    except CollectError:
        print(stage.release(), file=sys.stderr)
        raise
else:
    stage._creep(3.0, 1.0)
"""


@contextmanager
def running(link: Path, dialect: str) -> Iterator[GcodeMachine]:
    """A machine by the real clock."""
    ended = threading.Event()
    with GcodeMachine(link, dialect) as machine:

        def keep_time() -> None:
            put_ahead(threading.get_native_id())
            before_s = time.monotonic()
            while not ended.wait(0.002):
                now_s = time.monotonic()
                machine.turn(now_s - before_s)
                before_s = now_s

        thread = threading.Thread(target=keep_time)
        thread.start()
        try:
            yield machine
        finally:
            ended.set()
            thread.join()


def stands_at(machine: GcodeMachine, z_mm: float) -> bool:
    end_s = time.monotonic() + PATIENCE_S
    while abs(machine.place[2] - z_mm) > 1e-3 and time.monotonic() < end_s:
        time.sleep(0.01)
    return abs(machine.place[2] - z_mm) <= 1e-3


def ended(words: list[str | Path]) -> tuple[int, str]:
    """How a collector ended, and its output on stderr."""
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        put_ahead(process.pid)  # it allows its machine a second to answer
        said = process.communicate(timeout=PATIENCE_S)[1]
    return process.returncode, said


@pytest.mark.parametrize("how", ["is killed", "is told to end", "crashes"])
@pytest.mark.parametrize("dialect", ["marlin", "grbl"])
def test_rod_is_lifted_when_the_collector(tmp_path: Path, dialect: str, how: str) -> None:
    words = [sys.executable, "-c", COLLECTOR, tmp_path / "machine", dialect, how]
    with (
        running(tmp_path / "machine", dialect) as machine,
        subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process,
    ):
        put_ahead(process.pid)  # it allows its machine a second to answer
        assert process.stdout is not None
        assert process.stderr is not None
        said = process.stdout.readline()
        assert said == "down\n", process.stderr.read()
        assert machine.place[2] < 10.0
        if how == "is killed":
            process.kill()
        elif how == "is told to end":
            process.terminate()
        assert process.wait(PATIENCE_S) < 0
        assert stands_at(machine, 12.0)
        assert process.stderr is not None
        assert "collect ended with the rod down: the rod was sent up" in process.stderr.read()


@pytest.mark.parametrize("dialect", ["marlin", "grbl"])
def test_rod_is_lifted_when_the_collector_hangs(tmp_path: Path, dialect: str) -> None:
    """It is stopped, and continues later: then it must not press on."""
    words = [sys.executable, "-c", COLLECTOR, tmp_path / "machine", dialect, "hangs"]
    with (
        running(tmp_path / "machine", dialect) as machine,
        subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process,
    ):
        put_ahead(process.pid)  # it allows its machine a second to answer
        assert process.stdout is not None
        assert process.stdout.readline() == "down\n"
        time.sleep(1.2 * HANG_S)
        assert machine.place[2] < 10.0, "who polls does not hang"
        process.send_signal(signal.SIGSTOP)
        try:
            assert stands_at(machine, 12.0)
        finally:
            process.send_signal(signal.SIGCONT)
        said = process.communicate(timeout=PATIENCE_S)[1]
    assert process.returncode == 1
    assert "collect stood still for 1 s with the rod down: the rod was sent up" in said
    assert "StoppedError" in said, "it does not press on"
    assert "its guard sent the rod up, because collect stood still for 1 s: was it stopped" in said


@pytest.mark.parametrize(
    ("said", "end"),
    [
        (b"dud", guard._End.DIED),
        (b"du", guard._End.DIED),
        (b"", guard._End.DIED),
        (b"du.", guard._End.DONE),
    ],
)
def test_guard_reads_how_the_collector_ended(said: bytes, end: guard._End) -> None:
    reading, writing = os.pipe()
    os.write(writing, said)
    os.close(writing)
    assert guard._wait(reading, HANG_S) is end
    os.close(reading)


def test_silence_counts_as_hang_only_while_rod_is_down() -> None:
    """With the rod up the collector may wait for a person."""
    reading, writing = os.pipe()
    os.write(writing, guard.DOWN)
    assert guard._wait(reading, 0.05) is guard._End.HANGS
    os.write(writing, guard.DOWN + guard.UP)
    ending = threading.Timer(0.3, os.close, [writing])
    ending.start()
    assert guard._wait(reading, 0.05) is guard._End.DIED
    ending.join()
    os.close(reading)


def test_guard_leaves_machine_alone_when_collector_ends_by_itself(tmp_path: Path) -> None:
    words = [sys.executable, "-c", COLLECTOR, tmp_path / "machine", "marlin", "ends"]
    with running(tmp_path / "machine", "marlin") as machine:
        assert ended(words) == (0, "")
        assert stands_at(machine, 9.0)


@pytest.mark.parametrize("dialect", ["marlin", "grbl"])
def test_rod_is_lifted_when_the_collector_dies_of_a_limit_switch(tmp_path: Path, dialect: str) -> None:
    """GRBL then ignores everything but a reset, even from the guard."""
    words = [sys.executable, "-c", COLLECTOR, tmp_path / "machine", dialect, "ends"]
    with running(tmp_path / "machine", dialect) as machine:
        machine.switch_mm = 9.5
        code, said = ended(words)
        assert code == 1
        assert stands_at(machine, 12.0)
        assert "the rod was sent up" in said
