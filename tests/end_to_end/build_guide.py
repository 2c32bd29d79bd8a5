"""Types docs/build-a-pad.md as its reader would, in an empty folder, with emulated parts instead of wired ones.

A and B: real smbus2 on an emulated kernel bus, by the page's own chips. D: the binary that is flashed, on an emulated
STM32F103C8. (C: `make test-rp2040`.)
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np

from emulator.pace import slowed
from end_to_end.firmware_in_the_loop import PACE, EmulatedBoard
from end_to_end.kernel_bus import KernelBus, kernel_bus
from fmfts.config.file import load
from fmfts.sensor.chips import CHIPS, TESLA_PER_GAUSS
from fmfts_simulation.mounted import MountedPad

PAGE = Path(__file__).parents[2] / "docs" / "build-a-pad.md"
EARTH_T = np.array([2e-5, 0.0, 4e-5])
FORCE_N, PLACE_M = 1.0, (3e-3, -2e-3)
HELD_S, LISTEN_S = 3.0, 12.0  # by the pad's clock
PATIENCE_S = 300.0


class Step(NamedTuple):
    """A command of the page, and the lines of output that it shows."""

    command: str
    shown: tuple[str, ...]

    def missing(self, said: str) -> list[str]:
        """The shown lines that were not printed, in order; figures may differ."""
        lines = iter(said.splitlines())
        return [line for line in self.shown if not any(re.fullmatch(_pattern(line), each) for each in lines)]


def _pattern(line: str) -> str:
    """`…` matches anything, and a figure matches any other."""
    parts = [re.sub(r"-?\d+(?:\\\.\d+)?", r"-?[\\d.]+", re.escape(part)) for part in line.split("…")]
    return ".*".join(parts)


def steps(page: str) -> list[Step]:
    """The page's commands in its own order."""
    found: list[Step] = []
    for block in re.findall(r"^```\n(\$ .*?)^```$", page, re.MULTILINE | re.DOTALL):
        for part in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
            command, *shown = part.splitlines()
            found.append(Step(command.partition("#")[0].strip(), tuple(line for line in shown if line != "…")))
    return found


class Build(ABC):
    """One way to wire the pad. folder: where the reader works."""

    finds = ""  # the words of `init` that name the pad's connection
    settings: tuple[tuple[str, str], ...] = ()  # lines of pad.toml that the page asks to change, and their new text

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.surroundings = os.environ | {"FMFTS_BUS": f"ipc://{folder}", "XDG_STATE_HOME": f"{folder}/state"}

    @abstractmethod
    def put(self, field_t: np.ndarray) -> None:
        """The field (4, 3) at the chips, tesla."""

    def words(self, command: str) -> str:
        """The command with this build's names instead of the page's."""
        return command.replace("init --i2c 1", f"init {self.finds}")

    def line(self, shown: str) -> str:
        return shown

    def press(self, force_n: float) -> None:
        """0: the mounted pad, untouched."""
        pad = MountedPad.exact(load(self.folder / "pad.toml")[0].pad[0].pad())
        press = (np.full(4, value) for value in (*PLACE_M, force_n))
        self.put(pad.sensed(pad.magnet_field(*press) + EARTH_T))

    def begun(self, command: str) -> subprocess.Popen[str]:
        words = [sys.executable, "-m", "fmfts", *shlex.split(command)[1:]]
        return subprocess.Popen(
            words, cwd=self.folder, env=self.surroundings, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )

    def typed(self, command: str, code: int = 0) -> str:
        with self.begun(command) as process:
            said, errors = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == code, (command, said, errors)
        assert "Traceback" not in errors, errors
        return said + errors

    def wait(self, pad_s: float) -> None:
        """Wait until this much time has passed for the pad."""
        time.sleep(pad_s)

    def set_up(self) -> None:
        """Make the page's change in pad.toml."""
        file = self.folder / "pad.toml"
        text = file.read_text()
        for key, value in self.settings:
            text, changed = re.subn(rf"^#? ?{key} = \S+", f"{key} = {value}", text, count=1, flags=re.MULTILINE)
            assert changed == 1, f"no {key} in {text}"
        file.write_text(text)


class OnPi(Build):
    chip = ""
    finds = "--i2c 7"  # the emulated bus

    def __init__(self, folder: Path, bus: KernelBus) -> None:
        super().__init__(folder)
        self._bus = bus
        self.put(np.tile(EARTH_T, (4, 1)))

    def put(self, field_t: np.ndarray) -> None:
        noise_gauss = CHIPS[self.chip].noise_at_t(200, "free") / TESLA_PER_GAUSS
        for number, field_gauss in enumerate(field_t / TESLA_PER_GAUSS):
            changes = {"field_gauss": field_gauss.tolist(), "noise_gauss": noise_gauss}
            assert self._bus.order(**self.place(number), set=changes) == "done"

    def place(self, number: int) -> dict[str, object]:
        return {"direct": number}


class A(OnPi):
    chip = "mmc5983ma"
    settings = (("trigger", '"simultaneous"'),)

    def place(self, number: int) -> dict[str, object]:
        return {"chip": [0, number]}


class B(OnPi):
    chip = "mlx90393"


class D(Build):
    settings = (("trigger", '"simultaneous"'), ("rate_hz", "200"))

    def __init__(self, folder: Path, board: EmulatedBoard) -> None:
        super().__init__(folder)
        self.surroundings |= slowed(PACE)
        self._board = board
        self.finds = f"--port {board.port}"
        self.put(np.tile(EARTH_T, (4, 1)))

    def put(self, field_t: np.ndarray) -> None:
        self._board.field(field_t)

    def wait(self, pad_s: float) -> None:
        time.sleep(pad_s / PACE)

    def line(self, shown: str) -> str:
        return re.sub(r"for the pad on /dev/i2c-1", "for board …", shown).replace("I2C bus 1", "bridge on …")


@contextmanager
def wired(name: str, folder: Path) -> Iterator[Build]:
    """Build A, B or D, wired as on the page."""
    if name == "D":
        with EmulatedBoard(folder, "--chips", "mmc5983ma") as board:
            yield D(folder, board)
    else:
        chip, addresses = {"A": (A.chip, ()), "B": (B.chip, CHIPS[B.chip].addresses[:4])}[name]
        with kernel_bus(chip, *addresses) as bus:
            yield (A if name == "A" else B)(folder, bus)


def follow(build: Build) -> list[str]:
    """Types every command of the page. Shown lines that were not printed, each with its command."""
    missed = []
    for step in steps(PAGE.read_text()):
        if "baseline --rest" in step.command:
            build.press(0.0)
        said = build.typed(build.words(step.command))
        missing = Step(step.command, tuple(map(build.line, step.shown))).missing(said)
        missed += [f"{step.command}: {line!r} is not in {said!r}" for line in missing]
        if step.command.startswith("fmfts-daemon init"):
            build.set_up()
    return missed


def first_contact(build: Build) -> str:
    """What `listen` prints for one press, with the daemon running."""
    with build.begun("fmfts-daemon run") as daemon:
        try:
            with build.begun(f"fmfts-daemon listen --seconds {LISTEN_S}") as listening:
                build.wait(0.5 * LISTEN_S)
                build.press(FORCE_N)
                build.wait(HELD_S)
                build.press(0.0)
                said, errors = listening.communicate(timeout=PATIENCE_S)
        finally:
            daemon.terminate()
            daemon.communicate(timeout=PATIENCE_S)
    return said + errors
