"""What a pad's frames need besides their memory: FMFTS_PARAMETERS (frame.h), filled before the first frame."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import length, product
from fmfts.baseline import Mounting
from fmfts.common.chi2 import quantile
from fmfts.common.record import Numbers, Record
from fmfts.contact import ContactModel, NoContactModel, TouchDetector
from fmfts.contact.drive import drive_power, to_pose, untouched_drive
from fmfts.contact.response import Response
from fmfts.contact.touch import DEGREES_OF_FREEDOM
from fmfts.pad import Pad
from fmfts.pipeline._pad import PARAMETERS
from fmfts.pipeline.baselined_pad import BaselinedPad
from fmfts.pipeline.hidden_force import hidden_force_n
from fmfts.pipeline.lead import Lead
from fmfts.pose.change import shortest_rotation
from fmfts.pose.gates import (
    FALSE_ALARM,
    FALSE_INNOVATION,
    FALSE_LINE,
    FALSE_MEAN_ALARM,
    JUMP_PROBABILITY,
    MOVED_MISFIT,
    SOUND,
)
from fmfts.pose.hidden_gradient import HEALTHY, HiddenGradient
from fmfts.pose.neighbour import NeighbourView
from fmfts.pose.problem import Part
from fmfts.pose.silicone import silicone_fields
from fmfts.pose.solver import FREE_FIELD
from fmfts.pose.state import SIZE, tangent_basis
from fmfts.sensor.chips import Chip

Array = NDArray[np.float64]
MODE_WEIGHTS = (1.0, 1.0)  # for a still and for a moving finger: `bench now --ablation` leaves one out
Values = dict[str, Numbers]


def parameters_of(
    drawing: Pad, baselined: BaselinedPad | None, model: ContactModel | NoContactModel, rate_hz: float, lead: Lead
) -> Record:
    """All parameters but those of neighbours. baselined: None while nothing can be subtracted.

    ValueError if something exceeds the sizes of frame.h.
    """
    parameters = Record(PARAMETERS)
    parameters.put("sensors", len(drawing.sensors))
    parameters.put("period_us", 1e6 / rate_hz)
    parameters.fill(chip_fields(drawing.chip))
    parameters.put("repeats_allowed", np.full(3 * len(drawing.sensors), np.inf))
    parameters.fill(_slip(model))
    if baselined is None:
        return parameters
    parameters.put("has_baseline", 1.0)
    parameters.fill(_sensors(baselined))
    parameters.fill(_tracking(baselined))
    parameters.fill(_residuals(baselined))
    parameters.fill(_message(baselined.mounting, drawing.magnet.remanence_t))
    if baselined.at_rest:
        touch, hidden = TouchDetector(rate_hz), baselined.hidden_gradient()
        parameters.fill(silicone_fields(drawing.silicone, touch.longest_gap_s))
        parameters.fill(hidden_gradient_fields(hidden))
        parameters.fill(_touch(baselined, touch))
        parameters.put("hidden_force_sd_n", hidden_force_n(baselined, hidden, model))
        if isinstance(model, ContactModel):
            parameters.fill(_contact(baselined, model))
            parameters.put("detection_limit_n", detection_limit_n(baselined, model, touch))
            if model.response is not None:
                parameters.fill(_now(baselined, response_of(model), lead))
    return parameters


def detection_limit_n(baselined: BaselinedPad, model: ContactModel | NoContactModel, touch: TouchDetector) -> float:
    """The largest force (N) anywhere on the pad that may go undetected; 0 if not known."""
    resting = baselined.resting_covariance() if isinstance(model, ContactModel) else None
    if resting is None or not isinstance(model, ContactModel):
        return 0.0
    return model.detection_limit_n(resting, touch.onset_chi2)


def response_of(model: ContactModel | NoContactModel) -> Response | None:
    """The pad's response, with the model's loads; None if it is not known."""
    if isinstance(model, NoContactModel) or model.response is None:
        return None
    return model.response if model.has_shear else model.response.without_shear()


def packed_response(model: ContactModel | NoContactModel) -> bytes | None:
    """The pad's response as C reads it, for refined answers, tolerances and `now`; None if it is not known."""
    return model.packed_response if isinstance(model, ContactModel) else None


