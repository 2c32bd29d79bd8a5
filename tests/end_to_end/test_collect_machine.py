"""The driver of a G-code machine alone, on the emulated one, in simulated time."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import msgspec
import pytest

from emulator.gcode_machine import GcodeMachine
from end_to_end.collecting_bench import SimulatedClock
from fmfts.sensor import Frame
from fmfts_collect.errors import StoppedError
from fmfts_collect.gauge import Reading
from fmfts_collect.machine import SHORT_S, Machine
from fmfts_collect.plan import Press
from fmfts_collect.settings import StageConfig
from fmfts_collect.stage import Stage
from fmfts_collect.watch import Limits, Watch

CLEAR_MM = 39.0
PRESS_MM_PER_S = 1.0
both_dialects = pytest.mark.parametrize("dialect", ["marlin", "grbl"])


def stage_config(port: Path, dialect: str) -> StageConfig:
    return StageConfig(
        port=str(port),
        dialect=dialect,  # type: ignore[arg-type]
        travel_mm=((80, 120), (80, 120), (5, 40)),
        force_limit_n=4.5,
        origin_mm=(100, 100),
        clear_z_mm=CLEAR_MM,
    )


@contextmanager
def stock_machine(folder: Path, dialect: str) -> Iterator[tuple[GcodeMachine, StageConfig, SimulatedClock]]:
    with GcodeMachine(folder / "machine", dialect) as machine:
        machine.port.lockstep = True
        yield machine, stage_config(folder / "machine", dialect), SimulatedClock(machine.turn, 0.002)


@both_dialects
def test_high_lift_at_the_default_speed_is_no_stall(tmp_path: Path, dialect: str) -> None:
    """A stock z axis takes five seconds for 26 mm, whatever the commanded feed."""
    with stock_machine(tmp_path, dialect) as (emulated, config, clock):
        machine = Machine(config, clock)
        machine.begin()
        machine.move(z=CLEAR_MM, mm_per_s=config.lift_mm_per_s)
        assert emulated.place[2] == CLEAR_MM
        machine.close()


@both_dialects
def test_rise_from_a_long_way_down_ends_that_way(tmp_path: Path, dialect: str) -> None:
    with stock_machine(tmp_path, dialect) as (emulated, config, clock):
        machine = Machine(config, clock)
        machine.begin()
        machine.move(z=30.0, mm_per_s=4.0)
        heard_ns = clock.now_ns()

        def interrupt() -> None:
            if clock.now_ns() - heard_ns > 500_000_000:
                raise StoppedError("enough")

        machine.listen = interrupt
        with pytest.raises(StoppedError):
            machine.move(z=6.0, mm_per_s=4.0)
        assert machine.lowest_mm() == 6.0
        reached_mm: list[float] = []
        emulated.on_moved = lambda place: reached_mm.append(place[2])
        assert machine.rise(CLEAR_MM, 4.0)
        assert min(reached_mm) > 27.0  # half a second at 4 mm/s below 30, and the time until it learns of the halt
        clock.sleep(8.0)
        assert emulated.place[2] == CLEAR_MM
        machine.close()


@both_dialects
def test_rise_after_a_power_failure_leads_up_from_any_zero(tmp_path: Path, dialect: str) -> None:
    """Machine coordinates are negative on a machine that homes to its upper end: "up to -5" would lead down from 0."""
    with stock_machine(tmp_path, dialect) as (emulated, config, clock):
        emulated.home[2] = -1.0
        travel_mm = (*config.travel_mm[:2], (-40.0, 0.0))
        machine = Machine(msgspec.structs.replace(config, travel_mm=travel_mm, clear_z_mm=-5.0), clock)
        machine.begin()
        machine.move(z=-12.0, mm_per_s=4.0)
        emulated.lose_power()
        with pytest.raises(StoppedError, match="it was reset"):
            machine.move(z=-13.0, mm_per_s=4.0)
        assert machine.rise(-5.0, 4.0)
        clock.sleep(3.0)
        # by the distance that the interrupted move still had to go at its lower end
        assert emulated.place[2] == pytest.approx(-12.0 + 8.0, abs=1.1)
        assert emulated.place[2] >= -5.0
        machine.close()


def test_z_goes_up_before_marlin_homes(tmp_path: Path) -> None:
    with stock_machine(tmp_path, "marlin") as (emulated, config, clock):
        machine = Machine(config, clock)
        reached_mm: list[float] = []
        emulated.on_moved = lambda place: reached_mm.append(place[2])
        begun_mm = emulated.place[2]
        machine.begin()
        assert max(reached_mm) == begun_mm + 5.0
        assert emulated.received.index("G1 Z5 F240") < emulated.received.index("G28")
        machine.close()


class OneFrameEach:
    """A board that never loses a frame."""

    description, counts = "a board", None

    def poll(self, now_ns: int) -> list[Frame]:
        self.number = getattr(self, "number", 0) + 1
        return [Frame(0, self.number, 0, now_ns, 3, None, None, None, None, 25.0)]  # type: ignore[arg-type]


class Gauge:
    """Reads the messages that it receives."""

    description = "a gauge"
    unread = ""

    def __init__(self) -> None:
        self.force_n = 7.0  # the rod's weight, more than the limit

    def poll(self, now_ns: int) -> list[Reading]:
        return [Reading(now_ns, self.force_n)]

    def close(self) -> None:
        """Nothing is open."""


@contextmanager
def watched_stage(
    folder: Path, dialect: str, **changes: object
) -> Iterator[tuple[GcodeMachine, Gauge, Stage, SimulatedClock]]:
    """A stage that is not homed yet, its gauge at zero."""
    with stock_machine(folder, dialect) as (emulated, config, clock):
        gauge = Gauge()
        watch = Watch(OneFrameEach(), gauge, Limits(4.5, 0.1), clock)
        watch.begin()
        stage = Stage(msgspec.structs.replace(config, **changes), watch, 0.05)
        yield emulated, gauge, stage, clock
        stage.close()


@both_dialects
def test_collision_while_homing_gets_the_emergency_stop(tmp_path: Path, dialect: str) -> None:
    with watched_stage(tmp_path, dialect) as (emulated, gauge, stage, clock):

        def collide(place: list[float]) -> None:
            if any("G28" in line or "$H" in line for line in emulated.received):
                gauge.force_n = 12.0

        emulated.on_moved = collide
        emulated.homing_mm_per_s = 20.0
        with pytest.raises(StoppedError, match="over-force"):
            stage.begin()
        assert "got the emergency stop" in stage.release()
        clock.sleep(0.1)
        assert emulated.locked


@both_dialects
def test_collision_while_travelling_halts_the_machine(tmp_path: Path, dialect: str) -> None:
    with watched_stage(tmp_path, dialect) as (emulated, gauge, stage, clock):
        stage.begin()

        def collide(place: list[float]) -> None:
            if place[0] > 90.0:
                gauge.force_n = 12.0

        stage._machine.move(x=82.0, mm_per_s=20.0)
        emulated.on_moved = collide
        with pytest.raises(StoppedError, match="over-force"):
            stage._machine.move(x=118.0, mm_per_s=20.0)
        assert stage.release() == "the rod was up"
        clock.sleep(3.0)
        assert emulated.place[0] < 92.0


@contextmanager
def standing_stage(folder: Path, **changes: object) -> Iterator[tuple[GcodeMachine, Gauge, Stage]]:
    """A homed Marlin stage, its gauge at zero."""
    with watched_stage(folder, "marlin", **changes) as (emulated, gauge, stage, _):
        stage.begin()
        yield emulated, gauge, stage


def test_missing_pad_is_noticed_at_the_end_of_travel(tmp_path: Path) -> None:
    """Seven hundred steps of 0.01 mm: the force never oscillates."""
    with standing_stage(tmp_path, clear_z_mm=12.0, step_mm=0.01) as (_, _, stage):
        with pytest.raises(StoppedError, match=r"nothing was touched down to z = 5\.00 mm"):
            stage.press(Press(1, 0.0, 0.0, 1.0))
        assert "the rod was lifted by 7.00 mm" in stage.release()


@pytest.mark.real_time  # the guard waits a second for a delayed collector
def test_pad_that_lies_askew_is_approached_from_higher_farther_away(tmp_path: Path) -> None:
    with standing_stage(tmp_path, press_mm_per_s=PRESS_MM_PER_S) as (emulated, gauge, stage):
        felt_n: list[float] = []

        def press_down(place: list[float]) -> None:
            surface_mm = 30.0 + 0.04 * (place[0] - 82.0)  # 1 N/mm
            felt_n.append(max(0.0, surface_mm - place[2]))
            gauge.force_n = 7.0 + felt_n[-1]

        emulated.on_moved = press_down
        for x_m in (-0.018, 0.018):
            press = Press(1, x_m, 0.0, 0.5)
            stage.stand_over(press)
            stage.press(press)
            stage.lift()
        heights_mm = [float(re.search(r"Z([\d.]+)", line)[1]) for line in emulated.received if line.startswith("G1 X")]
        steps_mm = [abs(b - a) for a, b in pairwise(heights_mm) if 0.0 < abs(b - a) < 1.0]
        assert max(steps_mm) < 1.01 * SHORT_S * PRESS_MM_PER_S  # what must end before a rise begins
        assert max(felt_n) < 0.55  # the tolerance, and a cautious step; 1.6 N from 0.3 mm above the first place
