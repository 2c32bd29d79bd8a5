"""The demo for somebody who just cloned the repository: started, interrupted, and failing."""

from __future__ import annotations

import math
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from end_to_end.processes import PATIENCE_S, ROOT, build_firmware_host
from fmfts.cli.verb import VerbError
from fmfts.common import exit_codes
from fmfts_simulation import page_beside
from fmfts_simulation.demo import _sockets

DEMO = (sys.executable, "-m", "fmfts_simulation.demo", "--config", ROOT / "config.toml")
LINE_S = 60.0  # on a busy computer
PAPER_DEMO = (sys.executable, ROOT / "tests" / "end_to_end" / "paper_demo.py")


def started(command: tuple[str | Path, ...]) -> subprocess.Popen[str]:
    """In a process group of its own, as a shell starts it: Ctrl-C reaches all of them.

    nohup, or a shell's background, where the tests may run, would make the demo ignore a hangup, or Ctrl-C.
    """
    pipe = subprocess.PIPE
    return subprocess.Popen(
        command,
        stdout=pipe,
        stderr=pipe,
        text=True,
        start_new_session=True,
        preexec_fn=hearing,
    )


def hearing() -> None:
    for number in (signal.SIGHUP, signal.SIGINT):
        signal.signal(number, signal.SIG_DFL)


