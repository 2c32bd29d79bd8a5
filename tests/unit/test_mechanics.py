"""The simulated pad's mechanical response: what must hold of it, and an independent finite-element model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from recovered import recover_poses

from fmfts.cli.main import main
from fmfts_calibrate.dataset import read_calibration_set
from fmfts_lab.calibration.standard_set import rows
from fmfts_simulation.solved_table import standard_mechanics

DATA = Path(__file__).parents[1] / "data"
# Of another finite-element model, labelled with a pressure of 10, 40 or 70 kPa times the patch's area at rest.
BY_PRESSURE = DATA / "calibration_pressure_1.23T.csv"
# The share of the pressed patch's rest area that is visible from above, at (8, 6):
# `python -m fmfts_lab.finite_elements.patch_area`.
SEEN_AREA = {0.2827: 0.988, 1.131: 0.949, 1.9792: 0.906}


def test_shipped_calibration_set_is_what_its_command_makes() -> None:
    shipped = np.loadtxt(DATA / "calibration_1.23T.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(rows(), shipped, rtol=1e-5)


@pytest.mark.parametrize("force_n", SEEN_AREA)
def test_independent_model_agrees_once_its_pressure_is_a_force(force_n: float) -> None:
    """Its pressure stays normal to the surface, so that its resultant is pressure times the area seen from above. The
    magnet's way is then ours to 2 %: the two models spread the load over the patch differently."""
    independent = read_calibration_set(BY_PRESSURE)
    chosen = np.flatnonzero((independent.force_n == force_n) & (np.hypot(independent.x_m, independent.y_m) < 9e-3))
    assert len(chosen) > 50
    moved = recover_poses(independent.field_t[chosen], independent.pad)
    x_m, y_m = independent.x_m[chosen], independent.y_m[chosen]
    ours = standard_mechanics().response(x_m, y_m, np.full(len(chosen), force_n * SEEN_AREA[force_n]))
    error = np.linalg.norm((ours - moved)[:, :3], axis=1) / np.linalg.norm(moved[:, :3], axis=1)
    assert error.max() < 0.02


def test_field_of_another_magnet_is_refused() -> None:
    calibration = read_calibration_set(BY_PRESSURE)
    with pytest.raises(ValueError, match="unexplained"):
        recover_poses(calibration.field_t[:1] * 1.02, calibration.pad)


def test_unloaded_pad_is_exactly_at_rest() -> None:
    place = np.linspace(-20e-3, 20e-3, 50)
    displacement_m, axis = standard_mechanics().displacement(place, -place, np.zeros(50))
    np.testing.assert_array_equal(displacement_m, 0.0)
    np.testing.assert_array_equal(axis, np.tile([0.0, 0.0, 1.0], (50, 1)))


def test_presses_in_a_row_move_the_magnet_as_each_alone() -> None:
    """To the last bit, though a press that repeats the one before it is computed once."""
    random = np.random.default_rng(3)
    low, high = np.array([[-12e-3, -12e-3, 0.1, -0.5, -0.5], [12e-3, 12e-3, 3.0, 0.5, 0.5]])
    once = random.uniform(low, high, (60, 5))
    once[1:6] = once[0]
    for changed in range(5):  # the next press differs by one number alone
        once[changed + 1 :, changed] = once[-1, changed]
    once[20:30, 2:] = 0.0
    press = np.repeat(once, random.integers(1, 5, len(once)), axis=0)
    for numbers in (3, 5):
        alone = [standard_mechanics().response(*row[:, None]) for row in press[:, :numbers]]
        np.testing.assert_array_equal(standard_mechanics().response(*press[:, :numbers].T), np.concatenate(alone))


def test_magnet_sinks_and_tilts_further_with_every_newton_up_to_six() -> None:
    random = np.random.default_rng(2)
    x_m, y_m = random.uniform(-14e-3, 14e-3, (2, 200))
    forces = np.linspace(0.0, 6.0, 61)
    response = [standard_mechanics().displacement(x_m, y_m, np.full(200, force)) for force in forces]
    depth = np.array([displacement_m[:, 2] for displacement_m, _ in response])
    tilt = np.array([np.hypot(axis[:, 0], axis[:, 1]) for _, axis in response])
    assert (np.diff(depth, axis=0) < 0.0).all()
    firm = np.hypot(x_m, y_m) > 1e-3  # at the centre there is no tilt that could grow
    assert (np.diff(tilt[:, firm], axis=0) > 0.0).all()


def test_response_is_smooth_where_the_table_ends() -> None:
    """Just beyond the largest force and just before it, the compliance is the same: the tangent goes on."""
    force = standard_mechanics().largest_force_n + np.array([-2e-4, -1e-4, 0.0, 1e-4, 2e-4])
    displacement_m, _ = standard_mechanics().displacement(np.full(5, 4e-3), np.full(5, 2e-3), force)
    compliance = np.diff(displacement_m[:, 2]) / 1e-4
    np.testing.assert_allclose(compliance, compliance[0], rtol=1e-4)


@pytest.mark.parametrize(
    ("mechanics", "model", "warned"), [("soft.npz", "default", True), ("standard", "default", False)]
)
def test_slab_that_the_shipped_model_was_not_made_for_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], mechanics: str, model: str, warned: bool
) -> None:
    (tmp_path / "soft.npz").touch()
    config = tmp_path / "pad.toml"
    config.write_text(
        f'[[pad]]\nname = "one"\n[pad.source]\ntype = "simulated"\nmechanics = "{mechanics}"\n'
        f'[pad.contact]\nmodel = "{model}"\n'
    )
    assert main(["check-config", "--config", str(config)]) == 0
    assert ("one: warning: [pad.source] mechanics is" in capsys.readouterr().err) == warned
