"""Ambiguities of unlabelled presses: a second answer that fits, the length scale, which way is up."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from fmfts.pose import State
from fmfts_calibrate.learn.drawing import FIRST_PLACE, Drawing
from fmfts_calibrate.learn.fit import Fit

Array = NDArray[np.float64]

ANOTHER = 5.0  # deviations between two different answers
# Beyond these deviations the learned geometry is useless: a twentieth of every distance (and so of every force), five
# degrees of the pad's axes (0.9 mm at its rim), and twice of a sensor against the others what a measured board has.
LARGEST_SCALE, LARGEST_TURN_RAD, LARGEST_PLACE_M = 0.05, np.deg2rad(5.0), 2e-4
FEW_TILTS_RAD = np.deg2rad(1.0)
# A mirror image this much further from the drawing, in −2 ln, need not be tried: the drawing excludes it.
EXCLUDED = 200.0


def is_another(fit: Fit, other: Fit) -> bool:
    """Whether two answers are further apart than what is uncertain about one of them."""
    apart = other.vector - fit.vector
    return bool(apart @ fit.information @ apart > ANOTHER**2 * len(apart) ** 0.5)


def mirrored(drawing: Drawing, vector: Array) -> Array | None:
    """The vector of the point image, whose fields are the same: a dipole's field at −r is that at r.

    Of its four positions with the same drawn axes up to half a turn the one nearest to the drawing; None where the
    drawing excludes all of them.
    """
    from scipy.spatial.transform import Rotation

    geometry, pad, deviation = drawing.geometry(vector), drawing.pad, drawing.deviation
    free = np.where(deviation > 0.0, deviation, np.inf)
    nearest: Array | None = None
    for half_turn in (np.eye(3), np.diag([1.0, -1.0, -1.0]), np.diag([-1.0, 1.0, -1.0]), np.diag([-1.0, -1.0, 1.0])):
        rest = replace(
            geometry.rest, position_m=-half_turn @ geometry.rest.position_m, axis=half_turn @ geometry.rest.axis
        )
        if rest.axis @ pad.rest_axis <= 0.0:
            continue
        axes = pad.sensors.axes.transpose(0, 2, 1) @ half_turn @ geometry.sensors.axes
        places = -geometry.sensors.position_m @ half_turn - pad.sensors.position_m
        image = vector.copy()
        image[:6] = rest.step_from(State.at_rest(pad))[:6] / free[:6]
        first, size = FIRST_PLACE, places.size
        image[first : first + size] = places.ravel() / free[first : first + size]
        turned = Rotation.from_matrix(axes).as_rotvec().ravel()
        image[first + size : first + 2 * size] = turned / free[first + size : first + 2 * size]
        if nearest is None or image @ image < nearest @ nearest:
            nearest = image
    if nearest is None or nearest @ nearest - vector @ vector > EXCLUDED:
        return None
    return nearest


def _sides(drawing: Drawing, fits: list[Fit]) -> list[bool]:
    """For each fit, whether the magnet is on the other side of the sensors than in the first."""
    here = drawing.geometry(fits[0].vector)
    places = here.sensors.position_m - here.rest.position_m
    three = max(combinations(range(len(places)), 3), key=lambda each: abs(np.linalg.det(places[list(each)])))
    spanned = []
    for fit in fits:
        geometry = drawing.geometry(fit.vector)
        spanned.append(np.linalg.det((geometry.sensors.position_m - geometry.rest.position_m)[list(three)]))
    return [bool(one * spanned[0] < 0.0) for one in spanned]


def open_directions(drawing: Drawing, fit: Fit, rivals: list[Fit]) -> list[str]:
    """The undetermined directions, each as a sentence with its figure and a remedy; empty: none."""
    told = []
    images = _sides(drawing, [fit, *rivals])[1:]
    if any(images):
        told.append(
            "the mirror image fits as well: say in the drawing on which side of the sensors the magnet is, or how one "
            "chip lies (geometry.sensor_rotations_deg), with smaller tolerances"
        )
    others = [one for one, is_image in zip(rivals, images, strict=True) if not is_image]
    if others:
        _, places_m = _moved(drawing, fit, others[0])
        told.append(
            f"a second geometry fits as well, with sensors up to {places_m * 1e3:.1f} mm elsewhere: press more, also "
            "firmly and at the rim, or measure some places and lower tolerance.sensor_position_mm"
        )
    covariance, common = np.linalg.inv(fit.information), common_motions(drawing, fit)
    motion = common @ covariance @ common.T
    scale, turn = float(np.sqrt(motion[0, 0])), float(np.sqrt(np.linalg.eigvalsh(motion[1:4, 1:4]).max()))
    if scale > LARGEST_SCALE:
        told.append(
            f"the length scale is known to {scale:.1%} only, as presses cannot measure it: give the magnet's strength "
            "(tolerance.remanence) or its height (tolerance.magnet_position_mm) more exactly, or measure the distance "
            "of two sensors"
        )
    if turn > LARGEST_TURN_RAD:
        told.append(
            f"how the pad's axes lie is known to {np.degrees(turn):.1f}° only, as presses cannot measure it: measure "
            "how one chip is turned, or where two are"
        )
    worst_m = float(np.max(relative_place_deviation_m(drawing, fit)))
    tilt = spread_of_tilts(fit)
    if worst_m > LARGEST_PLACE_M:
        cause = (
            "the presses hardly tilt the magnet"
            if tilt < FEW_TILTS_RAD
            else "there are too few presses, or they are too similar"
        )
        told.append(
            f"a sensor's place against the others is known to {worst_m * 1e3:.2f} mm only, because {cause} "
            f"({np.degrees(tilt):.1f}°): press nearer the rim, and firmly"
        )
    return told


def common_motions(drawing: Drawing, fit: Fit) -> Array:
    """(4, M) what a step of the vector is, at most, of growth (1) and of a turn about each axis (rad), of all sensors'
    places about the magnet's rest."""
    geometry = drawing.geometry(fit.vector)
    r = geometry.sensors.position_m - geometry.rest.position_m
    moves = np.stack([r, *(np.cross(axis, r) for axis in np.eye(3))]).reshape(4, -1)
    found = np.zeros((4, len(fit.vector)))
    of_places = np.linalg.pinv(moves.T)
    found[:, FIRST_PLACE : FIRST_PLACE + r.size] = of_places
    found[:, :3] = -of_places.reshape(4, -1, 3).sum(axis=1)
    return np.asarray(found * drawing.deviation)


