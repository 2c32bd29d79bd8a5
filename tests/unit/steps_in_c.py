"""Single steps of a frame, as C takes them: functions of the part that is compiled, which step.h declares."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.baseline import Mounting
from fmfts.common.chi2 import quantile
from fmfts.common.record import Record
from fmfts.contact import TouchDetector, _contact
from fmfts.pad import Pad, Silicone
from fmfts.pipeline import _pad
from fmfts.pipeline.parameters import put_neighbours
from fmfts.pose import SIZE, State, tangent_basis
from fmfts.pose.gates import JUMP_PROBABILITY
from fmfts.pose.model import predict
from fmfts.pose.neighbour import NeighbourView
from fmfts.pose.problem import Parts, magnet_rows, measurement_rows
from fmfts.pose.silicone import TIMES_S, SiliconeFollower
from oracle.compiled import library_of, memory_between, part_of, pointer

Array = NDArray[np.float64]
COMPILED = ctypes.CDLL(_pad.__file__)
COMPILED.fmfts_touch.restype = ctypes.c_bool
COMPILED.fmfts_force_sd_n.restype = COMPILED.fmfts_lasting_variance.restype = ctypes.c_double


class Estimate(ctypes.Structure):
    """fmfts_estimate of contact/step.h."""

    _fields_ = (
        ("outputs", ctypes.c_int),
        ("place", ctypes.c_double * 5),
        ("deviation", ctypes.c_double * 5),
        ("by_pose", ctypes.c_double * 30),
        *((name, ctypes.c_double) for name in ("force_min_n", "central_force_sd_n", "pose_force_sd_n", "doubt")),
        *((name, ctypes.c_bool) for name in ("over_range", "refused")),
    )

    @classmethod
    def of(cls, force_n: float, force_sd_n: float, pose_sd_n: float, refused: bool = False) -> Estimate:
        """pose_sd_n: the part of the deviation that the pose causes, and all of it in the middle of the pad."""
        made = cls(outputs=3, central_force_sd_n=pose_sd_n, pose_force_sd_n=pose_sd_n, refused=refused)
        made.place[2], made.deviation[2] = force_n, force_sd_n
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
        known = COMPILED.fmfts_touch(part_of(self._parameters), part_of(self.memory), *map(pointer, taken))
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


class SiliconeInC:
    """silicone.c, as a SiliconeFollower, whose shares it gets."""

    def __init__(self, silicone: Silicone, longest_gap_s: float) -> None:
        of_python = SiliconeFollower(silicone, longest_gap_s)
        self._rest = State(np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.0, np.zeros(3))
        self._parameters, self._memory = Record(_pad.PARAMETERS), Record(_pad.MEMORY)
        self._parameters.fill(
            {
                "rest": self._rest.vector(),
                "silicone_share": of_python.share,
                "creep_share": of_python.creep_share,
                "unseen_gap_s": longest_gap_s,
                "creep_time_s": TIMES_S,
            }
        )
        self._elapsed_s = 0.0

    @property
    def crept(self) -> Array:
        """(4, 5) the change of pose, filtered with TIMES_S."""
        return self._memory["crept"].reshape(len(TIMES_S), 5)

    def passed(self, elapsed_s: float) -> None:
        self._elapsed_s = elapsed_s

    def update(self, change: Array) -> Array:
        tilt = tangent_basis(self._rest.axis) @ change[3:]
        axis = tilt + np.sqrt(1.0 - tilt @ tilt) * self._rest.axis
        self._memory.put("state", replace(self._rest, position_m=change[:3], axis=axis).vector())
        given = part_of(self._parameters), part_of(self._memory)
        COMPILED.fmfts_follow_creep(*given, ctypes.c_double(self._elapsed_s))
        covariance = np.zeros((5, 5))
        COMPILED.fmfts_creep(*given, pointer(np.ascontiguousarray(change)), pointer(covariance))
        return covariance


def lasting_deviation_t(mounting: Mounting, pad: Pad, field_t: Array, ambient_t: Array) -> Array:
    """(N, 3) deviation of the magnet's field (N, 3) that the baseline leaves, without noise. ambient_t (3,): the change
    of the ambient field since then, in the pad's axes."""
    parameters, memory = Record(_pad.PARAMETERS), Record(_pad.MEMORY)
    parameters.fill(
        {
            "direction": pad.sensors.axes.transpose(0, 2, 1),
            "sensitivity_deviation": mounting.sensitivity_deviation,
            "place_deviation": mounting.place_deviation,
            "systematic_t": mounting.systematic_t,
        }
    )
    memory.put("state", np.concatenate([np.zeros(7), ambient_t]))
    change = field_t - mounting.rest_field_t
    variance = [
        COMPILED.fmfts_lasting_variance(part_of(parameters), part_of(memory), axis, pointer(change[axis // 3]))
        for axis in range(change.size)
    ]
    return np.sqrt(variance).reshape(change.shape)


class SingleSteps:
    """Steps that need the whole of a frame: single_steps.c."""

    SOURCES = (str(Path(__file__).with_name("single_steps.c")), "pose/overlap.c", "pose/neighbour.c")

    def __init__(self, folder: Path) -> None:
        self._library = library_of(folder, *self.SOURCES)

    def overlap(
        self, pad: Pad, state: State, covariance: Array, parts: Parts, deviation_t: Array, lasting_t: Array
    ) -> Array:
        """(5, 5) the part of a pose's covariance that `lasting_t` (N, 3) has brought into it.

        pad: as mounted. state, covariance (SIZE, SIZE): the solution of a frame. deviation_t (N, 3): of the
        measurements, lasting part included.
        """
        rows = measurement_rows(np.zeros(deviation_t.shape), pad.sensors, 1.0)
        _, slopes = predict(rows, magnet_rows(pad.magnet), state)
        parameters, memory = Record(_pad.PARAMETERS), Record(_pad.MEMORY)
        parameters.fill({"sensors": len(pad.sensors), "part": parts[:SIZE]})
        memory.put("covariance", covariance[:SIZE, :SIZE])
        given = [np.ascontiguousarray(each) for each in (lasting_t**2, deviation_t**2, slopes[:, :SIZE])]
        found = np.zeros((5, 5))
        self._library.count_overlap(part_of(parameters), part_of(memory), *map(pointer, given), pointer(found))
        return found

    def felt(self, pad: Pad, views: Sequence[NeighbourView], time_ns: int) -> Felt:
        """What C makes of neighbours at that time on the host's clock."""
        parameters, count = Record(_pad.PARAMETERS), sum(len(each.sighting.magnets) for each in views)
        put_neighbours(parameters, views)
        sensors = {"place_m": pad.sensors.position_m, "direction": pad.sensors.axes.transpose(0, 2, 1)}
        parameters.fill({"sensors": len(pad.sensors), **sensors})
        shapes = (len(pad.sensors), 3), (len(pad.sensors), 3), (count, 7), (count, 7), (6 * count, 6 * count)
        felt = Felt(*map(np.zeros, shapes))
        tables = (ctypes.c_void_p * len(views))(*(part_of(each.sighting.table).value for each in views))
        self._library.feel(part_of(parameters), tables, ctypes.c_double(time_ns), *map(pointer, felt))
        return felt


class Felt(NamedTuple):
    """added_t, added_t2 (N, 3): to the field and its variance. rest, now (M, 7): values of all magnets. covariance
    (6M, 6M): of a step of all."""

    added_t: Array
    added_t2: Array
    rest: Array
    now: Array
    covariance: Array
