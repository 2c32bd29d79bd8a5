"""The dimensions of `study stability`: why methods fail in each, and which setting avoids that."""

from __future__ import annotations

from fmfts_lab.study import foreign, hazards
from fmfts_lab.study.hazards import Hazard

HAZARDS = (
    Hazard(
        "start error", hazards.start_error,
        "From 135° on least squares on the sphere is lost; SciPy's free moment vector is not; a filter is at once.",
        "Start at rest and again where χ² is too large, as the tracker does; wider: fmfts.pose.acquire.",
    ),
    Hazard(
        "finger speed", hazards.speed,
        "A filter without iteration linearises about where the magnet was; a warm start that iterates does not mind.",
        "source.rate_hz = 220; iterate.",
    ),
    Hazard(
        "missing sensor", hazards.missing,
        "With eight unknowns three sensors leave one equation over, and two too few; networks need all twelve values.",
        "None: two sensors are refused (`lost`), one is left out (`degraded`).",
    ),
    Hazard(
        "saturation", hazards.saturation,
        "A saturated axis that is not marked reads as a field; the chip marks it, so it is left out like a lost one.",
        "A larger source.range_gauss.",
    ),
    Hazard(
        "noise", hazards.noise,
        "Noise moves a pose in proportion; where it bends the field's curve, linear deviations are too small.",
        "The baseline measures the noise, and deviations grow with it.",
    ),
    Hazard(
        "ambient step", hazards.ambient_offset,
        "With five or six unknowns an ambient field that was not subtracted becomes a shift of the pose, 2 µm a mG.",
        'scene.ambient = "drifting".',
    ),
    Hazard(
        "turning", hazards.turning,
        "The same, growing: a robot turns the Earth's 500 mG through the pad.",
        'scene.ambient = "drifting".',
    ),
    Hazard(
        "remanence", hazards.remanence,
        "A moment that is held at the wrong value becomes height: 1 % is 70 µm. A table of fields knows one moment.",
        "The baseline measures the moment; magnet.remanence_t and tolerance.remanence must include it.",
    ),
    Hazard(
        "distance", hazards.distance,
        "Farther away the signal drowns (1/r³, its slope 1/r⁴); nearer, chips saturate and a dipole is no cylinder.",
        "Set magnet.rest_mm; the daemon adds the cylinder's term where it matters. A model of that pad is needed.",
    ),
    Hazard(
        "gain errors", hazards.gains,
        "A gain that is off by a per cent moves the pose by some ten µm, and white-noise deviations do not know it.",
        "`selftest` (±0.5 %), `baseline --turn`; tolerance.gain as large as the error is.",
    ),
    Hazard(
        "steel tool", foreign.steel,
        "Steel bends field unevenly: what all sensors share is taken for ambient, the rest for a pose.",
        "scene.steel_nearby = true; a flag is the right answer.",
    ),
    Hazard(
        "motor", foreign.motor,
        "A rotor's field turns faster than frames come, and is uneven over the pad when it is near.",
        "Keep 0.1 A·m² 250 mm away; a flag is the right answer.",
    ),
    Hazard(
        "neighbour", foreign.neighbour,
        "Another pad's magnet moves with its own finger, and its field is uneven over this pad.",
        "scene.neighbours, with [pad.placement] of both.",
    ),
    Hazard(
        "warming", hazards.warming,
        "A magnet loses 0.12 % of its moment with each kelvin: height, for those who look at no thermometer.",
        "magnet.temperature_coefficient_per_k.",
    ),
    Hazard(
        "symmetric pose", hazards.symmetric,
        "Upright and centred, height, moment and vertical field are one: nine unknowns have no answer there.",
        "No larger model than the scene needs.",
    ),
    Hazard(
        "timing", hazards.timing,
        "Gaps let the magnet move farther between samples, as a faster finger does.",
        "Samples carry their own times; nothing to set.",
    ),
    Hazard(
        "place", hazards.edge,
        "At edge and corner a press moves the magnet least: places are vague there, and must say so.",
        "None: the deviations grow; trust what lies within 11 mm.",
    ),
)  # fmt: skip
