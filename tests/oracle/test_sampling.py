"""The compiled alignment against the history of each sensor, on random chips: late, missing, stuck and jumping ones."""

from __future__ import annotations

import numpy as np
import pytest

from fmfts.pose import Alignment
from oracle.sampling import History

PERIOD_US = 4545


@pytest.mark.parametrize("seed", range(5))
def test_alignment_is_that_of_each_sensors_history(seed: int) -> None:
    random = np.random.default_rng(seed)
    count = 4 + seed % 5
    alignment, histories = Alignment(count, PERIOD_US), [History() for _ in range(count)]
    phase, own_us = random.uniform(0, PERIOD_US, count), PERIOD_US * random.uniform(0.97, 1.03, count)
    told, level = np.full(count, -1), np.zeros((count, 3))
    missing = random.random(count) * 0.1
    bent = 0
    for frame in range(160):
        now_us = 10_000_000 + (frame + 1) * PERIOD_US
        sample = np.floor((now_us - phase) / own_us).astype(int)
        fresh = (sample != told) & ((random.random(count) > missing) | (frame < 3))
        if frame == 80:
            level = level + 3e-4 * random.normal(size=(count, 3))
        time_us = np.rint(phase + np.where(fresh, sample, told) * own_us).astype(np.int64)
        field = (
            level + 1e-5 * np.sin(now_us * 1e-6 * 20.0 + np.arange(3)) + 2e-7 * np.rint(random.normal(size=(count, 3)))
        )
        field = np.where(
            fresh[:, None], field, [history.fields[-1] if history.fields else np.zeros(3) for history in histories]
        )
        told = np.where(fresh, sample, told)
        for sensor in np.flatnonzero(fresh).tolist():
            histories[sensor].add(int(time_us[sensor]), field[sensor])
        aligned = alignment.push(field, time_us, fresh)
        newest = np.array([history.times[-1] for history in histories])
        running = newest.max() - newest <= alignment.stopped_us
        instant = int(newest[running].min())
        assert aligned.time_us == instant
        for sensor, history in enumerate(histories):
            if not running[sensor]:
                assert np.isnan(aligned.field_t[sensor]).all()
                continue
            value, share, bend = history.at(instant)
            # Fields are 1e-5 T; a double has 16 digits of them, a parabola less: a bend is a small difference.
            assert aligned.field_t[sensor] == pytest.approx(value, rel=1e-12, abs=1e-18)
            if len(history.times) > 1:
                assert aligned.noise_share[sensor, 0] == pytest.approx(share, rel=1e-12)
            assert aligned.bend_t[sensor] == pytest.approx(bend, rel=1e-7, abs=1e-18)
            assert aligned.repeats[sensor].tolist() == history.repeats()
            bent += int((bend > 4e-5).sum())
    assert bent > 5, "no field jumped"
