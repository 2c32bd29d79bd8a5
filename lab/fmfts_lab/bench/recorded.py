"""The baselines of a built pad, and the mounting from each: exact fields, as means of noisy frames."""

from __future__ import annotations

import numpy as np

from fmfts.baseline import Baseline, Means, Mounting, Recording, make_bare, make_refined, make_rest, make_turn
from fmfts.baseline.file_format import StoredGains
from fmfts.pad import Pad, Tolerance, rotation_from_vector
from fmfts.sensor.chips import HMC5983, NOISE_T
from fmfts.sensor.chips.selftest import strap_of
from fmfts_lab.bench.workspace import Array
from fmfts_simulation.mounted import MountedPad

FRAMES, MEAN_OF = 660, 11
ORIENTATIONS, PRESSES = 100, 30
# Change of the field's strength from one attitude of the robot to the next, as in a room with steel in it.
UNEVEN = 0.005
KINDS = ("rest only", "bare + rest", "+ turn", "+ refine", "+ turn + refine")


def mountings(
    built: MountedPad,
    drawing: Pad,
    tolerance: Tolerance,
    random: np.random.Generator,
    noise_t: float = NOISE_T,
    gains: StoredGains | None = None,
) -> dict[str, Mounting]:
    """One mounting for each of KINDS. noise_t: the real noise of one frame; the recordings state NOISE_T. gains: of a
    self-test, None: there was none."""
    _, alone = bare_and_rest(built, drawing, tolerance, random, noise_t, with_bare=False, gains=gains)
    both, mounting = bare_and_rest(built, drawing, tolerance, random, noise_t, gains=gains)
    turn, presses = _turned(built, random, noise_t), _pressed(built, random, noise_t)
    turned, after_turn = make_turn(drawing, turn, both)
    assert isinstance(after_turn, Mounting)  # of one magnet
    refined, refined_after_turn = (make_refined(drawing, presses, before)[1] for before in (both, turned))
    return dict(zip(KINDS, (alone, mounting, after_turn, refined, refined_after_turn), strict=True))


def bare_and_rest(
    built: MountedPad,
    drawing: Pad,
    tolerance: Tolerance,
    random: np.random.Generator,
    noise_t: float = NOISE_T,
    with_bare: bool = True,
    gains: StoredGains | None = None,
) -> tuple[Baseline, Mounting]:
    def recording(field: Array) -> Recording:
        mean = field + random.normal(0.0, noise_t / np.sqrt(FRAMES), field.shape)
        return Recording(mean, np.full(field.shape, NOISE_T), np.full(len(field), FRAMES), 3, 25.0, 3.0)

    bare = recording(built.sensed(np.tile(built.ambient_t, (len(drawing.sensors), 1))))
    before = make_bare(drawing, tolerance, bare, gains=gains) if with_bare else None
    rest = recording(pressed_field(built, 0.0, 0.0, 0.0))
    baseline, mounting = make_rest(drawing, tolerance, rest, before, gains=gains)
    assert isinstance(mounting, Mounting)  # of one magnet
    return baseline, mounting


def selftested(built: MountedPad, random: np.random.Generator) -> StoredGains:
    """What a self-test finds: the gains, each with the error of its strap's field."""
    strap = strap_of(HMC5983)
    found = built.gain * random.normal(1.0, strap.deviation, built.gain.shape)
    return StoredGains("", tuple((float(x), float(y), float(z)) for x, y, z in found), strap.deviation)


def pressed_field(built: MountedPad, *press: float, ambient_t: Array | None = None) -> Array:
    """(N, 3) field of a pressed pad in sensor axes, without noise. press: x, y in m, force, and shear x, y if any."""
    at = (np.full(len(built.pad.sensors), value) for value in press)
    return built.sensed(built.magnet_field(*at) + (built.ambient_t if ambient_t is None else ambient_t))


def _turned(built: MountedPad, random: np.random.Generator, noise_t: float) -> Means:
    """The means that a turn through random attitudes gives."""
    attitudes = [rotation_from_vector(random.normal(0.0, 2.0, 3)) for _ in range(ORIENTATIONS)]
    strength, drawn = random.normal(0.0, UNEVEN, (3, 3)), []
    for attitude in attitudes:
        earth = attitude @ built.ambient_t
        unit = earth / np.linalg.norm(earth)
        drawn.append(pressed_field(built, 0.0, 0.0, 0.0, ambient_t=earth * (1.0 + unit @ strength @ unit)))
    return _means(np.array(drawn), random, noise_t)


def _pressed(built: MountedPad, random: np.random.Generator, noise_t: float) -> Means:
    place, force = random.uniform(-12e-3, 12e-3, (PRESSES, 2)), random.uniform(0.3, 2.0, PRESSES)
    fields = [pressed_field(built, x, y, f) for (x, y), f in zip(place, force, strict=True)]
    return _means(np.array(fields), random, noise_t)


def _means(fields: Array, random: np.random.Generator, noise_t: float) -> Means:
    noisy: Array = fields + random.normal(0.0, noise_t, fields.shape) / np.sqrt(MEAN_OF)
    times = np.linspace(0.0, 20.0, len(fields))
    return Means(noisy, np.zeros(len(fields)), times, np.full(fields.shape[1:], NOISE_T))
