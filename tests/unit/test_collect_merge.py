"""A log of another machine: its clock beside the frames', and the plateaus in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fmfts.config import PadConfig, SimulatedSource
from fmfts.sensor import Frame
from fmfts.sensor.chips import DEFAULT_CHIP
from fmfts_collect import machine_log
from fmfts_collect.alignment import align
from fmfts_collect.errors import RefusedError
from fmfts_collect.machine_log import Log, plateaus, read_log
from fmfts_collect.plan import read_plan
from fmfts_simulation.mounted import MountedPad

STEP_T = DEFAULT_CHIP.step_t[3]
REST_T = np.full((4, 3), 300 * STEP_T)


def frames_of(time_s: np.ndarray, force_n: np.ndarray) -> list[Frame]:
    """Frames whose field follows a force, with a board's noise."""
    counts = 300.0 + 40.0 * force_n[:, None, None] * np.array([[1.0, -0.5, 0.2]]).repeat(4, axis=0)
    return frames_at(time_s, counts + np.random.default_rng(5).normal(0.0, 1.3, counts.shape))


def frames_at(time_s: np.ndarray, counts: np.ndarray) -> list[Frame]:
    four = np.ones(4, dtype=bool)
    return [
        Frame(0, number, int(at * 1e6), int(at * 1e9), 3, count, np.zeros(4, np.uint16), four, four, 25.0)
        for number, (at, count) in enumerate(zip(time_s, np.rint(counts).astype(np.int16), strict=True))
    ]


