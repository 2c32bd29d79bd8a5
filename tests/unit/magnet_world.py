"""A person who holds a magnet above an emulated board that was built with a mistake, or without one.

Fields are those of a uniformly magnetised cylinder, by magpylib (Ortner and Coliandro Bandeira, SoftwareX 11, 2020),
not by the daemon's dipole. The register-level emulators of tests/emulator turn them into readings, and the daemon's
real drivers read these. A chip with an inverted axis, or with another LSB, is emulated with that property.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import magpylib
import numpy as np
from emulated_bus import Clock, emulated_pad, patched
from scipy.spatial.transform import Rotation

from emulator.chips import Hmc5983
from emulator.magnetometers import Lis3mdl, Mmc5983ma, Qmc5883l
from emulator.mlx90393 import Mlx90393
from fmfts.sensor.chips import CHIPS, TESLA_PER_GAUSS
from fmfts.sensor.frame import Frame, bits
from fmfts_magnet.holding import Held, Hold, readings_of
from fmfts_magnet.readings import Readings

KINDS: dict[str, Any] = {
    "hmc5983": Hmc5983, "qmc5883l": Qmc5883l, "lis3mdl": Lis3mdl, "mmc5983ma": Mmc5983ma, "mlx90393": Mlx90393
}  # fmt: skip
# Gain code and its range in gauss, from the data sheets: HMC5983 ±2.5 G, QMC5883L ±2 G, LIS3MDL ±4 G, MMC5983MA ±8 G.
GAINS = {"hmc5983": (3, 2.5), "qmc5883l": (0, 2.0), "lis3mdl": (0, 4.0), "mmc5983ma": (0, 8.0), "mlx90393": (0, 132.0)}
# Deviations of one sample in gauss, from the same sheets and docs/chips.md.
NOISE_GAUSS = {"hmc5983": 2e-3, "qmc5883l": 2e-3, "lis3mdl": 3.2e-3, "mmc5983ma": 0.8e-3, "mlx90393": 15e-3}
# The largest zero of a chip that a baseline removes.
ZERO_GAUSS = {"hmc5983": 0.02, "qmc5883l": 0.1, "lis3mdl": 0.5, "mmc5983ma": 0.2, "mlx90393": 0.5}
MAGNETS_MM = ((2, 2), (3, 3), (4, 4), (5, 2), (6, 3), (8, 3), (10, 3))  # diameter and length, as they are sold
BOARDS_MM = {
    4: [[8, 8, 0], [8, -8, 0], [-8, 8, 0], [-8, -8, 0]],
    # The plus of a ReSkin or AnySkin board: centre, +y, +x, −y, −x, arms of 7 mm.
    5: [[0, 0, 0], [0, 7, 0], [7, 0, 0], [0, -7, 0], [-7, 0, 0]],
    8: [
        [13.5, 13.5, 0],
        [13.5, -13.5, 0],
        [-13.5, 13.5, 0],
        [-13.5, -13.5, 0],
        [9, 0, 0],
        [-9, 0, 0],
        [0, 9, 0],
        [0, -9, 0],
    ],
}
# Above the middle, then 2 cm to +x, then from the middle 2 cm to +y: the places that the check asks for.
STEPS = np.array([[0.0, 0.0, 0.0], [0.02, 0.0, 0.0], [0.0, 0.02, 0.0]])
RATE_HZ = 75.0
HELD_S = 1.1
PLACE_M, ROTATION_RAD, GAIN = 3e-4, np.radians(1.5), 0.05
JITTER_M, TILT_RAD, TREMBLE_M = 5e-3, np.radians(15.0), 2e-4
AMBIENT_T = 5e-5


class RefusedStepError(Exception):
    """The check refuses a step; the text is its hint."""


@dataclass
class Built:
    """A board as it was built. channel i is wired to the chip at place `wired[i]`, whose axes are turned by `turned[i]`
    (columns: the real axes in those of the drawn chip), and reads `factor[i]` (3,) times the field along each."""

    place_m: np.ndarray
    drawn_axes: np.ndarray
    wired: np.ndarray
    turned: np.ndarray
    factor: np.ndarray


@dataclass
class Person:
    """Holds one magnet: its size, the height, which pole is up, and how well he aims."""

    diameter_m: float
    length_m: float
    remanence_t: float
    height_m: float
    pole: int
    random: np.random.Generator
    directions: np.ndarray = field(default_factory=lambda: STEPS.copy())
    jitter_m: float = JITTER_M
    tilt_rad: float = TILT_RAD

    def poses(self) -> list[tuple[np.ndarray, Rotation]]:
        """For each step: within 5 mm and 15° of the request, as one deviation of a normal hand."""
        found = []
        for step in self.directions:
            place = step + np.array([0.0, 0.0, self.height_m]) + self.random.uniform(-1.0, 1.0, 3) * self.jitter_m
            tilt = self.random.uniform(0.0, self.tilt_rad)
            about = self.random.uniform(0.0, 2.0 * np.pi)
            found.append((place, Rotation.from_rotvec(tilt * np.array([np.cos(about), np.sin(about), 0.0]))))
        return found

    def field(self, points_m: np.ndarray, place_m: np.ndarray, turn: Rotation) -> np.ndarray:
        cylinder = magpylib.magnet.Cylinder(
            dimension=(self.diameter_m, self.length_m),
            polarization=(0.0, 0.0, self.remanence_t * self.pole),
            position=place_m,
            orientation=turn,
        )
        return np.asarray(cylinder.getB(points_m)).reshape(-1, 3)


def good_board(count: int, axes: np.ndarray | None = None) -> Built:
    axes = np.tile(np.eye(3), (count, 1, 1)) if axes is None else axes
    places = np.array(BOARDS_MM[count]) * 1e-3
    return Built(places, axes, np.arange(count), np.tile(np.eye(3), (count, 1, 1)), np.ones((count, 3)))


def person(kind: str, random: np.random.Generator, largest_factor: float = 1.0) -> Person:
    """Lower a magnet until the board sees a good part of its range, as the check asks."""
    diameter, length = (each * 1e-3 for each in MAGNETS_MM[random.integers(len(MAGNETS_MM))])
    wished_gauss = random.uniform(0.25, 0.6) * min(GAINS[kind][1], 8.0) / largest_factor
    one = Person(diameter, length, random.uniform(1.2, 1.35), 0.05, int(random.choice([-1, 1])), random)
    heights = np.linspace(0.015 + length, 0.07, 111)
    seen = np.abs(one.field(np.column_stack([np.zeros((111, 2)), -heights]), np.zeros(3), Rotation.identity())).max(
        axis=1
    )
    one.height_m = float(heights[np.abs(np.log(seen / (wished_gauss * TESLA_PER_GAUSS))).argmin()])
    return one


def measured(built: Built, kind: str, someone: Person, random: np.random.Generator) -> Readings:
    """The check's measurements: without a magnet, then the steps. Raises RefusedStepError if the check refuses one."""
    clock, count = Clock(), len(built.place_m)
    with patched(clock):
        chips = []
        for channel in range(count):
            chip = KINDS[kind](clock, noise_gauss=NOISE_GAUSS[kind], seed=int(random.integers(1 << 30)),
                               clock_error=random.uniform(-0.02, 0.02), phase_s=random.uniform(0.0, 2e-3))  # fmt: skip
            chip.gain = (built.factor[channel] * (1.0 + random.uniform(-GAIN, GAIN, 3))).tolist()
            chips.append(chip)
        places = built.place_m + random.normal(0.0, PLACE_M, (count, 3))
        small = Rotation.from_rotvec(random.normal(0.0, ROTATION_RAD, (count, 3))).as_matrix()
        axes = np.array([
            built.drawn_axes[built.wired[channel]] @ built.turned[channel] @ small[channel] for channel in range(count)
        ])  # fmt: skip
        zero = random.uniform(-1.0, 1.0, (count, 3)) * ZERO_GAUSS[kind] * TESLA_PER_GAUSS
        direction = random.normal(size=3)
        ambient = AMBIENT_T * direction / np.linalg.norm(direction)
        frames = _frames(clock, kind, chips, places[built.wired], axes, zero, ambient)
        before = _held(frames, Hold(), None, random)
        held: list[Held] = []
        for place, turn in someone.poses():
            hold = Hold(before, held[-1] if held else None)
            held.append(_held(frames, hold, (someone, place, turn), random))
    return readings_of(before, held)


