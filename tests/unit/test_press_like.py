"""A contact needs a press that moves the magnet as it moved: what steel does to a pose is none."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest
from contact_steps_in_c import COMPILED, Estimate, TouchInC
from numpy.typing import NDArray

from fmfts.contact import ContactModel
from fmfts.contact.touch import TouchDetector
from fmfts.pad import Pad
from fmfts.pipeline.configured import load_contact_model
from fmfts_lab.bench import tools
from fmfts_lab.bench.tool_ways import WAYS, Tool
from fmfts_simulation.finger import no_finger
from oracle.compiled import pointer

Array = NDArray[np.float64]
COMPILED.fmfts_explained_share.restype = ctypes.c_double
COMPILED.fmfts_view_response.restype = ctypes.c_bool
BEGINS, KEPT = 0.75, 0.25  # contact/touch.c
# Of a pad on a robot that turns, after bare and rest alone, in mm and components of the axis.
DEVIATION = np.array([0.117, 0.115, 0.035, 0.020, 0.019])
# A magnet of 55 mA·m² put down 60 mm beside it: sideways, tilted, and up.
BESIDE_MAGNET = np.array([-0.68, -0.51, 0.154, -0.135, -0.110])


class Table(ctypes.Structure):
    """fmfts_response of contact/refine.h."""

    _fields_ = (
        ("knots", ctypes.c_size_t * 2),
        ("monomials", ctypes.c_size_t),
        ("loads", ctypes.c_size_t),
        ("first_mm", ctypes.c_double * 2),
        ("spacing_mm", ctypes.c_double * 2),
        ("scale_n", ctypes.c_double),
        ("exponent", ctypes.c_void_p),
        ("coefficient", ctypes.c_void_p),
    )


class Search(ctypes.Structure):
    """fmfts_press_search of contact/refine.h."""

    _fields_ = (
        ("change", ctypes.c_void_p),
        ("covariance", ctypes.c_void_p),
        ("steps", ctypes.c_int),
        ("settled", ctypes.c_double),
        ("shear_share", ctypes.c_double),
    )


@pytest.fixture
def model(pad: Pad) -> ContactModel:
    return ContactModel.load("default", pad)


def explained(model: ContactModel, change: Array, answer: Array) -> float:
    assert model.packed_response is not None
    packed, table = np.frombuffer(model.packed_response, np.uint8).copy(), Table()
    content, size = ctypes.c_void_p(packed.ctypes.data), ctypes.c_size_t(packed.size)
    assert COMPILED.fmfts_view_response(content, size, ctypes.byref(table))
    lowered = ctypes.c_double()
    given = [np.ascontiguousarray(each, dtype=float) for each in (change, np.diag(DEVIATION**2), answer)]
    search = Search(given[0].ctypes.data, given[1].ctypes.data)
    share = COMPILED.fmfts_explained_share(
        ctypes.byref(table), ctypes.byref(search), pointer(given[2]), ctypes.c_double(BEGINS), ctypes.byref(lowered)
    )
    return float(share)


@pytest.mark.parametrize("answer", [(-8.3, -6.0, 3.0), (0.0, 0.0, 1.0), (-14.0, -14.0, 1.7)])
def test_change_beside_a_magnet_is_no_press(model: ContactModel, answer: tuple[float, ...]) -> None:
    assert explained(model, BESIDE_MAGNET, np.array(answer)) < 0.3


def test_detected_presses_are_explained(model: ContactModel) -> None:
    """From answers that are off, as a network's are of an uncertain pose. Presses with forces beyond the calibrated
    ones, too.
    """
    assert model.response is not None
    random, onset = np.random.default_rng(1), TouchDetector(220.0).onset_chi2
    press = np.column_stack([random.uniform(-10.0, 10.0, (1500, 2)), random.uniform(0.1, 4.0, 1500)])
    changes = model.response.change(press) + random.normal(size=(1500, 5)) * DEVIATION
    felt = np.sum((changes / DEVIATION) ** 2, axis=1) > onset
    answers = press + random.normal(size=press.shape) * [2.0, 2.0, 0.1]
    shares = np.array([explained(model, *one) for one in zip(changes[felt], answers[felt], strict=True)])
    assert len(shares) > 1000
    assert np.mean(shares > BEGINS) > 0.995
    assert np.mean(shares > KEPT) > 0.999


def test_contact_needs_a_press_that_explains_the_movement() -> None:
    detector = TouchInC()
    detector.update(np.full(5, 1e-3), np.diag([8.6e-6, 8.6e-6, 6.1e-6, 2e-3, 2e-3]) ** 2)
    shares, said = (0.7, 0.8, 0.3, 0.2, 0.6), []
    for share in shares:
        estimate = Estimate.of(3.0, 0.1, 0.1)
        estimate.explained = share
        said.append(detector.presses(estimate))
    assert said == [False, True, True, False, False]
    estimate.is_beyond = True  # a squeeze that the table describes less well
    assert detector.presses(estimate)


def test_magnet_put_down_beside_an_unturned_pad_is_no_contact() -> None:
    """For two seconds, 440 frames read as a contact of 3.1 ± 1.7 N."""
    config = tools.pad_config("turning", 1, "hand")
    way = next(one for one in WAYS if one.label.startswith("put down 60 mm 0.05"))
    tool = Tool(way, 0.055, np.random.default_rng([1, WAYS.index(way), 55000]))
    baseline, model = tools.baseline_of(config, "turning"), load_contact_model(config)
    messages, _ = tools.messages_beside(config, baseline, tool, no_finger, way.seconds, model)
    assert any(message.health == "ok" for message in messages[-300:])
    assert not any(message.contact for message in messages)
