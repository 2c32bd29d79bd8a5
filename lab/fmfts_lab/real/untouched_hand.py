"""A hand that moves and touches nothing: what a skin on it reports, with its posture taught and without.

leaphand's rows have the fields of four AnySkin boards (µT, the sensors' axes) and sixteen joints (counts of motors that
divide a turn into 4096). Nothing says when a row was taken: they are taken for even at 50 Hz. A press is added to the
fields: of four dipoles in a skin that moves so far that 0.3 N change the field as eFlesh's recorded presses of 0.3 N do
(60 µT rms over the fifteen values: 32 rows of eflesh_normal_1 with 20 to 40 g).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import msgspec
import numpy as np

from fmfts.baseline import Baseline, make_rest
from fmfts.baseline.posture import StoredPosture
from fmfts.baseline.posture_fit import fit_posture
from fmfts.baseline.recording import Recording
from fmfts.bus.messages import ContactMessage
from fmfts.config import ContactConfig, GeometryConfig, PadConfig, SceneConfig
from fmfts.pad import Array
from fmfts.pose.hand import Hand
from fmfts.sensor import Frame
from fmfts.sensor.chips import CHIPS
from fmfts_skin.calibrate.field_fit import make_response
from fmfts_skin.calibrate.field_set import FieldSet
from fmfts_skin.field_response import FieldResponse
from fmfts_skin.model import SkinModel
from fmfts_skin.pipeline import SkinPipeline
from fmfts_skin.settings import AnyskinSource

SKINS, JOINTS, RATE_HZ = 4, 16, 50
RAD_PER_COUNT = 2.0 * np.pi / 4096.0
JUMPS = 12  # the first rows, in which the joints jump
STILL_ROWS = 15
PRESS_N, PRESS_UT = 0.3, 60.0
PLACES_MM = (-5.0, 0.0, 5.0)
NAMES = tuple(f"joint_{number}" for number in range(JOINTS))


@dataclass(frozen=True)
class HandRows:
    """field_ut (K, 4, 15), joints_rad (K, 16), without the rows in which the joints jump."""

    name: str
    field_ut: Array
    joints_rad: Array

    @classmethod
    def of(cls, path: Path) -> HandRows:
        rows = np.loadtxt(path)[JUMPS:]
        fields = rows[:, : 15 * SKINS].reshape(-1, SKINS, 15)
        return cls(path.stem, fields, rows[:, 15 * SKINS :] * RAD_PER_COUNT)

    def rest(self, skin: int) -> slice:
        """The stillest rows."""
        moved = np.abs(np.diff(self.field_ut[:, skin], axis=0)).mean(axis=1)
        sums = np.convolve(moved, np.ones(STILL_ROWS - 1), mode="valid")
        first = int(np.argmin(sums))
        return slice(first, first + STILL_ROWS)


@dataclass
class Reported:
    """The counts of one skin over one recording: rows, of these disturbed, with a contact, or not ok; presses, of these
    found.
    """

    rows: int = 0
    disturbed: int = 0
    touching: int = 0
    degraded: int = 0
    presses: int = 0
    found: int = 0
    beyond: int = 0  # detected presses whose force is wrong by more than five deviations
    when: list[int] = field(default_factory=list)  # disturbed rows

    def __add__(self, other: Reported) -> Reported:
        return Reported(
            self.rows + other.rows,
            self.disturbed + other.disturbed,
            self.touching + other.touching,
            self.degraded + other.degraded,
            self.presses + other.presses,
            self.found + other.found,
            self.beyond + other.beyond,
            [*self.when, *other.when],
        )


class HandPad:
    """One skin of the hand, as the daemon judges it."""

    def __init__(self, scene: SceneConfig) -> None:
        self.config = PadConfig(
            name="skin",
            source=AnyskinSource(port="/dev/null", rate_hz=RATE_HZ),
            geometry=GeometryConfig(board="anyskin5"),
            contact=ContactConfig(model="skin.response"),
            scene=scene,
        )
        self.pad = self.config.pad()
        self.by_ambient: Array = self.pad.sensors.axes.transpose(0, 2, 1).reshape(-1, 3)

    def rested(self, rows: HandRows, skin: int) -> Baseline:
        still = rows.field_ut[rows.rest(skin), skin] * 1e-6
        noise = np.diff(rows.field_ut[:, skin], axis=0).std(axis=0) * 1e-6 / np.sqrt(2.0)
        quiet = np.full((5, 3), float(np.quantile(noise, 0.1)))
        samples = np.full(5, len(still), dtype=np.int64)
        recording = Recording(still.mean(axis=0).reshape(5, 3), quiet, samples, 0, None, STILL_ROWS / RATE_HZ)
        return make_rest(self.pad, self.config.tolerance.si(), recording, None)[0]

    def taught(self, rows: HandRows, skin: int, joints: bool = True) -> StoredPosture:
        """The result of `baseline --posture` on this recording."""
        change = (rows.field_ut[:, skin] - rows.field_ut[rows.rest(skin), skin].mean(axis=0)) * 1e-6
        positions = rows.joints_rad if joints else np.empty((len(change), 0))
        return StoredPosture.of(fit_posture(NAMES if joints else (), positions, change, self.by_ambient))

    def pipeline(self, baseline: Baseline, response: FieldResponse) -> SkinPipeline:
        hand = Hand(15) if self.config.scene.ambient == "posture" else None
        model = SkinModel(response, "synthetic")
        pipeline = SkinPipeline(self.pad, model, "boot", float(RATE_HZ), 1e-4, -0.0012, hand)
        pipeline.use(baseline)
        return pipeline

    def frames(self, field_ut: Array) -> Iterator[Frame]:
        chip = CHIPS["mlx90393_streamed"]
        step_t = np.asarray(chip.step_t[0])
        for number, row in enumerate(field_ut):
            time_us = (number + 1) * 1_000_000 // RATE_HZ
            counts = np.rint(row.reshape(5, 3) * 1e-6 / step_t).astype(np.int16)
            yield Frame(
                *(0, number, time_us, time_us * 1000, 0, counts, np.zeros(5, dtype=np.uint16)),
                *(np.ones(5, dtype=np.bool_), np.ones(5, dtype=np.bool_), None),
                chip=chip,
            )

    def messages(self, pipeline: SkinPipeline, field_ut: Array, joints_rad: Array | None) -> list[ContactMessage]:
        told = []
        for number, frame in enumerate(self.frames(field_ut)):
            if joints_rad is not None and pipeline.hand is not None:
                pipeline.hand.take(dict(zip(NAMES, joints_rad[number].tolist(), strict=True)), frame.host_time_ns)
            told.append(pipeline.process(frame))
        return told


def reported(
    pad: HandPad, rows: HandRows, skin: int, posture: StoredPosture | None, with_joints: bool, press_every: int = 0
) -> Reported:
    """The messages of a skin over a recording, and of presses that are added to some of its rows.

    posture: as taught on another recording; None: nothing was. press_every: rows between two presses; 0: no press.
    """
    baseline = pad.rested(rows, skin)
    if posture is not None:
        still = rows.joints_rad[rows.rest(skin)].mean(axis=0)
        known = tuple(still.tolist()) if with_joints and posture.names else None
        posture = msgspec.structs.replace(posture, rest_rad=known, rest_unknown=known is None)
        baseline = msgspec.structs.replace(baseline, posture=posture).sealed()
    joints = rows.joints_rad if with_joints else None
    fields, response = rows.field_ut[:, skin], synthetic_response()
    untouched = pad.messages(pad.pipeline(baseline, response), fields, joints)
    out = Reported(len(untouched))
    for number, message in enumerate(untouched):
        out.disturbed += message.health == "disturbed"
        out.when += [number] if message.health == "disturbed" else []
        out.touching += bool(message.contact)
        out.degraded += message.health == "degraded"
    if press_every:
        _press(pad, out, baseline, response, fields, joints, press_every)
    return out


def _press(
    pad: HandPad,
    out: Reported,
    baseline: Baseline,
    response: FieldResponse,
    fields: Array,
    joints: Array | None,
    every: int,
) -> None:
    """Adds a press of three rows at every so many rows, in turn at nine places."""
    places = [(x, y) for x in PLACES_MM for y in PLACES_MM]
    pressed = fields.copy()
    starts = list(range(every, len(fields) - 3, every))
    for number, start in enumerate(starts):
        x, y = places[number % len(places)]
        pressed[start : start + 3] += press_ut(np.array([[x, y, PRESS_N]]))[0]
    told = pad.messages(pad.pipeline(baseline, response), pressed, joints)
    for start in starts:
        mine = [one for one in told[start : start + 3] if one.contact]
        out.presses += 1
        out.found += bool(mine)
        out.beyond += sum(
            one.force_n is not None and one.force_sd_n is not None and abs(one.force_n - PRESS_N) > 5.0 * one.force_sd_n
            for one in mine
        )


@cache
def mm_of_a_newton() -> float:
    """The depth at which the synthetic skin changes the field by PRESS_UT rms over nine places, under 0.3 N."""
    low, high = 0.01, 20.0
    press = np.array([[x, y, 1.0] for x in PLACES_MM for y in PLACES_MM])
    for _ in range(60):
        middle = (low + high) / 2.0
        change = dipoles_ut(press * np.array([1.0, 1.0, PRESS_N * middle])) - dipoles_ut(np.zeros((1, 3)))
        low, high = (low, middle) if np.sqrt((change**2).mean()) > PRESS_UT else (middle, high)
    return low


def press_ut(press: Array) -> Array:
    """(K, 15) µT, in the sensors' axes, that presses x, y in mm and force in N (K, 3) change."""
    scaled = press * np.array([1.0, 1.0, mm_of_a_newton()])
    return dipoles_ut(scaled) - dipoles_ut(np.zeros((1, 3)))


