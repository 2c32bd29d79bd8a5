"""A damaged pad is replaced: another magnet, built otherwise; one baseline, and the model of the old one serves."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from mounted_world import NOISE_T, TOLERANCE, World

from fmfts.baseline import Baseline, BaselineError, encode, make_rest
from fmfts.cli.main import main
from fmfts.common.names import field_columns
from fmfts.pad import Pad

PRESSES = 300
SIMULATED = '[[pad]]\nname = "standard"\n[pad.source]\ntype = "simulated"\n'
CONFIG = SIMULATED + "[pad.tolerance]\ngain = 0.005\nremanence = 0.05\n"


def replaced(old: World, remanence_t: float) -> World:
    """Another silicone with another magnet, placed and tilted otherwise, over the same sensors in the same field."""
    new = World(old.pad, np.random.default_rng(2))
    new.gain, new.places, new.earth_t = old.gain, old.places, old.earth_t
    new.remanence_t = remanence_t
    return new


def labelled(world: World, path: Path) -> None:
    """Raw fields, ambient and gains and noise in them, of presses within 8 mm."""
    random = np.random.default_rng(5)
    angle, radius_m = random.uniform(0, 2 * np.pi, PRESSES), 8e-3 * np.sqrt(random.uniform(0, 1, PRESSES))
    x_m, y_m, force_n = radius_m * np.cos(angle), radius_m * np.sin(angle), random.uniform(0.5, 1.9, PRESSES)
    with path.open("w", newline="") as out:
        writer = csv.writer(out)
        writer.writerow(["x_mm", "y_mm", "force_n", *field_columns(4)])
        for place_x, place_y, force, state in zip(x_m, y_m, force_n, world.pressed(x_m, y_m, force_n), strict=True):
            field = world.field(state) + random.normal(0.0, NOISE_T, (4, 3))
            writer.writerow([place_x * 1e3, place_y * 1e3, force, *(field.ravel() * 1e6)])


@pytest.mark.parametrize("remanence_t", [1.05, 1.28])
def test_new_pad_needs_a_baseline_and_nothing_else(
    tmp_path: Path, pad: Pad, remanence_t: float, capsys: pytest.CaptureFixture[str]
) -> None:
    """Mounting tolerances of 0.1 mm, 1° and ±0.5 % of gain: 0.1 mm and 0.02 N on average over pads (docs: what a
    baseline is worth), so 0.3 mm and 0.06 N on one."""
    old = World(pad, np.random.default_rng(1))
    new = replaced(old, remanence_t)
    first = old.baseline(TOLERANCE)
    with pytest.raises(BaselineError):
        make_rest(pad, TOLERANCE, new.recorded(new.field()), first)  # the test is whether the pad was replaced
    second, mounting = make_rest(pad, TOLERANCE, new.recorded(new.field()), first, replaced=True)
    # Height and moment are correlated: the tolerances leave 2 % of it, one deviation.
    assert mounting.remanence_t(pad) == pytest.approx(remanence_t, rel=0.05)
    labelled(new, tmp_path / "new.csv")
    found = evaluated(tmp_path, second, capsys)
    assert found["over_range"] == 0
    everywhere = found["regions"][0]  # type: ignore[index]
    assert everywhere["mae_x_mm"] < 0.3
    assert everywhere["mae_y_mm"] < 0.3
    assert everywhere["mae_force_n"] < 0.06


def evaluated(tmp_path: Path, baseline: Baseline, capsys: pytest.CaptureFixture[str]) -> dict[str, object]:
    (tmp_path / "pad.toml").write_text(CONFIG)
    (tmp_path / "baseline.json").write_bytes(encode(baseline))
    arguments = ["--config", str(tmp_path / "pad.toml"), "--baseline", str(tmp_path / "baseline.json"), "--json"]
    assert main(["evaluate", str(tmp_path / "new.csv"), *arguments]) == 0
    facts: dict[str, object] = json.loads(capsys.readouterr().out)
    return facts
