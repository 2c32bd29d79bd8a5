"""What a controller acts on: the judge of the study, its straight line, its table; it measures as `bench now` does."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest

from fmfts.cli.main import main
from fmfts.common import exit_codes
from fmfts.config import PadConfig, SimulatedSource
from fmfts.pad import Array
from fmfts_lab.bench import now as bench
from fmfts_lab.bench.drills import RATE_HZ
from fmfts_lab.bench.motions import Motion, hold, ramp, tap
from fmfts_lab.bench.now_pads import BEFORE_S, TRANSPORT_S, drawn, published_s
from fmfts_lab.study import controller, controller_chart, pareto
from fmfts_lab.study.controller_methods import NOTHING, NOW, TODAY, UNKNOWN, Line, Told
from fmfts_lab.study.harness import Request, Row
from fmfts_simulation.finger import Touch

SECONDS = 1.2
FRAMES = round((BEFORE_S + SECONDS) * RATE_HZ)
RAMP_N_PER_S = 30.0


def motion_of(draw: Callable[[np.random.Generator, float], Motion]) -> Motion:
    return draw(np.random.default_rng(4), SECONDS)


def told_late(motion: Motion, age_s: float, rates: Array = UNKNOWN) -> list[Told]:
    """A method that tells the truth of `age_s` before publishing."""
    when = published_s(FRAMES) - age_s
    return [Told(at + BEFORE_S, value, rates) for at, value in zip(when.tolist(), motion.truth(when), strict=True)]


class Truthful:
    """Tells the truth of `age_s` before publishing; the raw answer is the frame's number."""

    def __init__(self, motion: Motion, age_s: float) -> None:
        self._told = told_late(motion, age_s)

    def ask(self, frame: Any) -> int:
        return int(frame.sequence)

    def told(self, raw: int) -> Told:
        return self._told[raw]


class Numbered:
    def __init__(self, sequence: int) -> None:
        self.sequence = sequence


def steady_ramp() -> Motion:
    """30 N/s all the time, so that age is all that is wrong."""
    return Motion("steady", lambda time_s: Touch(1e-3, 0.0, 1.0 + RAMP_N_PER_S * time_s), ((0.2, SECONDS),))


def number(row: Row, name: str) -> float:
    return pareto.number(row, name)


def test_truth_at_publishing_is_off_only_by_the_reading_delay() -> None:
    row = controller.scored(steady_ramp(), told_late(steady_ramp(), 0.0))
    assert row["publishing_n"] == pytest.approx(0.0, abs=1e-9)
    # Read once a millisecond, a message is 0 to 4.5 ms old: rms 4.55/√3 ms, to within one read.
    assert number(row, "read_n") == pytest.approx(RAMP_N_PER_S / RATE_HZ / np.sqrt(3.0), rel=0.05)
    assert row["age_ms"] == pytest.approx(0.0, abs=1e-6)


def test_age_is_reported_in_newtons_and_in_milliseconds() -> None:
    row = controller.scored(steady_ramp(), told_late(steady_ramp(), 6e-3))
    assert row["publishing_n"] == pytest.approx(6e-3 * RAMP_N_PER_S, rel=1e-6)
    assert row["age_ms"] == pytest.approx(6.0)
    assert row["late_ms"] == pytest.approx(6.0)


def test_rate_extrapolates_the_force_until_it_is_read() -> None:
    rates = np.array([0.0, 0.0, RAMP_N_PER_S])
    row = controller.scored(steady_ramp(), told_late(steady_ramp(), 0.0, rates))
    assert row["read_n"] == pytest.approx(0.0, abs=1e-6)


def test_lateness_is_found_from_arrival_not_from_message() -> None:
    """A filter that lags speaks of now and tells the past."""
    motion = motion_of(tap(50e-3))
    lagging = [one._replace(at_s=one.at_s + 7e-3) for one in told_late(motion, 7e-3)]
    row = controller.scored(motion, lagging)
    assert row["age_ms"] == pytest.approx(0.0, abs=1e-6)
    assert row["late_ms"] == pytest.approx(7.0, abs=0.26)


