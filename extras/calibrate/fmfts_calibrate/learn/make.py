"""`baseline --learn`: picks the presses of a recording, learns the geometry from them, and makes a baseline of both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from fmfts.baseline.baseline import UNKNOWN_MAGNETS, Baseline, require_rest
from fmfts.baseline.file_format import StoredGeometry, StoredPresses
from fmfts.baseline.learned import LearnedGeometry
from fmfts.baseline.learner import LEARN_PRESSES
from fmfts.baseline.mounting import Mounting
from fmfts.baseline.recording import BaselineError
from fmfts.baseline.refine import STEADY_T, PressFields
from fmfts.baseline.request import LEARN_S
from fmfts.baseline.unknowns import STANDING_AMBIENT_T
from fmfts.baseline.window_means import Means, means
from fmfts.pad import Pad, Tolerance
from fmfts.pose.state import POSITION
from fmfts.sensor import Frame
from fmfts_calibrate.learn.drawing import FIRST_PLACE, Drawing
from fmfts_calibrate.learn.fit import Fields
from fmfts_calibrate.learn.next_press import next_press
from fmfts_calibrate.learn.search import (
    Learned,
    LearnError,
    covariance_of,
    information_of,
    learn,
    octupole_factor,
    with_octupole,
)
from fmfts_calibrate.learn.uniqueness import common_motions, relative_place_deviation_m, spread_of_tilts

Array = NDArray[np.float64]

FEWEST, MOST = 30, 100
# Presses whose fields are nearer than this to each other, or to rest, are redundant.
NEAREST_T = 1.5e-6
# Suggested places: the middle, and half and nearly all the way to each side and corner, pressed two ways.
REACH_MM, FORCES_N = (0.0, 5.0, 9.0), (0.5, 1.8)


@dataclass(frozen=True, slots=True)
class _Known:
    """The knowledge before a press: the pad with the drawing's tolerances, and the magnet's field untouched."""

    drawing: Drawing
    gain: Array
    bare_t: Array
    rest_t: Array
    rest_deviation_t: Array

    @classmethod
    def of(cls, pad: Pad, before: Baseline) -> _Known:
        assert before.bare is not None
        assert before.rest is not None
        tolerance, gain = Tolerance(**before.tolerance), np.ones((len(pad.sensors), 3))
        if before.gains is not None:
            gain, tolerance = np.array(before.gains.gain), replace(tolerance, gain=before.gains.deviation)
        bare, rest = before.bare.recording(), before.rest.recording()
        noise = np.sqrt(rest.mean_deviation_t**2 + bare.mean_deviation_t**2)
        return cls(Drawing(pad, tolerance), gain, bare.mean_t, rest.mean_t, noise)

    def fields(self, raw_t: Array, noise_t: Array) -> Fields:
        away = np.linalg.norm(self.drawing.pad.sensors.position_m - self.drawing.pad.rest_position_m, axis=1).min()
        other_t = np.hypot(STANDING_AMBIENT_T, self.drawing.pad.magnet.beyond_octupole_t(float(away)))
        return Fields(
            (self.rest_t - self.bare_t) / self.gain,
            (raw_t - self.bare_t) / self.gain,
            np.hypot(self.rest_deviation_t, other_t),
            np.hypot(noise_t, other_t),
        )


def make_learned(pad: Pad, means: Means, before: Baseline | None) -> tuple[Baseline, Mounting, dict[str, Any]]:
    """`before` with the geometry from presses, its mounting, and the facts.

    `before` must have bare and rest. Presses that an earlier --learn kept count as well. BaselineError if the presses
    are too few, fit no pad, or leave more than one answer.
    """
    require_rest(before, "--learn")
    assert before is not None
    require_learnable(pad, before)
    known = _Known.of(pad, before)
    noise_t = means.noise_t / np.sqrt(means.mean_of)
    earlier = [] if before.learned is None or before.refine is None else [before.refine.presses().field_t]
    steady = means.field_t[means.wander_t < STEADY_T + 4.0 * float(noise_t.max())]
    raw_t = spread_out(np.concatenate([*earlier, steady]), known.rest_t)
    if len(raw_t) < FEWEST:
        raise BaselineError(
            f"only {len(raw_t)} different presses were found, of at least {FEWEST}: press some 60 times, each for a "
            "moment, all over the pad and from lightly to firmly"
        )
    fields = known.fields(raw_t, noise_t)
    try:
        learned = learn(known.drawing, fields)
    except LearnError as error:
        raise BaselineError(
            f"{error}: hold the robot still, keep steel away, and press with a finger; if the drawing may be further "
            "off than its tolerances say, make them wider"
        ) from error
    told = next_place(learned, fields)
    if learned.open:
        raise BaselineError(f"the answer is not unique: {'; and '.join(learned.open)}. {told}")
    kept = PressFields(raw_t[learned.used], noise_t * learned.inflation, known.rest_t)
    geometry = StoredGeometry.of(_found(learned))
    stored = StoredPresses.of(kept)
    baseline = msgspec.structs.replace(before, turn=None, refine=stored, learned=geometry).sealed()
    return baseline, baseline.mounting(pad), _facts(learned, fields) | {"press_next": told}


class FromPresses:
    """The `Learner` of a request."""

    option, seconds, presses, weight_n = "--learn", LEARN_S, LEARN_PRESSES, 0.0

    def require(self, pad: Pad, before: Baseline) -> None:
        require_learnable(pad, before)

    def make(
        self, pad: Pad, frames: Sequence[Frame], before: Baseline | None
    ) -> tuple[Baseline, Mounting, dict[str, Any]]:
        return make_learned(pad, means(frames), before)


def require_learnable(pad: Pad, before: Baseline) -> None:
    """BaselineError unless one known magnet and a bare recording are there."""
    if not pad.are_magnets_known:
        raise BaselineError(UNKNOWN_MAGNETS)
    if pad.other_magnets:
        raise BaselineError("a pad with several magnets has no --learn: its sensors' places must be measured")
    if before.bare is None:
        raise BaselineError(
            "bare is not recorded, and with a rough drawing the chips' zeros look like the magnet's field: take the "
            "pad off, `fmfts-daemon baseline --bare`, mount it, `--rest`, then --learn"
        )


def spread_out(raw_t: Array, rest_t: Array) -> Array:
    """(K, N, 3) fields as far from each other and from rest as possible, since the magnet's place is still unknown."""
    distance = _apart(raw_t, rest_t)
    chosen: list[int] = []
    while len(chosen) < min(MOST, len(raw_t)) and distance.max() > NEAREST_T:
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, _apart(raw_t, raw_t[chosen[-1]]))
    return raw_t[chosen]


