"""The deliberate changes of net_catches.py: each is one line, as a slip of the pen would leave it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Change:
    """path: in daemon/fmfts. checks: what should find it, the nearest first; a world's name may have a number of
    messages."""

    area: str
    path: str
    old: str
    new: str
    checks: tuple[str, ...]

    @property
    def summary(self) -> str:
        """Where, and the words that differ."""
        one, other = self.old.split(), self.new.split()
        while one and other and one[0] == other[0]:
            del one[0], other[0]
        while one and other and one[-1] == other[-1]:
            del one[-1], other[-1]
        return f"{self.path}: {' '.join(one)} → {' '.join(other)}"[:72]


SOLVER, SAMPLING, SEVERAL = (f"tests/oracle/test_{name}.py" for name in ("solver", "sampling", "several"))
TOUCH, LINE, RESIDUALS, NETWORK = (
    f"tests/oracle/test_{name}.py" for name in ("touch_gates", "line", "residuals", "network")
)
SAYS, RECORDED = (
    f"tests/golden/test_golden.py::test_{name}"
    for name in ("what_goes_with_a_message_is_what_it_says", "snapshots_and_a_replay_change_no_bit")
)
CHANGES = [
    Change("field", "pose/model.h", "further * w * (52.5 - 157.5 * uw)", "further * w * (52.5 - 152.5 * uw)",
           (SOLVER,)),
    Change("solver", "pose/conclude.c", "inverse[i][j] -= inverse[i][n + c]", "inverse[i][j] += inverse[i][n + c]",
           (SOLVER,)),
    Change("alignment", "pose/push.c", ".reach = 2.0 * (double)behind", ".reach = 1.0 * (double)behind", (SAMPLING,)),
    Change("alignment", "pose/push.c", "? *repeats + 1 : 0", "? *repeats + 1 : 1", (SAMPLING,)),
    Change("alignment", "pose/push.c", "sqrt(b.share * b.share + (1.0 - b.share) * (1.0 - b.share))",
           "sqrt(b.share * b.share + (1.0 - b.share))", (SAMPLING,)),
    Change("alignment", "pose/push.h", "FMFTS_LONGEST_GAP_US 300000.0", "FMFTS_LONGEST_GAP_US 200000.0",
           ("faulty:3200", "faulty")),
    Change("alignment", "pose/alignment.c", "double noise_t = parameters->noise_t[axis] * share;",
           "double noise_t = parameters->noise_t[axis];", ("healthy:400",)),
    Change("alignment", "pose/alignment.c", "cannot_be = !is_saturated && (count > largest || count < -largest - 1)",
           "cannot_be = false", ("growing",)),
    Change("clock's leap", "pose/push.c", "return there_us - passed_us;", "return there_us;", ("leaps:700", "leaps")),
    Change("clock's leap", "pose/push.c", "(passed_us > made_us ? passed_us : made_us)", "passed_us",
           ("leaps:700", "leaps")),
    Change("clock's leap", "pose/alignment.c", "- memory->last_us - (double)field->leap_us;", "- memory->last_us;",
           ("leaps:700", "leaps")),
    Change("clock's leap", "pose/alignment.c", "memory->leapt_us += leap_us;", "memory->leapt_us = leap_us;",
           ("leaps:700", "leaps")),
    Change("clock's leap", "pipeline/reading.c", "if (field->leap_us) {", "if (false) {", ("leaps:700", "leaps")),
    Change("temperature", "pose/alignment.c", "isnan(warmed_k) ? step->memory->warmed_k : warmed_k;",
           "isnan(warmed_k) ? 0.0 : warmed_k;", ("cold:1500", "cold")),
    Change("temperature", "pipeline/contact_of_pose.c", "memory->unread_s + work->step.field.elapsed_s : 0.0;",
           "memory->unread_s : 0.0;", ("cold:2500", "cold")),
    Change("temperature", "pose/tracker.c", "memory->unread_variance * (by_moment[i] * by_moment[j])",
           "memory->unread_variance * by_moment[i]", ("cold:500", "cold")),
    Change("temperature", "pose/tracker.c", "fmax(warmth * warmth, memory->warmth_variance)", "warmth * warmth",
           ("cooling",)),
    Change("tracker", "pose/tracker.c", "parameters->walk_per_s[c] * memory->since_good_s",
           "parameters->walk_per_s[c] * 0.0045", ("faulty:1500", "tools:3000")),
    Change("tracker", "pose/tracker.c", "MISFIT_FRAMES = 8.0", "MISFIT_FRAMES = 9.0", ("eight-sensors:700",)),
    Change("tracker", "pose/tracker.c", "fmax(step->memory->misfit, lasting)", "step->memory->misfit",
           ("slightly-off",)),
    Change("tracker", "pose/tracker.c", "is_unused |= isfinite(step->field.field_t[axis]) && !verdict->used[axis];",
           "is_unused |= !verdict->used[axis];", ("steel-faulty",)),
    Change("tracker", "pose/gate.c", "stronger < strongest;", "stronger < FMFTS_LOG_MOMENT_REACH;",
           ("tools-constant",)),
    Change("fault search", "pose/fault_search.c", "fmfts_probability(parameters, &solved) > of_foreign_field",
           "fmfts_probability(parameters, &solved) > 0.0", ("tools:1500", "tools:4000", "tools")),
    Change("fault search", "pose/tracking.h", "FMFTS_SEARCH_EVERY = 8", "FMFTS_SEARCH_EVERY = 7", ("tools:1500",)),
    Change("fault search", "pose/gates.py", "FALSE_ALARM = 1e-6", "FALSE_ALARM = 1e-7", ("noisy:400", "faulty")),
    Change("fault search", "pose/fault_search.c",
           "others.field_t[3 * sensor] = others.field_t[3 * sensor + 1] = others.field_t[3 * sensor + 2] = NAN;",
           "others.field_t[3 * sensor] = others.field_t[3 * sensor + 1] = NAN;", ("faulty:700", "faulty")),
    Change("fault search", "pose/fault_search.c", "fmfts_accept(step, attempt->prior, &found->without_last);",
           "fmfts_accept(step, attempt->prior, whole);", ("faulty:700", "faulty")),
    Change("fault search", "pose/fault_search.c", "memory->searched_sensors = found.sensors;", ";",
           ("tools:1500", "faulty:1500", "tools", "faulty")),
    Change("fault search", "pose/frame_solver.c", "if (problem->parts[AMBIENT_COLUMN] == FMFTS_FIXED) {",
           "if (false) {", ("faulty-constant:1000", "faulty-constant")),
    Change("fault search", "pose/fault_search.c", "return explains || fmfts_has_plausible_pose(",
           "return fmfts_has_plausible_pose(", ("growing",)),
    Change("residuals", "pose/mean_residuals.c", "2.0 * MEMORY_FRAMES - 1.0", "MEMORY_FRAMES", ("slightly-off",)),
    Change("residuals", "pose/mean_residuals.c", "2.0 * MEMORY_FRAMES - 1.0", "2.0 * MEMORY_FRAMES", (RESIDUALS,)),
    Change("residuals", "pose/mean_residuals.c", "forgives ? sound_chi2 : parameters->alarm_chi2[freedom]",
           "parameters->alarm_chi2[freedom]", ("steel-faulty",)),
    Change("residuals", "pose/mean_residuals.c", "if (forgives && has_recent && is_over(step, common, recent_t)) {",
           "if (false) {", ("faulty:1500", "faulty")),
    Change("residuals", "pose/blame.c", "CLEAR 0.999", "CLEAR 0.99",
           ("tools:3000", "faulty:3000", "tools", "faulty")),
    Change("residuals", "pose/blame.c", "log_determinant -= fmfts_log(factored[k][k]);",
           "log_determinant += fmfts_log(factored[k][k]);", ("faulty:3000", "slightly-off")),
    Change("residuals", "pose/residual_monitor.c", "memory->heard = 0;", ";",
           ("faulty:3000", "tools:3000", "faulty", "tools")),
    Change("residuals", "pose/residual_monitor.c", "if (ambient_is_known(parameters) || memory->sound) {",
           "if (true) {", ("faulty:3000", "tools:3000", "faulty", "tools")),
    Change("residuals", "pose/residual_monitor.c",
           "if (!memory->found_foreign && single_frames_agree && is_degraded) {",
           "if (false) {", ("growing",)),
    Change("residuals", "pose/residual_monitor.c", "if (fmfts_blamed(memory) >= 0) {", "if (false) {",
           ("faulty:1500", "faulty")),
    Change("ambient motion", "pose/ambient_motion.c", "WELL_FRAMES = 220", "WELL_FRAMES = 240",
           ("tools-constant:2500", "tools-constant")),
    Change("ambient motion", "pose/ambient_motion.c", "EVERY = 8, LOOKS = 12", "EVERY = 8, LOOKS = 13",
           ("turning-constant:700", "tools-constant")),
    Change("ambient motion", "pose/ambient_motion.c", "MOVED_T 5e-7", "MOVED_T 5e-6",
           ("turning-constant:700", "tools-constant")),
    Change("ambient motion", "pose/ambient_motion.c", "if (step->verdict.stronger) {", "if (false) {",
           ("tools-constant:2500", "tools-constant", "steel")),
    Change("neighbours", "pose/limits.h", "FMFTS_TURN_RAD_PER_S 2.0",
           "FMFTS_TURN_RAD_PER_S 1.5", ("neighbours:700",)),
    Change("neighbours", "pose/neighbour.c", "by_placement = 4.0 *", "by_placement = 3.0 *", ("neighbours:700",)),
    Change("neighbours", "pipeline/reading.c", "*pad->own.time_ns = (double)work->memory->message.sampled_ns;", ";",
           ("neighbours:700",)),
    Change("change", "pose/change.c", "(overlap ? own - overlap[i][j] : own)", "(overlap ? own + overlap[i][j] : own)",
           ("healthy:700",)),
    Change("overlap", "pose/overlap.c", "weight * moved[i] * moved[j]", "weight * moved[i] * moved[i]",
           ("healthy:700",)),
    Change("silicone", "pose/silicone.c", "gained * (held[i] -", "0.9 * gained * (held[i] -", ("healthy:1500",)),
    Change("silicone", "pose/silicone.c", "unseen_s > parameters->unseen_gap_s && square_of", "square_of",
           ("faulty:2500", "faulty")),
    Change("hidden gradient", "pose/hidden_gradient.c", "FADES_S / (FADES_S + step->field.elapsed_s)", "1.0",
           ("turned:2500", "turned")),
    Change("hidden gradient", "pose/hidden_gradient.c", "strange * strange - healthy * healthy * variance_along",
           "strange * strange - healthy * variance_along", ("turned:1500", "turned")),
    Change("touch", "contact/touch.c", "memory->quiet_frames + 1.0 : 0.0",
           "1.0 : 0.0", (TOUCH,)),
    Change("touch", "contact/touch.c", "memory->quiet_frames + 1.0 : 0.0", "memory->quiet_frames + 1.0 : 1.0",
           (TOUCH,)),
    Change("touch", "contact/touch.c", "fmin(memory->quiet_frames + 1.0, FMFTS_RELEASE_FRAMES)",
           "fmin(memory->quiet_frames, FMFTS_RELEASE_FRAMES)", ("noisy:200", "tools")),
    Change("touch", "contact/touch.c", "KEPT_FORCE_DEVIATIONS 1.0", "KEPT_FORCE_DEVIATIONS 1.5", ("healthy:1500",)),
    Change("smoothing", "contact/smooth.c", "1.5 * (fresh * fresh)", "1.4 * (fresh * fresh)", (TOUCH,)),
    Change("smoothing", "contact/smooth.c", "(1.0 - fading * fading * fading)", "(1.0 - fading * fading)", (TOUCH,)),
    Change("lift", "contact/estimate.c", "LIFTED_DEVIATIONS 6.0", "LIFTED_DEVIATIONS 5.0", ("lifted",)),
    Change("lift", "pipeline/contact_of_pose.c", "LIFTED_S 0.6", "LIFTED_S 0.7", ("pulled",)),
    Change("lift", "pipeline/contact_of_pose.c", "RESTED_S 0.15", "RESTED_S 0.1", ("pulled",)),
    Change("contact", "contact/estimate.c", "return doubt * doubt * sqrt(doubt)", "return doubt * doubt",
           ("healthy:700",)),
    Change("contact", "contact/network.c", "(by_direction[k] - along * direction[k])", "by_direction[k]",
           (NETWORK,)),
    Change("contact", "contact/step.h", "CERTAIN_FORCE_DEVIATIONS 2.0", "CERTAIN_FORCE_DEVIATIONS 2.1",
           ("healthy:1500",)),
    Change("contact", "contact/refine.c", "damping /= DAMPING_FACTOR;", "damping *= DAMPING_FACTOR;",
           ("smoothed:400", "smoothed")),
    Change("now", "pose/motion_modes.c", "own->widths *= s / r", "own->widths *= 1.0", ("healthy:700",)),
    Change("now", "contact/now.c", "LEAD_SHARE 0.75", "LEAD_SHARE 0.7", ("healthy:700",)),
    Change("now", "contact/drive.c", "fmax(place[2], 0.0)", "place[2] * 0.9", ("healthy:700",)),
    Change("now", "pipeline/now.c", "LET_GO 0.0025", "LET_GO 0.025", ("healthy:700", "samples")),
    Change("samples", "pipeline/now.c",
           "fmax((double)early->time_us + parameters->now.early_lead_us, memory->now.told_us)",
           "(double)early->time_us + parameters->now.early_lead_us", ("samples-on-board:1000",)),
    Change("samples", "pose/motion.c", "return goes_on ? memory->early_from_us :",
           "return false ? memory->early_from_us :", ("samples:1000",)),
    Change("samples", "pose/motion.c", "memory->early_us[early->sensor] = (double)early->time_us;",
           "memory->early_us[0] = (double)early->time_us;", ("samples:1000",)),
    Change("samples", "pose/motion.c", "!is_sound(modes, before, own->early_chi2) ||", "", ("samples-again",)),
    Change("samples", "pipeline/now.c", "early->time_us > taken_us[early->sensor] &&", "", ("samples-again",)),
    Change("message", "pipeline/message.c", "&r->estimate.deviation[i];", "&r->estimate.deviation[0];",
           ("healthy:400",)),
    Change("message", "pipeline/reading.c", "fmax(deviation[3], deviation[4])", "deviation[3]", ("healthy:400",)),
    Change("message", "pipeline/reading.c", "work->memory->contact.touched != 0.0 ? FMFTS_IN_CONTACT",
           "work->memory->contact.in_contact != 0.0 ? FMFTS_IN_CONTACT", ("without-model:700",)),
    Change("message", "pipeline/_pad.c", "self->memory->message.number++;", ";", (SAYS,)),
    Change("message", "pipeline/encoded.py", "    over_range: bool\n    t_sample_ns: int\n    t_publish_ns: int\n",
           "    over_range: bool\n    t_publish_ns: int\n    t_sample_ns: int\n", (SAYS,)),
    Change("snapshot", "common/record.py", "            self._values[name] = values[name]\n",
           "            self._values[name] = values[name] if self._values[name].ndim else self._values[name]\n",
           (RECORDED,)),
    Change("snapshot", "pipeline/pad_pipeline.py", "        self._sighting.recall(memory.sighting)\n", "", (RECORDED,)),
    Change("several", "several/press_table.c", "weighted(model, slope, table[VALUE]",
           "weighted(model, value, table[VALUE]", (SEVERAL,)),
    Change("several", "several/covariance.c", "= shear_n * by_shear[2 * p + 1]", "= shear_n * by_shear[2 * p]",
           (SEVERAL,)),
    Change("several", "several/free_poses.c", "(square * square * nearer)", "(square * square)", (SEVERAL,)),
    Change("several", "several/count.py", "SECOND_GAIN = 45.0", "SECOND_GAIN = 35.0", ("fingers:1500", "fingers")),
    Change("several", "several/odd_sensor.py", "AGREES, AGREES_FRAMES = 1e-3, 20", "AGREES, AGREES_FRAMES = 1e-3, 21",
           ("fingers-faulty:1000", "fingers-faulty")),
    Change("skin", "skin/estimator.py", "KEEPS = 0.5", "KEEPS = 0.6", ("skin:1500", "skin")),
    Change("wire", "sensor/wire/sample.c", "packet[12] & 7", "packet[12] & 3", (LINE,)),
    Change("wire", "sensor/wire/framing.py", "packet[-2] | packet[-1] << 8", "packet[-2] | packet[-2] << 8", (LINE,)),
    Change("clock", "sensor/wire/clock.c", "- line->fixed_delay_ns;", ";", (LINE,)),
    Change("clock", "sensor/wire/clock.c", "(double)hull[i].us >= mean_us", "(double)hull[i - 1].us >= mean_us",
           (LINE,)),
]  # fmt: skip
