"""Parts of `collect` alone: plans, gauges, the hand, and two weights."""

from __future__ import annotations

import io
import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from emulator.pty_port import PtyPort
from fmfts.baseline.files import store
from fmfts.baseline.origin import Origin
from fmfts.config import BridgeSource, PadConfig, SimulatedSource
from fmfts.sensor import Frame
from fmfts_calibrate.fitting import empty_response
from fmfts_collect.errors import AbsentError, RefusedError, StoppedError
from fmfts_collect.gauge import Reading, open_gauge
from fmfts_collect.hand import Hand
from fmfts_collect.picture import Picture, cells_of
from fmfts_collect.plan import PlanError, Press, read_plan
from fmfts_collect.settings import CollectConfig, LoadCellGauge, SerialGauge, StageConfig, UdpGauge, problems
from fmfts_collect.stage import machine_place, require_within_reach
from fmfts_collect.watch import Limits, Watch
from fmfts_collect.weigh import GRAVITY_M_S2, weigh
from fmfts_collect.work import require_own_baseline
from fmfts_simulation.baseline import simulated_baseline


@pytest.mark.parametrize(
    ("preset", "presses", "largest_n"),
    [
        ("simulation", 675, 1.9792),
        ("experiment", 1800, 4.0),
        ("test-simulation", 90, 1.98),
        ("test-experiment", 90, 4.0),
    ],
)
def test_presets_are_the_papers_plans(preset: str, presses: int, largest_n: float) -> None:
    plan = read_plan(preset)
    assert [press.number for press in plan.presses] == list(range(1, presses + 1))
    assert plan.largest_force_n <= largest_n
    assert max(abs(value) for press in plan.presses for value in press.place_m) <= 14e-3


