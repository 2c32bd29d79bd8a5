"""`fmfts-daemon weigh`: a known weight in the middle of a pad measures the stiffness of its silicone.

The pad judges the frames as usual, but with a known structure. The weight over the reported force is the stiffness: a
factor of all forces. It is the most probable one under the tolerances of modulus and thickness, and is kept in the
baseline.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, hypot, log
from typing import Any

import msgspec
import numpy as np

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import root_of_squares
from fmfts.baseline import Baseline, BaselineError, Mounting, summarise
from fmfts.baseline.silicone import StoredSilicone
from fmfts.bus.messages import ContactMessage
from fmfts.config import PadConfig
from fmfts.contact import ContactModel, ModelError
from fmfts.contact.no_model import NoContactModel
from fmfts.contact.shipped import SHIPPED_PATHS
from fmfts.contact.tolerances import PROBE_M, SHAPE_SHARE, StructureTolerance
from fmfts.pad import Pad
from fmfts.pipeline.configured import contact_model_of, pipeline_of
from fmfts.sensor import Frame

# Default for an unknown cure: all published cures of Sylgard 184 (tolerances.py) are within two of these deviations of
# the model's. A configured value replaces it.
ANY_CURE = log(2.0) / 2.0
UNBELIEVABLE = 3.5  # deviations
# This share of weights is entered as half or twice its mass. `weigh` refuses a weight that is UNLIKELY deviations off,
# where the probability of this mistake exceeds DOUBT.
MISTAKEN, DOUBT, UNLIKELY = 0.01, 0.05, 2.5
RARELY = 2.0  # deviations
# `weigh` refuses a weight that stands further from the middle than MIDDLE_M and SURELY deviations of its place. Without
# --turn and --refine the place may be off by a millimetre.
MIDDLE_M, SURELY = 2e-3, 2.0
LIGHTEST_N, HEAVIEST_N = 0.2, 4.0
# Other deviations of the ratio: the model itself and a pad that is not level (2 %), and a kitchen scale.
READ_SHARE, SCALE_N = 0.02, 0.01
SETTLED_S, SECONDS = 0.5, 3.0
TREMBLING = 1.5  # of the noise of the untouched pad
MOSTLY = 0.95


@dataclass(frozen=True, slots=True)
class Weighing:
    """A `Learner`. width_m: of the weight's contact with the silicone; None: any width of `finger_mm`. anew: accept it
    even if an earlier weight contradicts it."""

    config: PadConfig
    weight_n: float
    width_m: float | None = None
    anew: bool = False

    option, seconds, presses = "weigh", SECONDS, 0

    def require(self, pad: Pad, before: Baseline) -> None:
        if not LIGHTEST_N <= self.weight_n <= HEAVIEST_N:
            raise BaselineError(
                f"a weight of {self.weight_n:.3g} N ({self.weight_n / 9.81e-3:.3g} g) cannot be used: take one of "
                f"{LIGHTEST_N / 9.81e-3:.0f} to {HEAVIEST_N / 9.81e-3:.0f} g, and name its unit (g, kg or N)"
            )
        if self.width_m is not None and not 1e-3 <= self.width_m <= 15e-3:
            raise BaselineError(
                f"a width of {self.width_m * 1e3:.3g} mm cannot be used: put the weight on a coin or a ball, 1 to 15 "
                "mm wide"
            )
        self._model()

    def make(
        self, pad: Pad, frames: Sequence[Frame], before: Baseline | None
    ) -> tuple[Baseline, Mounting, dict[str, Any]]:
        assert before is not None
        model = self._model()
        _require_still(frames, before)
        read = _read(self.config, model, frames, msgspec.structs.replace(before, silicone=None))
        x_m, y_m = read.x_m - pad.rest_position_m[0], read.y_m - pad.rest_position_m[1]
        away_m = hypot(x_m, y_m)
        if away_m > MIDDLE_M and away_m > MIDDLE_M + SURELY * hypot(x_m * read.x_sd_m, y_m * read.y_sd_m) / away_m:
            raise BaselineError(
                f"the weight stands {away_m * 1e3:.1f} mm from the middle, at ({read.x_m * 1e3:.1f}, "
                f"{read.y_m * 1e3:.1f}) mm: put it within 1 mm, and weigh again"
            )
        stored = self._silicone(model, read, before.silicone)
        baseline = msgspec.structs.replace(before, silicone=stored).sealed()
        facts = {
            "weight_n": self.weight_n,
            "weight_read_n": read.force_n,
            "weight_place_m": [read.x_m, read.y_m],
            "stiffness": stored.stiffness,
            "stiffness_sd": stored.stiffness * stored.deviation,
            "warnings": self._doubts(stored.stiffness),
        }
        return baseline, baseline.mounting(pad), facts

    def _model(self) -> ContactModel:
        """The configured model, as if it were of this very pad."""
        if not self.config.are_magnets_known or self.config.other_magnets:
            raise BaselineError("only a pad with one known magnet can be weighed on: see docs/calibration.md")
        cannot_shear = msgspec.structs.replace(self.config.contact, friction=0.0, slip=False)
        try:
            model = contact_model_of(msgspec.structs.replace(self.config, contact=cannot_shear))
        except ModelError as error:
            raise BaselineError(f"weighing needs a contact model: {error}") from error
        if isinstance(model, NoContactModel):
            raise BaselineError(model.reason)
        assert isinstance(model, ContactModel), "the pad has one known magnet"
        if model.response is None:
            raise BaselineError("the contact model holds no response of its pad: use one that `calibrate` wrote")
        if model.tolerance.force_share == 0.0:
            raise BaselineError(
                "this pad's silicone is as calibrated: its own presses made the contact model, or the file sets "
                "tolerance.modulus and tolerance.thickness_mm to 0"
            )
        return model.with_tolerance(StructureTolerance())

    def _silicone(self, model: ContactModel, read: _Reading, earlier: StoredSilicone | None) -> StoredSilicone:
        width, width_deviation = self._of_width(model, read.force_n)
        found = log(self.weight_n * width / read.force_n)
        deviation = float(
            root_of_squares(read.force_sd_n / read.force_n, READ_SHARE, width_deviation, SCALE_N / self.weight_n)
        )
        prior = self._prior
        away = abs(found) / hypot(prior, deviation)
        is_rather_twice = _is_rather_twice(away, log(2.0) / hypot(prior, deviation))
        if away > UNBELIEVABLE or is_rather_twice:
            doubled = f". It fits {'half' if found > 0.0 else 'twice'} of it better" if is_rather_twice else ""
            raise BaselineError(
                f"a pad within its tolerances reads this weight as {self.weight_n / exp(2.0 * prior):.2g} to "
                f"{self.weight_n * exp(2.0 * prior):.2g} N, and this pad reads {read.force_n:.2g} N: "
                f"compare the weight and its unit (g, kg or N), and tolerance.modulus{doubled}"
            )
        if earlier is not None and earlier.model == model.hash and not self.anew:
            apart = abs(found - log(earlier.stiffness))
            if apart > UNBELIEVABLE * hypot(deviation, earlier.deviation):
                raise BaselineError(
                    f"{self.weight_n:.3g} N say that the silicone is {exp(found):.2f} times as stiff as the model's, "
                    f"and the {earlier.weight_n:.3g} N of {earlier.utc} said {earlier.stiffness:.2f} times: compare "
                    "weight and unit; if the earlier one was wrong: --anew"
                )
        shrunk = square(prior) / (square(prior) + square(deviation))
        return StoredSilicone.of(model.hash, self.weight_n, exp(shrunk * found), float(np.sqrt(shrunk)) * deviation)

    def _doubts(self, stiffness: float) -> list[str]:
        """Without `tolerance.modulus` any cure is accepted, and a wrong weight with it."""
        if abs(log(stiffness)) <= RARELY * self.config.structure_tolerance().scale_deviation:
            return []
        return [
            f"{stiffness:.2f} times as stiff as the model's, which is rare: is the weight right? "
            "`fmfts-daemon weigh 100g --anew` weighs again"
        ]

    @property
    def _prior(self) -> float:
        """Deviation of the logarithm of the stiffness, before anything was weighed."""
        tolerance = self.config.structure_tolerance()
        is_said = self.config.tolerance.modulus is not None or self.config.contact.model not in SHIPPED_PATHS
        return tolerance.scale_deviation if is_said else hypot(ANY_CURE, tolerance.scale_deviation)

    def _of_width(self, model: ContactModel, force_n: float) -> tuple[float, float]:
        """The model's force for this width, over that for the probe; and the deviation of its logarithm."""
        probe = model.reads(force_n, PROBE_M)
        widths_m = self.config.structure_tolerance().finger_m
        width_m = widths_m[0] if widths_m[0] == widths_m[1] else None
        if (known_m := self.width_m or width_m) is not None:
            ratio = model.reads(force_n, known_m) / probe
            return ratio, SHAPE_SHARE * abs(log(ratio))
        return 1.0, max(abs(log(model.reads(force_n, each) / probe)) for each in widths_m) / 2.0