def test_missing_answers_keep_the_last_one() -> None:
    motion = steady_ramp()
    told = told_late(motion, 0.0)
    gap = [NOTHING if number % 2 else one for number, one in enumerate(told)]
    row = controller.scored(motion, gap)
    assert number(row, "answered") == pytest.approx(0.5, abs=0.01)
    assert number(row, "publishing_n") == pytest.approx(RAMP_N_PER_S / RATE_HZ * np.sqrt(0.5), rel=0.01)


def test_noise_is_of_the_force_alone_and_without_what_drifts() -> None:
    motion, random = motion_of(hold), np.random.default_rng(1)
    drift = 0.05 * np.linspace(-1.0, 1.0, FRAMES) ** 2
    off = random.normal(0.0, 5e-3, FRAMES) + drift
    told = [
        one._replace(values=one.values + np.array([1e-3, 0.0, 0.1 + noise]))
        for one, noise in zip(told_late(motion, 0.0), off, strict=True)
    ]
    row = controller.scored(motion, told)
    assert number(row, "noise_mn") == pytest.approx(5.0, rel=0.1)
    assert number(row, "publishing_n") == pytest.approx(0.1, rel=0.15)
    assert row["publishing_mm"] == pytest.approx(1.0, rel=1e-6)
    assert controller.scored(motion_of(ramp), told_late(motion_of(ramp), 0.0))["noise_mn"] is None


def test_line_through_two_frames_is_exact_for_even_motion() -> None:
    line = Line(Truthful(steady_ramp(), 5e-3))
    told = [line.told(line.ask(Numbered(number))) for number in range(FRAMES)]  # type: ignore[arg-type]
    assert told[5].at_s == pytest.approx(5 / RATE_HZ + TRANSPORT_S)
    row = controller.scored(steady_ramp(), told)
    assert row["publishing_n"] == pytest.approx(0.0, abs=1e-9)
    assert row["read_n"] == pytest.approx(0.0, abs=1e-9)


def test_line_needs_two_answers_and_gives_no_negative_force() -> None:
    falling = [Told(0.0, np.array([0.0, 0.0, 0.3]), UNKNOWN), Told(1e-3, np.array([0.0, 0.0, 0.1]), UNKNOWN)]

    class Falling:
        def ask(self, frame: Any) -> int:
            return int(frame.sequence)

        def told(self, raw: int) -> Told:
            return falling[raw]

    line = Line(Falling())
    assert line.told(line.ask(Numbered(0))) is falling[0]  # type: ignore[arg-type]
    assert line.told(line.ask(Numbered(1))).values[2] == 0.0  # type: ignore[arg-type]


def request(out: Path) -> Request:
    return Request(PadConfig(name="demo", source=SimulatedSource()), out, quick=True, seed=2)


