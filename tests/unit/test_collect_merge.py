"""A log of another machine: its clock beside the frames', and the plateaus in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fmfts.collect.alignment import align
from fmfts.collect.errors import RefusedError
from fmfts.collect.machine_log import Log, plateaus, read_log
from fmfts.sensor import Frame, step_t

REST_T = np.full((4, 3), 300 * step_t(3))


def frames_of(time_s: np.ndarray, force_n: np.ndarray) -> list[Frame]:
    """Frames whose field follows a force, with a board's noise."""
    random = np.random.default_rng(5)
    counts = (300.0 + 40.0 * force_n[:, None, None] * np.array([[1.0, -0.5, 0.2]]).repeat(4, axis=0)).astype(float)
    counts = np.rint(counts + random.normal(0.0, 1.3, counts.shape)).astype(np.int16)
    four = np.ones(4, dtype=bool)
    return [
        Frame(0, number, int(at * 1e6), int(at * 1e9), 3, count, np.zeros(4, np.uint16), four, four, 25.0)
        for number, (at, count) in enumerate(zip(time_s, counts, strict=True))
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


def test_clock_that_runs_fast_is_followed_for_an_hour() -> None:
    ppm = 50.0
    frame_s, random = np.arange(0.0, 3600.0, 1 / 25), np.random.default_rng(4)
    edges = np.cumsum(random.uniform(0.6, 3.0, 2400))
    levels = np.where(np.arange(2401) % 2 == 0, 0.0, random.uniform(0.3, 2.0, 2401))
    pressed = lambda at: levels[np.searchsorted(edges, at)]  # noqa: E731
    log_s = np.arange(0.0, 3600.0, 0.02)
    log = Log(
        log_s,
        np.zeros((len(log_s), 2)),
        pressed(log_s / (1 + ppm * 1e-6)) + 0.05 + random.normal(0.0, 0.005, len(log_s)),
    )
    alignment = align(log, frames_of(frame_s, pressed(frame_s)), REST_T)
    for log_time_s in (10.0, 1800.0, 3590.0):
        # half a row of the log, and half a frame; the clocks differ by 180 ms at the end
        assert alignment.frame_time_s(log_time_s) == pytest.approx(log_time_s / (1 + ppm * 1e-6), abs=0.03)


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
        # within its 2 s; the first mean may have felt the press before
        assert 2 * number + 0.1 <= plateau.begun_s < plateau.ended_s <= 2 * number + 1.9
        assert plateau.ended_s - plateau.begun_s >= 1.2
        deviation_n = 0.005 / np.sqrt(plateau.end - plateau.first)
        mean_n = force_n[plateau.first : plateau.end].mean()
        assert mean_n == pytest.approx(0.35 if number % 2 else 0.05, abs=5 * deviation_n)


def test_what_nobody_logged_is_within_no_plateau() -> None:
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
