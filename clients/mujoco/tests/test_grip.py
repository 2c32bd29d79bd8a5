"""The gripper that holds with the least force: the world judges alone, and the controller holds where it is blind."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from fmfts_client import Contact

from fmfts_mujoco.grip import _pads, lift, line
from fmfts_mujoco.lift_over_bus import Gripping
from fmfts_mujoco.lifting import HIGH_M, PERIOD_S, Lift, Lifting, pads_here
from fmfts_mujoco.motion import COLUMNS, way_m
from fmfts_mujoco.objects import GRAVITY_M_PER_S2, SHAPES, Object
from fmfts_mujoco.rivals import controller, example

SEED = 4242  # of no published figure


def drawn(number: int, shape: str = "ball") -> Object:
    return Object.drawn(np.random.default_rng([SEED, number]), shape)


@pytest.mark.parametrize(("share", "slides"), [(1.08, False), (0.92, True)])
def test_object_slides_below_the_least_force_alone(share: float, slides: bool) -> None:
    """No pad and no controller: two fingers press, and the table is gone."""
    thing = replace(drawn(1), above_m=0.0, sideways_m=0.0)
    model = thing.model()
    data = mujoco.MjData(model)
    force_n, way_m = share * thing.least_n(thing.mass_kg, 0.0), 0.0
    for step in range(3000):
        way_m += 5e-5 * np.clip(force_n - data.sensordata.mean(), -0.5, 0.5)
        data.ctrl[:2] = way_m
        data.xfrc_applied[model.body("object").id, 2] = thing.mass_kg * GRAVITY_M_PER_S2 * (step < 2000)
        if step == 2000:
            model.geom_contype[model.geom("table").id] = model.geom_conaffinity[model.geom("table").id] = 0
            before_m = data.xpos[model.body("object").id, 2]
        mujoco.mj_step(model, data)
    fell_m = before_m - data.xpos[model.body("object").id, 2]
    assert (fell_m > 5e-3) if slides else (fell_m < 5e-4)


def test_filling_makes_the_glass_heavier_and_nothing_else() -> None:
    things = [drawn(number, shape) for shape in SHAPES for number in range(50)]
    assert all((thing.full > 1.0) == (thing.shape == "glass") for thing in things)
    least_n = [thing.least_n(thing.mass_kg * thing.full, 0.0) for thing in things]
    assert 0.8 <= min(least_n) < 0.85
    assert 1.4 < max(least_n) <= 1.45
    assert 0.02 < min(thing.mass_kg for thing in things) < max(thing.mass_kg for thing in things) < 0.36


@pytest.mark.parametrize("shape", SHAPES)
def test_example_holds_with_little_more_than_the_least_force(shape: str) -> None:
    ended = lift(2, SEED, "slip", shape, False, "tested")
    assert ended.end == "held"
    assert 1.0 < ended.share < 1.35
    assert ended.slid_m < 12e-3
    assert "0 dropped" in line("slip", [ended])


def test_force_alone_presses_harder() -> None:
    own, rival = (lift(2, SEED, kind, "ball", False, "tested") for kind in ("slip", "fixed"))
    assert rival.thing == own.thing
    assert rival.share > own.share


class Blind(Lifting):
    """This many of its pads fall silent as soon as the object is lifted."""

    silent = 2

    def _contacts(self, usable: object) -> list[Contact | None]:
        seen = super()._contacts(usable)
        return [None] * self.silent + seen[self.silent :] if self._phase in ("lift", "hold") else seen


class OneEyed(Blind):
    silent = 1


@pytest.mark.parametrize("kind", [Blind, OneEyed])
def test_example_holds_the_object_while_pads_say_nothing(kind: type[Blind]) -> None:
    configs, recorded = _pads(1, False, "tested")
    lifted = kind(drawn(3), pads_here(configs, recorded, 1, as_built=False)).run(controller("slip"), example().usable)
    there = lifted.during("lift", "hold")
    force_n = np.array(lifted.force_n)[there]
    assert force_n[20:].min() > force_n[20] - 0.05
    assert kind is OneEyed or np.ptp(force_n[20:]) < 0.05
    assert lifted.object_m[-1] - lifted.object_m[0] > 0.5e-2
    assert lifted.object_m[-1] < 2.0 * HIGH_M


def test_example_commands_from_a_process_of_its_own(tmp_path: Path) -> None:
    with Gripping(f"ipc://{tmp_path}") as gripping:
        gripping.wait()
        for loosen in (False, True):
            assert gripping.step([], loosen, 0.01)[:2] == (0.0, False), "no pad is there"
        assert not gripping.found


def test_turned_robot_makes_shear_better_known() -> None:
    _, recorded = _pads(1, False, "tested")
    assert all(baseline.turn is not None for baseline in recorded.values())


def recorded(path: Path, *columns: np.ndarray) -> Path:
    rows = [",".join(map(repr, map(float, row))) for row in np.column_stack(columns)]
    path.write_text("\n".join([",".join(COLUMNS), *rows]))
    return path


def test_recorded_motion_is_followed_with_its_acceleration(tmp_path: Path) -> None:
    """From rest to rest in 2 s, as a camera at 60 Hz paces the rows: 0.2 m along (3, 0, 4), at most 0.25 m/s²."""
    time_s = np.arange(0.0, 2.0, 1.0 / 60.0)
    away_m = 0.1 * (1.0 - np.cos(np.pi * time_s / time_s[-1]))
    path = recorded(tmp_path / "robot_state.csv", time_s + 7.0, 0.6 * away_m, 0.3 + 0.0 * time_s, 0.8 * away_m)
    motion_m = way_m(path, PERIOD_S)
    acceleration = np.diff(motion_m, 2) / PERIOD_S**2
    assert motion_m[0] == pytest.approx(0.0, abs=1e-4)
    assert motion_m[-1] == pytest.approx(0.2, abs=1e-4)
    expected = 0.1 * (np.pi / time_s[-1]) ** 2
    assert np.abs(acceleration).max() == pytest.approx(expected, rel=0.1)

    configs, baseline = _pads(1, False, "tested")
    lifting = Lifting(drawn(3), pads_here(configs, baseline, 1, as_built=False), motion_m)
    lifted = lifting.run(controller("slip"), example().usable)
    moved = lifted.during("move")
    assert lifted.held
    assert moved.sum() == len(motion_m)
    assert np.ptp(np.array(lifted.fingers_m)[moved]) == pytest.approx(0.2, abs=2e-3)
    least_n = np.array(lifted.least_n)[moved] / lifting.thing.least_n(lifting.thing.mass_kg, 0.0)
    assert least_n.max() == pytest.approx(1.0 + expected / GRAVITY_M_PER_S2, abs=0.02)


@pytest.mark.parametrize("rows", ["time,ee_T_03\n0,1\n1,2\n", ",".join(COLUMNS) + "\n0,0,0,0\n"])
def test_file_that_is_no_motion_is_refused_by_name(tmp_path: Path, rows: str) -> None:
    path = tmp_path / "other.csv"
    path.write_text(rows)
    with pytest.raises(ValueError, match=r"other\.csv: needs"):
        way_m(path, PERIOD_S)


@pytest.mark.parametrize(
    ("phase", "object_m", "ended"),
    [
        ("end", (0.0, 0.078, 0.075), (True, False)),
        ("end", (0.0, 0.078, 0.0), (False, True)),
        ("hold", (0.0, 0.078, -0.01), (False, True)),
        ("hold", (0.0, 0.075, 0.075), (False, False)),  # the time was up
        ("load", (0.0, 0.002, 0.0), (False, False)),
    ],
)
def test_object_is_dropped_only_if_it_fell(phase: str, object_m: tuple[float, ...], ended: tuple[bool, bool]) -> None:
    fingers_m = [0.0, 0.08, 0.08]
    lifted = Lift(drawn(1), phase=["close", "lift", phase], object_m=list(object_m), fingers_m=fingers_m)
    assert (lifted.held, lifted.dropped) == ended
