"""Every command of docs/without-hardware.md runs here, but those of minutes, which other tests run."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from end_to_end.processes import FirmwareHost, RunningDaemon

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/without-hardware.md").read_text()
COMMANDS = [line.strip() for line in re.findall(r"^    (\S.*)$", PAGE, flags=re.MULTILINE)]
TYPED = re.findall(r"^\| `([^`]+)` \|", PAGE, flags=re.MULTILINE)  # into the host's firmware
# Where each longer command is run; that file must name it.
ELSEWHERE = {
    "make demo FIRMWARE=1 SECONDS=10": ("tests/end_to_end/test_firmware_in_the_loop.py", "firmware_in_the_loop"),
    "make demo PAPER=1": ("tests/end_to_end/test_demo.py", "paper_demo.py"),
    "make install-c-client PREFIX=/tmp/fmfts-client": ("tests/c_client/test_examples.py", "make install-c-client"),
}
DAEMON = "fmfts-daemon run --config simulated.toml"
BESIDE_A_DAEMON = tuple(
    f"fmfts-daemon {words}" for words in ("status", "listen --seconds 5", "record touch.mcap --seconds 5")
)
GRIPPER = "python clients/python/examples/gripper.py demo"
HOST = "firmware/build/fmfts-host --link /tmp/fmfts-board"
WITHOUT_A_DAEMON = [
    command
    for command in COMMANDS
    if command.startswith("fmfts-daemon") and command not in (DAEMON, *BESIDE_A_DAEMON) and "replay" not in command
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("without")


@pytest.fixture(scope="module")
def environment(folder: Path) -> dict[str, str]:
    return os.environ | {"FMFTS_BUS": f"ipc://{folder}", "XDG_STATE_HOME": str(folder / "state")}


def ran(command: str, folder: Path, environment: dict[str, str]) -> str:
    words = [sys.executable, "-m", "fmfts", *shlex.split(command)[1:]]
    ended = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert ended.returncode == 0, ended
    return ended.stdout


@pytest.fixture(scope="module")
def prepared(folder: Path, environment: dict[str, str]) -> None:
    """The page's steps before `run`, in its order."""
    assert len(WITHOUT_A_DAEMON) == 8
    for command in WITHOUT_A_DAEMON:
        ran(command, folder, environment)


@pytest.mark.slow
@pytest.mark.usefixtures("prepared")
def test_verbs_of_the_page_run_in_its_order_beside_the_daemon(folder: Path, environment: dict[str, str]) -> None:
    words = [sys.executable, "-m", "fmfts", *shlex.split(DAEMON)[1:]]
    with subprocess.Popen(words, cwd=folder, env=environment, stderr=subprocess.PIPE, text=True) as daemon:
        try:
            until = time.monotonic() + 60.0
            while not (folder / "control").exists():
                assert time.monotonic() < until
                time.sleep(0.05)
            time.sleep(2.0)  # `status` describes the last second
            assert "demo" in ran(BESIDE_A_DAEMON[0], folder, environment)
            for command in BESIDE_A_DAEMON[1:]:
                assert ran(command, folder, environment)
            gripper = [sys.executable, *shlex.split(GRIPPER)[1:]]
            with subprocess.Popen(gripper, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True) as held:
                assert held.stdout is not None
                assert held.stdout.readline().startswith(("CLOSE", "OPEN"))
                held.kill()
        finally:
            daemon.send_signal(signal.SIGINT)
            daemon.communicate(timeout=30)
    assert "different: 0" in ran("fmfts-daemon replay touch.mcap", folder, environment)


def test_host_build_takes_every_command_of_the_page(tmp_path: Path) -> None:
    assert len(TYPED) == 9
    with FirmwareHost(tmp_path) as board:
        ended = subprocess.run(
            [sys.executable, "-m", "fmfts", "init", "--port", board.port, "--config", tmp_path / "pad.toml"],
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
        assert ended.returncode == 0, ended
        config = f'[[pad]]\nname = "left"\n[pad.source]\ntype = "bridge"\nport = "{board.port}"\n'
        with RunningDaemon(tmp_path, config) as daemon:  # garbage needs a listening daemon
            daemon.wait_for(lambda contact: contact.sensors_ok == 0b1111)
            for command in TYPED[:-1]:
                board.tell(command)


def test_baseline_of_the_pages_fields_and_stuck_sensor_are_reported(tmp_path: Path) -> None:
    environment = os.environ | {"FMFTS_BUS": f"ipc://{tmp_path}", "XDG_STATE_HOME": str(tmp_path / "state")}
    surroundings, resting, stuck = TYPED[:3]
    with FirmwareHost(tmp_path) as board:
        config = f'[[pad]]\nname = "left"\n[pad.source]\ntype = "bridge"\nport = "{board.port}"\n'
        (tmp_path / "pad.toml").write_text(config)
        for field, option in ((surroundings, "--bare"), (resting, "--rest")):
            board.tell(field)
            ran(f"fmfts-daemon baseline {option} --config pad.toml", tmp_path, environment)
        with RunningDaemon(tmp_path, config) as daemon:
            daemon.wait_for(lambda contact: contact.health == "ok")
            board.tell(stuck)
            told = daemon.wait_for(lambda contact: contact.health == "degraded")
    assert "sensor 3" in told.reason


def test_no_command_of_the_page_is_left_out() -> None:
    covered = {*WITHOUT_A_DAEMON, DAEMON, *BESIDE_A_DAEMON, "fmfts-daemon replay touch.mcap", GRIPPER, HOST}
    assert set(COMMANDS) == covered | set(ELSEWHERE) | {"make -C firmware host"}
    for file, word in ELSEWHERE.values():
        assert word in (ROOT / file).read_text(), f"{file} runs it no more"