@cache
def synthetic_response() -> FieldResponse:
    """The table that `calibrate` makes of noisy presses of the same skin."""
    random = np.random.default_rng(1)
    press = np.column_stack([random.uniform(-9.0, 9.0, (1500, 2)), random.uniform(0.03, 2.0, 1500)])
    fields = press_ut(press) + dipoles_ut(np.zeros((1, 3))) + random.normal(0.0, 4.0, (len(press), 15))
    nothing = np.zeros(len(press), dtype=np.bool_), np.zeros(len(press), dtype=np.intp)
    data = FieldSet(("x_mm", "y_mm", "force_n"), press, fields, *nothing, ("skin",), "none")
    return make_response(data, "synthetic skin", lambda line: None)


MAGNETS_MM = np.array([[6.0, 6.0, 9.0], [-6.0, 6.0, 9.0], [6.0, -6.0, 9.0], [-6.0, -6.0, 9.0]])
MOMENTS_AM2 = 0.4 * np.array([0.05, -0.05, -0.05, 0.05])
SPREAD_MM = 6.0


def dipoles_ut(press: Array) -> Array:
    """(K, 15) µT in the sensors' axes: four dipoles that a press x, y, depth (K, 3) in mm pushes down and apart."""
    drawn = GeometryConfig(board="anyskin5")
    apart = MAGNETS_MM[:, :2] - press[:, None, :2]
    share = np.exp(-(apart**2).sum(axis=2) / (2.0 * SPREAD_MM**2))[:, :, None] * press[:, None, 2:]
    moved = MAGNETS_MM + np.concatenate([0.15 * share * apart / SPREAD_MM, -0.4 * share], axis=2)
    way = (np.array(drawn.sensors_mm)[None, :, None] - moved[:, None]) * 1e-3
    far = np.sqrt((way**2).sum(axis=3))[..., None]
    moment = MOMENTS_AM2[:, None] * np.array([0.0, 0.0, 1.0])
    along = (way * moment).sum(axis=3)[..., None]
    field = (1e-7 * (3.0 * way * along / far**5 - moment / far**3)).sum(axis=2) * 1e6
    turned: Array = HandPad(SceneConfig()).pad.sensors.to_sensor(field)
    return turned.reshape(len(press), -1)


