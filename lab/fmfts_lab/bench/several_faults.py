"""The defects of a pad with four magnets in the drills: those of a pad with one, and those that only several magnets
have.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from math import inf

import msgspec
import numpy as np

from fmfts.config import PadConfig, SimulatedSource
from fmfts.pad import Array
from fmfts.pose.magnets import Magnets
from fmfts.sensor import Frame
from fmfts_lab.bench.drills import TURNING_DEG_PER_S, DrillSource, record, spoiled
from fmfts_lab.bench.fault_kinds import Fault, FieldFault, field_faults, sensor_faults, weaker
from fmfts_lab.bench.tool_ways import Tool, Way
from fmfts_lab.finite_elements.array_pad import array_config
from fmfts_simulation.array import SimulatedArray
from fmfts_simulation.finger import Finger, Touch, no_finger, steady_finger

RATE_HZ = 220
WARM_S, FAULT_S, AFTER_S = 0.3, 1.0, 0.4
GAIN_CODE = 7  # ±8.1 G
# x and y of a sensor at a side, z of one at a corner. By symmetry x reads zero at rest, whatever its gain.
AXES_AT = ((0, 0), (0, 1), (5, 2))
WIRES = ((0, 4), (4, 7))  # side by side, and across the pad
TOOLS_A_M2 = (0.005, 0.05, 0.2)


@dataclass(frozen=True, slots=True)
class Drill:
    """kind: its row. fault: from WARM_S on, for FAULT_S; None: the whole drill is judged. tool_a_m2: of a magnet that
    passes at 60 mm, 0: none."""

    kind: str
    fault: Fault | None = None
    tool_a_m2: float = 0.0
    turning_deg_per_s: float = TURNING_DEG_PER_S
    warming_k_per_minute: float = 0.0
    seconds: float = WARM_S + FAULT_S + AFTER_S

    @property
    def begin(self) -> int:
        """The first frame that is judged."""
        return round(WARM_S * RATE_HZ)

    @property
    def end(self) -> int:
        """The first frame that is well again."""
        return round((self.seconds if self.fault is None else WARM_S + FAULT_S) * RATE_HZ)


class ArrayDrillSource(DrillSource, SimulatedArray):
    """A simulated pad with several magnets and a foreign field from `begin_s` to `end_s`."""

    def __init__(
        self, config: PadConfig, field: FieldFault | None = None, begin_s: float = 0.0, end_s: float = inf
    ) -> None:
        super().__init__(config, field, begin_s, end_s)
        self._moved: tuple[list[Touch], list[Magnets]] = [], []

    def _field_of_magnets(self, places_m: Array, moment_s: float) -> Array:
        touches = [finger(moment_s) for finger in self.fingers]
        if touches != self._moved[0]:
            self._moved = touches, self.inside.moved([touches])
        return np.array(self.inside.fields_of(self._moved[1], places_m, 1.0))


class BesideTool(SimulatedArray):
    """A simulated pad beside a magnetic tool."""

    tool: Tool | None = None

    def _ambient(self, sampled_s: Array) -> Array:
        own = super()._ambient(sampled_s)
        if self.tool is None:
            return own
        both: Array = own + self.tool.field_t(self._built.pad.sensors.position_m, sampled_s[None])[0]
        return both


def drills() -> Iterator[Drill]:
    yield Drill("healthy, turning at 60°/s", seconds=6.0)
    yield Drill("healthy, turning at 90°/s", turning_deg_per_s=90.0)
    yield Drill("warming by 10 K a minute", warming_k_per_minute=10.0, turning_deg_per_s=20.0, seconds=10.0)
    sensors = (fault for sensor, axis in AXES_AT for fault in sensor_faults((sensor,), (axis,), GAIN_CODE))
    for fault in (*sensors, *field_faults(WIRES), *_of_one_magnet()):
        # Its field drifts, so that a turn is no fault, and a moving neighbour is harder to distinguish.
        if not (fault.kind.startswith("turning") or fault.kind.endswith("fixed")):
            yield Drill("wires of two sensors swapped" if fault.swapped else fault.kind, fault)
    for moment in TOOLS_A_M2:
        yield Drill(f"tool of {moment:g} A·m² passes at 60 mm", tool_a_m2=moment, seconds=4.0)


def _of_one_magnet() -> Iterator[Fault]:
    for share, what in ((1.0, "lost"), (0.5, "at half"), (0.1, "10 % weaker"), (0.02, "2 % weaker")):
        yield Fault(f"one of four magnets {what}", field=weaker(share, magnets=slice(1)))


# The fingers hold still, so that a pad's field is computed once for all drills; the robot turns all the time.
_HOLDING, _OTHER = steady_finger(-6e-3, -1e-3, 0.8), steady_finger(7e-3, 3e-3, 0.6)
FINGERS: dict[str, tuple[Finger, ...]] = {"none": (), "one": (_HOLDING,), "two": (_HOLDING, _OTHER)}


def drill_config(drill: Drill, seed: int) -> PadConfig:
    config = array_config(seed=seed)
    assert isinstance(config.source, SimulatedSource)
    source = msgspec.structs.replace(
        config.source,
        turning_deg_per_s=drill.turning_deg_per_s,
        warming_k_per_minute=drill.warming_k_per_minute,
        finger="none",
    )
    return msgspec.structs.replace(config, source=source)


def frames_of(drill: Drill, fingers: str, seed: int) -> list[Frame]:
    config, fault = drill_config(drill, seed), drill.fault
    if drill.tool_a_m2:
        source = BesideTool(config)
        source.tool = Tool(Way("passes", 0.06, 0.3), drill.tool_a_m2, np.random.default_rng((seed, 7)))
        return _recorded(source, fingers, drill.seconds)
    if fault is not None and fault.field is not None:
        return _recorded(ArrayDrillSource(config, fault.field, WARM_S, WARM_S + FAULT_S), fingers, drill.seconds)
    healthy = _healthy(config, fingers, drill.seconds)
    return healthy if fault is None else spoiled(healthy, fault, drill.begin, drill.end)


@cache
def _healthy(config: PadConfig, fingers: str, seconds: float) -> list[Frame]:
    return _recorded(SimulatedArray(config), fingers, seconds)


def _recorded(source: SimulatedArray, fingers: str, seconds: float) -> list[Frame]:
    first, second = (*FINGERS[fingers], None, None)[:2]
    source.second_finger = second
    return record(source, first or no_finger, seconds)
