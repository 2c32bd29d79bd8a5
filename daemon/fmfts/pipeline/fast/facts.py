"""All that is known of a pad before its first frame, as the compiled path reads it: FACTS in tables.h."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.baseline import Mounting
from fmfts.common.chi2 import quantile
from fmfts.common.double_table import Named
from fmfts.contact import ContactModel, TouchDetector
from fmfts.contact.model import (
    CERTAIN_DEVIATIONS,
    CERTAIN_FORCE_DEVIATIONS,
    HYSTERESIS_MM,
    LIFTED_DEVIATIONS,
    OUTSIDE_DEVIATIONS,
    TINY,
)
from fmfts.contact.refinement import STEPS
from fmfts.contact.touch import RELEASE_FRAMES
from fmfts.pad import Pad
from fmfts.pose import alignment, innovation, tracker
from fmfts.pose.change import shortest_rotation
from fmfts.pose.problem import MAX_ITERATIONS, Part
from fmfts.pose.state import SIZE
from fmfts.pose.tracking_model import TrackingModel
from fmfts.sensor.chips import Chip

Array = NDArray[np.float64]


def put_sensors(facts: Named, mounting: Mounting, mounted: Pad, repeats_allowed: Array, stopped_us: float) -> None:
    """mounted: the pad with its sensors where the baseline found them."""
    facts.put("sensors", len(mounted.sensors))
    _put_chip(facts, mounted.chip)
    facts.put("stopped_us", stopped_us)
    facts.put("jump_t", alignment.JUMP_T)
    facts.put("repeats_allowed", repeats_allowed)
    facts.put("gain", mounting.gain)
    facts.put("offset_t", mounting.offset_t)
    facts.put("rest_field_t", mounting.rest_field_t)
    facts.put("gain_deviation", mounting.gain_deviation)
    facts.put("place_deviation", mounting.place_deviation)
    facts.put("systematic_t", mounting.systematic_t)
    facts.put("noise_t", mounting.noise_t)
    facts.put("place_m", mounted.sensors.position_m)
    facts.put("direction", mounted.sensors.rotation.transpose(0, 2, 1))
    facts.put("strength_t_m3", mounted.magnet.strength_t_m3)
    facts.put("octupole_m2", mounted.magnet.modelled_octupole_m2)


def _put_chip(facts: Named, chip: Chip) -> None:
    thermometer = chip.thermometer
    facts.put("saturated_count", chip.saturated_count)
    facts.put("step_t", chip.step_t)
    facts.put("at_zero_c", np.nan if thermometer is None else thermometer.at_zero_c)
    facts.put("c_per_count", np.nan if thermometer is None else thermometer.c_per_count)


def put_tracking(facts: Named, mounting: Mounting, model: TrackingModel, rest_temperature_c: float | None) -> None:
    free = int((model.parts == Part.FREE).sum())
    estimated = int(np.isin(model.parts, (Part.FREE, Part.PRIOR)).sum())
    values = mounting.gain.size
    facts.put("part", model.parts[:SIZE])
    facts.put("walk_per_s", model.walk_per_s[:SIZE])
    facts.put("moment_per_k", model.moment_per_k)
    facts.put("moment_per_k_deviation", model.moment_per_k_deviation)
    facts.put("rest_temperature_c", np.nan if rest_temperature_c is None else rest_temperature_c)
    facts.put("rest", mounting.rest.vector())
    facts.put("stop_chi2", tracker.STOP_TRACKING)
    facts.put("max_iterations", MAX_ITERATIONS)
    facts.put("reach_m", tracker.REACH_M)
    facts.put("log_moment_reach", tracker.LOG_MOMENT_REACH)
    facts.put("vague_m", tracker.VAGUE_M)
    facts.put("gate_chi2", quantile(tracker.FALSE_ALARM, values - free))
    facts.put("freedom", values - free)
    facts.put("misfit_frames", tracker.MISFIT_FRAMES)
    facts.put("memory_frames", innovation.MEMORY_FRAMES)
    facts.put("judged_every", innovation.JUDGED_EVERY)
    facts.put("alarm_chi2", quantile(innovation.FALSE_ALARM, values - estimated))
    facts.put("sound_chi2", quantile(innovation.SOUND, values - estimated))
    errors = mounting.field_errors()
    if errors is not None:
        facts.put("field_errors", errors.by_field.shape[-1])
        facts.put("by_pose", errors.by_pose)
        facts.put("by_field", errors.by_field)


def put_contact(
    facts: Named,
    mounting: Mounting,
    drawing: Pad,
    change_error: Array,
    touch: TouchDetector,
    model: ContactModel,
    unfelt_n: float,
) -> None:
    """change_error (5, 5, M): see Leftover.change_error. unfelt_n: see ContactModel.unfelt_n."""
    facts.put("leftovers", change_error.shape[-1])
    facts.put("change_error", change_error)
    facts.put("onset_chi2", touch.onset_chi2)
    facts.put("release_chi2", touch.release_chi2)
    facts.put("release_frames", RELEASE_FRAMES)
    facts.put("longest_gap_s", touch.longest_gap_s)
    facts.put("drawn_rest_m", drawing.rest_position_m)
    facts.put("drawn_turn", shortest_rotation(mounting.rest.axis, drawing.rest_axis))
    facts.put("refine_steps", STEPS)
    facts.put("least_variance", TINY[0, 0])
    facts.put("model_rest", model.rest_pose)
    facts.put("lowest", model.lowest)
    facts.put("highest", model.highest)
    facts.put("outside_deviations", OUTSIDE_DEVIATIONS)
    facts.put("certain_deviations", CERTAIN_DEVIATIONS)
    facts.put("certain_force_deviations", CERTAIN_FORCE_DEVIATIONS)
    facts.put("trained_top_mm", model.trained_top_mm)
    facts.put("lifted_above_mm", model.trained_top_mm + HYSTERESIS_MM)
    facts.put("lifted_deviations", LIFTED_DEVIATIONS)
    facts.put("force_max_n", model.facts.envelope.force_max_n)
    facts.put("unfelt_n", unfelt_n)
    facts.put("edges_m", model.edges_m)
    facts.put("spread_m", model.spread_m)
    facts.put("force_bins", model.own_deviation.shape[0])
    facts.put("force_bin_n", model.force_bins_n)
    facts.put("radius_bins", model.own_deviation.shape[1])
    facts.put("radius_bin_m", model.radius_bins_m)
    facts.put("own_deviation", model.own_deviation)
    facts.put("trained_force_n", model.trained_force_n)
    facts.put("slipping_n", model.slipping_n)


def put_message(facts: Named, mounting: Mounting, remanence_t: float) -> None:
    """remanence_t: of the drawing's magnet."""
    facts.put("rest_variance", np.diagonal(mounting.rest_covariance))
    facts.put("remanence_t", remanence_t)
    measured = mounting.ambient_t is not None and mounting.ambient_deviation_t is not None
    nothing = np.full(3, np.nan)
    facts.put("ambient_t", mounting.ambient_t if measured and mounting.ambient_t is not None else nothing)
    deviation = mounting.ambient_deviation_t
    facts.put("ambient_variance", square(deviation) if measured and deviation is not None else nothing)
