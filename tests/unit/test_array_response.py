"""The table of presses of several magnets: its derivatives, its symmetry, its file."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from fmfts.contact import ModelError, OtherPadError
from fmfts.contact.array_model import ARRAY_PATH, ArrayModel
from fmfts.contact.array_response import ArrayResponse, ResponseError
from fmfts.pad import Array
from fmfts_lab.finite_elements.array_model import DATA, mirrored, read_presses, response_of
from fmfts_lab.finite_elements.array_pad import array_config

PAD = array_config().pad()
SHIPPED = ArrayModel.load(ARRAY_PATH, PAD).response
PRESS = np.array([3.3, -5.1, 0.7])


def changed(press: Array) -> Array:
    return SHIPPED.pressed(*press.tolist()).change


@pytest.mark.parametrize("column", range(3))
@pytest.mark.parametrize("press", [PRESS, np.array([13.9, 0.1, 2.9]), np.array([0.0, 6.0, 3.5])])
def test_slopes_agree_with_differences(column: int, press: Array) -> None:
    step = np.zeros(3)
    step[column] = 1e-5
    difference = (changed(press + step) - changed(press - step)) / 2e-5
    slope = SHIPPED.pressed(*press.tolist()).slope[:, column]
    assert np.allclose(slope, difference, rtol=1e-6, atol=1e-8 * np.abs(changed(press)).max())


def test_laplacian_gives_the_effect_of_a_wider_patch() -> None:
    """The mean over a ring of radius r is the middle and r²/4 times the Laplacian, to r⁴: of splines 2 mm wide, 1 %."""
    radius = 0.2
    angles = 2.0 * np.pi * np.arange(16) / 16
    ring = [changed(PRESS + np.array([radius * np.cos(a), radius * np.sin(a), 0.0])) for a in angles]
    wider = (np.mean(ring, axis=0) - changed(PRESS)) * 4.0 / radius**2
    told = SHIPPED.pressed(*PRESS.tolist()).laplacian
    assert np.abs(told - wider).max() < 0.01 * np.abs(wider).max()


def test_shipped_table_has_the_pads_eight_symmetries() -> None:
    places, changes = mirrored(PRESS[None, :2], changed(PRESS)[None])
    for place, change in zip(places, changes, strict=True):
        assert np.allclose(changed(np.append(place, PRESS[2])), change, atol=1e-9)


def test_table_continues_along_its_tangent() -> None:
    most = SHIPPED.scale_n
    at, slope = (SHIPPED.pressed(2.0, 2.0, most).change, SHIPPED.pressed(2.0, 2.0, most).slope[:, 2])
    assert np.allclose(SHIPPED.pressed(2.0, 2.0, most + 0.5).change, at + 0.5 * slope, rtol=1e-12)


def test_shipped_file_is_made_of_the_solved_presses() -> None:
    """Of the grid's presses the table repeats each one, to the rounding of the CSV: a tenth of a nanometre."""
    presses, changes = read_presses(DATA / "normal.csv")
    told = np.array([changed(press[0, :3]) for press in presses])
    assert np.abs(told - changes).max() < 2e-7  # mm, and 1e-7 of the axis
    with pytest.raises(ValueError, match="not solved yet"):
        response_of(DATA / "test-one.csv", PAD.geometry_hash)


def test_presses_that_finite_elements_solved_off_the_grid_agree() -> None:
    """RESPONSE_ERROR, half a percent, is twice what interpolation errs."""
    presses, changes = read_presses(DATA / "test-one.csv")
    told = np.array([changed(press[0, :3]) for press in presses])
    scale = np.tile([1.0, 1.0, 1.0, 4.0, 4.0], 4)
    error = np.abs((told - changes) * scale).max(axis=1) / np.abs(changes * scale).max(axis=1)
    assert error.max() < 0.003


def test_file_is_read_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "again.response"
    path.write_bytes(SHIPPED.encoded())
    again = ArrayModel.load(path, PAD)
    assert again.hash == hashlib.sha256(path.read_bytes()).hexdigest()[:12]
    assert np.array_equal(again.response.coefficient, SHIPPED.coefficient)
    assert np.array_equal(again.response.shear, SHIPPED.shear)


@pytest.mark.parametrize("damage", ["short", "nan", "format", "shape", "not msgpack"])
def test_damaged_file_is_refused_by_name(damage: str, tmp_path: Path) -> None:
    content = SHIPPED.encoded()
    facts = msgspec.msgpack.decode(content)
    if damage == "nan":
        facts["coefficient"] = np.full(len(facts["coefficient"]) // 8, np.nan).tobytes()
    elif damage == "format":
        facts["format"] = "something else"
    elif damage == "shape":
        facts["shape"] = [3, 3, 1, 20]
    content = {"short": content[:-9], "not msgpack": b"\xc1" + content}.get(damage, msgspec.msgpack.encode(facts))
    path = tmp_path / "damaged.response"
    path.write_bytes(content)
    with pytest.raises(ModelError, match=r"damaged\.response"):
        ArrayModel.load(path, PAD)
    with pytest.raises(ResponseError):
        ArrayResponse.of(content, "it")


def test_table_that_is_wider_than_the_search_is_refused() -> None:
    knots = SHIPPED.coefficient.shape[0] - 3
    wide = replace(SHIPPED, first_mm=-35.0, spacing_mm=70.0 / knots)
    with pytest.raises(ResponseError, match="its table is 70 mm wide: at most 60"):
        ArrayResponse.of(wide.encoded(), "it")


def test_model_of_another_pad_is_refused() -> None:
    other = msgspec.structs.replace(array_config(), other_magnets=array_config().other_magnets[:2]).pad()
    with pytest.raises(OtherPadError, match="for another pad"):
        ArrayModel.load(ARRAY_PATH, other)
