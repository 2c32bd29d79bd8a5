from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from fmfts.cli.main import main
from fmfts.config import PadConfig, SimulatedSource
from fmfts_lab.study import stability
from fmfts_lab.study.hazards import Cell
from fmfts_lab.study.kernels import misfits
from fmfts_lab.study.method import Answer
from fmfts_lab.study.world import Sample, World, drawn_world, frame_times, pressed, presses

DAEMON = "the daemon, whole"


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("stability")
    assert main(["study", "stability", "--quick", "--config", "config.toml", "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def methods(out: Path) -> dict[str, dict[str, float]]:
    found: dict[str, dict[str, float]] = json.loads((out / "stability.json").read_text())["methods"]
    return found


def test_gate_accepts_all_without_a_degree_of_freedom() -> None:
    assert not misfits(0.0, 0)
    assert misfits(100.0, 4)
    assert misfits(np.nan, 4)


@pytest.mark.long
def test_daemon_answers_every_healthy_condition(methods: dict[str, dict[str, float]]) -> None:
    assert methods[DAEMON]["available_when_healthy"] >= 0.999


@pytest.mark.long
def test_daemon_is_never_wrong_unflagged_and_every_other_method_is(methods: dict[str, dict[str, float]]) -> None:
    assert methods[DAEMON]["wrong"] == 0
    assert all(other["wrong"] > 0 for name, other in methods.items() if name != DAEMON)


@pytest.mark.long
def test_flagging_everything_does_not_win(methods: dict[str, dict[str, float]]) -> None:
    daemon = methods[DAEMON]
    assert daemon["frames"] - daemon["flagged"] - daemon["wrong"] > 0.7 * daemon["frames"]


@pytest.mark.long
def test_every_frame_of_every_cell_is_right_or_wrong_or_flagged(out: Path) -> None:
    with (out / "stability.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        assert int(row["right"]) + int(row["wrong"]) + int(row["flagged"]) == int(row["frames"]) > 0
    assert len({row["dimension"] for row in rows}) == 18  # `timing` counts as lost frames and as jitter
    assert (out / "stability.svg").stat().st_size < 300_000


class Answering:
    """A method whose error is known."""

    def __init__(self, error_m: float, deviation_m: float | None, flagged: bool = False) -> None:
        self.error_m, self.deviation_m, self.flagged = error_m, deviation_m, flagged
        self.number = 0

    def ask(self, sample: Sample) -> int:
        self.number += 1
        return self.number - 1

    def told(self, raw: int) -> Answer:
        deviation = None if self.deviation_m is None else np.full(3, self.deviation_m)
        position = path.position_m[raw] + [self.error_m, 0.0, 0.0]
        return Answer(position, path.axis[raw], deviation, self.flagged)


world: World = drawn_world(PadConfig(name="demo", source=SimulatedSource()))
times = frame_times(0.2, 220.0)
path = pressed(world.built, times, presses(times, np.random.default_rng(1)))
cell = Cell("drill", "none", True, world, path, judged=np.ones(len(times), dtype=np.bool_))


@pytest.mark.parametrize(
    ("method", "outcome"),
    [
        (Answering(49e-6, 10e-6), "right"),
        (Answering(51e-6, 10e-6), "wrong"),
        (Answering(0.49e-3, None), "right"),
        (Answering(0.51e-3, None), "wrong"),
        (Answering(1.0, 10e-6, flagged=True), "flagged"),
    ],
)
def test_failure_is_five_published_deviations_or_half_a_millimetre(method: Answering, outcome: str) -> None:
    samples = world.samples(path, np.random.default_rng(2))
    row = stability._row(cell, "drill", stability._outcome(cell, lambda _: method, samples))
    assert row[outcome] == row["frames"] == len(times)