def test_now_study_uses_the_pads_of_bench_now(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The daemon's two methods give the figures of `bench now` with the same seed."""
    monkeypatch.setattr(controller, "QUICK", (hold, tap(50e-3)))
    others = [method.name for method in controller.controller_methods() if method.name not in (TODAY, NOW)]
    rows = controller.controller_rows(request(tmp_path), 0, others)
    facts = {name: one.facts() for name, one in bench.measure(2, 1, SECONDS, (hold, tap(50e-3))).items()}
    found = {(row["scene"], row["method"]): row for row in rows}
    for motion, fact in facts.items():
        assert found[motion, TODAY]["publishing_n"] == pytest.approx(fact["today_n"], abs=2e-6)
        assert found[motion, TODAY]["read_n"] == pytest.approx(fact["read_today_n"], abs=2e-6)
        assert found[motion, NOW]["publishing_n"] == pytest.approx(fact["now_n"], abs=2e-6)
        assert found[motion, NOW]["read_n"] == pytest.approx(fact["read_carried_n"], abs=2e-6)
    assert found["hold", TODAY]["of_todays_time"] == 1.0


def test_pad_draws_same_motions_whatever_pads_are_measured_before_it() -> None:
    (_, few), (_, many) = (list(drawn(3, pads, 1.0))[1] for pads in (2, 4))
    assert [motion.windows for motion in few] == [motion.windows for motion in many]


def row_of(method: str, motion: str, error: float, frames: int, time: float) -> Row:
    errors: Row = dict.fromkeys(("publishing_n", "read_n", "publishing_mm", "read_mm"), error)
    rest: Row = {"answered": 1.0, "age_ms": 1.0, "late_ms": None, "noise_mn": 2.0, "frames": frames}
    times: Row = {"median_us": time, "p99_us": time, "of_todays_time": time}
    about: Row = {"chart": controller.CHART, "scene": motion, "method": method, "family": "one", "settings": ""}
    return about | errors | rest | times


def test_pads_pool_errors_as_squares_and_times_as_medians() -> None:
    rows = [row_of("a", "hold", *each) for each in ((0.1, 100, 1.0), (0.1, 100, 9.0), (0.4, 100, 2.0))]
    (row,) = controller_chart.pooled(rows)
    assert number(row, "publishing_n") == pytest.approx(np.sqrt((0.01 + 0.01 + 0.16) / 3), abs=1e-6)
    assert row["of_todays_time"] == 2.0
    assert row["frames"] == 300
    assert row["late_ms"] is None


def test_table_and_chart_have_every_method_and_motion(tmp_path: Path) -> None:
    motions = dict.fromkeys(motion for motion, _ in controller_chart.PANELS)
    rows = [
        row_of(method, motion, error, 100, time)
        for method, error, time in ((TODAY, 0.2, 1.0), (NOW, 0.05, 2.0))
        for motion in motions
    ]
    table = controller_chart.table(controller_chart.facts(rows))
    for motion in motions:
        assert table.count(f" {motion} ") == 2
    swift, slow, place = table.split("\n\n")
    for part in (swift, slow, place):
        assert [line.split(" | ")[0] for line in part.splitlines()[2:]] == [f"| {TODAY}", f"| {NOW}"]
    assert swift.count("0.050 / 0.050") + slow.count("0.050 / 0.050") == len(motions)
    assert place.count("0.20 / 0.20") == len(motions)
    text = tmp_path / "chart.svg"
    with matplotlib.rc_context({"svg.fonttype": "none"}):
        controller_chart.draw(rows).savefig(text)
    for name in (*motions, TODAY, NOW):
        assert name in text.read_text()


def test_option_belongs_to_one_study(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["study", "stability", "--controller", "--config", "config.toml", "--out", str(tmp_path)]
    assert main(command) == exit_codes.USAGE
    assert "--controller is an option of `study speed-accuracy`" in capsys.readouterr().err


@pytest.mark.long
def test_study_measures_the_controller_alone(tmp_path: Path) -> None:
    command = ["study", "speed-accuracy", "--controller", "--quick", "--config", "config.toml", "--out", str(tmp_path)]
    assert main(command) == 0
    table = (tmp_path / "speed-accuracy-controller.md").read_text()
    for method in (TODAY, NOW, "today's, line", "extended Kalman"):
        assert f"| {method} |" in table
    assert (tmp_path / "speed-accuracy-controller.svg").stat().st_size < 300_000
    assert not (tmp_path / "speed-accuracy-pose.svg").exists()
    told = {one["method"]: one for one in json.loads((tmp_path / "speed-accuracy.json").read_text())["controller"]}
    swift = {name: one["motions"]["tap in 50 ms"] for name, one in told.items()}
    assert swift[NOW]["publishing_n"] < swift["today's, line"]["publishing_n"] < swift[TODAY]["publishing_n"]
    assert told["today's, line"]["noise_mn"] > 1.5 * told[TODAY]["noise_mn"]
    assert told[NOW]["noise_mn"] < 1.2 * told[TODAY]["noise_mn"]
    # Methods that solve the same field are equally accurate where nothing moves: a frame reaches every method
    # unspoiled.
    for method in ("extended Kalman", "unscented Kalman", "all samples at once"):
        for unit in ("n", "mm"):
            error, todays = (told[name]["motions"]["hold"][f"publishing_{unit}"] for name in (method, TODAY))
            assert error == pytest.approx(todays, rel=0.25), (method, unit)