def put_neighbours(parameters: Record, neighbours: Sequence[NeighbourView]) -> None:
    """ValueError if they have more magnets than the solver has room for."""
    placed = [each.placement for each in neighbours]
    magnets = [one for each in neighbours for one in each.sighting.magnets]
    parameters.put("neighbours", len(neighbours))
    parameters.put("neighbour_magnets", [len(each.sighting.magnets) for each in neighbours])
    parameters.put("neighbour_turn", np.array([each.rotation for each in placed]))
    parameters.put("neighbour_place_m", np.array([each.position_m for each in placed]))
    parameters.put("neighbour_placement_m", np.array([each.tolerance_m for each in placed]))
    parameters.put("neighbour_magnet", np.array([(each.strength_t_m3, each.modelled_octupole_m2) for each in magnets]))


def chip_fields(chip: Chip) -> Values:
    thermometer = chip.thermometer
    return {
        "saturated_count": chip.saturated_count,
        "largest_count": chip.largest_count,
        "step_t": chip.step_t,
        "at_zero_c": np.nan if thermometer is None else thermometer.at_zero_c,
        "c_per_count": np.nan if thermometer is None else thermometer.c_per_count,
        "range_c": (np.nan, np.nan) if thermometer is None else thermometer.range_c,
    }


def _sensors(baselined: BaselinedPad) -> Values:
    mounting, mounted = baselined.mounting, baselined.pad
    return {
        "repeats_allowed": baselined.repeats_allowed,
        "gain": mounting.gain,
        "offset_t": mounting.offset_t,
        "rest_field_t": mounting.rest_field_t,
        "sensitivity_deviation": mounting.sensitivity_deviation,
        "place_deviation": mounting.place_deviation,
        "systematic_t": mounting.systematic_t,
        "noise_t": mounting.noise_t,
        "place_m": mounted.sensors.position_m,
        "direction": mounted.sensors.axes.transpose(0, 2, 1),
        "strength_t_m3": mounted.magnet.strength_t_m3,
        "octupole_m2": mounted.magnet.modelled_octupole_m2,
    }


def _tracking(baselined: BaselinedPad) -> Values:
    model, rest_c, values = baselined.tracking, baselined.temperature_c, baselined.mounting.gain.size
    free = int((model.parts == Part.FREE).sum())
    return {
        "part": model.parts[:SIZE],
        "walk_per_s": model.walk_per_s[:SIZE],
        "offset_t_per_k": model.offset_t_per_k,
        "moment_per_k": model.moment_per_k,
        "moment_per_k_deviation": model.moment_per_k_deviation,
        "unread_warming_k": model.unread_warming_k,
        "steel_nearby": model.steel_nearby,
        "at_rest": baselined.at_rest,
        "rest_temperature_c": np.nan if rest_c is None else rest_c,
        "rest": baselined.mounting.rest.vector(),
        # The moment of earlier frames counts as one more value.
        "gate_chi2": _quantiles(FALSE_ALARM, values - free + 1),
        "surprising_chi2": _quantiles(SOUND, values - free + 1),
        "line_chi2": quantile(FALSE_LINE, 6),
        "motion_chi2": _quantiles(MOVED_MISFIT, values - len(FREE_FIELD)),
    }


def _residuals(baselined: BaselinedPad) -> Values:
    tracking, values = baselined.tracking, baselined.mounting.gain.size
    estimated = int(np.isin(tracking.parts, (Part.FREE, Part.PRIOR)).sum())
    return {
        "alarm_chi2": _quantiles(FALSE_MEAN_ALARM, values - estimated),
        "sound_chi2": _quantiles(SOUND, values - estimated),
    }


