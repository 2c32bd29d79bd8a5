"""Makes the table of presses of the second standard pad (2 × 2 magnets) from its solved presses.

python -m fmfts_lab.finite_elements.array_model [OUT.response]

Without OUT it writes the file that ships. Normal presses come from array/normal.csv, mirrored and turned; what shear
does is linear, by reciprocity (some seconds).
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np

from fmfts.arithmetic.spline import spline_collocation
from fmfts.contact.array_model import ARRAY_PATH
from fmfts.contact.array_response import CHANGE, ArrayResponse
from fmfts.pad import Array
from fmfts_lab.finite_elements.array_pad import PLACES_M, array_config
from fmfts_lab.finite_elements.array_presses import array_slab, columns_of
from fmfts_lab.finite_elements.reciprocity import Influence
from fmfts_lab.finite_elements.slab import Slab

DATA = Path(__file__).with_name("array")
UNITS = np.array([1e-3, 1e-3, 1e-3, 1.0, 1.0])  # from the CSV's µm to mm
Signs = tuple[float, float]


def read_presses(path: Path, fingers: int = 1) -> tuple[Array, Array]:
    """Presses (K, fingers, 5), and the changes (K, 20) of the four magnets' poses in mm and components of the axis."""
    with path.open(newline="") as lines:
        rows = np.array([[float(row[name]) for name in columns_of(fingers)] for row in csv.DictReader(lines)])
    presses, poses = rows[:, : 5 * fingers], rows[:, 5 * fingers :]
    return presses.reshape(-1, fingers, 5), (poses.reshape(-1, 4, CHANGE) * UNITS).reshape(-1, 4 * CHANGE)


def mirrored(place: Array, change: Array) -> tuple[Array, Array]:
    """The places (8K, 2) and changes (8K, 20) under the eight symmetries of the pad."""
    places, changes = [], []
    for transposed in (False, True):
        for sign in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)):
            moved = (place[:, ::-1] if transposed else place) * sign
            own = change.reshape(-1, 4, CHANGE)
            turned = own[:, :, [1, 0, 2, 4, 3]] if transposed else own
            turned = turned * [sign[0], sign[1], 1.0, sign[0], sign[1]]
            where = [_image(number, transposed, sign) for number in range(4)]
            result = np.empty_like(turned)
            result[:, where] = turned
            places.append(moved)
            changes.append(result.reshape(-1, 4 * CHANGE))
    return np.concatenate(places), np.concatenate(changes)


def _image(number: int, transposed: bool, sign: Signs) -> int:
    """Which magnet stands where the symmetry takes magnet `number`."""
    x, y = PLACES_M[number][::-1] if transposed else PLACES_M[number]
    return PLACES_M.index((sign[0] * x, sign[1] * y))


def response_of(path: Path, geometry_hash: str) -> ArrayResponse:
    """The table from the solved normal presses in `path`."""
    presses, change = read_presses(path)
    force = np.unique(presses[:, 0, 2])
    grid = np.unique(np.abs(presses[:, 0, :2]))
    knots = np.concatenate([-grid[:0:-1], grid])
    whole = np.full((len(knots), len(knots), len(force), 4 * CHANGE), np.nan)
    for level, newton in enumerate(force):
        at = presses[:, 0, 2] == newton
        places, changes = mirrored(presses[at, 0, :2], change[at])
        i, j = (np.searchsorted(knots, np.round(places[:, axis], 6)) for axis in (0, 1))
        whole[i, j, level] = changes
    if np.isnan(whole).any():
        raise ValueError(f"{path}: some presses of the grid are not solved yet")
    powers = np.linalg.solve(force[:, None] ** np.arange(1, len(force) + 1), whole)
    spline = np.linalg.inv(spline_collocation(len(knots)))[:, 1:-1]
    coefficient = np.einsum("ai,bj,ijpc->abpc", spline, spline, powers)
    shear = np.einsum("ai,bj,ijpc->abpc", spline, spline, linear_shear(knots))
    spacing = float(knots[1] - knots[0])
    return ArrayResponse(float(knots[0]), spacing, float(force[-1]), coefficient, shear, geometry_hash)


def linear_shear(knots_mm: Array) -> Array:
    """(X, X, 2, 20) change per newton along x and y, for small strains."""
    whole = _linear(array_slab(), knots_mm)
    signs = np.repeat(np.sign(PLACES_M), CHANGE, axis=0).T
    return np.asarray(whole[:, :, :2] * signs)


def linear_normal(slab: Slab, knots_mm: Array) -> Array:
    """(X, X, 20) change per newton of normal force, for small strains, of such a slab with the magnets of this pad."""
    return np.asarray(-_linear(slab, knots_mm)[:, :, 2])


def _linear(slab: Slab, knots_mm: Array) -> Array:
    """(X, X, 3, 20) change per newton along x, y and z, the former as they are by the first magnet's corner."""
    influence = Influence.of(slab)
    first = np.array([[influence.of_patch(x * 1e-3, y * 1e-3) for y in knots_mm] for x in knots_mm])
    first = first * np.array([1e3, 1e3, 1e3, 1.0, 1.0])
    magnets = []
    for x, y in PLACES_M:
        sign = np.sign([x, y])
        mirror = first[:: int(sign[0]), :: int(sign[1])]
        magnets.append(mirror * [sign[0], sign[1], 1.0, sign[0], sign[1]])
    return np.concatenate(magnets, axis=3)


def main(arguments: list[str]) -> int:
    out = Path(arguments[0]) if arguments else ARRAY_PATH
    out.write_bytes(response_of(DATA / "normal.csv", array_config().pad().geometry_hash).encoded())
    print(f"wrote {out}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
