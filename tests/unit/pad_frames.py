"""Frames of a simulated pad: with its scripted finger, and with one fault after another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from test_pipeline import PERIOD_NS

from fmfts.config import PadConfig
from fmfts.sensor import Frame
from fmfts_simulation.source import Simulated


def frames_of(config: PadConfig, seconds: float) -> list[Frame]:
    source = Simulated(config)
    return [frame for step in range(round(seconds * 220)) for frame in source.poll(step * PERIOD_NS)]


def with_faults(frames: Sequence[Frame]) -> Iterator[Frame]:
    """One fault after another, each for a while, and health in between."""
    stuck, before = None, frames[0]
    for index, frame in enumerate(frames):
        phase, counts = index // 110, frame.counts.copy()
        if phase == 1:  # one frame in ten with a saturated axis
            counts[1, 2] = -4096 if index % 10 == 0 else counts[1, 2]
            yield replace(frame, counts=counts)
        elif phase == 3:  # a sensor that is silent
            yield replace(frame, valid=np.array([True, True, False, True]))
        elif phase == 5:  # an axis that is slightly wrong, until it is found
            counts[0, 0] += 20
            yield replace(frame, counts=counts)
        elif phase == 7:  # steel
            counts[:, 2] += np.array([60, -40, 20, -80], dtype=np.int16)
            yield replace(frame, counts=counts)
        elif phase == 9:  # an axis that is stuck
            stuck = counts[3, 1] if stuck is None else stuck
            counts[3, 1] = stuck
            yield replace(frame, counts=counts)
        elif phase == 11:  # samples that are not new, and frames that never arrive
            if index % 7:
                yield replace(frame, fresh=np.array([True, index % 3 > 0, True, index % 5 > 0]))
        elif phase == 12 and index % 110 == 20:  # the board is reset
            yield replace(frame, device_time_us=1000, age_us=np.zeros(4, np.uint16))
        elif phase == 13 and index % 20 < 3:  # the frames that first had a slow chip's samples never arrive
            before = frame
        elif phase == 13 and index % 20 == 3:
            counts[2] = before.counts[2]
            age_us = frame.age_us.copy()
            age_us[2] = frame.device_time_us - before.sampled_us[2]
            yield replace(frame, counts=counts, age_us=age_us, fresh=np.array([True, True, False, True]))
        elif phase == 14:  # no thermometer
            yield replace(frame, temperature_c=None)
        else:
            yield frame