def packed_errors(baselined: BaselinedPad | None) -> memoryview | None:
    """The errors of the field that the baseline leaves, as C takes them; None where it leaves none."""
    errors = baselined.mounting.field_errors() if baselined is not None and baselined.at_rest else None
    return None if errors is None else np.ascontiguousarray(errors.table).reshape(-1).data


def _quantiles(probability: float, most: int) -> Array:
    """The quantiles (most + 1,) by degrees of freedom: a missing sensor takes some away."""
    return np.array([np.nan] + [quantile(probability, freedom) for freedom in range(1, most + 1)])


def hidden_gradient_fields(hidden: HiddenGradient) -> Values:
    """What hidden_gradient.c needs."""
    return {
        "reference_t": hidden.reference.field_t,
        "reference_strength_t": length(hidden.reference.field_t),
        "iron_t": hidden.reference.iron_t,
        "even_t": hidden.even_t,
        "healthy_deviations": HEALTHY,
        "strongest_foreign_t": hidden.strongest_t,
        "ambient_errors": hidden.ambient_error.shape[-1],
        "ambient_error": hidden.ambient_error,
        "unit_gradient": hidden.unit,
    }


def _touch(baselined: BaselinedPad, touch: TouchDetector) -> Values:
    return {
        "leftovers": baselined.change_error.shape[-1],
        "change_error": baselined.change_error,
        "onset_chi2": touch.onset_chi2,
        "release_chi2": touch.release_chi2,
        "longest_gap_s": touch.longest_gap_s,
        "smoothing_jump_chi2": quantile(JUMP_PROBABILITY, DEGREES_OF_FREEDOM),
        "drawn_rest_m": baselined.drawing.rest_position_m,
        "drawn_turn": shortest_rotation(baselined.mounting.rest.axis, baselined.drawing.rest_axis),
        "pad_turn": baselined.mounting.pad_turn,
    }


def _contact(baselined: BaselinedPad, model: ContactModel) -> Values:
    return model.for_c | {"has_model": 1.0, "magnet_off_m": baselined.magnet_off_m}


def _slip(model: ContactModel | NoContactModel) -> Values:
    """tells_slip: 0 if slip is not configured."""
    friction = model.slip_friction if isinstance(model, ContactModel) else None
    return {"tells_slip": friction is not None, "slip_friction": friction or (0.0, 0.0)}


def _message(mounting: Mounting, remanence_t: float) -> Values:
    """remanence_t: that of the magnet as drawn, in tesla."""
    nothing = np.full(3, np.nan)
    ambient_t, deviation_t = mounting.ambient_t, mounting.ambient_deviation_t
    measured = ambient_t is not None and deviation_t is not None
    return {
        "rest_variance": np.diagonal(mounting.rest_covariance),
        "remanence_t": remanence_t,
        "ambient_t": ambient_t if measured and ambient_t is not None else nothing,
        "ambient_variance": square(deviation_t) if measured and deviation_t is not None else nothing,
    }


def _now(baselined: BaselinedPad, response: Response | None, lead: Lead) -> Values:
    if response is None:
        return {}
    rest_axis, values = baselined.mounting.rest.axis, baselined.mounting.noise_t.size
    turn = shortest_rotation(rest_axis, baselined.drawing.rest_axis)
    to_the_pose = to_pose(product(turn, tangent_basis(rest_axis))[:2])
    return {
        "tells_now": 1.0,
        "lead_us": 1e6 * lead.frame_s,
        "early_lead_us": 1e6 * lead.early_s,
        "surprise_chi2": quantile(FALSE_INNOVATION, values),
        "early_chi2": quantile(FALSE_INNOVATION, 3),
        "to_pose": to_the_pose,
        "untouched_drive": untouched_drive(response, to_the_pose),
        "drive_power": drive_power(loads=3),  # force, and shear with a shear model
        "weights": MODE_WEIGHTS,
    }
