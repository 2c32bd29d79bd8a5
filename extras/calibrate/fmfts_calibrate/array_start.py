"""The table of presses that a calibration starts from, brought to the pad's size and to the order of its magnets.

Pads of one shape, all lengths larger by a factor s, deform alike under forces that are larger by s²: movements grow by
s, angles stay.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from fmfts.common.reading import read_regular, unreadable_told
from fmfts.contact.array_model import ARRAY_PATH, STANDARD_SENSORS_MM
from fmfts.contact.array_response import CHANGE, LARGEST_BYTES, ArrayResponse, ResponseError
from fmfts.pad import Array, Pad, SensorArray
from fmfts_calibrate.field_table import DataError

# Places (4, 2) of the shipped table's magnets.
SHIPPED_MM = np.array([(6.0, 6.0), (6.0, -6.0), (-6.0, 6.0), (-6.0, -6.0)])
# Largest distance of a magnet from the scaled table's: a correction removes the rest.
NEAR_MM = 1.5
SMALLEST_SCALE, LARGEST_SCALE = 0.5, 2.0


def hash_of(pad: Pad) -> str:
    """For the pad's magnets over the standard sensors: a table of presses serves them over any sensors."""
    return replace(pad, sensors=SensorArray.aligned(STANDARD_SENSORS_MM * 1e-3)).geometry_hash


def starting_table(path: Path | None, pad: Pad) -> ArrayResponse:
    """The table in a file, which must be of this pad's magnets; None: the shipped one, brought to this pad.

    DataError where there is none for this pad.
    """
    response = _read(ARRAY_PATH if path is None else path)
    if path is not None:
        if response.geometry_hash not in (pad.geometry_hash, hash_of(pad)):
            raise DataError(
                f"{path}: is a table of other magnets than those of pad '{pad.name}': compare [[pad.magnet]], or leave "
                "--start out"
            )
        return replace(response, geometry_hash=hash_of(pad))
    place_mm = np.array([one.rest_position_m[:2] for one in pad.magnets]) * 1e3
    if len(place_mm) != len(SHIPPED_MM):
        raise DataError(
            f"pad '{pad.name}' has {len(place_mm)} magnets, and the shipped table of presses, which a calibration "
            "corrects, is of four: give a table of that structure with --start, from finite elements "
            "(docs/several.md, How it works)"
        )
    scale = float(np.sqrt(np.square(place_mm).sum() / np.square(SHIPPED_MM).sum()))
    apart_mm = np.hypot(*(place_mm[:, None] - scale * SHIPPED_MM[None]).transpose(2, 0, 1))
    order = apart_mm.argmin(axis=1)
    if len(set(order.tolist())) < len(order) or apart_mm.min(axis=1).max() > NEAR_MM * scale:
        raise DataError(
            f"pad '{pad.name}': its magnets are not near the corners of a square about its middle, as those of the "
            "shipped table of presses are: give a table of that structure with --start"
        )
    if not SMALLEST_SCALE <= scale <= LARGEST_SCALE:
        raise DataError(
            f"pad '{pad.name}': its magnets are {scale:.2g} times as far apart as those of the shipped table of "
            f"presses; from {SMALLEST_SCALE:g} to {LARGEST_SCALE:g} times can be calibrated from it"
        )
    return replace(_scaled(_ordered(response, order), scale), geometry_hash=hash_of(pad))


def _read(path: Path) -> ArrayResponse:
    try:
        with unreadable_told(DataError, path):
            return ArrayResponse.of(read_regular(path, LARGEST_BYTES), str(path))
    except ResponseError as error:
        raise DataError(str(error)) from error


def _ordered(response: ArrayResponse, order: Array) -> ArrayResponse:
    """The table with its magnet order[i] as the pad's magnet i."""
    own = (CHANGE * order[:, None] + np.arange(CHANGE)).ravel()
    return replace(response, coefficient=response.coefficient[..., own], shear=response.shear[..., own])


def _scaled(response: ArrayResponse, scale: float) -> ArrayResponse:
    """For a pad that is larger by `scale` in all lengths."""
    terms, magnets = response.coefficient.shape[2], response.magnets
    unit = np.tile([scale, scale, scale, 1.0, 1.0], magnets)
    per_force = scale ** (-2.0 * np.arange(1, terms + 1))
    return replace(
        response,
        first_mm=response.first_mm * scale,
        spacing_mm=response.spacing_mm * scale,
        scale_n=response.scale_n * scale * scale,
        coefficient=response.coefficient * unit * per_force[:, None],
        shear=response.shear * unit / (scale * scale),
    )
