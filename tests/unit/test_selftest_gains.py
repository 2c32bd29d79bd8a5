"""The gains that a self-test measured: stored with the sensors, and where every baseline of them begins."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import msgspec
import numpy as np
import pytest

from fmfts.baseline import Baseline, BaselineError, Mounting
from fmfts.baseline.files import path_of, store_gains, stored_gains
from fmfts.baseline.job import GainTest
from fmfts.baseline.origin import Origin
from fmfts.baseline.request import BaselineRequest, Recorded
from fmfts.config import PadConfig, SimulatedSource, ToleranceConfig
from fmfts.pad import Pad
from fmfts.sensor import Frame
from fmfts_simulation.baseline import hold_still
from fmfts_simulation.source import Simulated

MINE, ANOTHER = (Origin("bridge", "HMC5983", uid=uid, pad_index=0) for uid in ("0a", "0b"))
STRAPS = 0.005  # difference of the straps' fields between axes
CONFIG = PadConfig(name="standard", source=SimulatedSource(seed=4), tolerance=ToleranceConfig(gain=0.05))

GAIN = 1.0 + np.random.default_rng(2).normal(0.0, 0.05, (4, 3))


def chips() -> Simulated:
    """The simulated pad, with chips whose gains fill the tolerance."""
    source = Simulated(CONFIG)
    source.built.gain[:] = GAIN
    return source


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return tmp_path


@pytest.fixture
def pad() -> Pad:
    return CONFIG.pad()


def frames(source: Simulated, *, mounted: bool) -> list[Frame]:
    hold_still(source, mounted)
    begun_ns = source.deadline_ns()
    return [frame for step in range(661) for frame in source.poll(begun_ns + step * 10**9 // 220)]


def after_test(source: Simulated) -> Mapping[str, object]:
    """The facts of a self-test, whose gains are stored where it passed."""
    with ThreadPoolExecutor(1) as executor:
        task = GainTest(CONFIG.pad(), source, 0, executor, MINE)
        facts = task.facts()
        executor.shutdown()
        return task.facts() or facts or {}


def recorded(before: Baseline | None, source: Simulated, origin: Origin = MINE, *, bare: bool = False) -> Recorded:
    request = BaselineRequest(CONFIG.pad(), CONFIG.tolerance.si(), bare=bare, replaced=False, origin=origin)
    return request.record(frames(source, mounted=not bare), before)


def gain_deviation(mounting: Mounting) -> float:
    assert mounting.leftover is not None
    return float(np.sqrt(np.mean(np.square(mounting.leftover.sensitivity_deviation[:12]))))


def test_gains_of_passed_selftest_are_stored_and_begin_next_baseline(pad: Pad) -> None:
    untested = recorded(recorded(None, chips(), bare=True).baseline, chips())
    facts = after_test(chips())
    assert facts["passed"] is True
    assert facts["stored"] == str(path_of(pad.name, "selftest"))
    rest = recorded(recorded(None, chips(), bare=True).baseline, chips())
    # Untested, an axis is ±5 %, and the field at rest says little about it; tested, no axis is worse than its strap.
    assert gain_deviation(untested.mounting) > 4.0 * STRAPS
    assert gain_deviation(rest.mounting) <= STRAPS
    assert np.abs(rest.mounting.gain / GAIN - 1.0).max() < 4.0 * STRAPS
    assert (untested.baseline.gains_from, rest.baseline.gains_from) == ("tolerance", "selftest")
    assert untested.facts(pad)["gains_from"] == "tolerance.gain (±5.0 %)"
    assert rest.facts(pad)["gains_from"].endswith(" (±0.5 %)")
    assert _could_gain(untested)[0] == "selftest"
    assert "selftest" not in _could_gain(rest)


def _could_gain(recorded: Recorded) -> list[str]:
    return [sentence.split(":")[0] for sentence in recorded.facts(CONFIG.pad())["could_gain"]]


def test_gains_stay_in_baseline_and_under_bare_recording_alone(pad: Pad) -> None:
    after_test(chips())
    bare = recorded(None, chips(), bare=True)
    path_of(pad.name, "selftest").unlink()
    assert bare.baseline.gains is not None
    np.testing.assert_array_equal(bare.mounting.gain, bare.baseline.gains.gain)
    rest = recorded(bare.baseline, chips()).baseline
    assert rest.gains == bare.baseline.gains


def test_gains_of_another_board_are_not_used(pad: Pad) -> None:
    after_test(chips())
    assert stored_gains(pad, MINE) is not None
    assert stored_gains(pad, ANOTHER) is None
    assert recorded(None, chips(), ANOTHER, bare=True).baseline.gains_from == "tolerance"


def test_selftest_that_failed_leaves_gains_of_last_good_one(pad: Pad) -> None:
    after_test(chips())
    before = stored_gains(pad, MINE)
    broken = chips()
    broken.built.gain[2, 1] = 0.1
    facts = after_test(broken)
    assert facts["passed"] is False
    assert "stored" not in facts
    assert stored_gains(pad, MINE) == before


def test_damaged_file_of_a_selftest_is_refused_with_what_to_do(pad: Pad) -> None:
    after_test(chips())
    path = path_of(pad.name, "selftest")
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(BaselineError, match=r"the self-test in .*run `fmfts-daemon selftest` again"):
        recorded(None, chips(), bare=True)


def test_impossible_gains_are_refused(pad: Pad) -> None:
    facts = dict(after_test(chips()))
    path = store_gains(facts, pad, MINE)
    content = msgspec.json.decode(path.read_bytes())
    content["gains"]["gain"][0][0] = 0.0
    path.write_bytes(msgspec.json.encode(content))
    with pytest.raises(BaselineError, match="run `fmfts-daemon selftest` again"):
        stored_gains(pad, MINE)
