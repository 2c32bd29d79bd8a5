"""Finite elements of a pressed slab: finite strain, a rigid magnet, a dead load on the patch. Offline only.

felupe (GPL-3; extra `fem`) computes elements and residual: hexahedra Q1P0, with one mean pressure per element, so that
nearly incompressible silicone does not lock. It is imported when a slab is meshed and nowhere else, so that the rest of
the laboratory runs without it. Internally in mm, N, MPa; the public
functions use SI.

The load is a dead load: the force (Ft_x, Ft_y, −Fn) is spread evenly over the undeformed patch and keeps its direction.
So its resultant is exactly the reading of a load cell under the probe, however the patch turns and stretches. A dead
load is conservative, so the tangent is symmetric. One factorised tangent is used for many iterations, with Anderson's
acceleration (J. ACM 12 (1965) 547), until a new one costs less time.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.sparse.linalg import splu

from fmfts.pad import Array
from fmfts_lab.finite_elements.slab import ELEMENT_M, Press, Slab
from fmfts_lab.finite_elements.slab_mesh import SlabMesh

MAGNET_STIFFNESS = 1e3  # times the silicone's: the magnet then bends by a thousandth of its surroundings
MPA = 1e-6
RESIDUAL = 1e-5  # relative to the load: below it the equilibrium counts as found, and the pose is accurate to 1e-8
NO_LOAD = 1e-9  # N: a smaller residual counts as zero when nothing presses
MEMORY, ITERATIONS = 8, 150
PATIENCE = 25  # after this many iterations a fresh tangent costs less than going on


def felupe_module() -> Any:
    """Raises ImportError, with what to do, if felupe is absent."""
    try:
        import felupe
    except ImportError as error:
        raise ImportError(
            "finite elements need felupe, a package under GPL-3 that only the extra `fem` of fmfts installs"
        ) from error
    return felupe


class MooneyRivlin:
    """The isochoric part of W, with felupe's interface of a material. `stiffness` (C,): a factor for each cell."""

    def __init__(self, c10_mpa: float, c01_mpa: float, stiffness: Array) -> None:
        self.c10, self.c01, self.stiffness = c10_mpa, c01_mpa, stiffness
        self.x = [np.zeros((3, 3)), np.zeros(0)]
        felupe = felupe_module()
        self._cofactor = felupe.AreaChange().function
        self._unstrained = felupe.NeoHooke(mu=2.0 * (c10_mpa + c01_mpa))

    def gradient(self, x: list[Array], **_: Any) -> list[Array]:
        """First Piola–Kirchhoff stress (3, 3, Q, C) in MPa: dW/dF of C10 (J^−2/3 I1 − 3) + C01 (J^−4/3 I2 − 3)."""
        F, history = x[0], x[-1]
        C = np.einsum("ki...,kj...->ij...", F, F)
        I1 = np.einsum("ii...", C)
        I2 = (I1**2 - np.einsum("ij...,ij...", C, C)) / 2.0
        cofactor = self._cofactor([F])[0]
        J = np.einsum("ij...,ij...", F, cofactor) / 3.0
        first = 2.0 * self.c10 * self.stiffness * J ** (-2 / 3)
        second = 2.0 * self.c01 * self.stiffness * J ** (-4 / 3)
        stress = (first + second * I1) * F - second * np.einsum("ik...,kj...->ij...", F, C)
        stress -= ((first * I1 + 2.0 * second * I2) / (3.0 * J)) * cofactor
        return [stress, history]

    def hessian(self, x: list[Array], **_: Any) -> list[Array]:
        """The stiffness of a neo-Hookean solid of the same shear modulus: exact without strain, else an estimate."""
        return [self._unstrained.hessian(x)[0] * self.stiffness]


