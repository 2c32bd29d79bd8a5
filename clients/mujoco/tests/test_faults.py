"""Faults of a board show in health and reason as on the robot."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import pytest
from worlds import WEIGHT_N, pressed, run

from fmfts_mujoco import Faults, Pads
from fmfts_mujoco.told import Told


@pytest.fixture
def faults() -> Iterator[Faults]:
    model, data, pads = pressed()
    mujoco.mj_resetData(model, data)
    pads.reset(1)
    run(model, data, pads, 0.5)
    pads.contacts()
    broken = pads.faults["left"]
    yield broken
    broken.silent.clear()
    broken.stuck.clear()
    broken.unplugged = False


def told_later(seconds: float) -> Told:
    model, data, pads = pressed()
    run(model, data, pads, seconds)
    return pads.contacts()["left"]


def test_silent_sensor_is_left_out_and_named(faults: Faults) -> None:
    faults.silent.add(1)
    last = told_later(0.3)[-1]
    assert (last.health, last.sensors_ok) == ("degraded", 0b1101)
    assert "sensor 2" in last.reason
    assert abs(last.force_n - WEIGHT_N) < 3.0 * last.force_sd_n


def test_stuck_sensor_is_found(faults: Faults) -> None:
    faults.stuck.add(0)
    last = told_later(0.6)[-1]
    assert last.health != "ok"
    assert "sensor 1" in last.reason


def test_unplugged_board_is_disconnected_and_comes_back(faults: Faults) -> None:
    faults.unplugged = True
    told = told_later(0.5)
    assert told[-1].health == "disconnected"
    assert "unplugged" in told[-1].reason
    assert told[-1].force_n is None
    assert 2 <= len(told) <= 6
    faults.unplugged = False
    assert told_later(0.5)[-1].health == "ok"


def test_fault_of_one_pad_stays(faults: Faults) -> None:
    """A program asks for faults by the pad's name."""
    _, _, pads = pressed()
    assert isinstance(pads, Pads)
    assert pads.faults == {"left": faults}
