"""Single steps from field to pose, as C takes them: functions of the compiled part, which pose/step.h declares."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fmfts.baseline import Mounting
from fmfts.common.record import Record
from fmfts.pad import Array, Pad, Silicone
from fmfts.pipeline import _pad
from fmfts.pipeline.parameters import put_neighbours
from fmfts.pose import SIZE, PoseEstimate, State, tangent_basis
from fmfts.pose.change import UPRIGHT, shortest_rotation
from fmfts.pose.kernel import predict
from fmfts.pose.neighbour import NeighbourView
from fmfts.pose.problem import Parts, magnet_rows, measurement_rows
from fmfts.pose.silicone import TIMES_S, silicone_fields
from oracle.compiled import library_of, part_of, pointer

COMPILED = ctypes.CDLL(_pad.__file__)
COMPILED.fmfts_lasting_variance.restype = ctypes.c_double


class SiliconeInC:
    """silicone.c."""

    def __init__(self, silicone: Silicone, longest_gap_s: float) -> None:
        self._rest = State(np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.0, np.zeros(3))
        self._parameters, self._memory = Record(_pad.PARAMETERS), Record(_pad.MEMORY)
        self._parameters.fill({"rest": self._rest.vector(), **silicone_fields(silicone, longest_gap_s)})
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


class Displaced:
    """change.c: the change of a pose since rest. pad: as drawn. leftover (8, 5, M): `Mounting.change_error`."""

    def __init__(
        self, rest: State, pad: Pad, leftover: Array, estimate: PoseEstimate, pad_turn: Array = UPRIGHT
    ) -> None:
        self._parameters, self._state = Record(_pad.PARAMETERS), estimate.state.vector()
        self._parameters.fill(
            {
                "rest": rest.vector(),
                "leftovers": leftover.shape[-1],
                "change_error": leftover,
                "drawn_rest_m": pad.rest_position_m,
                "drawn_turn": shortest_rotation(rest.axis, pad.rest_axis),
                "pad_turn": pad_turn,
            }
        )
        pose = np.concatenate([estimate.covariance.ravel(), np.zeros(2)])
        self._numbers = np.zeros(65)  # fmfts_displacement
        no_loads, given = Record(_pad.MEMORY), map(pointer, (self._state, pose))
        COMPILED.fmfts_displace(
            part_of(self._parameters), part_of(no_loads), *given, ctypes.c_void_p(), pointer(self._numbers)
        )

    @property
    def change(self) -> Array:
        """(5,) since rest."""
        return self._numbers[:5]

    @property
    def at_rest(self) -> Array:
        """(5, 5) its covariance."""
        return self._numbers[30:55].reshape(5, 5)

    def distance(self) -> tuple[float, float]:
        moved_m, deviation_m = ctypes.c_double(), ctypes.c_double()
        COMPILED.fmfts_distance(pointer(self._numbers), ctypes.byref(moved_m), ctypes.byref(deviation_m))
        return moved_m.value, deviation_m.value

    def drawn(self) -> tuple[Array, Array]:
        """Pose (6,) and covariance (6, 6) in the drawing's frame."""
        pose, covariance = np.zeros(6), np.zeros((6, 6))
        given = part_of(self._parameters), pointer(self._state), pointer(self._numbers), ctypes.c_double(1.0)
        COMPILED.fmfts_draw(*given, pointer(pose), pointer(covariance))
        return pose, covariance


class SingleSteps:
    """Steps that need the whole of a frame: single_steps.c."""

    SOURCES = (
        str(Path(__file__).with_name("single_steps.c")),
        "pose/overlap.c",
        "pose/neighbour.c",
        "pose/beside.c",
        "arithmetic/matrix.c",
    )

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
        """The neighbours by C at that time on the host's clock."""
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


class _Line(ctypes.Structure):
    _fields_ = (("hz", ctypes.c_double), ("amplitude_t", ctypes.c_double))


def strongest_line(parameters: Record, ambient_t: Array) -> tuple[float, float]:
    """spectrum.c: frequency (Hz) and amplitude (T) of the line in the ambient fields (64, 3) of as many frames."""
    COMPILED.fmfts_strongest_line.restype = _Line
    line = COMPILED.fmfts_strongest_line(part_of(parameters), pointer(np.ascontiguousarray(ambient_t)))
    return line.hz, line.amplitude_t
