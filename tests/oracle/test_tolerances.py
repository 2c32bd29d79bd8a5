"""The uncertainty of a contact through the pad's structure (contact/tolerances.c), against finite differences of whole
answers.

The response and the model are the product's; the effects of another pad or finger are written here again.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from fmfts.config import ContactConfig, PadConfig, SimulatedSource, ToleranceConfig
from fmfts.contact import ContactModel
from fmfts.contact.estimate import ContactEstimate
from fmfts.contact.tolerances import RING_MM, THICKER_MM, THICKER_SHARE, StructureTolerance
from fmfts.pad import Pad
from fmfts.pipeline.configured import contact_model_of, pipeline_of
from fmfts.pipeline.encoded import message_of
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.source import Simulated

Array = NDArray[np.float64]
# Places all over the pad, in mm, and forces up to the calibrated one.
PRESSES = np.column_stack(
    [np.random.default_rng(45).uniform(-11.0, 11.0, (12, 2)), np.random.default_rng(46).uniform(0.4, 1.9, 12)]
)
SURE = np.diag([1e-7, 1e-7, 1e-7, 1e-5, 1e-5, 1e-5]) ** 2
STEP = 0.02  # step of a movement, so small that an answer is linear in it


def model(pad: Pad, name: str = "default", **tolerance: Any) -> ContactModel:
    friction = 0.8 if name == "shear" else 0.0
    return ContactModel.load(name, pad, friction=friction, tolerance=StructureTolerance(**tolerance))


def answer(model: ContactModel, pad: Pad, change: Array) -> ContactEstimate:
    """The answer to a change (5,) of pose, in mm and components of an axis of +z."""
    m, n = change[3:].tolist()
    return model.estimate(pad.rest_position_m + change[:3] * 1e-3, np.array([m, n, np.sqrt(1.0 - m * m - n * n)]), SURE)


def moved_by(model: ContactModel, press: Array) -> Array:
    assert model.response is not None
    more = np.zeros(2 + model.response.loads)
    more[:3] = press
    change: Array = model.response.change(more[None])[0]
    return change


def added(with_it: ContactEstimate, without: ContactEstimate) -> Array:
    """The deviations that a tolerance adds."""
    return np.sqrt(np.maximum(with_it.deviations**2 - without.deviations**2, 0.0))


def error_of_scale(deviation: float) -> float:
    """A log-normal factor, one deviation of its logarithm above 1: by many small steps, not by exp."""
    steps = 2**22
    return float((1.0 + deviation / steps) ** steps - 1.0)


@pytest.mark.parametrize("press", PRESSES)
def test_stiffer_silicone_scales_the_force_at_the_same_place(pad: Pad, press: Array) -> None:
    plain, stiff = model(pad), model(pad, modulus=0.2)
    change = moved_by(plain, press)
    without = answer(plain, pad, change)
    expected = [0.0, 0.0, error_of_scale(0.2) * without.force_n]
    np.testing.assert_allclose(added(answer(stiff, pad, change), without), expected, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("press", PRESSES)
def test_thicker_silicones_error_agrees_with_the_table(pad: Pad, press: Array) -> None:
    plain, thick = model(pad), model(pad, thickness_m=0.2e-3)
    change = moved_by(plain, press)
    without = answer(plain, pad, change)
    place_mm = without.values[:2] * 1e3
    radius_mm = np.hypot(*place_mm)
    rings = RING_MM * np.arange(len(THICKER_MM))
    off_m = 0.2e-3 * np.abs(np.interp(radius_mm, rings, THICKER_MM) * place_mm) / radius_mm
    off_n = error_of_scale(0.2 * abs(np.interp(radius_mm, rings, THICKER_SHARE))) * without.force_n
    np.testing.assert_allclose(added(answer(thick, pad, change), without), [*off_m, off_n], rtol=1e-3, atol=2e-7)


@pytest.mark.parametrize("press", PRESSES)
def test_wider_fingers_error_is_that_of_its_extra_movement(pad: Pad, press: Array) -> None:
    """12 mm against the probe's 6: two deviations. The mean over a ring of presses with known second moments is an
    area's effect to second order; the model's answers to a small share of the difference are then compared."""
    plain, wide = model(pad), model(pad, finger_m=(6e-3, 12e-3))
    moment_mm2 = (12.0**2 - 6.0**2) / 16.0 / 2.0
    change, step = moved_by(plain, press), np.sqrt(moment_mm2)
    without = answer(plain, pad, change)
    found = without.values * [1e3, 1e3, 1.0]
    along = [
        (moved_by(plain, found + step * axis) + moved_by(plain, found - step * axis)) / 2.0 - moved_by(plain, found)
        for axis in np.eye(3)[:2]
    ]
    variance = np.zeros(3)
    for movement in (along[0] + along[1], (along[0] - along[1]) / 2.0):
        more, less = (answer(plain, pad, change + side * STEP * movement).values for side in (1.0, -1.0))
        variance += ((more - less) / (2.0 * STEP)) ** 2
    found, scale = added(answer(wide, pad, change), without), np.array([1e3, 1e3, 1.0])
    np.testing.assert_allclose(scale * found, scale * np.sqrt(variance), rtol=0.02, atol=1e-3)


@pytest.mark.parametrize("width_mm", [3.0, 12.0])
@pytest.mark.parametrize("press", PRESSES * [0.7, 0.7, 1.0])
def test_known_finger_reads_as_the_probe_does(pad: Pad, press: Array, width_mm: float) -> None:
    """A wider disc is the probe smeared over a ring: here over one of 60 points."""
    plain, known = model(pad), model(pad, finger_m=(width_mm * 1e-3, width_mm * 1e-3))
    moment_mm2 = (width_mm**2 - 6.0**2) / 16.0
    around = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    ring_mm = np.sqrt(2.0 * abs(moment_mm2)) * np.column_stack([np.cos(around), np.sin(around), 0.0 * around])
    by_probe = moved_by(plain, press)
    more = np.sign(moment_mm2) * (np.mean([moved_by(plain, press + each) for each in ring_mm], axis=0) - by_probe)
    expected = answer(plain, pad, by_probe).values
    by_finger, uncorrected = (answer(one, pad, by_probe + more).values for one in (known, plain))
    # Where the network and the table differ, the finger's part is taken at another press, by a tenth of it.
    left, before = (np.abs(one - expected) * [1e3, 1e3, 1.0] for one in (by_finger, uncorrected))
    assert (left <= 0.15 * before + [0.02, 0.02, 0.01]).all()


@pytest.mark.parametrize("name", ["default", "shear"])
def test_tolerances_change_no_answer_and_no_judgement(pad: Pad, name: str) -> None:
    """Over range is judged without them: a wrong scale makes no squeeze."""
    plain, open_one = model(pad, name), model(pad, name, modulus=0.2, thickness_m=2e-4, finger_m=(3e-3, 12e-3))
    for press in [*PRESSES, *(PRESSES * [1.0, 1.0, 1.5])]:
        change = moved_by(plain, press)
        one, other = answer(plain, pad, change), answer(open_one, pad, change)
        np.testing.assert_array_equal(one.values, other.values)
        assert (one.over_range, one.refused) == (other.over_range, other.refused)
        assert (other.deviations >= one.deviations).all()


def test_shears_scale_like_the_force(pad: Pad) -> None:
    plain, stiff = model(pad, "shear"), model(pad, "shear", modulus=0.2)
    assert plain.response is not None
    change = plain.response.change(np.array([[1.0, 2.0, 1.5, 0.3, -0.2]]))[0]
    without = answer(plain, pad, change)
    assert without.shear_n is not None
    expected = error_of_scale(0.2) * np.abs(without.values[2:])
    np.testing.assert_allclose(added(answer(stiff, pad, change), without)[2:], expected, rtol=1e-6)


def test_tolerances_do_not_change_begin_and_end_of_contacts() -> None:
    """A touch is judged by noise: an unknown scale of the force makes it no less certain."""
    said = []
    for modulus, thickness_mm, finger_mm in ((0.0, 0.0, (6.0, 6.0)), (0.4, 0.4, (1.0, 15.0))):
        config = PadConfig(
            name="touched",
            source=SimulatedSource(seed=3, turning_deg_per_s=0.0),
            tolerance=ToleranceConfig(modulus=modulus, thickness_mm=thickness_mm),
            contact=ContactConfig(finger_mm=finger_mm),
        )
        pipeline = pipeline_of(config, contact_model_of(config), "boot")
        pipeline.use(simulated_baseline(config))
        source = Simulated(config)
        frames = [frame for step in range(1800) for frame in source.poll(step * 4545454)]
        messages = [message_of(answer) for answer in map(pipeline.answer, frames) if answer is not None]
        said.append([(one.contact, one.over_range, one.health, one.x_m, one.force_n) for one in messages])
    assert said[0] == said[1]
    assert sum(contact is True for contact, *_ in said[0]) > 300
