"""The running examples that hold with the least force, in Python and C, keep holding while the pads are blind."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from background import repeating, started
from c_client.built import CLIENT, HERE, SANITIZED, build
from c_client.grip_messages import NAMES, PYTHON_EXAMPLE, held, untouched
from end_to_end.processes import RunningDaemon
from fmfts.bus.messages import ContactMessage
from fmfts.bus.publisher import Publisher
from fmfts_client import Endpoints
from unit.bus_messages import contact_message

PERIOD_S, GOES_ON_S, PATIENCE_S, LATE_NS = 0.02, 0.5, 60.0, 250_000_000
BLIND, ONE_EYED = "hold (no pad knows its force)", "hold (a pad does not know its force)"
PADS = "".join(
    f"""
[[pad]]
name = "{name}"
[pad.source]
type = "simulated"
seed = 1
turning_deg_per_s = 0.0
[pad.contact]
model = "shear"
slip = true
"""
    for name in NAMES
)


@pytest.fixture(params=["c", "python"])
def command(request: pytest.FixtureRequest, tmp_path: Path) -> list[str]:
    if request.param == "python":
        return [sys.executable, str(PYTHON_EXAMPLE), *NAMES]
    program = build(tmp_path / "grip", "gcc", [CLIENT / "examples/grip.c"], f"-I{CLIENT}", "-lm", *SANITIZED)
    return [str(program), *NAMES]


class Example:
    """A running example; `lines` has its output so far."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process
        self.lines: list[str] = []
        self._taken = 0
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.lines.append(line.strip())

    def ended(self) -> int:
        """Its exit status; `lines` is then complete."""
        status = self._process.wait(PATIENCE_S)
        self._reader.join(PATIENCE_S)
        return status

    def says(self, wanted: str) -> None:
        """Wait for a new line that ends so."""
        until = time.monotonic() + PATIENCE_S
        while not any(line.endswith(wanted) for line in self.lines[self._taken :]):
            assert time.monotonic() < until, self.lines
            assert self._process.poll() is None, self.lines
            time.sleep(0.01)
        self._taken = len(self.lines)

    def goes_on(self, wanted: str) -> None:
        """It prints that line, and nothing else for a while: a busy computer makes messages late, too, but not for
        long."""
        until = time.monotonic() + PATIENCE_S
        while True:
            assert time.monotonic() < until, self.lines
            before = len(self.lines)
            time.sleep(GOES_ON_S)
            if len(self.lines) == before and self.lines and self.lines[-1].endswith(wanted):
                break
        self._taken = len(self.lines)


@contextmanager
def running(command: list[str], environment: dict[str, str]) -> Iterator[Example]:
    with started(command, stdout=subprocess.PIPE, env=environment) as process:
        yield Example(process)


def test_example_closes_on_slips_and_holds_without_readings(command: list[str], tmp_path: Path) -> None:
    endpoints = Endpoints.from_base(f"ipc://{tmp_path}")
    made: list[Callable[[str], ContactMessage]] = [untouched]
    publisher = Publisher(endpoints, "b00t", pads=list(NAMES))

    def send() -> None:
        for name in NAMES:
            publisher.send_contact(name, made[0](name))

    def late(name: str) -> ContactMessage:
        message = held(name)
        return held(name, t_sample_ns=message.t_publish_ns - LATE_NS)

    with running(command, os.environ | {"FMFTS_BUS": f"ipc://{tmp_path}"}) as example:
        example.says(BLIND)
        with closing(publisher), repeating(send, PERIOD_S):
            for make, words in (
                (untouched, "close"),
                (lambda name: held(name, 0.6), "hold, lift"),
                (lambda name: held(name, 0.6, sticks=0.02), "close"),
                (late, BLIND),
                (held, "lift"),
                (lambda name: held(name, health="degraded"), BLIND),
                (held, "lift"),
                (lambda name: held(name, force_n=None, x_m=None, y_m=None), BLIND),
                (lambda name: held(name, health="degraded" if name == "left" else "ok"), ONE_EYED),
            ):
                made[0] = make
                (example.goes_on if words in (BLIND, ONE_EYED) else example.says)(words)
        example.goes_on(BLIND)  # the daemon died


def test_example_stops_the_gripper_when_it_ends(command: list[str], tmp_path: Path) -> None:
    made: list[Callable[[str], ContactMessage]] = [untouched]
    publisher = Publisher(Endpoints.from_base(f"ipc://{tmp_path}"), "b00t", pads=list(NAMES))

    def send() -> None:
        for name in NAMES:
            publisher.send_contact(name, made[0](name))

    with running(command, os.environ | {"FMFTS_BUS": f"ipc://{tmp_path}"}) as example:
        with closing(publisher), repeating(send, PERIOD_S):
            example.says("close")
            made[0] = lambda name: held(name, v=2)
            assert example.ended() != 0
        assert example.lines[-1] == "hold (it ends)"


def test_example_refuses_one_pad(command: list[str]) -> None:
    for words in (command[:-1], [*command[:-1], "--loosen"], [*command, "more"]):
        ended = subprocess.run(words, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        assert ended.returncode != 0
        assert "needs two pads" in ended.stderr
        assert not ended.stdout


def test_example_follows_a_daemon_and_holds_when_it_ends(command: list[str], tmp_path: Path) -> None:
    with RunningDaemon(tmp_path, PADS) as daemon, running(command, daemon.environment) as example:
        example.says("close")  # nothing touches at first
        example.says("lift")  # the script presses hard enough
        daemon.stop()
        example.goes_on(BLIND)


@pytest.mark.parametrize("name", ["grip", "gripper", "fingers"])
def test_python_example_ends_when_its_output_is_closed(name: str, tmp_path: Path) -> None:
    publisher = Publisher(Endpoints.from_base(f"ipc://{tmp_path}"), "b00t", pads=["demo", *NAMES])

    def send() -> None:
        for pad in ("demo", *NAMES):
            publisher.send_contact(pad, contact_message(pad=pad, force_n=0.1))

    words = [sys.executable, str(PYTHON_EXAMPLE.with_name(f"{name}.py"))]
    environment = os.environ | {"FMFTS_BUS": f"ipc://{tmp_path}"}
    with started(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.readline()
        process.stdout.close()
        with closing(publisher), repeating(send, PERIOD_S):
            assert process.wait(PATIENCE_S) == 1
        told = process.stderr.read()
    assert told.endswith(f"{name}: its output was closed, so it ends\n")
    assert "Traceback" not in told


@pytest.mark.parametrize("name", ["grip", "gripper"])
def test_example_does_not_catch_up_after_a_stall(name: str, tmp_path: Path) -> None:
    example = f'-DEXAMPLE="{CLIENT}/examples/{name}.c"'
    program = build(tmp_path / name, "gcc", [HERE / "late_period.c"], example, f"-I{CLIENT}", "-lm", *SANITIZED)
    ended = subprocess.run([program], capture_output=True, text=True, timeout=PATIENCE_S, check=True)
    assert ended.stdout == "0\n"
