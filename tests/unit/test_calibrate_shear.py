"""Shear: measured by a model whose response includes it, and counted as an error by one without."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from fmfts.contact import ContactModel
from fmfts.pad import Pad
from fmfts_calibrate.dataset import CalibrationSet
from fmfts_calibrate.evaluate import evaluate
from fmfts_calibrate.field_table import DataError
from fmfts_calibrate.training import Options, calibrate
from fmfts_lab.calibration.simulated import magnet_fields, rest_field_of
from fmfts_simulation.solved_table import standard_mechanics

Array = NDArray[np.float64]
# A pad that answers shear evenly: the magnet's movement and tilt per newton. (The real one: lab/results/pad-model.md.)
MOVED_M_PER_N, TILTED_PER_N = 0.15e-3, 0.03


def sheared_fields(pad: Pad, press: Array) -> Array:
    moved, axis = standard_mechanics().displacement(press[:, 0] * 1e-3, press[:, 1] * 1e-3, press[:, 2])
    moved[:, :2] += MOVED_M_PER_N * press[:, 3:]
    tilt = axis[:, :2] + TILTED_PER_N * press[:, 3:]
    axis = np.column_stack([tilt, np.sqrt(1.0 - (tilt**2).sum(axis=1))])
    return magnet_fields(pad, moved, axis)


def sheared_set(pad: Pad, levels: Array, shears: list[tuple[float, float]]) -> CalibrationSet:
    """Every place of a grid over ±10 mm under three forces, with each shear as a share of the force."""
    press = np.array(
        [(x, y, f, f * sx, f * sy) for x in levels for y in levels for f in (0.4, 1.1, 1.9) for sx, sy in shears]
    )
    return CalibrationSet(
        pad, press, sheared_fields(pad, press), tuple(range(2, len(press) + 2)), "none", rest_field_of(pad)
    )


SHEARS = [(0.0, 0.0), (0.3, 0.0), (-0.3, 0.0), (0.0, 0.3), (0.0, -0.3), (0.2, 0.2), (-0.2, 0.2)]
GRID = np.linspace(-10.0, 10.0, 6)


def quiet(line: str) -> None:
    pass


@pytest.mark.long
def test_model_with_sheared_response_finds_place_force_and_shear(pad: Pad, tmp_path: Path) -> None:
    """Small layers, no noise, within 6 mm: tens of millinewtons, where shear is up to 0.5 N."""
    options = Options(hidden=8, presses=1500, shear=True)
    made = calibrate("set.csv", sheared_set(pad, GRID, SHEARS), options, quiet)
    path = tmp_path / "five.onnx"
    path.write_bytes(made.model)
    model = ContactModel.load(str(path), pad, friction=0.5)
    assert model.has_shear
    assert model.facts.envelope.x_mm == (-10.0, 10.0)
    random = np.random.default_rng(8)
    place, force = random.uniform(-4.0, 4.0, (60, 2)), random.uniform(0.8, 1.7, 60)
    press = np.column_stack(
        [place, force, force * random.uniform(-0.25, 0.25, 60), force * random.uniform(-0.25, 0.25, 60)]
    )
    judged = CalibrationSet(pad, press, sheared_fields(pad, press), tuple(range(60)), "none", rest_field_of(pad))
    found = evaluate(judged, Path("test.csv"), model, "drifting")
    assert found.in_range.all()
    error = np.abs(found.found - press).mean(axis=0)
    assert (error[:2] < 0.5).all()
    assert error[2] < 0.05
    assert (error[3:] < 0.05).all()


def test_friction_unknown_to_a_model_is_recorded_with_it(pad: Pad, tmp_path: Path) -> None:
    """From a set of its own, the calibration set having no shear."""
    normal, sheared = sheared_set(pad, GRID, [(0.0, 0.0)]), sheared_set(pad, GRID, SHEARS)
    made = calibrate("set.csv", normal, Options(hidden=5, presses=800), quiet, ("sheared.csv", sheared))
    path = tmp_path / "three.onnx"
    path.write_bytes(made.model)
    facts = ContactModel.load(str(path), pad).facts
    assert facts.outputs == ("x_mm", "y_mm", "force_n")
    assert facts.friction_error is not None
    centre = np.array(facts.friction_error.x_mm)[-2:, 0]
    # The error depends on the pad: here, some tenths of a millimetre for a newton.
    assert (centre > 0.2).all()
    knowing, ignoring = (ContactModel.load(str(path), pad, friction=friction) for friction in (0.0, 0.3))
    position, certain = pad.rest_position_m - [0.0, 0.0, 1e-3], np.eye(6) * 1e-16
    without, widened = (model.estimate(position, pad.rest_axis, certain).x_sd_m for model in (knowing, ignoring))
    # 0.9 N lie in the bin that ends at 0.7 of 1.9 N: 0.28 N of shear, and more than 0.2 mm for each newton.
    assert np.sqrt(widened**2 - without**2) > 0.056e-3


def test_set_without_shear_makes_no_shear_model(pad: Pad) -> None:
    with pytest.raises(DataError, match=r"set\.csv: no row has shear"):
        calibrate("set.csv", sheared_set(pad, GRID, [(0.0, 0.0)]), Options(shear=True), quiet)


def test_shear_model_without_friction_is_evaluated_by_place_and_force(pad: Pad) -> None:
    model = ContactModel.load("shear", pad, friction=0.0)
    judged = sheared_set(pad, np.array([-4.0, 4.0]), [(0.0, 0.0)])
    found = evaluate(judged, Path("test.csv"), model, "drifting")
    assert found.found.shape == (len(judged.press), 3)
    assert np.isfinite(found.found).all()
