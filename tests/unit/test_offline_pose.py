"""`fmfts-daemon pose` with every model: what each leaves unknown, on fields that need it."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from fmfts.cli.main import main
from fmfts.common import exit_codes
from fmfts.common.names import field_columns
from fmfts.pad import Pad
from fmfts.pose import State, dipole_field
from fmfts.pose.kernel import predict
from fmfts.pose.problem import magnet_rows, measurement_rows
from fmfts_simulation.cylinder import cylinder_field

CONFIG = """
[[pad]]
name = "a"
source.type = "simulated"
scene.neighbours = ["b"]
[[pad]]
name = "b"
source.type = "simulated"
placement.position_mm = [30, 0, 0]
"""
AMBIENT_T = np.array([2.1e-5, -1.3e-5, 3.2e-5])
PRESSED = np.array([3e-4, -2e-4, -9e-4, 0.08, 0.05])
B_PRESSED = np.array([-2e-4, 1e-4, -8e-4, -0.06, 0.04])


def solved(folder: Path, field_t: np.ndarray, *options: str) -> dict[str, str]:
    (folder / "config.toml").write_text(CONFIG)
    source, target = folder / "field.csv", folder / "pose.csv"
    source.write_text(
        ",".join(field_columns(4)) + "\n" + ",".join(f"{value * 1e6:.9f}" for value in field_t.ravel()) + "\n"
    )
    command = ["pose", "--config", str(folder / "config.toml"), "--pad", "a", str(source), "-o", str(target)]
    assert main([*command, *options]) == 0
    with target.open() as lines:
        (row,) = csv.DictReader(lines)
    return row


def off_um(row: dict[str, str], truth: State) -> float:
    assert row["status"] == "converged"
    return float(np.linalg.norm([float(row[f"{axis}_mm"]) * 1e3 for axis in "abc"] - truth.position_m * 1e6))


def field_of(pad: Pad, state: State) -> np.ndarray:
    return dipole_field(pad.sensors.position_m, state.position_m, state.axis, pad.magnet.strength_t_m3)


@pytest.fixture
def pressed(pad: Pad) -> State:
    return State.at_rest(pad).stepped(PRESSED)


def test_ambient_field_needs_eight_unknowns_and_is_reported(pad: Pad, pressed: State, tmp_path: Path) -> None:
    field = field_of(pad, pressed) + AMBIENT_T
    assert off_um(solved(tmp_path, field), pressed) > 100.0
    row = solved(tmp_path, field, "--unknowns", "8")
    assert off_um(row, pressed) < 0.1  # error in a noise-free field; the bound at 2 mG is 15 µm
    assert [float(row[f"ambient_{axis}_ut"]) for axis in "xyz"] == pytest.approx(AMBIENT_T * 1e6, abs=1e-3)
    assert all(float(row[f"ambient_{axis}_ut_sd"]) > 0.0 for axis in "xyz")


@pytest.mark.parametrize(("factor", "unit"), [(1e-2, "gauss"), (1e-3, "millitesla")])
def test_fields_in_another_unit_are_refused_as_calibrate_does(
    pad: Pad, pressed: State, tmp_path: Path, capsys: pytest.CaptureFixture[str], factor: float, unit: str
) -> None:
    row = ",".join(f"{value * 1e6 * factor:.9f}" for value in field_of(pad, pressed).ravel())
    (tmp_path / "field.csv").write_text(f"{','.join(field_columns(4))}\n{row}\n")
    (tmp_path / "config.toml").write_text(CONFIG)
    words = ["pose", "--config", str(tmp_path / "config.toml"), "--pad", "a", str(tmp_path / "field.csv")]
    assert main(words) == exit_codes.DATA
    assert f"in most rows; these columns are in µT (1 G = 100 µT): were they in {unit}?" in capsys.readouterr().err


def test_known_moment_makes_five_unknowns_and_is_held(pad: Pad, pressed: State, tmp_path: Path) -> None:
    row = solved(tmp_path, field_of(pad, pressed), "--unknowns", "5")
    assert off_um(row, pressed) < 0.1
    assert (float(row["remanence_t"]), float(row["remanence_t_sd"])) == (1.23, 0.0)
    assert "ambient_x_ut" not in row


def test_nine_unknowns_are_observable_only_when_tilted(pad: Pad, tmp_path: Path) -> None:
    row = solved(tmp_path, field_of(pad, State.at_rest(pad)), "--unknowns", "9")
    assert row["status"] == "unobservable"
    assert row["c_mm"] == row["remanence_t"] == row["ambient_z_ut"] == ""
    tilted = State.at_rest(pad).stepped(np.array([7e-4, 0.0, -3e-4, 1.0, 0.0]))
    assert off_um(solved(tmp_path, field_of(pad, tilted), "--unknowns", "9"), tilted) < 1.0


def test_octupole_takes_the_cylinders_error_away(pad: Pad, pressed: State, tmp_path: Path) -> None:
    field = cylinder_field(pad.sensors.position_m, pressed.position_m, pressed.axis, pad.magnet)
    assert off_um(solved(tmp_path, field), pressed) > 10.0
    assert off_um(solved(tmp_path, field, "--octupole"), pressed) < 1.0  # the next term is a hundred times smaller


def test_gradient_is_reported_from_the_pose(pad: Pad, pressed: State, tmp_path: Path) -> None:
    """Of 3e-4 T/m, as a prior of that size has it; five unknowns leave seven for the gradient's five."""
    state = State(pressed.position_m, pressed.axis, 0.0, np.zeros(3), 2e-4 * np.array([1.0, -0.5, 0.3, -0.8, 0.6]))
    rows = measurement_rows(np.zeros((4, 3)), pad.sensors, 1.0)
    field = predict(rows, magnet_rows(pad.magnet), state)[0].reshape(4, 3)
    without = off_um(solved(tmp_path, field, "--unknowns", "5"), pressed)
    with_gradient = off_um(solved(tmp_path, field, "--unknowns", "5", "--gradient-ut-per-mm", "0.3"), pressed)
    assert with_gradient < 0.1 * without


def test_neighbour_that_moved_is_part_of_the_state(pad: Pad, pressed: State, tmp_path: Path) -> None:
    """30 mm away: what a baseline left of it, its change, is told by this pad's sensors alone."""
    there = np.array([30e-3, 0.0, 0.0])
    rest = State.at_rest(pad)
    b = rest.stepped(B_PRESSED)
    moved = State(b.position_m + there, b.axis, 0.0, np.zeros(3))
    at_rest = State(rest.position_m + there, rest.axis, 0.0, np.zeros(3))
    field = field_of(pad, pressed) + field_of(pad, moved) - field_of(pad, at_rest)
    without = off_um(solved(tmp_path, field, "--unknowns", "5"), pressed)
    row = solved(tmp_path, field, "--unknowns", "5", "--neighbours")
    assert off_um(row, pressed) < 0.3 * without
    deviation_um = 1e3 * np.linalg.norm([float(row[f"{axis}_mm_sd"]) for axis in "abc"])
    assert off_um(row, pressed) < 3.0 * deviation_um
