"""How wrong is the contact that a controller acts on? Every method of `controller_methods`, by motion of the finger.

Pads, motions and the controller that reads are those of `bench now`. An error is judged against the finger when the
message is published, and when the controller reads it: by then the finger has moved on.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from fmfts.config import PadConfig
from fmfts.pad import Array
from fmfts_lab.bench.drills import pad_config
from fmfts_lab.bench.motions import DRAWN, Motion, hold, ramp, release, slide, stick_slip, tap, untouched
from fmfts_lab.bench.now_pads import BEFORE_S, BuiltPad, drawn, published_s, read_s
from fmfts_lab.study.contact_bench import LIGHTEST_N
from fmfts_lab.study.controller_methods import ControllerMethod, Told, controller_methods
from fmfts_lab.study.harness import Request, Row
from fmfts_lab.study.timing import timed

CHART = "controller"
COLUMNS = ("of_todays_time", "publishing_n", "read_n", "publishing_mm", "read_mm", "age_ms", "late_ms", "noise_mn")
PADS, SECONDS = 6, 2.0  # those of `bench now`
QUICK_SECONDS = 1.2
QUICK = (untouched, hold, slide(100e-3), stick_slip, tap(50e-3), release(20e-3), ramp)
# Largest delay of the force (negative: it is ahead), and the step in which it is searched.
LATEST_S, EARLIEST_S, LATE_STEP_S = 20e-3, -5e-3, 0.25e-3
SWINGS_N = 0.5  # a motion whose force changes this much shows how late a method is
FEWEST = 10  # frames to which a parabola is fitted


def points(request: Request) -> list[int]:
    """The pads' numbers."""
    return list(range(1 if request.quick else PADS))


def controller_rows(request: Request, number: int, skipped: Sequence[str] = ()) -> list[Row]:
    """A row for each motion and method on one pad."""
    seconds = QUICK_SECONDS if request.quick else SECONDS
    draws = QUICK if request.quick else DRAWN
    every = list(drawn(request.seed, number + 1, seconds, draws, lambda seed: _config(request, seed)))
    config, motions = every[number]
    pad = BuiltPad.of(config)
    methods = [method for method in controller_methods() if method.name not in skipped]
    return [row for motion in motions for row in _rows_of(pad, motion, seconds, methods)]


def _config(request: Request, seed: int) -> PadConfig:
    told = request.pad
    return structs.replace(
        pad_config("drifting", seed), geometry=told.geometry, magnet=told.magnet, contact=told.contact
    )


def _rows_of(pad: BuiltPad, motion: Motion, seconds: float, methods: Sequence[ControllerMethod]) -> Iterator[Row]:
    frames = list(pad.frames(motion, seconds))
    todays_us = None
    for method in methods:
        teller = method.make(pad)
        told, cost = timed(teller.ask, frames, teller.told)
        todays_us = todays_us or cost.median_us
        about: Row = {"chart": CHART, "scene": motion.name, "method": method.name, "family": method.family}
        times: Row = {
            "median_us": cost.median_us,
            "p99_us": cost.p99_us,
            "of_todays_time": round(cost.median_us / todays_us, 3),
        }
        yield about | {"settings": method.settings} | times | scored(motion, told)


def scored(motion: Motion, told: Sequence[Told]) -> Row:
    """The errors of one motion: force in N and place in mm, rms; see the columns of the page of results.

    age_ms: from the instant of the answer to publishing. late_ms: the delay at which the published force fits the true
    one best. noise_mn: of the force while the finger holds still.
    """
    published = published_s(len(told))
    values, rates, at = (np.array([getattr(one, name) for one in told]) for name in ("values", "rates", "at_s"))
    answered = np.isfinite(values[:, 2])
    last = np.maximum.accumulate(np.where(answered, np.arange(len(told)), -1))
    # A controller keeps the last value where a method gives none.
    values, rates = (np.where(last[:, None] >= 0, one[last], np.nan) for one in (values, rates))
    at = np.where(last >= 0, at[last], np.nan) - BEFORE_S
    counted = motion.counts(published)
    when, found = published[counted], values[counted]
    row = _errors(motion, when, found, "publishing") | {
        "frames": int(counted.sum()),
        "answered": round(float(answered[counted].mean()), 5),
        "age_ms": _rounded(1e3 * float(np.mean(when - at[counted])), 3),
        "late_ms": late_ms(motion, when, found[:, 2]),
        "noise_mn": noise_mn(motion, when, found[:, 2]),
    }
    moments, newest = read_s(motion, published)
    ahead = values[newest] + np.nan_to_num(rates[newest]) * (moments - at[newest])[:, None]
    ahead[:, 2] = np.maximum(ahead[:, 2], np.minimum(values[newest, 2], 0.0))
    return row | _errors(motion, moments, ahead, "read")


def _errors(motion: Motion, when: Array, found: Array, name: str) -> Row:
    off, pressed = found - motion.truth(when), motion.truth(when)[:, 2] >= LIGHTEST_N
    return {f"{name}_n": _rms(off[:, 2]), f"{name}_mm": _rms(1e3 * np.hypot(off[pressed, 0], off[pressed, 1]))}


def _rms(off: Array) -> float | None:
    """None without any number."""
    off = off[np.isfinite(off)]
    return _rounded(float(np.sqrt(np.mean(off * off))), 6) if off.size else None


def _rounded(value: float, digits: int) -> float | None:
    return round(value, digits) if np.isfinite(value) else None


def late_ms(motion: Motion, when: Array, force_n: Array) -> float | None:
    """The delay at which the published force fits the true one best; None if the force hardly changes."""
    delays = np.arange(EARLIEST_S, LATEST_S, LATE_STEP_S)
    known = np.isfinite(force_n)
    truth = motion.truth(when)[:, 2]
    if not known.any() or np.ptp(truth) < SWINGS_N or len(_still(motion)):
        return None
    # The truth is needed at many instants: between LATE_STEP_S of each other it is a straight line.
    fine = np.arange(when[0] - LATEST_S, when[-1] - EARLIEST_S + LATE_STEP_S, LATE_STEP_S)
    true = motion.truth(fine)[:, 2]
    off = [np.mean((force_n[known] - np.interp(when[known] - delay, fine, true)) ** 2) for delay in delays]
    return _rounded(1e3 * float(delays[int(np.argmin(off))]), 3)


def noise_mn(motion: Motion, when: Array, force_n: Array) -> float | None:
    """The noise of the force while the finger holds still; None if it never does. It is taken about a parabola, because
    gains that are not known make the force drift while the robot turns."""
    parts = []
    for begin, end in _still(motion):
        own = (when >= begin) & (when <= end) & np.isfinite(force_n)
        if own.sum() > FEWEST:
            fit = np.polynomial.Polynomial.fit(when[own], force_n[own], 2)
            parts.append(force_n[own] - fit(when[own]))
    return _rounded(1e3 * float(np.sqrt(np.mean(np.concatenate(parts) ** 2))), 4) if parts else None


def _still(motion: Motion) -> list[tuple[float, float]]:
    """The windows in which the finger presses and nothing moves."""
    return [window for window in motion.windows if _holds(motion.truth(np.linspace(*window, 50)))]


def _holds(press: Array) -> bool:
    still: NDArray[np.bool_] = np.ptp(press, axis=0) < 1e-12
    return bool(still.all() and press[0, 2] > 0.0)