def child_of(process: subprocess.Popen[str]) -> int:
    """The first child, as soon as there is one."""
    until = time.monotonic() + PATIENCE_S
    while not (children := Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < until
        time.sleep(0.001)
    return int(children[0])


def first_line(process: subprocess.Popen[str]) -> str:
    """Its next line. Empty if it ended, or said nothing for LINE_S and was killed with all that it started."""
    assert process.stdout is not None
    patience = threading.Timer(LINE_S, os.killpg, (process.pid, signal.SIGKILL))  # its daemon holds the pipe, too
    patience.start()
    try:
        return process.stdout.readline()
    finally:
        patience.cancel()


def read_until(process: subprocess.Popen[str], beginning: str) -> list[str]:
    """The lines up to the first that begins so."""
    lines = []
    while not lines or not lines[-1].startswith(beginning):
        lines.append(first_line(process))
        assert lines[-1], process.communicate()
    return lines


def gone(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("when", ["starting", "listening"])
def test_interrupted_demo_ends_quietly_and_takes_its_daemon_along(number: signal.Signals, when: str) -> None:
    with started(DEMO) as demo:
        daemon = child_of(demo)
        if when == "listening":
            read_until(demo, "the page: ")
        if number == signal.SIGINT:
            os.killpg(demo.pid, number)
        else:
            demo.send_signal(number)
        _, stderr = demo.communicate(timeout=PATIENCE_S)
    assert (demo.returncode, stderr) == (0, "")
    assert gone(daemon)


def test_interrupted_paper_demo_ends_without_a_traceback() -> None:
    build_firmware_host()
    with started(PAPER_DEMO) as demo:
        first_line(demo)
        child_of(demo)
        os.killpg(demo.pid, signal.SIGINT)
        _, stderr = demo.communicate(timeout=PATIENCE_S)
    assert (demo.returncode, stderr) == (130, "")


def test_two_fingers_of_the_demo_meet_and_part() -> None:
    """As `make demo PAD=array FINGERS=2` does; a line a second. They are 15 mm apart, then 4 mm, and 15 mm again."""
    command = (sys.executable, "-m", "fmfts_simulation.demo", "--pad", "array", "--fingers", "2", "--seconds", "60")
    apart_mm: list[float] = []
    with started(command) as demo:
        for is_next in (lambda mm: mm > 12.0, lambda mm: mm < 9.0, lambda mm: mm > 12.0):
            while not (apart_mm and is_next(apart_mm[-1])):
                line = first_line(demo)
                assert line, f"the demo ended; fingers were {apart_mm} mm apart (0: one was told)"
                if (mm := told_apart_mm(line)) is not None:
                    apart_mm.append(mm)
        demo.send_signal(signal.SIGTERM)
        _, stderr = demo.communicate(timeout=PATIENCE_S)
    assert (demo.returncode, stderr) == (0, "")


def told_apart_mm(line: str) -> float | None:
    """The distance of two fingers in a line of the demo; 0 if one is reported, None if none is."""
    places = re.findall(r"N at \(([-+.\d]+), ([-+.\d]+)\) mm", line)
    if len(places) != 2:
        return 0.0 if places else None
    (x, y), (other_x, other_y) = ((float(x), float(y)) for x, y in places)
    return math.hypot(x - other_x, y - other_y)


def test_daemon_that_dies_during_the_demo_leaves_its_log() -> None:
    with started(DEMO) as demo:
        daemon = child_of(demo)
        while (line := first_line(demo)) and not line.startswith("demo: "):
            pass  # its socket appears before its log; contacts come after both
        os.kill(daemon, signal.SIGKILL)
        _, stderr = demo.communicate(timeout=PATIENCE_S)
    assert demo.returncode == 1
    assert "fmfts-daemon ended with -9" in stderr
    assert "publishing on ipc://" in stderr


def test_demo_of_a_wrong_configuration_says_what_is_wrong(tmp_path: Path) -> None:
    config = tmp_path / "wrong.toml"
    config.write_text("pads = 1\n")
    with started((*DEMO[:-1], config)) as demo:
        _, stderr = demo.communicate(timeout=PATIENCE_S)
    assert demo.returncode == 78
    assert "wrong.toml" in stderr
    assert "Traceback" not in stderr


def test_demo_says_first_how_its_pad_was_set_up() -> None:
    with started(DEMO) as demo:
        said, *_ = read_until(demo, "demo: ok")  # each second; an event may come before the demo listens
        demo.send_signal(signal.SIGTERM)
        demo.communicate(timeout=PATIENCE_S)
    assert said.startswith("pad demo: self-test, bare, rest and turn were simulated in "), said


def test_demo_serves_where_fmfts_bus_says_each_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else no client could be seen to connect again."""
    monkeypatch.setenv("FMFTS_BUS", f"ipc://{tmp_path}/bus-of-mine")
    (tmp_path / "bus-of-mine").mkdir()
    with socket.socket(socket.AF_UNIX) as killed:
        killed.bind(str(tmp_path / "bus-of-mine" / "bus"))  # as a daemon that was killed leaves it
    with started(DEMO) as demo:
        lines = read_until(demo, "demo: ok")
        with started(DEMO) as second:
            _, refused = second.communicate(timeout=PATIENCE_S)
        demo.send_signal(signal.SIGTERM)
        assert demo.communicate(timeout=PATIENCE_S)[1] == ""
    assert any(line.startswith(f"another terminal: FMFTS_BUS=ipc://{tmp_path}/bus-of-mine ") for line in lines)
    assert second.returncode == exit_codes.UNAVAILABLE
    assert f"another fmfts-daemon serves ipc://{tmp_path}/bus-of-mine: stop it, or unset FMFTS_BUS" in refused


@pytest.mark.parametrize(
    ("bus", "said", "code"),
    [
        ("tcp://127.0.0.1:5570", "is no folder", exit_codes.USAGE),
        ("nonsense", "is not a base", exit_codes.UNAVAILABLE),
    ],
)
def test_demo_refuses_another_kind_of_bus(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bus: str, said: str, code: int
) -> None:
    monkeypatch.setenv("FMFTS_BUS", bus)
    with pytest.raises(VerbError, match=said) as refused:
        _sockets(tmp_path)
    assert refused.value.code == code


def test_line_that_demo_prints_listens_to_it_from_another_shell() -> None:
    with started(DEMO) as demo:
        assert demo.stdout is not None
        pasted = next(found[1] for line in demo.stdout if (found := re.match(r"another terminal: (.*) {4}\(", line)))
        elsewhere = {name: value for name, value in os.environ.items() if name != "FMFTS_BUS"}
        heard = subprocess.run(
            f"{pasted} --seconds 2", shell=True, env=elsewhere, capture_output=True, text=True, timeout=PATIENCE_S
        )
        demo.send_signal(signal.SIGINT)
        demo.communicate(timeout=PATIENCE_S)
    assert "pad demo: " in heard.stdout, heard


def test_killed_demo_leaves_no_process() -> None:
    """Each of them holds the end of its pipe."""
    with started(DEMO) as demo:
        said = [first_line(demo) for _ in range(2)]
        demo.kill()
        demo.communicate(timeout=PATIENCE_S)
    assert any(line.startswith("the page: ") for line in said), said


def test_missing_package_of_the_page_is_told_without_a_try(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page_beside, "entry_points_of", lambda group: ())
    monkeypatch.setattr(page_beside, "_started", lambda *words: pytest.fail("`view` was started"))
    with page_beside.page_beside(tmp_path, f"ipc://{tmp_path}") as line:
        assert line().startswith("no page: view belongs to a package of its own; install it with")


def test_page_is_served_elsewhere_if_its_port_is_taken_meanwhile(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        monkeypatch.setattr(page_beside, "USUAL_PORT", ("--port", str(other.getsockname()[1])))
        with page_beside.page_beside(tmp_path, f"ipc://{tmp_path}") as line:
            assert re.fullmatch(r"the page: http://127\.0\.0\.1:\d+/#[\w-]{32,}", line())


def test_page_that_cannot_be_served_says_why(tmp_path: Path) -> None:
    with page_beside.page_beside(tmp_path, f"ipc://{tmp_path}", "--host", "192.0.2.1") as line:
        assert line().startswith("no page: "), line()
