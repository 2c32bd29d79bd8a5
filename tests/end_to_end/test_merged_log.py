"""`collect --merge` on a realistic machine's log: noisy, with another zero and another clock than the frames'."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from subprocess import CompletedProcess

import msgspec
import numpy as np
import pytest

from end_to_end.processes import run_command
from fmfts.baseline.job import BaselineJob
from fmfts.baseline.request import BaselineRequest
from fmfts.bus.frame_message import frame_message
from fmfts.common import exit_codes
from fmfts.config.file import load
from fmfts_recording.file import RecordingWriter
from fmfts_simulation.finger import Touch, no_finger
from fmfts_simulation.source import Simulated

RATE_HZ = 75
CONFIG = f"""
[[pad]]
name = "left"
[pad.source]
type = "simulated"
finger = "none"
turning_deg_per_s = 0
rate_hz = {RATE_HZ}
"""
BEGUN_NS = 7_000_000_000
PAUSE_S, PRESS_S = 1.8, 2.0
PRESSES = [(x, y, force) for y in (-10, 0, 10) for x in (-10, 0, 10) for force in (0.4, 1.5)]
# Properties of a machine's log: over this minute and a bit, 0.4 % correspond to 75 ppm over an hour.
GAUGE_HZ, NOISE_N, OFFSET_N, CLOCK_AHEAD_S, CLOCK_RATE = 160, 0.005, 0.05, 1234.5, 1.004


@dataclass(frozen=True, slots=True)
class Machine:
    """The program in seconds since the recording began: each place once untouched, then with its two forces."""

    edges_s: np.ndarray
    steps: list[tuple[float, float, float]]

    def at(self, time_s: float) -> tuple[float, float, float]:
        return self.steps[min(int(np.searchsorted(self.edges_s, time_s, side="right")), len(self.steps) - 1)]

    @property
    def ended_s(self) -> float:
        return float(self.edges_s[-1])


@pytest.fixture(scope="module")
def machine() -> Machine:
    random = np.random.default_rng(3)
    steps: list[tuple[float, float, float]] = []
    for x, y, force in PRESSES:
        if force == PRESSES[0][2]:
            steps.append((x, y, 0.0))
        steps.append((x, y, force))
    steps.append((*steps[-1][:2], 0.0))
    durations_s = [(PRESS_S if step[2] else PAUSE_S) + random.uniform(0.0, 1.0) for step in steps]
    return Machine(np.cumsum(durations_s), steps)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, machine: Machine) -> Path:
    """With the pad's baseline and a recording of the presses."""
    folder = tmp_path_factory.mktemp("merge")
    (folder / "config.toml").write_text(CONFIG)
    pad = load(folder / "config.toml")[0].pad[0]
    source = Simulated(pad)
    with pytest.MonkeyPatch.context() as patch, ThreadPoolExecutor(max_workers=1) as executor:
        patch.setenv("XDG_STATE_HOME", str(folder / "state"))
        source.finger = no_finger
        wanted = BaselineRequest(pad.pad(), pad.tolerance.si(), bare=False, replaced=False)
        job = BaselineJob(wanted, None, source, executor)
        now_ns = BEGUN_NS
        while job.share < 1.0:  # the time that the computer then takes to judge them changes nothing
            now_ns += 10_000_000
            for frame in source.poll(now_ns):
                job.take(frame)
    assert job.facts() is not None
    recorded_s = (now_ns - BEGUN_NS) * 1e-9

    def touch(time_s: float) -> Touch:
        x_mm, y_mm, force_n = machine.at(time_s - recorded_s)
        return Touch(x_mm * 1e-3, y_mm * 1e-3, force_n)

    source.finger = touch
    writer = RecordingWriter(folder / "frames.mcap")
    end_ns = now_ns + round(machine.ended_s * 1e9)
    while now_ns < end_ns:
        now_ns += 10_000_000
        for frame in source.poll(now_ns):
            message = frame_message(frame, "left", "0" * 8, frame.host_time_ns)
            writer.add("frame", "left", msgspec.to_builtins(message))
    writer.finish()
    writer.close()
    return folder


def write_log(path: Path, machine: Machine, offset_n: float = OFFSET_N, drift_n: float = 0.0) -> Path:
    """drift_n: change of the gauge's zero until the end. The log begins later."""
    random = np.random.default_rng(8)
    with path.open("w", newline="") as out:
        writer = csv.writer(out)
        writer.writerow(["t_s", "x_mm", "y_mm", "force_n"])
        for time_s in np.arange(0.3, machine.ended_s, 1.0 / GAUGE_HZ):
            x_mm, y_mm, force_n = machine.at(time_s)
            shown_n = force_n + offset_n + drift_n * time_s / machine.ended_s + random.normal(0.0, NOISE_N)
            writer.writerow([f"{CLOCK_AHEAD_S + time_s * CLOCK_RATE:.4f}", x_mm, y_mm, f"{shown_n:.4f}"])
    return path


