"""How a running pad handles touches: the smallest one it detects, moving fingers, and presses that are too hard."""

from __future__ import annotations

from typing import Any

import numpy as np

from fmfts.config import MagnetConfig, SceneConfig
from fmfts.contact import ContactModel, TouchDetector
from fmfts.pad import Pad
from fmfts.pipeline.drawn import in_nominal_frame
from fmfts.pose import STOP_CONVERGED, solve
from fmfts.scene.tracking import tracking_model_for
from fmfts.sensor.chips import NOISE_T
from fmfts_calibrate.evaluation import rounded
from fmfts_calibrate.tracked import FrameSolver
from fmfts_lab.bench.contact_answers import estimates
from fmfts_lab.bench.field_tracker import FieldTracker
from fmfts_lab.bench.workspace import Array, standard_pad
from fmfts_lab.calibration.simulated import pressed_fields, rest_field_of
from fmfts_simulation.source import ROOM_C

RATE_HZ = 220.0
MEMORY_S = 0.04
SPEED_MM_PER_S = 10.0
PLACES_MM = (0.0, 4.0, 8.0, 11.0, 14.0)
SQUEEZES_N = (2.2, 2.6, 3.0, 4.0, 6.0)
AT_ONCE = 50_000


def touch(hours: float, random: np.random.Generator) -> dict[str, Any]:
    """False contacts in `hours` of unloaded frames; the smallest touch by place; the delay of the onset at twice it."""
    pad = standard_pad()
    solver = FrameSolver(pad, rest_field_of(pad), "drifting", NOISE_T)
    onset = TouchDetector(RATE_HZ).onset_chi2
    frames, false = int(hours * 3600 * RATE_HZ), 0
    for first in range(0, frames, AT_ONCE):
        count = min(AT_ONCE, frames - first)
        false += int((_chi2(pad, solver, np.zeros((count, 3)), random) > onset).sum())
    print(f"{hours:g} hours of unloaded frames: {false} false contacts")
    print("smallest touch in mN (seen in half of the frames), and frames to the onset at twice it, median and worst")
    print("  y\\x   " + "".join(f"{x:14g} mm" for x in PLACES_MM))
    smallest, delays = [], []
    for y_mm in PLACES_MM:
        row = [_smallest(pad, solver, x_mm, y_mm, onset) for x_mm in PLACES_MM]
        late = [
            _delay(pad, solver, np.array([x, y_mm, 2.0 * f]), onset, random)
            for x, f in zip(PLACES_MM, row, strict=True)
        ]
        smallest.append([rounded(force) for force in row])
        delays.append([int(worst) for _, worst in late])
        cells = (
            f"{force * 1e3:8.0f} ({median:.0f}, {worst})" for force, (median, worst) in zip(row, late, strict=True)
        )
        print(f"  {y_mm:4g}   " + "".join(f"{cell:>17}" for cell in cells))
    return {"false_contacts": false, "hours": hours, "smallest_n": smallest, "worst_onset_frames": delays}


def _chi2(pad: Pad, solver: FrameSolver, press: Array, random: np.random.Generator) -> Array:
    """(K,) squared displacement from rest in deviations, for one noisy frame of each press (K, 3)."""
    field = pressed_fields(pad, press)
    tracked = solver.solved(field + random.normal(0.0, NOISE_T, field.shape))
    change = tracked.pose[:, :5] - solver.rest_pose[:5]
    chi2: Array = np.einsum("ki,kij,kj->k", change, np.linalg.inv(tracked.covariance), change)
    return chi2


def _smallest(pad: Pad, solver: FrameSolver, x_mm: float, y_mm: float, onset: float) -> float:
    """The force whose expected χ² (with that of the noise, five degrees of freedom) reaches the onset's."""
    forces = np.geomspace(2e-3, 2.0, 200)
    press = np.column_stack([np.full(200, x_mm), np.full(200, y_mm), forces])
    tracked = solver.solved(pressed_fields(pad, press))
    change = tracked.pose[:, :5] - solver.rest_pose[:5]
    expected = np.einsum("ki,kij,kj->k", change, np.linalg.inv(tracked.covariance), change) + 5.0
    return float(np.interp(onset, expected, forces))


def _delay(pad: Pad, solver: FrameSolver, press: Array, onset: float, random: np.random.Generator) -> tuple[float, int]:
    """Frames from the first pressed one to the onset, over 200 presses: median and worst."""
    seen = _chi2(pad, solver, np.tile(press, (200 * 8, 1)), random).reshape(200, 8) > onset
    waited = np.where(seen.any(axis=1), seen.argmax(axis=1), 8)
    return float(np.median(waited)), int(waited.max())