def _held(frames: Any, hold: Hold, magnet: Any, random: np.random.Generator) -> Held:
    for number, frame in enumerate(frames(magnet, random)):
        hold.take(frame)
        if hold.held is not None:
            return hold.held
        if number > 6 * HELD_S * RATE_HZ:
            raise RefusedStepError(hold.hint)
    raise AssertionError("frames never end")


def _frames(clock: Clock, kind: str, chips: list[Any], places: np.ndarray, axes: np.ndarray, zero: np.ndarray,
            ambient: np.ndarray) -> Any:  # fmt: skip
    gain_code = GAINS[kind][0]
    rate_hz = min(RATE_HZ, CHIPS[kind].free_rate_hz)
    pad, _ = emulated_pad(clock, kind, chips, gain_code=gain_code, rate_hz=round(rate_hz))
    pad.poll()

    def frames(magnet: Any, random: np.random.Generator) -> Iterator[Frame]:
        number = 0
        while True:
            if number % 10 == 0:  # the hand trembles
                field_t = np.tile(ambient, (len(chips), 1))
                if magnet is not None:
                    someone, place, turn = magnet
                    field_t = field_t + someone.field(places, place + random.normal(0.0, TREMBLE_M, 3), turn)
                own = np.einsum("cij,ci->cj", axes, field_t) + zero
                for chip, each in zip(chips, own, strict=True):
                    chip.feel((each / TESLA_PER_GAUSS).tolist())
            number += 1
            clock.sleep(1.0 / rate_hz)
            pad.poll()
            sample = pad.sample()
            if number > 5:  # the first sample may be of the previous field
                yield Frame(
                    0, sample.sequence, sample.time_us, sample.time_us * 1000, sample.gain_code, sample.counts,
                    sample.age_us, bits(sample.fresh, len(chips)), bits(sample.valid, len(chips)), None, 0, CHIPS[kind],
                )  # fmt: skip

    return frames
