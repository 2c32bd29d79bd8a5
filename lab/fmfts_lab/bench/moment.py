"""What would following the magnet's moment at rest gain, and hide? Tried on a warmed pad, with and without a touch."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import dataclass, field

import numpy as np

from fmfts.common.chi2 import quantile
from fmfts.config import MagnetConfig, SceneConfig
from fmfts.pose import LOG_MOMENT, PoseEstimate, State, change_since, dipole_field
from fmfts.scene.tracking import MOMENT_DEVIATION, tracking_model_for
from fmfts.sensor.chips import NOISE_T
from fmfts_lab.bench.field_tracker import FieldTracker
from fmfts_lab.bench.workspace import Array, standard_pad

RATE_HZ = 55.0
WARM_K, WARMING_S, TOUCHED_S, END_S, SHOWN_S = 20.0, 60.0, 90.0, 120.0, 20.0
COEFFICIENT_ERROR = 0.2  # relative error of the temperature coefficient: one deviation of what the scene allows
DEPTH_M_PER_N = 0.8e-3  # how far a press on the centre moves the magnet down
WINDOW_FRAMES = 220
UNTOUCHED = 0.01  # share of untouched windows that may count as touched


@dataclass
class Follower:
    """If the mean pose agrees with rest within the moment's uncertainty, the pad counts as untouched; then the rest of
    the difference counts as the moment's error."""

    rest: State
    error: float = 0.0  # estimated error of the log moment in the tracker
    variance: float = 0.0
    held_variance: float = 0.0
    changes: list[Array] = field(default_factory=list)

    def see(self, estimate: PoseEstimate, held: float) -> float:
        """The height (m) that the moment's error causes. held: variance of the log moment that the tracker remembers;
        that of a single frame is larger where the frame misfits."""
        self.variance += max(held - self.held_variance, 0.0)
        self.held_variance = held
        by_moment = estimate.covariance[:5, LOG_MOMENT] / estimate.covariance[LOG_MOMENT, LOG_MOMENT]
        self.changes.append(change_since(self.rest, estimate.state)[:5] - by_moment * self.error)
        if len(self.changes) == WINDOW_FRAMES:
            frame = estimate.covariance[LOG_MOMENT, LOG_MOMENT] * np.outer(by_moment, by_moment)
            own = (estimate.covariance[:5, :5] - frame) / WINDOW_FRAMES
            self._learn(np.mean(self.changes, axis=0), own, by_moment)
            self.changes.clear()
        return float(by_moment[2] * self.error)

    def _learn(self, change: Array, own: Array, by_moment: Array) -> None:
        spread = own + self.variance * np.outer(by_moment, by_moment)
        weighed = np.linalg.solve(spread, change)
        if change @ weighed < quantile(UNTOUCHED, 5):
            gain = self.variance * by_moment
            self.error += float(gain @ weighed)
            left = self.variance - float(gain @ np.linalg.solve(spread, gain))
            self.variance = max(left, MOMENT_DEVIATION**2)


def run(options: Namespace) -> None:
    print(
        f"warmed by {WARM_K:g} K in {WARMING_S:g} s, coefficient off by {COEFFICIENT_ERROR:.0%}: error of a force on "
        "the centre, mN,\nand its deviation, with the moment held (as `run` does) and followed while the pad seems "
        "untouched\n"
    )
    print("pad                              held             followed")
    for label, force_n, since_s in (
        ("untouched", 0.0, 0.0),
        ("touched by 30 mN at 90 s", 0.03, TOUCHED_S),
        ("touched by 30 mN all along", 0.03, 0.0),
        ("touched by 100 mN at 90 s", 0.1, TOUCHED_S),
    ):
        held, followed = _warmed(force_n, since_s, np.random.default_rng(options.seed))
        print(f"{label:28} {held[0]:6.1f} ± {held[1]:4.1f}    {followed[0]:6.1f} ± {followed[1]:4.1f}")


def _warmed(force_n: float, since_s: float, random: np.random.Generator) -> tuple[Array, Array]:
    """Mean error and deviation (2,) in mN over the last seconds, with the moment held and with the moment followed."""
    pad, rest = standard_pad(), State.at_rest(standard_pad())
    model = tracking_model_for(SceneConfig(ambient="drifting"), MagnetConfig()).tracking
    tracker, follower, shown = FieldTracker(pad, rest, model, 25.0), Follower(rest), []
    for frame in range(round(END_S * RATE_HZ)):
        time_s = frame / RATE_HZ
        warmer_k = WARM_K * min(time_s / WARMING_S, 1.0)
        force = force_n if time_s >= since_s else 0.0
        weaker = model.moment_per_k * (1.0 + COEFFICIENT_ERROR) * warmer_k
        truth = rest.stepped(np.array([0.0, 0.0, -DEPTH_M_PER_N * force, 0.0, 0.0, weaker]))
        strength = pad.magnet.strength_t_m3 * np.exp(truth.log_moment)
        octupole_m2 = pad.magnet.modelled_octupole_m2
        field_t = dipole_field(pad.sensors.position_m, truth.position_m, truth.axis, strength, octupole_m2)
        measured = field_t + random.normal(0.0, NOISE_T, field_t.shape)
        estimate = tracker.update(measured, np.full(field_t.shape, NOISE_T), 1.0 / RATE_HZ, 25.0 + warmer_k).estimate
        assert estimate is not None
        remembered = tracker.memory["covariance"].reshape(estimate.covariance.shape)
        by_error = follower.see(estimate, float(remembered[LOG_MOMENT, LOG_MOMENT]))
        if time_s >= END_S - SHOWN_S:
            error = truth.position_m[2] - estimate.position_m[2]
            variance, of_moment = estimate.covariance[2, 2], estimate.covariance[LOG_MOMENT, LOG_MOMENT]
            less = (estimate.covariance[2, LOG_MOMENT] / of_moment) ** 2 * (of_moment - follower.variance)
            shown.append((error, np.sqrt(variance), error + by_error, np.sqrt(variance - less)))
    mean = np.mean(shown, axis=0) / DEPTH_M_PER_N * 1e3
    return mean[:2], mean[2:]