class PressedSlab:
    """A meshed slab. Each press starts from the solution of the last one.

    patience: iterations with one factorised tangent. Several magnets make the slab's answer so uneven that far from
    rest an old tangent leads nowhere.
    """

    def __init__(self, slab: Slab, element_m: float = ELEMENT_M, patience: int = PATIENCE) -> None:
        self.slab, self._patience = slab, patience
        self.mesh = SlabMesh.of(slab, element_m)
        felupe = felupe_module()
        mesh = felupe.Mesh(self.mesh.points_mm, self.mesh.cells, "hexahedron")
        stiffness = np.where(self.mesh.magnet_cells, MAGNET_STIFFNESS, 1.0)
        self._field = felupe.FieldContainer([felupe.Field(felupe.RegionHexahedron(mesh), dim=3)])
        material = MooneyRivlin(slab.c10_pa * MPA, slab.c01_pa * MPA, stiffness)
        self._body = felupe.SolidBodyNearlyIncompressible(material, self._field, slab.bulk_pa * MPA * stiffness)
        self._free = np.repeat(~self.mesh.fixed_points, 3)
        self._rest_factor = self._factorised_tangent(np.zeros_like(self.mesh.points_mm))
        self.rest()

    def rest(self) -> None:
        """Forget the last press: what is solved next is the same to the last bit, whatever was solved before."""
        self.displacement_mm = np.zeros_like(self.mesh.points_mm)
        self._factor = self._rest_factor
        # The elements' pressures are extrapolated from the previous displacement: the second evaluation removes this
        # error.
        for _ in range(2):
            self._inner_force(self.displacement_mm)

    def solve(self, press: Press) -> tuple[Array, Array]:
        """The first magnet's displacement (3,) in m and unit axis (3,), +z at rest.

        ArithmeticError if no equilibrium is found: the press is too hard for this slab.
        """
        return self.solve_all([press])[0]

    def solve_all(self, presses: Sequence[Press]) -> list[tuple[Array, Array]]:
        """As `solve`, of each magnet, under presses at once."""
        free = self._free
        load = np.sum([self.mesh.load(self.slab, press) for press in presses], axis=0).reshape(-1)[free]
        u = self.displacement_mm.reshape(-1).copy()
        mixing = Anderson()
        for iteration in range(1, ITERATIONS + 1):
            residual = load - self._inner_force(u.reshape(-1, 3))[free]
            if not np.all(np.isfinite(residual)):
                break
            if np.linalg.norm(residual) <= RESIDUAL * np.linalg.norm(load) + NO_LOAD:
                self.displacement_mm = u.reshape(-1, 3)
                return [self.mesh.magnet_pose(self.displacement_mm, i) for i in range(len(self.slab.magnets_m))]
            if iteration % self._patience == 0:
                self._factor, mixing = self._factorised_tangent(u.reshape(-1, 3)), Anderson()
            u[free] = mixing.next(u[free], self._factor.solve(residual))
        self._factor = self._rest_factor
        raise ArithmeticError(f"the finite elements found no equilibrium in {ITERATIONS} iterations: {presses}")

    def linear(self, load: Array) -> Array:
        """Displacement (P, 3) in mm under nodal forces `load` (P, 3) in N, for small strains."""
        u = np.zeros(load.size)
        u[self._free] = self._rest_factor.solve(load.reshape(-1)[self._free])
        return u.reshape(-1, 3)

    def _factorised_tangent(self, displacement_mm: Array) -> Any:
        self._inner_force(displacement_mm)
        tangent = self._body.assemble.matrix(self._field).tocsr()[self._free][:, self._free]
        return splu(tangent.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})

    def _inner_force(self, displacement_mm: Array) -> Array:
        self._field[0].values[:] = displacement_mm
        with np.errstate(invalid="ignore"):  # an element turned inside out gives NaN; the caller checks for it
            force: Array = self._body.assemble.vector(self._field).toarray()[:, 0]
        return force


class Anderson:
    """Fixed-point iteration u ← u + step(u) with the best combination of its last steps (Anderson 1965, type II)."""

    def __init__(self) -> None:
        self._at: list[Array] = []
        self._steps: list[Array] = []

    def next(self, u: Array, step: Array) -> Array:
        self._at = [*self._at[-MEMORY:], u.copy()]
        self._steps = [*self._steps[-MEMORY:], step]
        if len(self._at) == 1:
            return u + step
        moved, changed = np.diff(self._at, axis=0).T, np.diff(self._steps, axis=0).T
        share = np.linalg.lstsq(changed, step, rcond=1e-10)[0]
        combined: Array = u + step - (moved + changed) @ share
        return combined
