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
TOUCH, LINE = "tests/oracle/test_touch_gates.py", "tests/oracle/test_line.py"
CHANGES = [
    Change("field", "pose/model.h", "further * w * (52.5 - 157.5 * uw)", "further * w * (52.5 - 152.5 * uw)",
           (SOLVER,)),
    Change("solver", "pose/conclude.c", "inverse[i][j] -= inverse[i][n + c]", "inverse[i][j] += inverse[i][n + c]",
           (SOLVER,)),
    Change("alignment", "pose/push.c", ".reach = 2.0 * (double)behind", ".reach = 1.0 * (double)behind", (SAMPLING,)),
    Change("alignment", "pose/push.c", "? *repeats + 1 : 0", "? *repeats + 1 : 1", (SAMPLING,)),
    Change("alignment", "pose/alignment.c", "(share * share + (1.0 - share) * (1.0 - share))",
           "(share * share + (1.0 - share))", ("healthy:400",)),
    Change("alignment", "pose/alignment.py", "LONGEST_GAP_US = 300_000.0", "LONGEST_GAP_US = 200_000.0",
           ("faulty:3200", "faulty")),
    Change("tracker", "pose/tracker.c", "parameters->walk_per_s[c] * elapsed", "parameters->walk_per_s[c] * 0.0045",
           ("faulty:3000",)),
    Change("tracker", "pose/tracker.py", "self._model.walk_per_s * self.memory.since_good_s",
           "self._model.walk_per_s * 0.0045", ("faulty:1500", "tools:3000")),
    Change("tracker", "pose/tracker.py", "MISFIT_FRAMES = 8", "MISFIT_FRAMES = 9", ("eight-sensors:700",)),
    Change("fault search", "pose/tracker.py", "if probability(one, self._rest) > foreign}",
           "if probability(one, self._rest) > 0.0}", ("tools:1500", "tools:4000", "tools")),
    Change("fault search", "pose/tracker.py", "SEARCH_EVERY = 8", "SEARCH_EVERY = 7", ("tools:1500",)),
    Change("fault search", "pose/gate.py", "FALSE_ALARM = 1e-6", "FALSE_ALARM = 1e-7", ("noisy:400", "faulty")),
    Change("residuals", "pose/mean_residuals.c", "2.0 * memory_frames - 1.0", "memory_frames",
           ("slightly-off",)),
    Change("residuals", "pose/mean_residuals.py", "CLEAR = 0.999", "CLEAR = 0.99",
           ("tools:3000", "faulty:3000", "tools", "faulty")),
    Change("residuals", "pose/residual_monitor.py", "            heard.clear()", "            pass",
           ("faulty:3000", "tools:3000", "faulty", "tools")),
    Change("ambient motion", "pose/ambient_motion.py", "WELL_FRAMES = 220", "WELL_FRAMES = 240",
           ("tools-constant:2500", "tools-constant")),
    Change("neighbours", "pose/neighbour.py", "SPEED_M_PER_S, TURN_RAD_PER_S = 0.02, 2.0",
           "SPEED_M_PER_S, TURN_RAD_PER_S = 0.02, 1.5", ("neighbours:700",)),
    Change("neighbours", "pose/neighbour.c", "by_placement = 4.0 *", "by_placement = 3.0 *", ("neighbours:700",)),
    Change("change", "pose/change.c", "(overlap ? own - overlap[i][j] : own)", "(overlap ? own + overlap[i][j] : own)",
           ("healthy:700",)),
    Change("overlap", "pose/overlap.c", "weight * moved[i] * moved[j]", "weight * moved[i] * moved[i]",
           ("healthy:700",)),
    Change("silicone", "pose/silicone.c", "gained * (held[i] -", "0.9 * gained * (held[i] -", ("healthy:1500",)),
    Change("silicone", "pose/silicone.py", "elapsed_s > self.longest_gap_s and was_larger", "was_larger",
           ("faulty:2500", "faulty")),
    Change("hidden gradient", "pose/hidden_gradient.c", "fades_s / (fades_s + pose->elapsed_s)", "1.0",
           ("turned:2500", "turned")),
    Change("hidden gradient", "pose/hidden_gradient.py", "square(strange_t) - square(HEALTHY) * variance",
           "square(strange_t) - HEALTHY * variance", ("turned:1500", "turned")),
    Change("touch", "contact/touch.py", "memory.quiet_frames = memory.quiet_frames + 1 if",
           "memory.quiet_frames = 1 if",
           (TOUCH,)),
    Change("touch", "contact/touch.c", "memory->quiet_frames[0] + 1.0 : 0.0", "memory->quiet_frames[0] + 1.0 : 1.0",
           ("healthy:2000",)),
    Change("touch", "contact/touch.py", "quiet_frames + 1, RELEASE_FRAMES)", "quiet_frames, RELEASE_FRAMES)",
           ("noisy:200", "tools")),
    Change("smoothing", "contact/smooth.c", "1.5 * (fresh * fresh)", "1.4 * (fresh * fresh)", ("smoothed:400",)),
    Change("smoothing", "contact/smoothing.py", "(1.0 - power(fading, 3))", "(1.0 - power(fading, 2))", (TOUCH,)),
    Change("contact", "contact/estimate.c", "return doubt * doubt * sqrt(doubt)", "return doubt * doubt",
           ("healthy:700",)),
    Change("contact", "contact/network.c", "(by_direction[k] - along * direction[k])", "by_direction[k]",
           ("healthy:700",)),
    Change("contact", "contact/estimate.py", "CERTAIN_FORCE_DEVIATIONS = 2.0", "CERTAIN_FORCE_DEVIATIONS = 2.1",
           ("healthy:1500",)),
    Change("now", "pose/motion.c", "own->widths *= s / r", "own->widths *= 1.0", ("healthy:700",)),
    Change("now", "contact/now.py", "LEAD_SHARE = 0.75", "LEAD_SHARE = 0.7", ("healthy:700",)),
    Change("now", "contact/drive.c", "fmax(place[2], 0.0)", "place[2] * 0.9", ("healthy:700",)),
    Change("samples", "pipeline/fast/now.c", "fmax(early->time_us + own->early_lead_us[0], memory->now.told_us[0])",
           "early->time_us + own->early_lead_us[0]", ("samples-on-board:1000",)),
    Change("samples", "pose/motion.c", "return goes_on ? memory->early_from_us[0] :",
           "return false ? memory->early_from_us[0] :",
           ("samples:1000",)),
    Change("message", "pipeline/fast/frame_step.c", "n->y_sd_m[0] = estimate->deviation[1]",
           "n->y_sd_m[0] = estimate->deviation[0]", ("healthy:400",)),
    Change("message", "pipeline/contact_message.py", "\"y_sd_m\": contact.y_sd_m", "\"y_sd_m\": contact.x_sd_m",
           ("faulty:1500", "faulty")),
    Change("several", "several/press_table.c", "weighted(model, slope, table[VALUE]",
           "weighted(model, value, table[VALUE]",
           (SEVERAL,)),
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
    Change("clock", "sensor/wire/clock.py", "if end_us >= mean_us:", "if start_us >= mean_us:", (LINE,)),
]  # fmt: skip
