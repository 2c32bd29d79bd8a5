"""`now` of a pad with several magnets: finger.c follows the finger that presses, as now.c follows one magnet's pose.

It is null with two fingers, beside pads that are felt, and on a hand that moves: docs/several.md.
"""

from __future__ import annotations

import numpy as np

from fmfts.arithmetic.elementary import square
from fmfts.common.chi2 import quantile
from fmfts.common.record import Record, Values
from fmfts.contact.drive import drive_power
from fmfts.pad import Array
from fmfts.pipeline import _pad
from fmfts.pipeline.found import put_fit
from fmfts.pipeline.lead import Lead
from fmfts.pipeline.parameters import MODE_WEIGHTS
from fmfts.pose import AMBIENT, Aligned
from fmfts.pose.gates import FALSE_INNOVATION
from fmfts.sensor import Frame
from fmfts.sensor.early import EarlySample
from fmfts.several.appearing import Appearing
from fmfts.several.estimator import FingersEstimator
from fmfts.several.fit import Measured
from fmfts.several.reading import FingersReading, PosesReading

NOT_KNOWN = -1.0
# A finger is looked for in the newest samples where one of them has changed by so much since the frame's instant.
SURE_DEVIATIONS = 4.0
# χ² of the change since the frame's instant must have grown by the first of these after a look that found nothing, and
# by the second beside each of the last frames: mains change the samples as much in every frame, a finger begins to.
GROWN, GROWN_OVER_FRAMES, LAST_FRAMES = 1.5, 2.0, 3
# What the linear field, the table and the gains may be wrong by while a finger moves, as a share of the field's change.
UNKNOWN_SHARE = 0.03


class FollowedFinger:
    """For one pad with its baseline."""

    def __init__(self, estimator: FingersEstimator, lead: Lead, parameters: Record, compiled: _pad.Pad) -> None:
        """parameters: of C's pad, which are filled. compiled: this pad."""
        mounting, scene = estimator.mounting, estimator.scene
        self._estimator, self._mounting, self._compiled = estimator, mounting, compiled
        self._appearing = Appearing(estimator)
        self._memory, self._found = Record(_pad.FOLLOWED), Record(_pad.FOUND)
        walk = np.zeros(_pad.STEP)
        walk[AMBIENT] = scene.ambient_walk_t2_per_s
        values = mounting.noise_t.size
        parameters.fill(
            {
                "gain": mounting.gain,
                "offset_t": mounting.offset_t,
                "rest_field_t": mounting.rest_field_t,
                "noise_t": mounting.noise_t / mounting.gain,
                "sensitivity_deviation": np.full(3 * values, UNKNOWN_SHARE),
                "direction": mounting.sensors.axes.transpose(0, 2, 1),
                "walk_per_s": walk,
                "lead_us": 1e6 * lead.frame_s,
                "early_lead_us": 1e6 * lead.early_s,
                "surprise_chi2": quantile(FALSE_INNOVATION, values),
                "early_chi2": quantile(FALSE_INNOVATION, 3),
                "drive_power": drive_power(loads=3),
                "weights": MODE_WEIGHTS,
            }
        )

        self._buffer = self._memory.buffer
        self._sure_t = SURE_DEVIATIONS * mounting.noise_t
        # χ² of the last look since the frame, and the largest of each of the last frames and since.
        self._looked_chi2, self._largest_chi2 = 0.0, [0.0] * (LAST_FRAMES + 1)
        # Of the last frame, in which nothing pressed: its change, its field (N, 3), and the newest samples (N, 3) and
        # how much later than the frame's instant they were taken (N,).
        self._last: tuple[Measured, Array, Array, Array]
        self._instant_us = 0

    @property
    def memory(self) -> Values:
        """The fields of FMFTS_FOLLOWED_MEMORY (finger.h), by name."""
        return self._memory.copy()

    def recall(self, memory: Values) -> None:
        self._memory.recall(memory)

    def forget(self) -> None:
        """Nobody knows what presses."""
        self._memory.fill({"pressing": NOT_KNOWN, "untouched_us": 0.0, "motion_us": 0.0})

    @property
    def buffer(self) -> memoryview:
        """Of its memory, for C."""
        return self._buffer

    def rests(self, measured: Measured, aligned: Aligned, frame: Frame, newest_t: Array) -> None:
        """Nothing presses in the last frame, which has this change; newest_t (N, 3): its samples."""
        self._instant_us = aligned.time_us
        passed_us = frame.sampled_us.astype(np.float64) - aligned.time_us
        self._last = measured, aligned.field_t, newest_t, passed_us
        self._looked_chi2, self._largest_chi2 = 0.0, [*self._largest_chi2[1:], 0.0]

    def ahead(
        self, reading: FingersReading | PosesReading, aligned: Aligned, frame: Frame, newest_t: Array
    ) -> memoryview | None:
        """Of a frame in which nothing presses: the finger that its newest samples (N, 3) show, for Pad.tell."""
        if not isinstance(reading, FingersReading) or reading.fit is None or reading.measured is None:
            return None
        if reading.health != "ok" or len(reading.fit.fingers) or reading.over_range or aligned.leap_us:
            return None
        self.rests(reading.measured, aligned, frame, newest_t)
        if not (np.abs(newest_t - aligned.field_t) > self._sure_t).any():
            return None
        self._looked_chi2 = self._newer_chi2()
        return self._look_ahead()

    def _newer_chi2(self) -> float:
        """Of the change from the frame's instant to the newest samples."""
        _, field_t, newest_t, _ = self._last
        return float(square((newest_t - field_t) / self._mounting.noise_t).sum())

    def _may_press(self) -> bool:
        """Whether the newest samples have changed by so much more than before that a look may find a finger."""
        chi2, largest = self._newer_chi2(), self._largest_chi2
        few_chi2 = max(GROWN * self._looked_chi2, GROWN_OVER_FRAMES * min(largest[:-1]))
        largest[-1] = max(largest[-1], chi2)
        if chi2 >= few_chi2:
            self._looked_chi2 = chi2
        return chi2 >= few_chi2

    def _look_ahead(self) -> memoryview | None:
        """The newest samples may show a finger, though nothing pressed at the frame's instant."""
        measured, field_t, newest_t, passed_us = self._last
        seen = self._appearing.found(measured, newest_t - field_t, passed_us)
        if seen is None:
            return None
        newest, fit = seen
        put_fit(self._found, fit, newest.field_t, self._estimator.since_rest.moment)
        return self._found.buffer

    def early(self, early: EarlySample) -> bytes | None:
        """The last message with what a sample says that came before its frame; None where it says nothing new."""
        sample = early.sensor, early.gain_code, *early.counts, early.device_time_us
        payload = self._compiled.follow_early(*sample, None)
        if payload is True:
            self._last[2][early.sensor] = early.field_t
            self._last[3][early.sensor] = early.device_time_us - self._instant_us
            ahead = self._look_ahead() if self._may_press() else None
            payload = None if ahead is None else self._compiled.follow_early(*sample, ahead)  # from the last frame on
        return None if payload is True else payload