@dataclass(frozen=True, slots=True)
class _Reading:
    x_m: float
    x_sd_m: float
    y_m: float
    y_sd_m: float
    force_n: float
    force_sd_n: float


def _is_rather_twice(away: float, twice: float) -> bool:
    """Whether half or twice the weight is too likely. away: of what is said; twice: a factor of two, in deviations."""
    likelier = exp((square(away) - square(away - twice)) / 2.0) * MISTAKEN / (1.0 - MISTAKEN)
    return away > UNLIKELY and bool(likelier > DOUBT / (1.0 - DOUBT))


def _require_still(frames: Sequence[Frame], before: Baseline) -> None:
    assert before.rest is not None
    try:
        recording = summarise(frames)
    except BaselineError as error:
        if "the field moves" not in str(error):
            raise
        raise BaselineError(
            f"the weight does not stand still: {error}; take the hand off, and give the silicone ten seconds to settle"
        ) from error
    noise, usual = (
        float(np.sqrt(np.mean(square(each)))) for each in (recording.noise_t, np.array(before.rest.noise_t))
    )
    if noise > TREMBLING * usual:
        raise BaselineError(
            f"the field trembles {noise / usual:.1f} times as much as that of the untouched pad: take the hand off the "
            "weight, stop motors, and weigh again"
        )


