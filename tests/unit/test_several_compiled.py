"""The C of several/ against its NumPy: the same bits, for every pad and every finger."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from several_world import fingers_of, models_of

from fmfts.several.compiled import AVAILABLE
from fmfts.several.field_model import Predicted

COMPILED = pytest.mark.skipif(not AVAILABLE, reason="the estimator of several magnets was not compiled")
# Magnets, sensors, causes, knots, terms: the usual pad, the least, the most, and sizes that fill no register.
PADS = [(4, 8, 48, 15, 1), (1, 2, 1, 4, 3), (9, 16, 64, 12, 8), (3, 5, 7, 6, 2), (2, 7, 0, 31, 2)]


def bits(*arrays: np.ndarray | float) -> list[bytes]:
    return [np.ascontiguousarray(array, float).tobytes() for array in arrays]


def of_predicted(one: Predicted) -> list[bytes]:
    return bits(*one[:4], *(part for pressed in one.pressed for part in pressed))


@COMPILED
@pytest.mark.parametrize("sizes", PADS)
@pytest.mark.parametrize("beyond", [False, True], ids=["on the table", "beyond it"])
def test_field_and_its_covariance_have_the_same_bits_in_c(sizes: tuple[int, ...], beyond: bool) -> None:
    model, reference = models_of(1, *sizes)
    assert model.compiled
    assert not reference.compiled
    random = np.random.default_rng(2)
    for trial in range(20):
        fingers = fingers_of(random, trial % 4, beyond)
        there, here = model.predict(fingers), reference.predict(fingers)
        assert of_predicted(there) == of_predicted(here)
        assert [part.shape for part in there[:4]] == [part.shape for part in here[:4]]
        variance, ambient = random.uniform(0.5e-14, 2e-14, len(here.field_t)), random.normal(0.0, 2e-5, 3)
        covariance = [one.covariance(fingers, here, variance, ambient) for one in (model, reference)]
        assert bits(covariance[0]) == bits(covariance[1])


@pytest.mark.parametrize("which", [0, 1], ids=["compiled", "NumPy"])
def test_finger_that_is_no_number_is_refused_by_name(which: int) -> None:
    model = models_of(1)[which]
    with pytest.raises(ValueError, match="fingers: number 4 is nan"):
        model.predict(np.array([[0.0, 0.0, 1.0], [0.0, np.nan, 1.0]]))


@COMPILED
@pytest.mark.parametrize("sizes", [(10, 8, 4, 6, 1), (4, 17, 4, 6, 1), (4, 8, 65, 6, 1), (4, 8, 4, 6, 9)])
def test_pad_that_is_too_large_for_c_is_computed_in_numpy(sizes: tuple[int, ...]) -> None:
    model, reference = models_of(3, *sizes)
    assert not model.compiled
    fingers = np.array([[1.0, 2.0, 1.0]])
    assert of_predicted(model.predict(fingers)) == of_predicted(reference.predict(fingers))


@COMPILED
def test_more_fingers_than_c_has_room_for_are_computed_in_numpy() -> None:
    model, reference = models_of(4)
    fingers = fingers_of(np.random.default_rng(5), 4)
    there, here = model.predict(fingers), reference.predict(fingers)
    assert of_predicted(there) == of_predicted(here)
    noise, none = np.full(len(here.field_t), 4e-14), np.zeros(3)
    covariance = [one.covariance(fingers, here, noise, none) for one in (model, reference)]
    assert bits(covariance[0]) == bits(covariance[1])


WITHOUT_C = """
import sys
{missing}
from several_world import models_of
model, reference = models_of(1)
assert not model.compiled
import numpy as np
fingers = np.array([[1.0, 2.0, 1.0]])
print(model.predict(fingers).field_t.tobytes().hex())
"""


@pytest.mark.parametrize(
    ("missing", "solver"), [("sys.modules['fmfts.several._several'] = None", ""), ("", "numpy")], ids=["none", "off"]
)
def test_without_the_compiled_part_numpy_says_the_same(missing: str, solver: str) -> None:
    """As on a machine without a compiler, and where FMFTS_SOLVER=numpy turns C off."""
    said = subprocess.run(
        [sys.executable, "-c", WITHOUT_C.format(missing=missing)],
        env=os.environ | {"FMFTS_SOLVER": solver, "PYTHONPATH": str(Path(__file__).parent)},
        capture_output=True,
        text=True,
        check=False,
    )
    field = models_of(1)[0].predict(np.array([[1.0, 2.0, 1.0]])).field_t
    assert said.stdout.strip() == field.tobytes().hex(), said.stderr