def _apart(raw_t: Array, other_t: Array) -> Array:
    """(K,) distances of fields from another one, by their common values."""
    return np.asarray(np.sqrt(np.nansum((raw_t - other_t) ** 2, axis=(1, 2))), dtype=np.float64)


def next_place(learned: Learned, fields: Fields) -> str:
    """The most informative next press, in a sentence. The silicone is assumed to be the standard pad's."""
    from fmfts.config import PadConfig, SimulatedSource
    from fmfts.contact import ContactModel

    standard = PadConfig(name="standard", source=SimulatedSource()).pad()
    response = ContactModel.load("default", standard).response
    assert response is not None
    sides = sorted({sign * reach + 0.0 for reach in REACH_MM for sign in (-1.0, 1.0)})
    presses = np.array([(x, y, force) for x in sides for y in sides for force in FORCES_N])
    steps = response.without_shear().change(presses) * np.array([1e-3, 1e-3, 1e-3, 1.0, 1.0])
    found = next_press(learned, fields, steps)
    x, y, force = presses[found.number]
    firmly = "firmly" if force == FORCES_N[-1] else "lightly"
    return (
        f"press next at about ({x:.0f}, {y:.0f}) mm, {firmly}: ten such presses bring the worst sensor's place from "
        f"±{found.now_m * 1e3:.3f} to ±{found.then_m * 1e3:.3f} mm"
    )


def _found(learned: Learned) -> LearnedGeometry:
    drawing, vector = learned.drawing, learned.fit.vector
    count = len(drawing.pad.sensors)
    values = (drawing.deviation * vector)[FIRST_PLACE:].reshape(4, count, 3)
    places = drawing.geometry(vector).sensors.position_m
    return LearnedGeometry(
        places, values[1], np.column_stack([learned.fit.poses[:, POSITION], learned.fit.poses[:, 3:6]])
    )


def _facts(learned: Learned, fields: Fields) -> dict[str, Any]:
    drawing, fit, count = learned.drawing, learned.fit, 3 * len(learned.drawing.pad.sensors)
    covariance = covariance_of(fit, learned.inflation)
    common = common_motions(drawing, fit)
    motion = np.sqrt(np.diagonal(common @ covariance @ common.T))
    deviation = np.sqrt(np.diagonal(covariance)) * drawing.deviation
    widened = replace(fit, information=information_of(fit, learned.inflation))
    factor = octupole_factor(with_octupole(learned, fields))
    return {
        "presses": int(learned.used.sum()),
        "presses_left_out": int((~learned.used).sum()),
        "starts_that_agree": f"{learned.agreeing} of {learned.starts}",
        "length_scale_sd": float(motion[0]),
        "pad_axes_sd_rad": motion[1:].tolist(),
        "tilts_of_presses_rad": spread_of_tilts(fit),
        "sensor_places_m": drawing.geometry(fit.vector).sensors.position_m.ravel().tolist(),
        "sensor_places_sd_m": deviation[FIRST_PLACE : FIRST_PLACE + count].tolist(),
        "sensor_places_against_each_other_sd_m": float(relative_place_deviation_m(drawing, widened).max()),
        "sensor_rotations_rad": (drawing.deviation * fit.vector)[
            FIRST_PLACE + count : FIRST_PLACE + 2 * count
        ].tolist(),
        "sensor_rotations_sd_rad": deviation[FIRST_PLACE + count : FIRST_PLACE + 2 * count].tolist(),
        **({} if factor is None else {"octupole_against_the_drawing": factor}),
    }
