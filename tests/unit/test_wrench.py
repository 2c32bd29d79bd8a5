"""The wrench of a contact and its covariance, against drawn forces and places."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest

from fmfts_client import Contact
from fmfts_client.row import COLUMNS, row_of
from fmfts_client.wrench import wrench_of
from unit.bus_messages import contact_message

HEIGHT_M = 0.012
FORCE = {"force_n": 1.5, "force_sd_n": 0.1, "shear_x_n": 0.3, "shear_x_sd_n": 0.05, "shear_y_n": -0.2}
PLACE = {"shear_y_sd_n": 0.02, "x_m": 4e-3, "x_sd_m": 3e-4, "y_m": -6e-3, "y_sd_m": 5e-4}


def contact(**changed: Any) -> Contact:
    message = contact_message(**({"contact": True, "over_range": False} | FORCE | PLACE | changed))
    return Contact.from_message(msgspec.to_builtins(message))


def test_covariance_is_that_of_drawn_forces_and_places() -> None:
    told = wrench_of(contact(), HEIGHT_M)
    random = np.random.default_rng(1)
    force = random.normal([0.3, -0.2, -1.5], [0.05, 0.02, 0.1], (400_000, 3))
    place = np.column_stack([random.normal([4e-3, -6e-3], [3e-4, 5e-4], (400_000, 2)), np.full(400_000, HEIGHT_M)])
    drawn = np.cov(np.column_stack([force, np.cross(place, force)]).T)
    sd = np.sqrt(np.diag(drawn))
    np.testing.assert_allclose(np.array(told.covariance) / np.outer(sd, sd), drawn / np.outer(sd, sd), atol=0.01)
    np.testing.assert_allclose(told.torque_nm, np.cross([4e-3, -6e-3, HEIGHT_M], told.force_n))


def test_unknown_value_is_nan_and_others_stay() -> None:
    told = wrench_of(contact(shear_x_n=None, shear_x_sd_n=None, shear_y_n=None, shear_y_sd_n=None), HEIGHT_M)
    covariance = np.array(told.covariance)
    assert told.force_n[2] == -1.5
    assert math.isnan(told.torque_nm[0])
    assert covariance[2, 2] == pytest.approx(0.1**2)
    assert np.isnan(covariance[[0, 1, 3, 4, 5], [0, 1, 3, 4, 5]]).all()


def test_untouched_pad_has_the_noise_of_its_force_and_no_torque() -> None:
    told = wrench_of(contact(contact=False, force_n=0.02, x_m=None, y_m=None), HEIGHT_M)
    assert (told.force_n, told.torque_nm) == ((0.0, 0.0, -0.02), (0.0, 0.0, 0.0))
    expected = np.zeros((6, 6))
    expected[2, 2] = 0.1**2
    np.testing.assert_allclose(told.covariance, expected)


def test_row_holds_all_known_values() -> None:
    row = dict(zip(COLUMNS, row_of(contact(shear_x_n=None, health="degraded"), 0.004), strict=True))
    assert (row["age_s"], row["degraded"], row["ok"], row["place_known"], row["shear_known"]) == (0.004, 1, 0, 1, 0)
    assert (row["force_n"], row["y_m"], row["shear_x_n"]) == (1.5, -6e-3, 0.0)