def presses(time_s: np.ndarray, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    edges = np.cumsum(random.uniform(0.6, 1.4, 40))
    levels = np.where(np.arange(41) % 2 == 0, 0.0, random.uniform(0.3, 2.0, 41))
    return levels[np.searchsorted(edges, time_s)]


@settings(max_examples=30)
@given(lag_s=st.floats(-3.0, 3.0), seed=st.integers(0, 20))
def test_log_is_aligned_with_the_frames_to_some_milliseconds(lag_s: float, seed: int) -> None:
    log_s, frame_s = np.arange(0.0, 20.0, 0.02), np.arange(100.0, 120.0, 1 / 220)
    log = Log(log_s, np.zeros((len(log_s), 2)), presses(log_s, seed))
    alignment = align(log, frames_of(frame_s, presses(np.clip(frame_s - 100.0 - lag_s, 0.0, 20.0), seed)), REST_T)
    # half a row of the log, and half a frame
    assert alignment.frame_time_s(10.0) == pytest.approx(110.0 + lag_s, abs=0.0125)


def test_log_of_another_session_is_refused() -> None:
    log_s, frame_s = np.arange(0.0, 20.0, 0.02), np.arange(0.0, 20.0, 1 / 220)
    log = Log(log_s, np.zeros((len(log_s), 2)), presses(log_s, 1))
    with pytest.raises(RefusedError, match="are they of one session"):
        align(log, frames_of(frame_s, presses(frame_s, 2)), REST_T)


def test_regular_presses_are_refused_as_ambiguous() -> None:
    log_s, frame_s = np.arange(0.0, 60.0, 0.02), np.arange(0.0, 60.0, 1 / 220)
    regular = lambda at: 1.0 * (at % 1.0 > 0.5)  # noqa: E731
    log = Log(log_s, np.zeros((len(log_s), 2)), regular(log_s))
    with pytest.raises(RefusedError, match="irregular rhythm"):
        align(log, frames_of(frame_s, regular(frame_s)), REST_T)


@pytest.mark.parametrize("ppm", [0.0, 300.0])
def test_plateaus_of_the_papers_plan_are_found_on_any_clock(ppm: float) -> None:
    """Half an hour: 675 presses, some of them a seventieth of others in the field, and a pause before each place."""
    pad, random = MountedPad.exact(PadConfig(name="left", source=SimulatedSource()).pad()), np.random.default_rng(0)
    steps: list[tuple[float, float, float]] = []
    for press in read_plan("simulation").presses:
        if not steps or steps[-1][:2] != press.place_m:
            steps.append((*press.place_m, 0.0))
        steps.append((*press.place_m, press.force_n))
    fields_t = np.array([pad.magnet_field(*(np.full(4, value) for value in step)) for step in steps])
    edges_s = np.cumsum([random.uniform(2.0, 2.3) if step[2] else random.uniform(1.2, 1.5) for step in steps])
    step_at = lambda at: np.minimum(np.searchsorted(edges_s, at, side="right"), len(steps) - 1)  # noqa: E731

    frame_s, log_s = np.arange(0.0, edges_s[-1], 1 / 50), np.arange(0.0, edges_s[-1], 1 / 50)
    seen_t = fields_t[step_at(frame_s)] + random.normal(0.0, 2e-7, (len(frame_s), 4, 3))
    seen_t += np.array([1e-6, 0.0, -5e-7]) * (frame_s / frame_s[-1])[:, None, None]  # the ambient field drifts
    pressed = np.array(steps)[step_at(log_s)]
    shown_n = pressed[:, 2] + 0.05 + random.normal(0.0, 0.005, len(log_s))
    log = Log(log_s * (1.0 + ppm * 1e-6), pressed[:, :2] * 1e3, shown_n)

    alignment = align(log, frames_at(frame_s, seen_t / STEP_T), fields_t[0])
    for true_s in (0.0, 0.5 * frame_s[-1], frame_s[-1]):
        # half a row of the log, and half a frame; at 300 ppm the clocks differ by half a second at the end
        assert alignment.frame_time_s(true_s * (1.0 + ppm * 1e-6)) == pytest.approx(true_s, abs=0.02)
    # means of 0.1 s of five readings lie beyond four of their deviations once in 16,000
    assert len(plateaus(log, 0.3, 0.3)) >= len(steps) - 5


def test_log_that_lost_rows_without_a_trace_is_refused() -> None:
    log_s, frame_s = np.arange(0.0, 150.0, 0.02), np.arange(0.0, 150.0, 1 / 50)
    random = np.random.default_rng(6)
    edges = np.cumsum(random.uniform(0.6, 3.0, 200))
    levels = np.where(np.arange(201) % 2 == 0, 0.0, 1.0)
    jumped = log_s + 0.2 * (log_s > 30.0) - 0.2 * (log_s > 90.0)
    log = Log(log_s, np.zeros((len(log_s), 2)), levels[np.searchsorted(edges, jumped)])
    with pytest.raises(RefusedError, match="do not run evenly"):
        align(log, frames_of(frame_s, levels[np.searchsorted(edges, frame_s)]), REST_T)


@pytest.mark.parametrize("rate_hz", [10, 50, 160])
def test_plateaus_are_found_through_the_noise_of_the_gauge(rate_hz: int) -> None:
    time_s = np.arange(0.0, 120.0, 1 / rate_hz)
    force_n = 0.05 + np.where(time_s // 2 % 2, 0.3, 0.0) + np.random.default_rng(7).normal(0.0, 0.005, len(time_s))
    found = plateaus(Log(time_s, np.zeros((len(time_s), 2)), force_n), 0.3, 0.3)
    assert len(found) == 60
    for number, plateau in enumerate(found):
        # within its 2 s; the first mean may already contain the press
        assert 2 * number + 0.1 <= plateau.begun_s < plateau.ended_s <= 2 * number + 1.9
        assert plateau.ended_s - plateau.begun_s >= 1.2
        deviation_n = 0.005 / np.sqrt(plateau.end - plateau.first)
        mean_n = force_n[plateau.first : plateau.end].mean()
        assert mean_n == pytest.approx(0.35 if number % 2 else 0.05, abs=5 * deviation_n)


def test_unlogged_time_lies_in_no_plateau() -> None:
    time_s = np.concatenate([np.arange(0.0, 2.0, 0.01), np.arange(5.0, 7.0, 0.01)])
    found = plateaus(Log(time_s, np.zeros((len(time_s), 2)), np.ones(len(time_s))), 0.0, 0.3)
    assert [(round(p.begun_s, 1), round(p.ended_s, 1)) for p in found] == [(0.1, 1.9), (5.1, 6.9)]


def test_plateaus_are_where_force_and_place_stand(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    lines = [f"{0.01 * i},{2.0 if i < 300 else 4.0},0,{0.0 if i < 100 else 1.5}" for i in range(500)]
    path.write_text("t_s,x_mm,y_mm,force_n\n" + "\n".join(lines) + "\n")
    log = read_log(path)
    assert [
        (round(p.begun_s, 2), round(p.ended_s, 2), p.x_mm, set(log.force_n[p.first : p.end]))
        for p in plateaus(log, 0.2, 0.3)
    ] == [(0.2, 0.89, 2.0, {0.0}), (1.2, 2.89, 2.0, {1.5}), (3.2, 4.89, 4.0, {1.5})]
    path.write_text("t_s,x_mm,y_mm,force_n\n0,0,0,0\n1,0,nix,0\n")
    with pytest.raises(RefusedError, match="row 3, column y_mm: 'nix' is not a number"):
        read_log(path)


def test_log_of_too_many_rows_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine_log, "MOST_ROWS", 3)
    path = tmp_path / "log.csv"
    path.write_text("t_s,x_mm,y_mm,force_n\n0,0,0,0\n\n1,0,0,0\n2,0,0,0\n")
    assert len(read_log(path).time_s) == 3
    path.write_text(path.read_text() + "3,0,0,0\n")
    with pytest.raises(RefusedError, match="more than 3 rows"):
        read_log(path)
