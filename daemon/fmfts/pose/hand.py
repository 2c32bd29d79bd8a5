"""The field of a hand's posture at a frame's time, from the newest joint positions.

Joint positions arrive independently of frames, with their own times. The field is interpolated between the two newest,
and extrapolated for a while, with a deviation proportional to its rate. If joint positions stop arriving, the hand may
be in any recorded posture. joints.c has the limits, and the sentences.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fmfts.arithmetic.matrix import cholesky, eigen, product, solve_lower
from fmfts.common.record import Field, Record
from fmfts.pad import Array
from fmfts.pose import _alignment
from fmfts.pose.posture import REST_UNKNOWN, PostureModel, Predicted
from fmfts.sensor.joints import NO_JOINTS, Joints

APART_S = 0.5  # positions that are further apart give no speed
SECOND_NS = 1_000_000_000
# Positions that follow sooner are ignored: one takes as long as fifty frames, and hands are slow.
SPARES_NS = 15_000_000


def hand_fields(values: int) -> list[Field]:
    """The fields of Hand.table; C takes them in this order (fmfts_hand in step.h). state: in joints.h."""
    each = ("field_t", "rate_t_per_s", "variance_t2", "rate_variance", "wide_field_t", "wide_variance_t2")
    return [("state", "<f8", 0), ("time_ns", "<f8", 0), *((name, "<f8", values) for name in each)]


class Hand:
    """The joints of a hand that a pad is part of. values: of the pad's field. table: what C reads."""

    def __init__(self, values: int) -> None:
        self.table = Record(hand_fields(values))
        self.joints = NO_JOINTS
        self._values = values
        self._model: PostureModel | None = None
        self.use(None)

    @property
    def names(self) -> tuple[str, ...]:
        """The joints of the recorded postures."""
        return () if self._model is None else self._model.names

    def use(self, model: PostureModel | None, to_pose: Array | None = None) -> None:
        """From the next frame on, use this posture field; None: there is none. to_pose (5, P): how C's pose at rest
        follows from the field; None: C judges no frame of this pad."""
        self._model, self._to_pose = model, to_pose
        self.joints = NO_JOINTS
        self._latest: dict[str, tuple[float, int]] = {}  # by joint: its position and time
        nothing = Predicted(np.zeros(self._values), np.zeros((self._values, self._values)))
        self._wide = nothing if model is None else model.predicted(None)._replace(why="")
        self._wide_values = self._wide.field_t, self._independent(self._wide.covariance_t2)
        self._newest, self._rate_t_per_s = self._wide, np.zeros(self._values)
        self._show()

    def take(self, position_rad: Mapping[str, float], time_ns: int) -> None:
        """Positions by the joints' names, and their time on the host's clock. Those of an older time are left out.

        Each message may hold some of the joints. They count when all joints are known, at times that differ by less
        than SILENT_S.
        """
        if self._model is None or not self._model.names:
            return
        for name in self._model.names:
            if name in position_rad:
                self._latest[name] = float(position_rad[name]), time_ns
        last, latest = self.joints, self._latest
        if len(latest) < len(self._model.names) or not any(name in position_rad for name in latest):
            return
        at_ns = [one_ns for _, one_ns in latest.values()]
        if max(at_ns) - min(at_ns) > _alignment.SILENT_S * SECOND_NS:
            return
        if last.time_ns is not None and time_ns < last.time_ns + SPARES_NS:
            if last.time_ns - time_ns < SECOND_NS:
                return
            last = NO_JOINTS  # the publisher's clock restarted
        position = tuple(latest[name][0] for name in self._model.names)
        self.recall(Joints(time_ns, position, last.time_ns, last.position_rad))

    def recall(self, joints: Joints) -> None:
        """Continue from another hand with the same joints. ValueError if its joints differ."""
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
        later_s = np.nan if self.joints.time_ns is None else (time_ns - self.joints.time_ns) * 1e-9
        posture, goes_on_s, unsure_s, why = _alignment.posture(self._state, later_s)
        if posture in (_alignment.POSTURE_OUTSIDE, _alignment.POSTURE_NO_REST):
            return self._newest
        if posture == _alignment.POSTURE_ANY:
            return self._wide
        if posture != _alignment.POSTURE_KNOWN:
            return self._wide._replace(why=why)
        unsure_t = self._rate_t_per_s * unsure_s
        covariance = self._newest.covariance_t2 + product(unsure_t[:, None], unsure_t[None, :])
        return Predicted(self._newest.field_t + self._rate_t_per_s * goes_on_s, covariance)

    @property
    def _state(self) -> float:
        if self._model is None:
            return _alignment.POSTURE_UNTAUGHT
        if not self._model.names:
            return _alignment.POSTURE_ANY
        if self.joints.time_ns is None:
            return _alignment.POSTURE_NO_JOINTS
        if self._newest.why:
            return _alignment.POSTURE_NO_REST if self._newest.why == REST_UNKNOWN else _alignment.POSTURE_OUTSIDE
        return _alignment.POSTURE_KNOWN

    def _show(self) -> None:
        """Write the table, if C reads it."""
        if self._to_pose is None:
            return
        newest, rate = self._newest, self._rate_t_per_s
        time_ns = np.nan if self.joints.time_ns is None else float(self.joints.time_ns)
        of_rate = self._independent(product(rate[:, None], rate[None, :]))
        parts = newest.field_t, rate, self._independent(newest.covariance_t2), of_rate, *self._wide_values
        self.table.flat[:] = np.concatenate([[self._state, time_ns], *parts])  # in one call, as C may read any time

    def _independent(self, covariance_t2: Array) -> Array:
        """(P,) variances of independent errors that bound the covariance in every direction of the pose."""
        variance_t2 = np.diagonal(covariance_t2).copy()
        if self._to_pose is None or not variance_t2.any():
            return variance_t2
        root = cholesky(product(self._to_pose * variance_t2, self._to_pose.T))
        half = solve_lower(root, product(self._to_pose, covariance_t2, self._to_pose.T))
        largest = eigen(solve_lower(root, half.T))[0][-1]
        wider: Array = max(float(largest), 1.0) * variance_t2
        return wider
