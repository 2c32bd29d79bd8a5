"""Pads with several magnets for tests: any number of magnets and sensors, mounted at random, without a file."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmfts.baseline.array_mounting import ArrayMounting
from fmfts.contact.array_response import ArrayResponse
from fmfts.pad import Magnet, Pad, RestingMagnet, SensorArray, rotation_from_vector
from fmfts.pose import FieldErrors
from fmfts.pose.magnets import Magnets, field_of, rest_frames
from fmfts.several.field_model import FieldModel, Scene
from fmfts.several.fit import Measured

Array = NDArray[np.float64]

SCENE = Scene(ambient_t=2e-4, moment=1e-3, friction=0.3)
NOISE_T = 2e-7


def pad_of(random: np.random.Generator, magnets: int, sensors: int) -> Pad:
    """Magnets on a square grid 12 mm apart, up and down in turn, over sensors in two squares."""
    side = int(np.ceil(np.sqrt(magnets)))
    each = [
        RestingMagnet(
            Magnet(3e-3, 3e-3, 1.2, as_cylinder=bool(number % 3)),
            np.array(
                [12e-3 * (number % side) - 6e-3 * (side - 1), 12e-3 * (number // side) - 6e-3 * (side - 1), 12e-3]
            ),
            np.array([0.0, 0.0, 1.0 if number % 2 == 0 else -1.0]),
        )
        for number in range(magnets)
    ]
    place = np.zeros((sensors, 3))
    place[:, :2] = random.uniform(-14e-3, 14e-3, (sensors, 2))
    first = each[0]
    return Pad(
        "several",
        SensorArray.aligned(place),
        first.magnet,
        first.rest_position_m,
        first.rest_axis,
        other_magnets=tuple(each[1:]),
    )


def response_of(random: np.random.Generator, pad: Pad, knots: int, terms: int, reach_mm: float = 14.0) -> ArrayResponse:
    """Each magnet moves down and leans towards a finger; higher powers of the force reduce this a little."""
    first_mm, spacing_mm = -reach_mm, 2.0 * reach_mm / (knots - 1)
    along = first_mm + spacing_mm * (np.arange(knots + 2) - 1.0)
    x, y = np.meshgrid(along, along, indexing="ij")
    coefficient = np.empty((knots + 2, knots + 2, terms, 5 * len(pad.magnets)))
    for number, one in enumerate(pad.magnets):
        dx, dy = x - 1e3 * one.rest_position_m[0], y - 1e3 * one.rest_position_m[1]
        near = np.exp(-(dx * dx + dy * dy) / 100.0)
        shape = np.stack(
            [0.02 * dx * near, 0.02 * dy * near, -0.4 * near, -0.01 * dx * near, -0.01 * dy * near], axis=-1
        )
        for term in range(terms):
            coefficient[:, :, term, 5 * number : 5 * number + 5] = shape * (-0.1) ** term
    coefficient *= random.normal(1.0, 0.05, coefficient.shape)
    shear = random.normal(0.0, 0.05, (knots + 2, knots + 2, 2, coefficient.shape[3]))
    return ArrayResponse(first_mm, spacing_mm, 3.0, coefficient, shear, pad.geometry_hash)


def mounting_of(random: np.random.Generator, pad: Pad, causes: int) -> ArrayMounting:
    """The mounting of a pad whose parts lie anywhere within their tolerances."""
    count, drawn = len(pad.sensors), Magnets.drawn(pad)
    moved = random.normal(0.0, [1e-4, 1e-4, 1e-4, 0.02, 0.02], (len(drawn), 5))
    magnets = drawn.stronger(random.normal(0.0, 0.02, len(drawn))).changed(moved.ravel(), rest_frames(drawn.axis))
    axes = np.array([rotation_from_vector(random.normal(0.0, 0.02, 3)) for _ in range(count)])
    sensors = SensorArray(pad.sensors.position_m + random.normal(0.0, 1e-4, (count, 3)), axes)
    spread = np.tile([1e-4, 1e-4, 1e-4, 0.02, 0.02, 0.02], len(drawn))
    mixed = np.eye(len(spread)) + 0.1 * random.normal(size=(len(spread), len(spread)))
    root = spread[:, None] * mixed
    typical = np.tile([0.5, 0.5, 0.5, 1e-3, 1e-3], len(drawn))  # T/m, T: change of a field with a pose
    return ArrayMounting(
        magnets=magnets,
        frames=rest_frames(magnets.axis),
        gain=random.normal(1.0, 0.01, (count, 3)),
        sensors=sensors,
        offset_t=random.normal(0.0, 5e-5, (count, 3)),
        rest_field_t=field_of(magnets, sensors),
        noise_t=np.full((count, 3), NOISE_T),
        errors=FieldErrors(
            0.0005 * random.normal(size=(5 * len(drawn), 3 * count, causes)) * typical[:, None, None],
            0.002 * random.normal(size=(3 * count, 3, causes)),
        ),
        log_moment=np.zeros(len(drawn)),
        rest_covariance=root @ root.T,
        chi2=1.0,
        measurements=3 * count,
        misfit_t=np.zeros((count, 3)),
        ambient_t=None,
        ambient_deviation_t=None,
    )


def models_of(
    seed: int,
    magnets: int = 4,
    sensors: int = 8,
    causes: int = 48,
    knots: int = 8,
    terms: int = 2,
    reach_mm: float = 14.0,
) -> FieldModel:
    random = np.random.default_rng(seed)
    pad = pad_of(random, magnets, sensors)
    response, mounting = response_of(random, pad, knots, terms, reach_mm), mounting_of(random, pad, causes)
    return FieldModel(pad, mounting, response, SCENE)


def fingers_of(random: np.random.Generator, count: int, beyond: bool = False) -> Array:
    """Anywhere on the pad, or also beside the table and beyond its largest force."""
    reach, most = (25.0, 9.0) if beyond else (12.0, 2.0)
    places = random.uniform(-reach, reach, (count, 2))
    return np.column_stack([places, random.uniform(0.1, most, count)])


def measured_of(random: np.random.Generator, model: FieldModel, fingers: Array, ambient_t: float = 2e-5) -> Measured:
    """The field under `fingers` with noise, and with an ambient field that has changed."""
    field = model.predict(fingers).field_t
    ambient = model.by_ambient @ random.normal(0.0, ambient_t, 3)
    values = len(field)
    return Measured(
        field + ambient + random.normal(0.0, NOISE_T, values), np.full(values, NOISE_T * NOISE_T), np.ones(values, bool)
    )


def masked(random: np.random.Generator, measured: Measured, trial: int) -> Measured:
    """All values, or without some sensors, or without single values; missing ones are NaN."""
    used = np.ones(len(measured.used), bool)
    if trial % 3 == 1:
        used = np.repeat(random.uniform(size=len(used) // 3) < 0.8, 3)
    elif trial % 3 == 2:
        used = random.uniform(size=len(used)) < 0.6
    variance = measured.variance_t2 * random.uniform(0.5, 2.0, len(used))
    root = 3e-7 * random.standard_normal((len(used), 6))  # field of neighbouring pads, in every other trial
    foreign = root @ root.T if trial % 2 else None
    return Measured(np.where(used, measured.field_t, np.nan), np.where(used, variance, np.nan), used, foreign)
