"""Is a slower, quieter sensor an alternative? The error of the newest pose at any moment, by rate and averaging."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fmfts.config import SceneConfig
from fmfts.sensor.chips import NOISE_T
from fmfts_lab.study.harness import Request, Row
from fmfts_lab.study.kernels import default
from fmfts_lab.study.world import Path, drawn_world, frame_times, in_scene, pressed, presses

RATES_HZ, AVERAGING = (55, 110, 220), (1, 2, 4, 8)
LOOKED_AT_HZ = 1760  # period at which the newest pose is compared with the true one
SECONDS, QUICK_SECONDS = 6.0, 2.0


def rate_rows(request: Request) -> list[Row]:
    """Averaging n samples within a frame's period gives noise/√n, and a pose that is half a period old."""
    rows: list[Row] = []
    world = drawn_world(in_scene(request.pad, SceneConfig()), 60.0)
    seconds = QUICK_SECONDS if request.quick else SECONDS
    for rate_hz in RATES_HZ:
        for averaging in AVERAGING:
            random = np.random.default_rng([request.seed, 7])
            time_s = frame_times(seconds, LOOKED_AT_HZ)
            truth = pressed(world.built, time_s, presses(time_s, random))
            step = LOOKED_AT_HZ // rate_hz
            seen = replace(world, noise_t=NOISE_T / np.sqrt(averaging), rate_hz=float(rate_hz))
            method = default(seen)
            samples = seen.samples(_averaged(truth, step, averaging), random)
            poses = np.array([method.told(method.ask(sample)).position_m for sample in samples])
            held = np.repeat(poses, step, axis=0)[: len(time_s) - step]
            error = held - truth.position_m[step : step + len(held)]
            rms = float(np.sqrt(np.nanmean(np.sum(error**2, axis=1)))) * 1e6
            answered = float(np.isfinite(poses).all(axis=1).mean())
            about: Row = {"chart": "rate", "method": "the daemon's filter", "rate_hz": rate_hz, "averaging": averaging}
            rows.append(about | {"position_um": round(rms, 2), "answered": answered})
    return rows


def _averaged(path: Path, step: int, averaging: int) -> Path:
    """One pose for each `step` poses: the mean of `averaging` of them (one: the last)."""
    count = len(path.time_s) // step
    within = [round(step - 1 - part * step / averaging) for part in range(averaging)]
    position = np.mean(
        [path.position_m[: count * step].reshape(count, step, 3)[:, max(at, 0)] for at in within], axis=0
    )
    axis = np.mean([path.axis[: count * step].reshape(count, step, 3)[:, max(at, 0)] for at in within], axis=0)
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    return Path(path.time_s[step - 1 :: step][:count], position, axis, path.press[step - 1 :: step][:count])