def test_every_place_of_a_lattice_is_pressed_with_every_force(tmp_path: Path) -> None:
    places = {press.place_m for press in read_plan("simulation").presses}
    assert len(places) == 225
    assert all(np.isclose(x * 500 % 1, 0) or np.isclose(x * 500 % 1, 1) for x, _ in places)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[lattice]\nspacing_mm = 2", "missing required field `first_mm`"),
        ("[lattice]\nfirst_mm = [0, 0]\nspacing_mm = -2\ncount = [1, 1]\nforces_n = [1]", "spacing_mm"),
        ("[lattice]\nfirst_mm = [0, 0]\nspacing_mm = 2\ncount = [1, 1]\nforces_n = []", "forces_n names no force"),
        ("[lattice]\nfirst_mm = [0, 0]\nspacing_mm = 2\ncount = [1, 1]\nforces = [1]", "unknown field `forces`"),
        ("[random]\npresses = 3\nhalf_width_mm = 3\nforce_n = [2, 1]", "the lighter force comes first"),
        ("", "one table is needed"),
        ("[lattice", "is not TOML"),
    ],
)
def test_wrong_plan_is_refused_with_its_fault(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "grid.toml"
    path.write_text(text)
    with pytest.raises(PlanError, match=r"grid\.toml") as refused:
        read_plan(str(path))
    assert sentence in str(refused.value)


def test_missing_plan_lists_the_presets() -> None:
    with pytest.raises(PlanError, match="experiment, simulation"):
        read_plan("nowhere")


def stage(**changes: object) -> StageConfig:
    facts: dict[str, object] = {
        "port": "/dev/null", "dialect": "grbl", "travel_mm": ((80, 120), (80, 120), (0, 40)), "force_limit_n": 4.5,
        "origin_mm": (100, 100), "clear_z_mm": 20,
    }  # fmt: skip
    return StageConfig(**(facts | changes))  # type: ignore[arg-type]


def test_press_beyond_travel_or_force_is_refused_before_anything_moves() -> None:
    require_within_reach(stage(), [Press(1, 14e-3, -14e-3, 4.0)])
    with pytest.raises(RefusedError, match=r"press 7 .* x = 121\.00 mm, beyond collect\.stage\.travel_mm"):
        require_within_reach(stage(), [Press(7, 21e-3, 0.0, 1.0)])
    with pytest.raises(RefusedError, match=r"wants 4\.5 N, and collect\.stage\.force_limit_n is 4\.5 N"):
        require_within_reach(stage(), [Press(1, 0.0, 0.0, 4.5)])


def test_turned_pad_is_pressed_where_its_axes_are() -> None:
    assert machine_place(stage(turn_deg=90.0), Press(1, 3e-3, 1e-3, 1.0)) == pytest.approx((99.0, 103.0))


def readings(poll: Callable[[], Sequence[Reading]], count: int) -> list[Reading]:
    found: list[Reading] = []
    end_s = time.monotonic() + 60.0
    while len(found) < count and time.monotonic() < end_s:
        found += poll()
    return found


def test_serial_gauge_is_read_by_its_pattern_and_hangs_up_with_name(tmp_path: Path) -> None:
    port = PtyPort(tmp_path / "gauge")
    config = SerialGauge(port=str(tmp_path / "gauge"), pattern=r"F=(-?\d+) g", newton_per_unit=-0.01, delay_ms=20.0)
    gauge = open_gauge(config, None)
    port.write(b"warming up\r\nF=-150 g\r\nF=25")
    first = readings(lambda: gauge.poll(1_000_000_000), 1)
    assert [(reading.force_n, reading.time_ns) for reading in first] == [(1.5, 980_000_000)]
    port.write(b"0 g\r\n")
    assert [reading.force_n for reading in readings(lambda: gauge.poll(0), 1)] == [-2.5]
    port.unplug()
    with pytest.raises(AbsentError, match=r"the gauge on .* plug it in again"):
        gauge.poll(0)
    gauge.close()


@pytest.mark.parametrize("shown", ["nan", "inf", "-inf", "1e999"])
def test_non_finite_value_is_no_reading(tmp_path: Path, shown: str) -> None:
    port = PtyPort(tmp_path / "gauge")
    gauge = open_gauge(SerialGauge(port=str(tmp_path / "gauge"), pattern=r"F=(\S+)"), None)
    port.write(f"F={shown}\r\nF=1.5\r\n".encode())
    assert [reading.force_n for reading in readings(lambda: gauge.poll(0), 1)] == [1.5]
    assert gauge.unread == f"the last line without a number was 'F={shown}'"
    gauge.close()
    port.unplug()


@pytest.mark.parametrize("scale", [0.0, float("nan"), float("inf")])
def test_scale_without_response_is_refused(scale: float) -> None:
    for gauge in [
        SerialGauge(port="/dev/null", newton_per_unit=scale),
        UdpGauge(port=5005, newton_per_unit=scale),
        LoadCellGauge(newton_per_count=scale),
    ]:
        ((where, why),) = problems(CollectConfig(gauge=gauge))
        assert where[0] == "gauge"
        assert "with it no force can be measured" in why


def test_gauge_that_does_not_stream_is_asked(tmp_path: Path) -> None:
    port = PtyPort(tmp_path / "gauge")
    gauge = open_gauge(SerialGauge(port=str(tmp_path / "gauge"), ask="?\r"), None)
    gauge.poll(time.monotonic_ns())
    assert port.read(1.0) == b"?\r"
    gauge.close()
    port.unplug()


def test_load_cell_without_its_board_is_refused() -> None:
    with pytest.raises(AbsentError, match="stop fmfts-daemon"):
        open_gauge(LoadCellGauge(newton_per_count=1e-6), None)


class Cell:
    """A feed whose load cell reports the weight that hangs on it."""

    description = "a board"

    def __init__(self) -> None:
        self.count = 0
        self._random = np.random.default_rng(3)

    def counts(self) -> list[tuple[int, int]]:
        return [(time.monotonic_ns(), self.count + round(self._random.normal(0.0, 20.0)))]

    def poll(self, now_ns: int) -> list[Frame]:
        return []

    def board_uid(self) -> str:
        return ""

    def close(self) -> None:
        """Nothing is open."""


def test_two_weights_give_newtons_per_count(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fmfts_collect.weigh.LISTEN_S", 0.8)
    cell, hung = Cell(), iter([0.1, 0.5])

    def hang(_: str) -> None:
        cell.count = round(next(hung) * GRAVITY_M_S2 / -2.1e-6) + 8000

    facts = weigh(cell, (100.0, 500.0), hang)
    # 20 counts of noise in about 200 readings of two weights 1.9 million counts apart
    assert facts["newton_per_count"] == pytest.approx(-2.1e-6, rel=1e-5)
    assert facts["counts_at_zero"] == pytest.approx(8000, abs=10)
    with pytest.raises(RefusedError, match="two different weights"):
        weigh(cell, (100.0, 100.0), hang)


def test_picture_draws_each_place_of_a_lattice_separately() -> None:
    plan = read_plan("simulation")
    cells = cells_of(plan)
    assert len(set(cells.values())) == 225
    for press in plan.presses:
        column, row = cells[press.number]
        assert (column, row) == (round(press.x_m * 1e3 + 14), round(7 - press.y_m * 1e3 / 2))
    assert all(0 <= c < 41 and 0 <= r < 21 for c, r in cells_of(read_plan("test-simulation")).values())


def test_picture_reports_what_is_done_what_presses_and_time_left(monkeypatch: pytest.MonkeyPatch) -> None:
    plan = read_plan("simulation")
    picture = Picture(plan, {1, 2, 3}, force_n=lambda: 0.5)
    assert "left" not in picture.sentence()
    monkeypatch.setattr("fmfts_collect.picture.time", SimpleNamespace(monotonic=lambda: picture.begun_s + 60.0))
    picture.done |= {4, 5, 6}
    picture.now = plan.presses[6]
    drawn = Console(width=100, record=True, file=io.StringIO())
    drawn.print(picture.render())
    text = drawn.export_text()
    assert "6 of 675 presses, 223 min left" in text  # after a minute for three, 669 are left
    assert "0.500 N" in text
    assert (text.count("●"), text.count("◉")) == (2, 1)


def test_person_is_told_what_to_do_and_asked_again() -> None:
    reader, writer = os.pipe()
    said: list[str] = []
    with open(reader) as answers:
        watch = Watch(Cell(), None, Limits(None, 1.0))
        hand = Hand(watch, 0.05, said.append, gauge=False, answers=answers)
        os.write(writer, b"\nlots\n1,05\n")
        press = Press(1, 2e-3, -4e-3, 1.0)
        hand.stand_over(press)
        hand.press(press)
        os.close(writer)
        with pytest.raises(StoppedError, match="standard input is closed"):
            hand.press(press)
    assert hand.typed_n == 1.05
    assert "press 1.00 N at x +2.0, y -4.0 mm" in said[1]
    assert "not a number" in said[2]


class Resting:
    """A gauge on which nobody presses."""

    description = "a gauge"

    def poll(self, now_ns: int) -> list[Reading]:
        return [Reading(now_ns, 0.2)]

    def close(self) -> None:
        """Nothing is open."""


def test_press_without_field_change_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fmfts_collect.hand.PATIENCE_S", 0.6)
    watch = Watch(Cell(), Resting(), Limits(None, 1.0))
    hand, press = Hand(watch, 0.05, lambda _: None, gauge=True), Press(1, 2e-3, -4e-3, 1.0)
    hand.stand_over(press)  # the press begins although the zero is not known yet
    watch.tare_n = 0.15
    with pytest.raises(StoppedError, match=r"1\.00 N was not measured for 0\.6 s: it reads 0\.050 N"):
        hand.press(press)
    watch.tare_n = 0.19
    assert hand.release() == "nothing presses"
    watch.tare_n = 0.1
    assert hand.release() == "let go of the pad"


def test_reached_forces_form_the_planned_levels() -> None:
    plan, random = read_plan("simulation"), np.random.default_rng(2)
    press = np.array([[p.x_m * 1e3, p.y_m * 1e3, p.force_n * random.uniform(0.94, 1.06)] for p in plan.presses])
    assert empty_response(press).exponent.ravel().tolist() == [1, 2, 3]
    press[:, 2] = random.uniform(0.3, 4.0, len(press))
    assert empty_response(press).exponent.ravel().tolist() == [1, 2, 3, 4, 5]


def test_baseline_of_another_board_gives_no_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    simulated = PadConfig(name="left", source=SimulatedSource())
    on_board = PadConfig(name="left", source=BridgeSource(port="/dev/null", pad_index=0))
    drawing = on_board.pad()
    store(simulated_baseline(simulated).recorded_on(Origin("bridge", "hmc5983", uid="0a", pad_index=0)), drawing)
    require_own_baseline(on_board, drawing, "0A")
    require_own_baseline(on_board, drawing, "")  # a board that sends no uid may be this one
    with pytest.raises(RefusedError, match=r"recorded on board 0a.*but the pad is on board 0b"):
        require_own_baseline(on_board, drawing, "0b")
