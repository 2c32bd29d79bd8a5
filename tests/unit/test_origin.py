"""Whose a baseline is."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import msgspec
import pytest

from fmfts.baseline import encode, load
from fmfts.baseline.job import BaselineJob
from fmfts.baseline.origin import Origin
from fmfts.baseline.recording import ForeignError
from fmfts.baseline.request import BaselineRequest
from fmfts.config import BridgeSource, I2cSource, PadConfig, ReplaySource, SimulatedSource
from fmfts.sources import origin_of
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.source import Simulated

UID = "0123456789abcdef01234567"


def of(source: BridgeSource | I2cSource | SimulatedSource | ReplaySource) -> Origin:
    origin = origin_of(PadConfig(name="left", source=source))
    assert origin is not None
    return origin


BOARD = of(BridgeSource(port="/dev/a"))
BUS = of(I2cSource(bus=1))


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (BOARD.on({"uid": UID}), BOARD.on({"uid": UID[::-1]})),
        (BOARD, of(BridgeSource(port="/dev/a", pad_index=1))),
        (BOARD, BUS),
        (BOARD, of(SimulatedSource())),
        (BUS, of(I2cSource(bus=2))),
        (BUS, of(I2cSource(bus=1, mux_address=0x71))),
        (BUS, of(I2cSource(bus=1, channels=(4, 5, 6, 7)))),
        (BUS, of(I2cSource(bus=1, chip="hmc5883l", rate_hz=75))),
        (of(SimulatedSource(seed=1)), of(SimulatedSource(seed=2))),
    ],
    ids=lambda origin: str(origin),
)
def test_baseline_of_other_sensors_is_refused_with_its_origin(one: Origin, other: Origin, tmp_path: Path) -> None:
    config = PadConfig(name="left", source=SimulatedSource(finger="none", turning_deg_per_s=0.0))
    path = tmp_path / "left.json"
    path.write_bytes(encode(simulated_baseline(config).recorded_on(one)))
    assert load(path, config.pad(), one) is not None
    with pytest.raises(ForeignError) as refused:
        load(path, config.pad(), other)
    assert f"was recorded on {one}, but the pad is on {other}" in str(refused.value)


@pytest.mark.parametrize("kind", ["turn", "refine"])
def test_other_sensors_baseline_is_refused_at_once(kind: str) -> None:
    config = PadConfig(name="left", source=SimulatedSource(finger="none", turning_deg_per_s=0.0))
    mine, others = of(SimulatedSource(seed=1)), of(SimulatedSource(seed=2))
    before = simulated_baseline(config).recorded_on(others)
    request = BaselineRequest(config.pad(), config.tolerance.si(), False, False, origin=mine, **{kind: True})
    with ThreadPoolExecutor(1) as executor, pytest.raises(ForeignError, match="seed 2"):
        BaselineJob(request, before, Simulated(config), executor)
    BaselineJob(request, before.recorded_on(mine), Simulated(config), executor)


def test_unknown_board_identity_is_not_a_difference() -> None:
    """A port without uid: the board tells it when it is open. Another port of the same board is the same board."""
    board = BOARD.on({"uid": UID.upper()})
    assert board.agrees_with(BOARD)
    assert board.agrees_with(of(BridgeSource(port="/dev/b", uid=UID.upper())))


def test_recording_asks_for_no_board() -> None:
    assert origin_of(PadConfig(name="left", source=ReplaySource(file="a.mcap"))) is None


def test_baseline_without_an_origin_keeps_its_old_id() -> None:
    config = PadConfig(name="left", source=SimulatedSource(finger="none", turning_deg_per_s=0.0))
    baseline = simulated_baseline(config)
    assert "origin" not in msgspec.to_builtins(baseline)
    assert baseline.recorded_on(BOARD).recorded_on(None).id == baseline.id