def merged(folder: Path, log: Path, table: Path) -> CompletedProcess[str]:
    return run_command(
        *("collect", "--merge", log, "--frames", folder / "frames.mcap", "-o", table, "--json"),
        *("--config", folder / "config.toml"),
        environment={"XDG_STATE_HOME": str(folder / "state"), "PATH": ""},
    )


def rows(table: Path) -> list[dict[str, str]]:
    with table.open() as lines:
        return list(csv.DictReader(lines))


def test_noisy_log_with_shifted_zero_and_clock_gives_every_press(
    tmp_path: Path, folder: Path, machine: Machine
) -> None:
    done = merged(folder, write_log(tmp_path / "log.csv", machine, drift_n=0.1), tmp_path / "data.csv")
    assert done.returncode == 0, done.stderr
    facts = json.loads(done.stdout)
    assert (facts["collected"], facts["refused"]) == (len(PRESSES), [])
    assert facts["clock_ppm"] == pytest.approx(
        -(CLOCK_RATE - 1) * 1e6, abs=600
    )  # 20 ms at the ends: a frame and a half
    table = rows(tmp_path / "data.csv")
    assert sum(row["press"] == "0" for row in table) == facts["untouched"] == 10
    pressed = [row for row in table if row["press"] != "0"]
    for row, (x_mm, y_mm, force_n) in zip(pressed, PRESSES, strict=True):
        assert (float(row["x_mm"]), float(row["y_mm"])) == (x_mm, y_mm)
        # the zero drifts by 7 mN from a pause to the second press after it; in addition, means of 200 readings of 5 mN
        assert float(row["force_n"]) == pytest.approx(force_n, abs=0.01)
        assert float(row["force_sd_n"]) == pytest.approx(NOISE_N, rel=0.3)


def changed(log: Path, change: Callable[[float, list[float]], None]) -> Path:
    """`change` gets each row's share of the log and its x, y and force, and alters those."""
    header, *lines = log.read_text().splitlines()
    table = [[float(cell) for cell in line.split(",")] for line in lines]
    for number, (_, *cells) in enumerate(table):
        change(number / len(table), cells)
        table[number][1:] = cells
    log.write_text("\n".join([header, *(",".join(map(str, row)) for row in table)]) + "\n")
    return log


def forces(table: Path) -> list[float]:
    return [float(row["force_n"]) for row in rows(table) if row["press"] != "0"]


def test_presses_after_a_jump_of_the_zero_are_refused(tmp_path: Path, folder: Path, machine: Machine) -> None:
    for jump_n in (-0.3, 0.3):
        log, table = write_log(tmp_path / "log.csv", machine), tmp_path / f"{jump_n}.csv"

        def tared(share: float, cells: list[float], jump_n: float = jump_n) -> None:
            cells[2] += jump_n * (share > 0.5)

        done = merged(folder, changed(log, tared), table)
        assert done.returncode == 0, done.stderr
        refused = json.loads(done.stdout)["refused"]
        assert all(f"{jump_n:+.1f}" in reason and "was the gauge tared meanwhile" in reason for reason in refused)
        assert len(refused) == 2  # of one place
        wanted = [press[2] for press in PRESSES]
        assert [round(force_n, 1) for force_n in forces(table)] == wanted[:-2]


def test_log_of_a_rod_beside_the_pad_makes_no_press(tmp_path: Path, folder: Path, machine: Machine) -> None:
    log = write_log(tmp_path / "log.csv", machine)
    last_s = machine.ended_s - machine.edges_s[-2]

    def beside(share: float, cells: list[float]) -> None:
        if share > 1.0 - 0.9 * last_s / machine.ended_s:
            cells[2] += 1.5

    done = merged(folder, changed(log, beside), tmp_path / "data.csv")
    assert done.returncode == 0, done.stderr
    assert "does the rod press beside the pad" in json.loads(done.stdout)["refused"][0]
    assert len(forces(tmp_path / "data.csv")) == len(PRESSES) - 2


def test_log_without_a_usable_row_is_refused_without_a_table(tmp_path: Path, folder: Path, machine: Machine) -> None:
    def moving(share: float, cells: list[float]) -> None:
        cells[0] = 1e3 * share

    done = merged(folder, changed(write_log(tmp_path / "log.csv", machine), moving), tmp_path / "data.csv")
    assert done.returncode == exit_codes.DATA
    assert "make no row of 0 plateaus: does the log stand still for long enough" in done.stderr
    assert not (tmp_path / "data.csv").exists()
