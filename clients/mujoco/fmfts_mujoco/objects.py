"""Draws what the gripper lifts: balls, eggs and bulging glasses; worse: sharp ones, rods and walls. All are random."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

GRIPPER = Path(__file__).with_name("models") / "gripper.xml"
GRAVITY_M_PER_S2 = 9.81
SHAPES = ("ball", "egg", "glass")
CHEEK_M = 9e-3
FRICTION, LEAST_N, WIDTH_M = (0.2, 1.2), (0.8, 1.45), (0.05, 0.09)
SHARP = (0.3, 0.7)  # radii of curvature, as shares of half the width, below those of SHAPES
FILLED = (1.3, 1.6)  # the full mass of a glass, as a multiple of its empty mass
TOP_M, CLEAR_M = 14e-3, 6e-3  # height of a pad above its sensors; gap between pad and object before it closes
HEIGHT_M = 31e-3  # height of the middle of the cheeks above the table
BODY_M = np.array([0.015, 0.025])  # half the depth and the height of the object on the table
ABOVE_M = (2e-3, 4e-3)  # the fingers are this far below the middle of the cheeks, because slips move them up
SIDEWAYS_M = 3e-3
# The same as the gripper's own cheeks, which have the silicone's stiffness (models/standard_pad.xml).
SOLREF, SOLIMP, TORSION = (-33000.0, -200.0), (0.5, 0.5, 0.001), (0.003, 1e-4)


@dataclass(frozen=True, slots=True)
class Object:
    """width_m: between the fingers. half_m: of each cheek, x toward the finger, z up. full: 1 of what is no glass."""

    shape: str
    friction: float
    mass_kg: float
    full: float
    width_m: float
    half_m: tuple[float, float, float]
    above_m: float
    sideways_m: float

    @classmethod
    def drawn(cls, random: np.random.Generator, shape: str | None = None) -> Object:
        """The least force on each finger is drawn, for a full glass; the mass follows from it and the friction."""
        friction, least_n, width_m = (float(random.uniform(*limits)) for limits in (FRICTION, LEAST_N, WIDTH_M))
        shape = str(random.choice(SHAPES)) if shape is None else shape
        full = float(random.uniform(*FILLED)) if shape == "glass" else 1.0
        # Curvature, as shares of half the width: along y and z. An object whose factor for z is below 1 tends to tip
        # over.
        egg, glass = random.uniform((0.5, 0.7), (1.0, 1.0)), random.uniform(1.0, 2.0)
        curved: tuple[float, ...] | None
        curved = {"ball": (1.0, 1.0), "egg": (float(egg[0]), float(egg[1])), "glass": (1.0, float(glass))}.get(shape)
        if shape == "sharp":
            curved = tuple(float(each) for each in random.uniform(*SHARP, 2))
        if curved is None:
            x, y, z = {"rod": (0.01, 3e-3, 0.01), "wall": (0.01, 0.015, 0.025)}[shape]
        else:  # an ellipsoid's pole has a radius of curvature of y²/x, z²/x
            x = CHEEK_M
            y, z = (float(np.sqrt(x * share * width_m / 2.0)) for share in curved)
        above_m, sideways_m = float(random.uniform(*ABOVE_M)), float(random.uniform(-SIDEWAYS_M, SIDEWAYS_M))
        mass_kg = 2.0 * friction * least_n / GRAVITY_M_PER_S2 / full
        return cls(shape, friction, mass_kg, full, width_m, (x, y, z), above_m, sideways_m)

    def least_n(self, mass_kg: float, acceleration_m_per_s2: float) -> float:
        """The force of each finger below which it slips."""
        return mass_kg * max(GRAVITY_M_PER_S2 + acceleration_m_per_s2, 0.0) / (2.0 * self.friction)

    def model(self) -> mujoco.MjModel:
        """The gripper around this object. MuJoCo's friction creeps below its limit; its no-slip solver mends that."""
        spec = mujoco.MjSpec.from_file(str(GRIPPER))
        spec.option.noslip_iterations = 10
        for name, side in (("left", -1.0), ("right", 1.0)):
            spec.body(name).pos[0] = side * (self.width_m / 2.0 + TOP_M + CLEAR_M)
        spec.body("carriage").pos[2] = HEIGHT_M - self.above_m
        body = spec.body("object")
        for geom in list(body.geoms):
            spec.delete(geom)
        body.pos = (0.0, self.sideways_m, BODY_M[1])
        inner_m = self.width_m / 2.0 - self.half_m[0]
        body.add_geom(
            name="body",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=(inner_m, *BODY_M),
            mass=self.mass_kg,
            rgba=(0.8, 0.4, 0.2, 1.0),
        )
        for name, side in (("left_cheek", -1.0), ("right_cheek", 1.0)):
            self._cheek(body, name, side * inner_m)
        return spec.compile()

    def _cheek(self, body: mujoco.MjsBody, name: str, x_m: float) -> None:
        kind, size = {
            "rod": (mujoco.mjtGeom.mjGEOM_CYLINDER, (self.half_m[0], self.half_m[1], 0.0)),
            "wall": (mujoco.mjtGeom.mjGEOM_BOX, self.half_m),
        }.get(self.shape, (mujoco.mjtGeom.mjGEOM_ELLIPSOID, self.half_m))
        cheek = body.add_geom(
            name=name,
            type=kind,
            size=size,
            pos=(x_m, 0.0, HEIGHT_M - BODY_M[1]),
            mass=1e-4,
            priority=1,
            condim=4,
            friction=(self.friction, *TORSION),
            rgba=(0.8, 0.5, 0.3, 1.0),
        )
        cheek.solref, cheek.solimp[:3] = SOLREF, SOLIMP
        if self.shape == "rod":  # its axis is MuJoCo's z, which lies along y
            cheek.quat = (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0)


def filled(model: mujoco.MjModel, body: int, share: float) -> None:
    """Makes the body heavier by this factor at once."""
    model.body_mass[body] *= share
    model.body_inertia[body] *= share
    model.body_subtreemass[body] *= share
