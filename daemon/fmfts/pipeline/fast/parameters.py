"""Fills the table of parameters that the fast path reads (PARAMETERS in tables.h), before the first frame."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import length
from fmfts.baseline import Mounting
from fmfts.common.chi2 import quantile
from fmfts.common.double_table import DoubleTable
from fmfts.contact import ContactModel, TouchDetector
from fmfts.contact.bend import BEND_DEVIATIONS, STRAIGHT_SHARE
from fmfts.contact.estimate import CERTAIN_FORCE_DEVIATIONS
from fmfts.contact.model import (
    CERTAIN_DEVIATIONS,
    HYSTERESIS_MM,
    LIFTED_DEVIATIONS,
    OUTSIDE_DEVIATIONS,
    TINY,
)
from fmfts.contact.refinement import STEPS
from fmfts.contact.smoothing import COMPONENTS, JUMP_PROBABILITY
from fmfts.contact.touch import KEPT_FORCE_DEVIATIONS, RELEASE_FRAMES
from fmfts.pad import Pad
from fmfts.pose import alignment, gate, hidden_gradient, mean_residuals, neighbour, tracker
from fmfts.pose.change import shortest_rotation
from fmfts.pose.hidden_gradient import HiddenGradient
from fmfts.pose.neighbour import NeighbourView
from fmfts.pose.problem import MAX_ITERATIONS, Part
from fmfts.pose.silicone import TIMES_S, SiliconeFollower
from fmfts.pose.state import SIZE
from fmfts.pose.tracking_model import TrackingModel
from fmfts.sensor.chips import Chip

Array = NDArray[np.float64]


def put_sensors(
    parameters: DoubleTable, mounting: Mounting, mounted: Pad, repeats_allowed: Array, stopped_us: float
) -> None:
    """mounted: the pad as the baseline found it. repeats_allowed (N, 3). stopped_us: see `Alignment.stopped_us`."""
    parameters.put("sensors", len(mounted.sensors))
    _put_chip(parameters, mounted.chip)
    parameters.put("stopped_us", stopped_us)
    parameters.put("longest_gap_us", alignment.longest_gap_us(stopped_us))
    parameters.put("jump_t", alignment.JUMP_T)
    parameters.put("repeats_allowed", repeats_allowed)
    parameters.put("gain", mounting.gain)
    parameters.put("offset_t", mounting.offset_t)
    parameters.put("rest_field_t", mounting.rest_field_t)
    parameters.put("sensitivity_deviation", mounting.sensitivity_deviation)
    parameters.put("place_deviation", mounting.place_deviation)
    parameters.put("systematic_t", mounting.systematic_t)
    parameters.put("noise_t", mounting.noise_t)
    parameters.put("place_m", mounted.sensors.position_m)
    parameters.put("direction", mounted.sensors.axes.transpose(0, 2, 1))
    parameters.put("strength_t_m3", mounted.magnet.strength_t_m3)
    parameters.put("octupole_m2", mounted.magnet.modelled_octupole_m2)


def _put_chip(parameters: DoubleTable, chip: Chip) -> None:
    thermometer = chip.thermometer
    parameters.put("saturated_count", chip.saturated_count)
    parameters.put("largest_count", chip.largest_count)
    parameters.put("step_t", chip.step_t)
    parameters.put("at_zero_c", np.nan if thermometer is None else thermometer.at_zero_c)
    parameters.put("c_per_count", np.nan if thermometer is None else thermometer.c_per_count)
    parameters.put("range_c", np.array((np.nan, np.nan) if thermometer is None else thermometer.range_c))


def put_tracking(
    parameters: DoubleTable, mounting: Mounting, model: TrackingModel, rest_temperature_c: float | None
) -> None:
    free = int((model.parts == Part.FREE).sum())
    estimated = int(np.isin(model.parts, (Part.FREE, Part.PRIOR)).sum())
    values = mounting.gain.size
    parameters.put("part", model.parts[:SIZE])
    parameters.put("walk_per_s", model.walk_per_s[:SIZE])
    parameters.put("offset_t_per_k", model.offset_t_per_k)
    parameters.put("moment_per_k", model.moment_per_k)
    parameters.put("moment_per_k_deviation", model.moment_per_k_deviation)
    parameters.put("rest_temperature_c", np.nan if rest_temperature_c is None else rest_temperature_c)
    parameters.put("rest", mounting.rest.vector())
    parameters.put("stop_chi2", tracker.STOP_TRACKING)
    parameters.put("max_iterations", MAX_ITERATIONS)
    parameters.put("reach_m", gate.REACH_M)
    parameters.put("log_moment_reach", gate.LOG_MOMENT_REACH)
    parameters.put("strongest", gate.STRONGER)
    parameters.put("vague_m", gate.VAGUE_M)
    parameters.put("gate_chi2", _quantiles(gate.FALSE_ALARM, values - free))
    parameters.put("unknowns", free)
    parameters.put("misfit_frames", tracker.MISFIT_FRAMES)
    parameters.put("memory_frames", mean_residuals.MEMORY_FRAMES)
    parameters.put("judged_every", mean_residuals.JUDGED_EVERY)
    parameters.put("alarm_chi2", _quantiles(mean_residuals.FALSE_ALARM, values - estimated))
    parameters.put("sound_chi2", _quantiles(mean_residuals.SOUND, values - estimated))
    errors = mounting.field_errors()
    if errors is not None:
        parameters.put("field_errors", errors.by_field.shape[-1])
        parameters.put("by_pose", errors.by_pose)
        parameters.put("by_field", errors.by_field)


def _quantiles(probability: float, most: int) -> Array:
    """(most + 1,) by degrees of freedom: a sensor that is missing takes some."""
    return np.array([np.nan] + [quantile(probability, freedom) for freedom in range(1, most + 1)])


def put_silicone(parameters: DoubleTable, silicone: SiliconeFollower) -> None:
    parameters.put("silicone_share", silicone.share)
    parameters.put("creep_share", silicone.creep_share)
    parameters.put("unseen_gap_s", silicone.longest_gap_s)
    parameters.put("creep_time_s", TIMES_S)


def put_hidden_gradient(parameters: DoubleTable, hidden: HiddenGradient) -> None:
    parameters.put("reference_t", hidden.reference.field_t)
    parameters.put("reference_strength_t", length(hidden.reference.field_t))
    parameters.put("iron_t", hidden.reference.iron_t)
    parameters.put("even_t", hidden_gradient.EVEN_T)
    parameters.put("healthy_deviations", hidden_gradient.HEALTHY)
    parameters.put("fades_s", hidden_gradient.FADES_S)
    parameters.put("strongest_foreign_t", hidden.strongest_t)
    parameters.put("ambient_errors", hidden.ambient_error.shape[-1])
    parameters.put("ambient_error", hidden.ambient_error)
    parameters.put("unit_gradient", hidden.unit)


def put_neighbours(parameters: DoubleTable, neighbours: Sequence[NeighbourView]) -> None:
    """Neighbours with one magnet each."""
    placed, magnets = [each.placement for each in neighbours], [each.sighting.magnets[0] for each in neighbours]
    parameters.put("neighbours", len(neighbours))
    parameters.put("neighbour_turn", np.array([each.rotation for each in placed]))
    parameters.put("neighbour_place_m", np.array([each.position_m for each in placed]))
    parameters.put("neighbour_placement_m", np.array([each.tolerance_m for each in placed]))
    parameters.put("neighbour_magnet", np.array([(each.strength_t_m3, each.modelled_octupole_m2) for each in magnets]))
    parameters.put("speed_m_per_s", neighbour.SPEED_M_PER_S)
    parameters.put("turn_rad_per_s", neighbour.TURN_RAD_PER_S)
    parameters.put("farthest_m", neighbour.REACH_M)
    parameters.put("farthest_rad", neighbour.REACH_RAD)
    parameters.put("moment_deviation", neighbour.MOMENT_DEVIATION)


def put_touch(
    parameters: DoubleTable, mounting: Mounting, drawing: Pad, change_error: Array, touch: TouchDetector
) -> None:
    """change_error (8, 5, M): see Leftover.change_error."""
    parameters.put("leftovers", change_error.shape[-1])
    parameters.put("change_error", change_error)
    parameters.put("onset_chi2", touch.onset_chi2)
    parameters.put("release_chi2", touch.release_chi2)
    parameters.put("release_frames", RELEASE_FRAMES)
    parameters.put("longest_gap_s", touch.longest_gap_s)
    parameters.put("hidden_force_sd_n", touch.hidden_force_sd_n)
    parameters.put("drawn_rest_m", drawing.rest_position_m)
    parameters.put("drawn_turn", shortest_rotation(mounting.rest.axis, drawing.rest_axis))


def put_contact(
    parameters: DoubleTable, mounting: Mounting, drawing: Pad, model: ContactModel, detection_limit_n: float
) -> None:
    """detection_limit_n: see ContactModel.detection_limit_n."""
    parameters.put("has_model", 1.0)
    parameters.put("refine_steps", STEPS if model.refines else 0)
    parameters.put("least_variance", TINY[0, 0])
    parameters.put("model_rest", model.rest_pose)
    parameters.put("lowest", model.lowest)
    parameters.put("highest", model.highest)
    parameters.put("outside_deviations", OUTSIDE_DEVIATIONS)
    parameters.put("certain_deviations", CERTAIN_DEVIATIONS)
    parameters.put("kept_force_deviations", KEPT_FORCE_DEVIATIONS)
    parameters.put("certain_force_deviations", CERTAIN_FORCE_DEVIATIONS)
    parameters.put("straight_share", STRAIGHT_SHARE)
    parameters.put("bend_deviations", BEND_DEVIATIONS)
    parameters.put("trained_top_mm", model.trained_top_mm)
    parameters.put("lifted_above_mm", model.trained_top_mm + HYSTERESIS_MM)
    parameters.put("lifted_deviations", LIFTED_DEVIATIONS)
    parameters.put("force_max_n", model.facts.envelope.force_max_n)
    parameters.put("detection_limit_n", detection_limit_n)
    parameters.put("edges_m", model.edges_m)
    parameters.put("magnet_off_m", (mounting.rest.position_m - drawing.rest_position_m)[:2])
    parameters.put("spread_m", model.spread_m)
    parameters.put("force_bins", model.own_deviation.shape[0])
    parameters.put("force_bin_n", model.force_bins_n)
    parameters.put("radius_bins", model.own_deviation.shape[1])
    parameters.put("radius_bin_m", model.radius_bins_m)
    parameters.put("own_deviation", model.own_deviation)
    parameters.put("trained_force_n", model.trained_force_n)
    parameters.put("slipping_n", model.slipping_n)
    parameters.put("smoothing_s", model.smoothing_s)
    parameters.put("smoothing_jump_chi2", quantile(JUMP_PROBABILITY, COMPONENTS))


def put_message(parameters: DoubleTable, mounting: Mounting, remanence_t: float) -> None:
    """remanence_t: that of the magnet as drawn, in tesla."""
    parameters.put("rest_variance", np.diagonal(mounting.rest_covariance))
    parameters.put("remanence_t", remanence_t)
    measured = mounting.ambient_t is not None and mounting.ambient_deviation_t is not None
    nothing = np.full(3, np.nan)
    parameters.put("ambient_t", mounting.ambient_t if measured and mounting.ambient_t is not None else nothing)
    deviation = mounting.ambient_deviation_t
    parameters.put("ambient_variance", square(deviation) if measured and deviation is not None else nothing)