def relative_place_deviation_m(drawing: Drawing, fit: Fit) -> Array:
    """(N,) deviation of each sensor's place, without the growth and the turns that all have in common."""
    geometry, count = drawing.geometry(fit.vector), len(drawing.pad.sensors)
    r = geometry.sensors.position_m - geometry.rest.position_m
    shifts = [np.tile(axis, (count, 1)) for axis in np.eye(3)]
    turns = [np.cross(axis, r) for axis in np.eye(3)]
    basis = np.linalg.qr(np.stack([r, *turns, *shifts]).reshape(7, -1).T)[0]
    apart = np.eye(r.size) - basis @ basis.T
    which = slice(FIRST_PLACE, FIRST_PLACE + r.size)
    scale = drawing.deviation[which]
    covariance = apart @ (np.linalg.inv(fit.information)[which, which] * scale * scale[:, None]) @ apart
    return np.asarray(np.sqrt(np.maximum(np.diagonal(covariance), 0.0).reshape(count, 3).sum(axis=1)))


def spread_of_tilts(fit: Fit) -> float:
    """(rad) how far the presses tilt the magnet, as a standard deviation about their mean direction."""
    axes = fit.poses[:, 3:6]
    mean = axes.mean(axis=0)
    size = float(np.linalg.norm(mean))
    return float(np.sqrt(2.0 * max(1.0 - size, 0.0)))


def _moved(drawing: Drawing, fit: Fit, other: Fit) -> tuple[float, float]:
    """The distances in m between two answers: of rest, and of the sensor that moved furthest."""
    here, there = drawing.geometry(fit.vector), drawing.geometry(other.vector)
    apart = np.linalg.norm(there.sensors.position_m - here.sensors.position_m, axis=1)
    return float(np.linalg.norm(there.rest.position_m - here.rest.position_m)), float(apart.max())