SCENES = {
    "nothing known of the hand": ("drifting", False, False),
    "taught on the other recording, with joints": ("posture", True, True),
    "taught on the other recording, without joints": ("posture", True, False),
}
PRESS_EVERY = 7


def judged(recordings: list[HandRows]) -> Iterator[tuple[str, str, list[Reported]]]:
    """Scene, recording, and what each skin reports: each recording by what the next one taught."""
    for name, (ambient, is_taught, with_joints) in SCENES.items():
        pad = HandPad(msgspec.convert({"ambient": ambient}, SceneConfig))
        for number, rows in enumerate(recordings):
            other = recordings[(number + 1) % len(recordings)]
            each = []
            for skin in range(SKINS):
                posture = pad.taught(other, skin, with_joints) if is_taught else None
                each.append(reported(pad, rows, skin, posture, with_joints, PRESS_EVERY))
            yield name, rows.name, each


def posture_errors(pad: HandPad, rows: HandRows, skin: int, posture: StoredPosture) -> Array:
    """(2, K, 15): errors of the uneven field that another recording taught, in deviations: of what left-out parts of
    that recording showed alone, and of the whole covariance."""
    rest, by = rows.rest(skin), pad.by_ambient
    uneven = np.eye(len(by)) - by @ np.linalg.solve(by.T @ by, by.T)
    rest_rad = tuple(rows.joints_rad[rest].mean(axis=0).tolist())
    model = msgspec.structs.replace(posture, rest_rad=rest_rad).model()
    change_t = (rows.field_ut[:, skin] - rows.field_ut[rest, skin].mean(axis=0)) * 1e-6
    told = [model.predicted(one) for one in rows.joints_rad]
    error_t = (change_t - np.array([one.field_t for one in told])) @ uneven
    variances = [np.diagonal(uneven @ of @ uneven) for of in (model.left_t2, *(one.covariance_t2 for one in told))]
    return np.stack([error_t / np.sqrt(variances[0]), error_t / np.sqrt(variances[1:])])


def coverage(recordings: list[HandRows]) -> Iterator[tuple[str, Array]]:
    """Recording, and (2, skins, K, 15) `posture_errors` by what the next one taught."""
    pad = HandPad(SceneConfig(ambient="posture"))
    for number, rows in enumerate(recordings):
        other = recordings[(number + 1) % len(recordings)]
        errors = [posture_errors(pad, rows, skin, pad.taught(other, skin)) for skin in range(SKINS)]
        yield rows.name, np.stack(errors, axis=1)


def line_of(reports: list[Reported]) -> str:
    """The figures of several skins in one line."""
    total = reports[0]
    for one in reports[1:]:
        total = total + one
    return (
        f"disturbed {total.disturbed / total.rows:.1%} of {total.rows} rows, {total.touching} false contacts; "
        f"presses of {PRESS_N:g} N found {total.found} of {total.presses} ({total.found / total.presses:.1%}), "
        f"{total.beyond} of their forces beyond five deviations"
    )
