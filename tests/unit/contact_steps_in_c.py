"""Single steps from pose to contact, as C takes them: functions of the part that is compiled (contact/step.h)."""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

from fmfts.common.chi2 import quantile
from fmfts.common.record import Record
from fmfts.contact import TouchDetector, _contact
from fmfts.pipeline import _pad
from fmfts.pose.gates import JUMP_PROBABILITY
from oracle.compiled import memory_between, part_of, pointer

Array = NDArray[np.float64]
COMPILED = ctypes.CDLL(_pad.__file__)
COMPILED.fmfts_touch.restype = ctypes.c_bool
COMPILED.fmfts_force_sd_n.restype = ctypes.c_double


class Estimate(ctypes.Structure):
    """fmfts_estimate of contact/step.h."""

    _fields_ = (
        ("outputs", ctypes.c_int),
        ("place", ctypes.c_double * 5),
        ("deviation", ctypes.c_double * 5),
        ("by_pose", ctypes.c_double * 30),
        *(
            (name, ctypes.c_double)
            for name in (
                *("force_min_n", "central_force_sd_n", "pose_force_sd_n", "own_force_sd_n", "doubt", "explained"),
                "lowered_chi2",
            )
        ),
        *((name, ctypes.c_bool) for name in ("over_range", "refused", "is_beyond")),
    )

    @classmethod
    def of(cls, force_n: float, force_sd_n: float, pose_sd_n: float, refused: bool = False) -> Estimate:
        """pose_sd_n: the part of the deviation that the pose causes, and all of it in the middle of the pad."""
        made = cls(outputs=3, central_force_sd_n=pose_sd_n, pose_force_sd_n=pose_sd_n, explained=1.0, refused=refused)
        made.place[2], made.deviation[2], made.own_force_sd_n = force_n, force_sd_n, force_sd_n
        made.doubt = min((2.0 * force_sd_n / force_n) ** 2, 1.0) if force_n > 0.0 else 1.0
        return made


class Question(ctypes.Structure):
    """fmfts_question of contact/step.h: mm and components of the axis."""

    _fields_ = (
        ("pose", ctypes.c_double * 6),
        ("covariance", ctypes.c_double * 36),
        ("share", ctypes.c_double),
        ("lifted_m", ctypes.c_double),
    )


class TouchInC:
    """touch.c, as a TouchDetector, whose thresholds it gets."""

    def __init__(self, rate_hz: float = 220.0, false_contacts_per_hour: float = 1.0, hidden_n: float = 0.0) -> None:
        thresholds = TouchDetector(rate_hz, false_contacts_per_hour)
        self.onset_chi2, self.release_chi2 = thresholds.onset_chi2, thresholds.release_chi2
        self._parameters = Record(_contact.PARAMETERS)
        self._parameters.put("onset_chi2", self.onset_chi2)
        self._parameters.put("release_chi2", self.release_chi2)
        self._parameters.put("hidden_force_sd_n", hidden_n)
        self.memory = memory_between("touched", "acceleration")

    @property
    def touched(self) -> bool:
        return self.memory.number("touched") != 0.0

    def update(self, displacement: Array, covariance: Array) -> bool | None:
        taken = np.ascontiguousarray(displacement), np.ascontiguousarray(covariance)
        known = COMPILED.fmfts_touch(
            part_of(self._parameters), part_of(self.memory), len(displacement), *map(pointer, taken)
        )
        return self.touched if known else None

    def presses(self, estimate: Estimate) -> bool:
        """Whether the frame that `update` judged last is a contact."""
        COMPILED.fmfts_press(part_of(self._parameters), part_of(self.memory), ctypes.byref(estimate))
        return self.memory.number("in_contact") != 0.0

    def unseen(self) -> None:
        COMPILED.fmfts_unseen(part_of(self.memory))

    def forget(self) -> None:
        COMPILED.fmfts_forget_touch(part_of(self.memory))

    def force_sd_n(self, estimate: Estimate, detection_limit_n: float) -> float:
        """The deviation to publish."""
        names = [name for name, _, _ in _pad.PARAMETERS]
        parameters = Record(_pad.PARAMETERS[names.index("has_baseline") :])
        parameters.put("detection_limit_n", detection_limit_n)
        return float(COMPILED.fmfts_force_sd_n(part_of(parameters), ctypes.byref(estimate), part_of(self.memory)))


class SmootherInC:
    """smooth.c. memory_s: time in which a frame's weight falls to 1/e; zero: no smoothing."""

    UNIT = np.array([1e3, 1e3, 1e3, 1.0, 1.0, 1.0])  # m → mm

    def __init__(self, memory_s: float) -> None:
        self._parameters = Record(_contact.PARAMETERS)
        self._parameters.put("smoothing_s", memory_s)
        self._parameters.put("smoothing_jump_chi2", quantile(JUMP_PROBABILITY, 5))
        self.memory = memory_between("touched", "acceleration")

    def update(self, position_m: Array, axis: Array, covariance: Array, elapsed_s: float) -> tuple[Array, Array, Array]:
        """Position (3,), axis (3,) and covariance (6, 6) after smoothing."""
        question = Question()
        question.pose[:] = (np.concatenate([position_m, axis]) * self.UNIT).tolist()
        question.covariance[:] = (covariance * self.UNIT * self.UNIT[:, None]).ravel().tolist()
        taken = part_of(self._parameters), part_of(self.memory), ctypes.c_double(elapsed_s), ctypes.byref(question)
        COMPILED.fmfts_smooth(*taken)
        pose = np.array(question.pose) / self.UNIT
        return pose[:3], pose[3:], np.array(question.covariance).reshape(6, 6) / self.UNIT / self.UNIT[:, None]
