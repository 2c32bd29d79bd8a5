"""`now` of a pad with several magnets: finger.c follows the finger that presses, as now.c follows one magnet's pose.

It is null with two fingers, beside pads that are felt, and on a hand that moves: docs/several.md.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fmfts.arithmetic.elementary import square
from fmfts.common.chi2 import quantile
from fmfts.common.record import Record, Values
from fmfts.contact.drive import drive_power
from fmfts.pad import Array
from fmfts.pipeline import _pad
from fmfts.pipeline.lead import Lead
from fmfts.pipeline.parameters import MODE_WEIGHTS
from fmfts.pipeline.possible_memory import require_possible
from fmfts.pose import AMBIENT, Aligned
from fmfts.pose.gates import FALSE_INNOVATION
from fmfts.sensor import Frame
from fmfts.sensor.early import EarlySample
from fmfts.several import _several
from fmfts.several.estimator import FingersEstimator
from fmfts.several.fit import Fit, Measured
from fmfts.several.reading import FingersReading

NOT_KNOWN, PRESSING = -1.0, 1.0
# A finger is looked for in the newest samples where one of them has changed by so much since the frame's instant.
SURE_DEVIATIONS = 4.0
LONGEST_AHEAD_S = 0.01
# χ² of the change since the frame's instant must have grown by the first of these after a look that found nothing, and
# by the second beside each of the last frames: mains change the samples as much in every frame, a finger begins to.
GROWN, GROWN_OVER_FRAMES, LAST_FRAMES = 1.5, 2.0, 3
LIGHT_N = 0.2
# What the linear field, the table and the gains may be wrong by while a finger moves, as a share of the field's change.
UNKNOWN_SHARE = 0.03


@dataclass(slots=True)
class FollowedMemory:
    """fields: of FMFTS_FOLLOWED_MEMORY (finger.h), by name."""

    fields: Values


class FollowedFinger:
    """For one pad with its baseline."""

    def __init__(self, estimator: FingersEstimator, lead: Lead, parameters: Record) -> None:
        """parameters: of C's pad, which are filled."""
        pad, mounting, scene = estimator.pad, estimator.mounting, estimator.scene
        self._estimator, self._mounting = estimator, mounting
        self._sensors = len(pad.sensors)
        self._memory = Record(_pad.FOLLOWED)
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
        self._linear = self._memory["ahead_t"][:values], self._memory["by_finger"][: 3 * values]
        head = "pressing", "places", "instant_us", "motion_us"
        self._pressing, self._places, self._instant_us, self._motion_us = (self._memory[name] for name in head)
        self._finger, self._motion = self._memory["finger"].reshape(1, -1), self._memory["motion_state"]
        self._covariance = self._memory["finger_covariance"].reshape(len(self._finger[0]), -1)
        self._deviation = self._memory["finger_deviation"]
        self._numbers = np.array([1.0, LIGHT_N])
        self._rest_t = mounting.rest_field_t.ravel()
        self._quiet = np.array([0.0, 0.0, estimator.quiet_force_sd_n])
        self._sure_t = SURE_DEVIATIONS * mounting.noise_t
        # χ² of the last look since the frame, and the largest of each of the last frames and since.
        self._looked_chi2, self._largest_chi2 = 0.0, [0.0] * (LAST_FRAMES + 1)
        # Of the last frame, in which nothing pressed: its change, its field (N, 3), and the newest samples (N, 3).
        self._last: tuple[Measured, Array, Array]

    @property
    def memory(self) -> FollowedMemory:
        return FollowedMemory(self._memory.copy())

    def recall(self, memory: FollowedMemory) -> None:
        """ValueError, and nothing changes, if no such pad can remember it."""
        require_possible(memory.fields, self._sensors)
        self._memory.recall(memory.fields)

    def forget(self) -> None:
        """Nobody knows what presses."""
        self._memory.fill({"pressing": NOT_KNOWN, "untouched_us": 0.0, "motion_us": 0.0})

    def after(
        self, reading: FingersReading, aligned: Aligned, frame: Frame, newest_t: Array, compiled: _pad.Pad
    ) -> bool:
        """Whether `compiled` knows the contact when the message of a frame is published. newest_t (N, 3): its
        samples."""
        fit = reading.fit
        if fit is None or reading.health != "ok" or reading.over_range or len(fit.fingers) > 1 or aligned.leap_us:
            self.forget()
            return False
        self._pressing[()] = self._places[()] = pressed = len(fit.fingers)
        self._instant_us[()] = aligned.time_us
        if pressed:
            self._put(reading.measured, fit, frame.device_time_us)
        else:
            assert reading.measured is not None
            self._deviation[:], self._last = self._quiet, (reading.measured, aligned.field_t, newest_t)
            self._looked_chi2, self._largest_chi2 = 0.0, [*self._largest_chi2[1:], 0.0]
            if (np.abs(newest_t - aligned.field_t) > self._sure_t).any():
                self._looked_chi2 = self._newer_chi2()
                self._look_ahead(frame.device_time_us)
        return compiled.follow(self._buffer)

    def _newer_chi2(self) -> float:
        """Of the change from the frame's instant to the newest samples."""
        _, field_t, newest_t = self._last
        return float(square((newest_t - field_t) / self._mounting.noise_t).sum())

    def _may_press(self) -> bool:
        """Whether the newest samples have changed by so much more than before that a look may find a finger."""
        chi2, largest = self._newer_chi2(), self._largest_chi2
        few_chi2 = max(GROWN * self._looked_chi2, GROWN_OVER_FRAMES * min(largest[:-1]))
        largest[-1] = max(largest[-1], chi2)
        if chi2 >= few_chi2:
            self._looked_chi2 = chi2
        return chi2 >= few_chi2

    def _look_ahead(self, time_us: int) -> None:
        """The newest samples may show a finger, though nothing pressed at the frame's instant."""
        measured, field_t, newest_t = self._last
        mounting, newer_t = self._mounting, newest_t - field_t
        change_t = measured.field_t + (newer_t / (mounting.gain * self._estimator.moment)).ravel()
        newest = replace(measured, field_t=change_t, variance_t2=square(mounting.noise_t / mounting.gain).ravel())
        found = self._estimator.appears(newest)
        if found is not None:
            self._pressing[()] = PRESSING
            self._put(newest, found, time_us)

    def _put(self, measured: Measured | None, fit: Fit, time_us: int) -> None:
        """The field is linear at the finger where the newest samples should find it: at a tap it has moved on since the
        frame's instant."""
        assert measured is not None
        there, model, began_us = fit.fingers, self._estimator.fitter.model, self._motion_us.item()
        if began_us > 0.0:
            ahead_s = min(max((time_us - began_us) * 1e-6, 0.0), LONGEST_AHEAD_S)
            there = self._motion[:3].copy()  # the rates of its place are poorly known
            there[2] = max(there[2] + ahead_s * self._motion[7], 0.0)
        self._numbers[0] = self._estimator.moment
        self._finger[:], self._covariance[:] = there, fit.covariance
        found = fit.fingers, measured.field_t, fit.noise_t, fit.misfit_t, fit.slope_t, fit.ambient_t
        _several.ahead(model.packed, model.work, *found, self._rest_t, there, self._numbers, *self._linear)

    def early(self, early: EarlySample, compiled: _pad.Pad) -> bytes | None:
        """The last message with what a sample says that came before its frame; None where it says nothing new."""
        sample = self._buffer, early.sensor, early.gain_code, *early.counts, early.device_time_us
        payload = compiled.follow_early(*sample)
        if payload is True:
            self._last[2][early.sensor] = early.field_t
            if not self._may_press():
                return None
            self._look_ahead(early.device_time_us)
            is_followed = self._pressing > 0.0 and compiled.follow(self._buffer)  # from the last frame on
            payload = compiled.follow_early(*sample) if is_followed else None
        return None if payload is True else payload
