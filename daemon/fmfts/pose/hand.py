"""Where a hand's joints are, as they were told last, and what that does to the field at a frame's time.

Joint positions come by themselves, with their own times. Between the two newest ones the field is interpolated, and
beyond the newest it goes on for a while, with a deviation by its own speed. Joints that stop arriving leave the hand in
any of the postures that were taught.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fmfts.arithmetic.matrix import cholesky, eigen, product, solve_lower
from fmfts.common.record import Field, Record
from fmfts.pad import Array
from fmfts.pose.posture import REST_UNKNOWN, PostureModel, Predicted
from fmfts.sensor.joints import NO_JOINTS, Joints

# Positions go on along their last speed for so long; then they are not known. Two that are further apart tell no speed.
GOES_ON_S, SILENT_S, APART_S = 0.1, 0.25, 0.5
AHEAD_S = 0.5  # a stamp so far ahead of a frame is of another clock
# A stamp's error, and which share of the change since the newest position the last speed does not foresee.
STAMP_S, UNFORESEEN = 3e-3, 0.5
SECOND_NS = 1_000_000_000
# Positions that come sooner after others are left out: one takes as long as fifty frames, and hands are slow.
SPARES_NS = 15_000_000
UNTAUGHT = "the field of the hand's posture was not taught: `fmfts-daemon baseline --posture`"
START, STAMP = "start the program that publishes them", "stamp them by this computer's monotonic clock"
NONE_CAME = "no joint positions have arrived: docs/scene.md says how to publish them"
# The table's `state`, as posture.c has it.
KNOWN, STATE_UNTAUGHT, STATE_NONE_CAME, STATE_UNKNOWN, STATE_ANY, STATE_NO_REST = 1.0, 2.0, 3.0, 4.0, 5.0, 6.0


def hand_fields(values: int) -> list[Field]:
    """The fields of Hand.table; C takes them in this order (fmfts_hand in step.h)."""
    each = ("field_t", "rate_t_per_s", "variance_t2", "rate_variance", "wide_field_t", "wide_variance_t2")
    return [("state", "<f8", 0), ("time_ns", "<f8", 0), *((name, "<f8", values) for name in each)]


class Hand:
    """The joints of a hand that a pad is part of. values: of the pad's field. table: what C reads."""

    def __init__(self, values: int) -> None:
        self.table = Record(hand_fields(values))
        self.joints = NO_JOINTS
        self._values = values
        self._model: PostureModel | None = None
        self._wide = self._newest = Predicted(np.zeros(values), np.zeros((values, values)), UNTAUGHT)
        self._rate_t_per_s = np.zeros(values)
        self.use(None)

    @property
    def names(self) -> tuple[str, ...]:
        """The joints that were taught."""
        return () if self._model is None else self._model.names

    def use(self, model: PostureModel | None, to_pose: Array | None = None) -> None:
        """From the next frame on, with what was taught; None: nothing was. to_pose (5, P): how C's pose at rest follows
        from the field; None: C judges no frame of this pad."""
        self._model, self._to_pose = model, to_pose
        self.joints = NO_JOINTS
        self._told: dict[str, tuple[float, int]] = {}
        nothing = np.zeros(self._values), np.zeros((self._values, self._values))
        self._wide = Predicted(*nothing, UNTAUGHT) if model is None else model.predicted(None)
        if model is not None and model.names:
            self._wide = self._wide._replace(why=NONE_CAME)
        self._wide_values = self._wide.field_t, self._independent(self._wide.covariance_t2)
        self._newest, self._rate_t_per_s = self._wide, np.zeros(self._values)
        self._show()

    def take(self, position_rad: Mapping[str, float], time_ns: int) -> None:
        """Positions by the joints' names, and their time on the host's clock. Those of an older time are left out.

        Each message may tell some of the joints; together they count once none is older than another by SILENT_S.
        """
        if self._model is None or not self._model.names:
            return
        for name in self._model.names:
            if name in position_rad:
                self._told[name] = float(position_rad[name]), time_ns
        last, told = self.joints, self._told
        if len(told) < len(self._model.names) or not any(name in position_rad for name in told):
            return
        at_ns = [one_ns for _, one_ns in told.values()]
        if max(at_ns) - min(at_ns) > SILENT_S * SECOND_NS:
            return
        if last.time_ns is not None and time_ns < last.time_ns + SPARES_NS:
            if last.time_ns - time_ns < SECOND_NS:
                return
            last = NO_JOINTS  # that clock has begun anew
        position = tuple(told[name][0] for name in self._model.names)
        self.recall(Joints(time_ns, position, last.time_ns, last.position_rad))

    def recall(self, joints: Joints) -> None:
        """Continue from the joints of another hand that was taught the same. ValueError if there are others."""
        model = self._model
        if model is None or joints.time_ns is None:
            return
        if {len(joints.position_rad), len(joints.before_rad or joints.position_rad)} != {len(model.names)}:
            raise ValueError(f"positions of {len(joints.position_rad)} joints, and {len(model.names)} were taught")
        goes_on = joints.before_ns is not None and joints.before_rad == self.joints.position_rad
        before = self._newest if goes_on else None
        self.joints = joints
        self._newest = model.predicted(np.array(joints.position_rad))
        self._rate_t_per_s = np.zeros(self._values)
        if joints.before_ns is not None and not self._newest.why:
            elapsed_s = (joints.time_ns - joints.before_ns) * 1e-9
            before = before or model.predicted(np.array(joints.before_rad))
            if 0.0 < elapsed_s <= APART_S and not before.why:
                self._rate_t_per_s = (self._newest.field_t - before.field_t) / elapsed_s
        self._show()

    def at(self, time_ns: int) -> Predicted:
        """The field that the posture makes at a time of the host's clock."""
        if self.joints.time_ns is None:  # none came, or none were there while it was taught
            return self._wide
        later_s = (time_ns - self.joints.time_ns) * 1e-9
        if later_s > SILENT_S:
            return self._wide._replace(why=f"joint positions stopped arriving {later_s:.1f} s ago: {START}")
        if later_s < -AHEAD_S:
            return self._wide._replace(why=f"joint positions are stamped {-later_s:.1f} s ahead of the frames: {STAMP}")
        if self._newest.why:
            return self._newest
        goes_on_s = min(later_s, GOES_ON_S)
        unsure_t = self._rate_t_per_s * (STAMP_S + UNFORESEEN * max(later_s, 0.0))
        covariance = self._newest.covariance_t2 + product(unsure_t[:, None], unsure_t[None, :])
        return Predicted(self._newest.field_t + self._rate_t_per_s * goes_on_s, covariance)

    def _show(self) -> None:
        """Write the table, if C reads it."""
        if self._to_pose is None:
            return
        newest = self._newest
        state = {"": KNOWN, REST_UNKNOWN: STATE_NO_REST}.get(newest.why, STATE_UNKNOWN)
        if self._model is None:
            state = STATE_UNTAUGHT
        elif not self._model.names:
            state = STATE_ANY
        elif self.joints.time_ns is None:
            state = STATE_NONE_CAME
        told_ns = np.nan if self.joints.time_ns is None else float(self.joints.time_ns)
        rate = self._rate_t_per_s
        of_rate = self._independent(product(rate[:, None], rate[None, :]))
        parts = newest.field_t, rate, self._independent(newest.covariance_t2), of_rate, *self._wide_values
        self.table.flat[:] = np.concatenate([[state, told_ns], *parts])  # at once: C may read between two calls

    def _independent(self, covariance_t2: Array) -> Array:
        """(P,) variances of independent errors by which no direction of the pose is more certain than it is."""
        variance_t2 = np.diagonal(covariance_t2).copy()
        if self._to_pose is None or not variance_t2.any():
            return variance_t2
        root = cholesky(product(self._to_pose * variance_t2, self._to_pose.T))
        half = solve_lower(root, product(self._to_pose, covariance_t2, self._to_pose.T))
        largest = eigen(solve_lower(root, half.T))[0][-1]
        wider: Array = max(float(largest), 1.0) * variance_t2
        return wider
