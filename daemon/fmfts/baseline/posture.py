"""`baseline --posture`: measures the field of the hand's postures, in an untouched minute in which the hand moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from fmfts.baseline.file_format import stored
from fmfts.baseline.joint_track import JointTrack, require_joints
from fmfts.baseline.posture_fit import MOST_COORDINATES, Taught, fit_posture
from fmfts.baseline.recording import BaselineError
from fmfts.baseline.window_means import means
from fmfts.common import possible
from fmfts.pad import Array, Pad
from fmfts.pose.posture import PostureModel
from fmfts.sensor import Frame

if TYPE_CHECKING:
    from fmfts.baseline.baseline import AnyMounting, Baseline

SECONDS = 60.0
MOST_ROWS = 600
MOST_TERMS, MOST_VALUES = 200, 192  # in a file
Numbers = tuple[float, ...]


class StoredPosture(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A `PostureModel` in a baseline's file, with its recording's time; matrices row by row. even_t: see Taught."""

    utc: str
    names: tuple[str, ...]
    middle_rad: Numbers
    off_rad: Numbers
    axes: tuple[Numbers, ...]
    exponents: tuple[Numbers, ...]
    weight_t: tuple[Numbers, ...]
    inverse_normal: tuple[Numbers, ...]
    left_t2: tuple[Numbers, ...]
    mean_t: Numbers
    spread_t2: tuple[Numbers, ...]
    even_t: float
    # The joints of a later rest recording, or that they are not known.
    rest_rad: Numbers | None = None
    rest_unknown: bool = False

    def __post_init__(self) -> None:
        joints, terms, values = len(self.names), len(self.exponents), len(self.mean_t)
        shapes = (
            (self.axes, len(self.axes), joints),
            (self.exponents, terms, len(self.axes)),
            (self.weight_t, terms, values),
            (self.inverse_normal, terms, terms),
            (self.left_t2, values, values),
            (self.spread_t2, values, values),
        )
        alike = all(len(rows) == count and {len(row) for row in rows} <= {width} for rows, count, width in shapes)
        if not alike or {len(self.middle_rad), len(self.off_rad)} != {joints} or values % 3 or not values:
            raise ValueError("no recording gives such a posture")
        has_many_terms = terms > MOST_TERMS or len(self.axes) > MOST_COORDINATES
        if joints > possible.MOST_JOINTS or values > MOST_VALUES or has_many_terms:
            raise ValueError("too many joints, or fields, for a hand")
        possible.JOINT_RAD.require(chain(self.middle_rad, self.off_rad, self.rest_rad or ()))
        possible.JOINT_AXIS.require(chain(*self.axes))
        possible.POLYNOMIAL_ORDER.require(chain(*self.exponents))
        possible.FIELD_T.require(chain(self.mean_t, *self.weight_t))
        possible.INVERSE_NORMAL.require(chain(*self.inverse_normal))
        possible.FIELD_T.require([self.even_t])
        possible.FIELD_T2.require(chain(*self.left_t2, *self.spread_t2))
        if any(row[i] < 0.0 for matrix in (self.left_t2, self.spread_t2) for i, row in enumerate(matrix)):
            raise ValueError("a negative variance")

    @property
    def sensors(self) -> int:
        return len(self.mean_t) // 3

    @classmethod
    def of(cls, taught: Taught) -> StoredPosture:
        return stored(cls, taught.model, even_t=taught.even_t)

    def after_rest(self, track: JointTrack | None, frames: Sequence[Frame]) -> StoredPosture:
        """The same after another rest recording, with the joints in it as far as they are known."""
        rest = None
        if track is not None and self.names:
            rest = track.mean(self.names, frames[0].host_time_ns, frames[-1].host_time_ns)
        known = None if rest is None else tuple(rest.tolist())
        return msgspec.structs.replace(self, rest_rad=known, rest_unknown=known is None)

    def model(self) -> PostureModel:
        terms, values, joints = len(self.exponents), len(self.mean_t), len(self.names)
        return PostureModel(
            self.names,
            np.array(self.middle_rad, dtype=np.float64),
            np.array(self.off_rad, dtype=np.float64),
            np.array(self.axes, dtype=np.float64).reshape(len(self.axes), joints),
            np.array(self.exponents, dtype=np.float64).reshape(terms, len(self.axes)),
            np.array(self.weight_t, dtype=np.float64).reshape(terms, values),
            np.array(self.inverse_normal, dtype=np.float64).reshape(terms, terms),
            np.array(self.left_t2),
            np.array(self.mean_t),
            np.array(self.spread_t2),
            None if self.rest_rad is None else np.array(self.rest_rad),
            self.rest_unknown,
        )


@dataclass(frozen=True)
class PostureLearner:
    """A `Learner`. track: the joint positions meanwhile, which the recorder adds."""

    seconds: float = SECONDS
    without_joints: bool = False
    track: JointTrack = field(default_factory=JointTrack)

    option, presses, weight_n = "--posture", 0, 0.0

    def require(self, pad: Pad, before: Baseline) -> None:
        """Any pad with a rest recording is accepted."""

    def make(
        self, pad: Pad, frames: Sequence[Frame], before: Baseline | None
    ) -> tuple[Baseline, AnyMounting, dict[str, Any]]:
        assert before is not None
        assert before.rest is not None
        if not self.without_joints:
            require_joints(self.track)
        taught = self._taught(pad, frames, before.rest.recording().mean_t)
        stored = StoredPosture.of(taught)
        baseline = msgspec.structs.replace(before, posture=stored).sealed()
        facts = {
            "posture_joints": list(stored.names),
            "posture_terms": taught.terms,
            "posture_uneven_t": taught.uneven_t,
            "posture_left_t": taught.left_t,
        }
        return baseline, baseline.any_mounting(pad), facts

    def _taught(self, pad: Pad, frames: Sequence[Frame], rest_t: Array) -> Taught:
        mean = means(frames)
        change = (mean.field_t - rest_t).reshape(len(mean.field_t), -1)
        joints = np.empty((len(change), 0))
        if not self.without_joints:
            begun_ns = frames[0].host_time_ns + 1000.0 * (mean.first_us - frames[0].device_time_us)
            joints = self.track.at(begun_ns + mean.time_s * 1e9)
            known: NDArray[np.bool_] = np.asarray(~np.isnan(joints).any(axis=1), dtype=np.bool_)
            if known.sum() < 0.8 * len(known):
                raise BaselineError(
                    f"joint positions were there for {known.mean():.0%} of the recording: publish all joints at 20 Hz "
                    "or more, stamped with this computer's monotonic clock (docs/scene.md#a-hand-that-moves)"
                )
            change, joints = change[known], joints[known]
        step = max(len(change) // MOST_ROWS, 1)
        by_ambient = pad.sensors.axes.transpose(0, 2, 1).reshape(-1, 3)
        names = () if self.without_joints else self.track.names
        return fit_posture(names, joints[::step], change[::step], by_ambient)
