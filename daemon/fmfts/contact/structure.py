"""Which pads a contact model fits (those of the same structure, with any sensors), and the effect of shear."""

from __future__ import annotations

import msgspec
import numpy as np

from fmfts.contact.contract import OUTPUT_ORDER, SHEAR_OUTPUT_ORDER, ErrorTables, Facts
from fmfts.contact.response import SHARE_OF_CONE, Response
from fmfts.contact.shipped import DEFAULT_PATH, STANDARD_DIMENSIONS, STANDARD_HASH
from fmfts.pad import Array, Dimensions, Pad, differences


def magnets_differ(facts: Facts, pad: Pad) -> str:
    """How the magnets of the model's pad differ from those of `pad`; "" if they do not.

    A model goes from a magnet's pose to a contact, so the places of the sensors do not matter.
    """
    if facts.geometry_hash == pad.geometry_hash:
        return ""
    its = STANDARD_DIMENSIONS if facts.geometry_hash == STANDARD_HASH else facts.dimensions
    if its is None:
        hashes = f"the model's have the hash {facts.geometry_hash}, the pad's {pad.geometry_hash}"
        return f"which ones, this file does not say ({hashes})"
    theirs, ours = (_of_magnets(each) for each in (its, pad.dimensions))
    found = differences(theirs, ours, "in the model", "in the configuration")
    return found or ("" if theirs.keys() == ours.keys() else "it is of another number of magnets")


def _of_magnets(dimensions: Dimensions) -> Dimensions:
    return {name: values for name, values in dimensions.items() if name.startswith("magnet")}


class _Report(msgspec.Struct):
    """From the shipped model's report, which is faster to read than the model."""

    friction_error: ErrorTables | None


def shipped_friction_error(geometry_hash: str) -> ErrorTables | None:
    """The effect of shear on the shipped model's answers, if it fits this geometry; else None.

    Shear moves the magnets of all pads of one structure alike.
    """
    if geometry_hash != STANDARD_HASH:
        return None
    shipped = msgspec.json.decode(DEFAULT_PATH.with_suffix(".json").read_bytes(), type=_Report)
    return shipped.friction_error


def friction_deviation(facts: Facts, friction: float, unit: Array) -> Array | float:
    """Deviation of a model's outputs, in `unit` of mm and N, through shear within the cone of friction.

    At the largest force of each bin of its own error: (forces, radii, outputs); 0 for a shear model. A smaller force
    gets up to twice its share. Another solver's presses have effects larger by a sixth, so that forces are within two
    deviations in 95 to 99 % of frames (lab/results/structure.md): the middle of each bin would be too little.
    """
    tables = facts.friction_error
    if tables is None or facts.outputs == SHEAR_OUTPUT_ORDER:
        return 0.0
    # The last bin has no end: take the largest calibrated force.
    force_n = np.append(np.minimum(tables.force_n[:-1], facts.envelope.force_max_n), facts.envelope.force_max_n)
    shear_n = friction * force_n / np.sqrt(2.0)  # rms over the disc of radius µF
    deviation: Array = np.stack(tables.tables, axis=-1) * unit * shear_n[:, None, None]
    return deviation


def solves_shear(facts: Facts, response: Response | None, told: int) -> bool:
    """Whether shear is in the response of a model, whose network tells `told` numbers (contact/sheared.c)."""
    named = facts.outputs == SHEAR_OUTPUT_ORDER and told == len(OUTPUT_ORDER)
    return named and response is not None and response.loads > 1


def shear_share(facts: Facts, told: int, friction: float) -> float:
    """Prior deviation of each shear over the force; 0 of a model whose response does not tell it."""
    return SHARE_OF_CONE * friction if facts.outputs == SHEAR_OUTPUT_ORDER and told == len(OUTPUT_ORDER) else 0.0