def _read(config: PadConfig, model: ContactModel, frames: Sequence[Frame], baseline: Baseline) -> _Reading:
    """The mean place and force of these frames. Deviations are those of one frame: noise is their smallest part."""
    pipeline = pipeline_of(config, model, boot="")
    pipeline.use(baseline)
    begun_us = frames[0].device_time_us + 1e6 * SETTLED_S
    messages = [pipeline.process(frame) for frame in frames]
    told = [one for frame, one in zip(frames, messages, strict=True) if frame.device_time_us >= begun_us]
    _require_sound(told)
    pressed = [
        (one.x_m, one.x_sd_m, one.y_m, one.y_sd_m, one.force_n, one.force_sd_n)
        for one in told
        if one.contact and one.x_m is not None
    ]
    if len(pressed) < MOSTLY * len(told):
        raise BaselineError("no weight is detected: put it on the middle of the pad, let go, and weigh again")
    return _Reading(*np.array(pressed, dtype=float).mean(axis=0).tolist())


def _require_sound(told: Sequence[ContactMessage]) -> None:
    unsound = Counter(f"{one.health}: {one.reason}" for one in told if one.health != "ok")
    if unsound.total() > (1.0 - MOSTLY) * len(told):
        ((what, _),) = unsound.most_common(1)
        raise BaselineError(
            f"the pad is {what}: take away what is of iron, also the weight if it is (brass, glass and water are "
            "not), and weigh again"
        )
    if sum(one.over_range for one in told) > (1.0 - MOSTLY) * len(told):
        raise BaselineError("the weight is more than the contact model knows on this silicone: take half of it")
