"""A pad that a script presses, as packets: the exact field at each frame's chips stays known.

Every frame carries a watermark in its temperature, which names the frame of a contact whatever time that claims. The
magnet follows that temperature, like a real one.
"""

from __future__ import annotations

import random
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from fmfts.baseline import encode
from fmfts.baseline.baseline import make_bare, make_rest
from fmfts.baseline.origin import Origin
from fmfts.baseline.recording import Recording
from fmfts.config import PadConfig, SimulatedSource
from fmfts.pad import Array, Pad
from fmfts_lab.bench.recorded import pressed_field
from fmfts_simulation.mounted import MountedPad

RATE_HZ = 220
CONFIG = PadConfig(name="p", source=SimulatedSource())
PAD = CONFIG.pad()
CHIP = PAD.chip
GAIN_CODE = 3
# Watermarks: temperatures of 25 °C ± 8 K in steps of 1/128 K. After 9 s they repeat.
MARKS = 2048
MIDDLE_C, STEP_C = 25.0, 1.0 / 128.0
PLACES, LEVELS = 12, 20
REACH_M, FORCES_N = 6e-3, (0.4, 1.2)
# In frames. A filter with hysteresis has converged to a force that was constant for SETTLED of them.
PAUSE, RAMP, HOLD = 110, 22, 154
SETTLED = 14
LIFT_M = 2e-3


class Touch(NamedTuple):
    """The finger in one frame. standing: for how many frames the force has been the same."""

    x_m: float
    y_m: float
    force_n: float
    standing: int


def mark_c(mark: int) -> float:
    """The temperature that encodes this watermark."""
    return MIDDLE_C + (mark - MARKS // 2) * STEP_C


class Library:
    """Fields of the pad as built, T (4, 3): at rest, pulled up, and at LEVELS forces at PLACES places."""

    def __init__(self, seed: int) -> None:
        random_ = np.random.default_rng(seed)
        built = MountedPad.exact(PAD)
        self.places_m = random_.uniform(-REACH_M, REACH_M, (PLACES, 2))
        self.forces_n = random_.uniform(*FORCES_N, PLACES)
        self.rest_t = pressed_field(built, 0.0, 0.0, 0.0)
        self.pressed_t = np.array(
            [
                [pressed_field(built, x, y, force * level / LEVELS) for level in range(1, LEVELS + 1)]
                for (x, y), force in zip(self.places_m, self.forces_n, strict=True)
            ]
        )
        above = PAD.rest_position_m + np.array([0.0, 0.0, LIFT_M])
        self.lifted_t = pressed_field(MountedPad.exact(_moved(above)), 0.0, 0.0, 0.0)
        self.dice = random.Random(seed)
        self.noise = random_.normal(0.0, CHIP.noise_t, (4096, 4, 3))

    def baseline(self, name: str, origin: Origin) -> bytes:
        """The file of a baseline of this pad, recorded for three seconds before and three after mounting."""
        tolerance = CONFIG.tolerance.si()
        noise = np.full((4, 3), np.hypot(CHIP.noise_t, CHIP.step_t[GAIN_CODE, 0] / np.sqrt(12.0)))
        pad = _named(name)

        def recorded(field_t: Array) -> Recording:
            return Recording(field_t, noise, np.full(4, 660), GAIN_CODE, MIDDLE_C, 3.0)

        bare = make_bare(pad, tolerance, recorded(np.zeros((4, 3))))
        rest, _ = make_rest(pad, tolerance, recorded(self.rest_t), bare)
        return encode(rest.recorded_on(origin))


class Finger:
    """Presses of one pad, frame by frame."""

    def __init__(self, library: Library, seed: int) -> None:
        self._library = library
        self._dice = random.Random(seed)
        self._at = self._dice.randrange(PAUSE)
        self._place = self._dice.randrange(PLACES)
        self._standing = 0

    def next(self) -> tuple[Touch, Array]:
        """The next frame's touch, and its field (4, 3) in T."""
        at = self._at
        rising, falling = at - PAUSE, PAUSE + RAMP + HOLD + RAMP - at
        level = min(max(min(rising, falling), 0) * LEVELS // RAMP, LEVELS)
        self._at += 1
        if falling <= 0:
            self._at, self._place = 0, self._dice.randrange(PLACES)
        self._standing = self._standing + 1 if level in (0, LEVELS) else 0
        library, place = self._library, self._place
        if not level:
            return Touch(0.0, 0.0, 0.0, self._standing), library.rest_t
        x_m, y_m = library.places_m[place].tolist()
        force_n = float(library.forces_n[place]) * level / LEVELS
        return Touch(x_m, y_m, force_n, self._standing), library.pressed_t[place, level - 1]


def counts_of(library: Library, field_t: Array, mark: int) -> Array:
    """The chips' readings (4, 3) of a field, with noise, at the magnet temperature of the watermark."""
    warm = 1.0 + CONFIG.magnet.temperature_coefficient_per_k * (mark_c(mark) - MIDDLE_C)
    seen = field_t * warm + library.noise[library.dice.randrange(len(library.noise))]
    return np.rint(seen / CHIP.step_t[GAIN_CODE]).astype(np.int16)


def _moved(rest_m: Array) -> Pad:
    return replace(PAD, rest_position_m=rest_m)


def _named(name: str) -> Pad:
    return replace(PAD, name=name)