def motion(model: ContactModel, random: np.random.Generator) -> dict[str, Any]:
    """Errors for a finger that moves at 10 mm/s through the pad's centre, with and without smoothing."""
    pad = standard_pad()
    rest = solve(rest_field_of(pad), pad, stop_chi2=STOP_CONVERGED).state
    time_s = np.arange(int(RATE_HZ * 1.6)) / RATE_HZ
    errors: dict[str, list[Array]] = {"single frames": [], "smoothed": []}
    for force_n in (0.5, 1.0, 1.8):
        for turn in np.linspace(0.0, np.pi, 4, endpoint=False):
            along = SPEED_MM_PER_S * (time_s - 0.8)
            press = np.column_stack([along * np.cos(turn), along * np.sin(turn), np.full(len(time_s), force_n)])
            field = pressed_fields(pad, press)
            noisy = field + random.normal(0.0, NOISE_T, field.shape)
            tracking = tracking_model_for(SceneConfig(), MagnetConfig()).tracking
            tracker, poses = FieldTracker(pad, rest, tracking, ROOM_C), []
            found: dict[str, list[list[float]]] = {name: [] for name in errors}
            for frame in noisy:
                estimate = tracker.update(frame, np.full(frame.shape, NOISE_T), 1.0 / RATE_HZ, ROOM_C).estimate
                assert estimate is not None
                position_m, axis, covariance = in_nominal_frame(estimate, rest, pad)
                poses.append(np.concatenate([position_m, axis]))
                smooth = _smoothed(np.array(poses))
                single = position_m, axis, covariance
                for name, asked in (("single frames", single), ("smoothed", (smooth[:3], smooth[3:], covariance))):
                    contact = model.estimate(*asked)
                    found[name].append([contact.x_m * 1e3, contact.y_m * 1e3, contact.force_n])
            axes = np.array([[np.cos(turn), np.sin(turn), 0.0], [-np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
            for name, values in found.items():
                errors[name].append(((np.array(values) - press) @ axes.T)[20:])
    mae = {name: np.abs(np.concatenate(values)).mean(axis=0) for name, values in errors.items()}
    lag_ms = {name: -1e3 * np.concatenate(v)[:, 0].mean() / SPEED_MM_PER_S for name, v in errors.items()}
    print(f"a finger at {SPEED_MM_PER_S:g} mm/s, {RATE_HZ:g} Hz: errors along, across (mm), force (N); lag")
    for name, values in mae.items():
        print(f"  {name:14}" + "".join(f"{value:9.4f}" for value in values) + f"{lag_ms[name]:8.1f} ms")
    share = mae["smoothed"] / mae["single frames"]
    print("  smoothed over single" + "".join(f"{value:9.3f}" for value in share))
    return {"share": [rounded(value) for value in share], "lag_ms": rounded(lag_ms["smoothed"])}


def _smoothed(poses: Array) -> Array:
    """(6,) the last pose by what smooth.c computes step by step: a parabola through all (K, 6), whose weight fades."""
    last: Array = poses[-round(10.0 * MEMORY_S * RATE_HZ) :]
    age_s = np.arange(len(last) - 1, -1, -1) / RATE_HZ
    if len(last) < 4:
        newest: Array = last[-1]
        return newest
    fitted = np.polynomial.polynomial.polyfit(-age_s, last, 2, w=np.exp(-age_s / (2.0 * MEMORY_S)))[0]
    smooth: Array = np.concatenate([fitted[:3], fitted[3:] / np.linalg.norm(fitted[3:])])
    return smooth


def squeezes(model: ContactModel, random: np.random.Generator) -> dict[str, Any]:
    """Presses beyond the calibrated force, anywhere on the pad: how many are over range, and does the bound hold?"""
    pad = standard_pad()
    solver = FrameSolver(pad, rest_field_of(pad), "drifting", NOISE_T)
    facts = {}
    print(f"squeezes, beyond the calibrated {model.facts.envelope.force_max_n:.2f} N: over range; the lower bound")
    for force_n in SQUEEZES_N:
        press = np.column_stack([random.uniform(-14.0, 14.0, (1000, 2)), np.full(1000, force_n)])
        field = pressed_fields(pad, press)
        found = estimates(model, solver.solved(field + random.normal(0.0, NOISE_T, field.shape)))
        flagged = np.array([one.over_range for one in found])
        inside = np.hypot(press[:, 0], press[:, 1]) <= 11.0
        bounds = np.array([one.force_min_n for one in found if one.force_min_n is not None])
        too_high = int((bounds > force_n).sum())
        print(
            f"  {force_n:4g} N: {flagged.mean():7.1%} ({flagged[inside].mean():7.1%} within 11 mm); "
            f"bound {np.median(bounds):.2f} N in the median, above the force {too_high} times"
        )
        facts[f"{force_n} N"] = {
            "flagged": rounded(flagged.mean()),
            "flagged_within_11_mm": rounded(flagged[inside].mean()),
            "bounds_too_high": too_high,
        }
    return facts
