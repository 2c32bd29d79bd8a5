"""The facts about a new baseline, for the person who recorded it."""

from __future__ import annotations

from typing import Any

import numpy as np

from fmfts.arithmetic.elementary import square
from fmfts.baseline.array_mounting import ArrayMounting
from fmfts.baseline.baseline import AnyMounting, Baseline
from fmfts.baseline.chips_found import chips_found
from fmfts.baseline.file_format import StoredGains
from fmfts.baseline.learner import LEARN_PRESSES
from fmfts.baseline.mounting import Mounting, ambient_of
from fmfts.baseline.prospects import prospects
from fmfts.pad import Pad

# A drawing with such places is rough: presses determine them better.
ROUGH_PLACE_M = 5e-4


def whose(baseline: Baseline) -> dict[str, Any]:
    return {"pad": baseline.pad, "baseline": baseline.id, "kind": baseline.kind}


def report(baseline: Baseline, mounting: AnyMounting | None, pad: Pad) -> dict[str, Any]:
    """mounting: None before rest was recorded, for pads with several or unknown magnets."""
    recording = baseline.rest or baseline.bare
    assert recording is not None
    facts: dict[str, Any] = {
        **whose(baseline),
        **({} if baseline.origin is None else {"recorded_on": str(baseline.origin)}),
        "gains_from": _gains_from(baseline),
        "duration_s": recording.duration_s,
        "temperature_c": recording.temperature_c,
        "noise_t": float(np.sqrt(np.mean(square(np.array(recording.noise_t))))),
        "noise_per_axis_t": recording.noise_t,
    }
    if baseline.bare is not None:
        ambient_t, deviation_t = ambient_of(pad, baseline.bare.recording())
        facts |= {"ambient_t": ambient_t.tolist(), "ambient_sd_t": deviation_t.tolist()}
    if isinstance(mounting, ArrayMounting):
        facts |= _of_several(baseline, mounting, pad)
    elif isinstance(mounting, Mounting) and baseline.rest is not None:
        deviation = np.sqrt(np.diagonal(mounting.rest_covariance))
        remanence_t = mounting.remanence_t(pad)
        facts |= {
            "with_bare": baseline.bare is not None,
            "remanence_t": remanence_t,
            "remanence_sd_t": float(deviation[5]) * remanence_t,
            "rest_position_m": mounting.rest.position_m.tolist(),
            "rest_position_sd_m": deviation[:3].tolist(),
            "rest_axis": mounting.rest.axis.tolist(),
            "rest_axis_sd_rad": float(deviation[3:5].max()),
            "chi2": mounting.chi2,
            "measurements": mounting.measurements,
            "chips": chips_found(mounting),
            "could_gain": _could_gain(baseline, mounting, pad),
        }
    return facts


def _could_gain(baseline: Baseline, mounting: Mounting, pad: Pad) -> list[str]:
    if baseline.turn is not None or baseline.refine is not None:
        return []
    if baseline.tolerance["sensor_position_m"] >= ROUGH_PLACE_M and baseline.bare is not None:
        return [f"--learn: the places and rotations of the sensors, from {LEARN_PRESSES} presses anywhere"]
    return prospects(mounting, pad)


def _of_several(baseline: Baseline, mounting: ArrayMounting, pad: Pad) -> dict[str, Any]:
    deviation = np.sqrt(np.diagonal(mounting.rest_covariance)).reshape(-1, 6)
    remanences_t = mounting.remanences_t(pad)
    return {
        "with_bare": baseline.bare is not None,
        "remanence_t": mounting.remanence_t(pad),
        "remanence_sd_t": float(deviation[:, 5].max()) * max(remanences_t),
        "remanences_t": remanences_t,
        "rest_positions_m": mounting.magnets.position_m.tolist(),
        "rest_position_m": mounting.magnets.position_m.mean(axis=0).tolist(),
        "rest_position_sd_m": deviation[:, :3].max(axis=0).tolist(),
        "chi2": mounting.chi2,
        "measurements": mounting.measurements,
    }


def _gains_from(baseline: Baseline) -> str:
    """A description, as far as a person can change it."""
    match baseline.gains_from, baseline.gains:
        case "selftest", StoredGains(utc=utc, deviation=deviation):
            return f"selftest of {utc} (±{deviation * 1e2:.1f} %)"
        case "turn", _:
            return "turn"
    return f"tolerance.gain (±{baseline.tolerance['gain'] * 1e2:.1f} %)"
