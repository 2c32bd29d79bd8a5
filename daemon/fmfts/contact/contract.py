"""The contract between a calibration and the daemon: what an ONNX contact model must contain.

Its metadata holds `Facts` as JSON under METADATA_KEY and, optionally, `PackedResponse` under RESPONSE_KEY. A model of
`calibrate` has the weights of its graph under WEIGHTS_KEY, too, which network.c evaluates.
"""

from __future__ import annotations

from base64 import b64decode, b64encode
from math import prod
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from fmfts.common import possible
from fmfts.contact.response import CHANGE, Response

CONTRACT_VERSION: Literal[2] = 2
OPSET = 17
IR_VERSION = 9
METADATA_KEY = "fmfts.contact"
RESPONSE_KEY = "fmfts.response"
WEIGHTS_KEY = "fmfts.weights"
INPUT, OUTPUTS = "pose", ("contact", "jacobian")  # tensors of the graph
EXTERNAL = 'weights in other files ("external data") are not read: save it as one file'
INPUT_ORDER = ("a_mm", "b_mm", "c_mm", "m", "n", "p")
OUTPUT_ORDER = ("x_mm", "y_mm", "force_n")
SHEAR_OUTPUT_ORDER = (*OUTPUT_ORDER, "shear_x_n", "shear_y_n")
SIZE_LIMIT_BYTES = 4_000_000
# Limits of a response. The shipped responses have 17 knots and 11 monomials; refine.h has room for 16 monomials.
MOST_KNOTS, MOST_MONOMIALS = 66, 16

Pose = Annotated[tuple[float, ...], Meta(min_length=6, max_length=6)]
Positive = Annotated[float, Meta(gt=0)]
Row = Annotated[tuple[Positive, ...], Meta(min_length=1, max_length=64)]
Table = Annotated[tuple[Row, ...], Meta(max_length=64)]


class ModelError(Exception):
    """A contact model cannot be used. The text names the file, what is wrong, and what to do."""


class OtherPadError(ModelError):
    """The model is intact, but for a pad of other dimensions."""


class Envelope(Struct, frozen=True, forbid_unknown_fields=True):
    """The range of the calibration: smallest and largest pose components (rest included), largest force, places."""

    pose_min: Pose
    pose_max: Pose
    force_max_n: Positive
    x_mm: tuple[float, float]
    y_mm: tuple[float, float]


class ErrorTables(Struct, frozen=True, forbid_unknown_fields=True):
    """Rms errors in bins of predicted force and radius.

    Row i is for forces up to force_n[i], column j for radii up to radius_mm[j]. The last ones are for all beyond.
    """

    force_n: Row
    radius_mm: Row
    x_mm: Table
    y_mm: Table
    force_error_n: Table
    shear_error_n: Table | None = None  # of each shear component

    @property
    def tables(self) -> tuple[Table, ...]:
        """The tables, one for each output."""
        shear = () if self.shear_error_n is None else (self.shear_error_n, self.shear_error_n)
        return (self.x_mm, self.y_mm, self.force_error_n, *shear)

    def __post_init__(self) -> None:
        for table in self.tables:
            if len(table) != len(self.force_n) or any(len(row) != len(self.radius_mm) for row in table):
                raise ValueError("its error tables do not have a row per force and a column per radius")


class Facts(Struct, frozen=True, forbid_unknown_fields=True):
    """Facts in a model's metadata.

    dimensions: of the pad, those of geometry_hash; None: not known. own_error: errors besides those that the Jacobian
    propagates from the pose. response_error: errors of the response that the network was trained on, measured with
    presses left out of its fit; None: not known. friction_error: rms error of noise-free answers per newton of shear,
    over its directions, in a model of three outputs; None if the calibration set had no shear. scene, noise_ut: what
    the model was trained for. data: SHA-256 of the calibration set.
    """

    contract: Literal[2]
    geometry_hash: Annotated[str, Meta(pattern=r"^[0-9a-f]{12}\Z")]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    rest_pose: Pose
    envelope: Envelope
    own_error: ErrorTables
    friction_error: ErrorTables | None
    metrics: dict[str, float]
    scene: Literal["drifting", "constant"]
    noise_ut: Positive
    data: str
    made_by: str
    response_error: ErrorTables | None = None
    dimensions: dict[str, tuple[float, ...]] | None = None

    def __post_init__(self) -> None:
        if self.inputs != INPUT_ORDER:
            raise ValueError(f"its input order is {', '.join(self.inputs)}, not {', '.join(INPUT_ORDER)}")
        if self.outputs not in (OUTPUT_ORDER, SHEAR_OUTPUT_ORDER):
            raise ValueError(
                f"its output order is {', '.join(self.outputs)}, not {', '.join(OUTPUT_ORDER)}"
                f"(, {', '.join(SHEAR_OUTPUT_ORDER[3:])})"
            )
        own, fit = self.own_error, self.response_error or self.own_error
        if not len(own.tables) == len(fit.tables) == len(self.outputs):
            raise ValueError("it lacks its own error for some of its outputs")
        if (own.force_n, own.radius_mm) != (fit.force_n, fit.radius_mm):
            raise ValueError("its own error and its response's error have different bins")
        below = (low > rest + 1e-6 for low, rest in zip(self.envelope.pose_min, self.rest_pose, strict=True))
        above = (rest > high + 1e-6 for rest, high in zip(self.rest_pose, self.envelope.pose_max, strict=True))
        if any(below) or any(above):
            raise ValueError("its envelope does not contain the rest pose: a training set must contain zero force")


def parse_facts(metadata: dict[str, str]) -> Facts:
    """Read the facts in a model's metadata. ValueError says what is missing or wrong."""
    if METADATA_KEY not in metadata:
        raise ValueError(f"its metadata has no {METADATA_KEY!r}: it was not made for this daemon")
    try:
        return msgspec.json.decode(metadata[METADATA_KEY], type=Facts)
    except msgspec.ValidationError as error:
        raise ValueError(f"its metadata is wrong: {error}") from error
    except msgspec.DecodeError as error:
        raise ValueError(f"its metadata is not JSON: {error}") from error


class PackedResponse(Struct, frozen=True, forbid_unknown_fields=True):
    """A `Response` as JSON. coefficient: float32, little-endian, in C order of `shape`."""

    first_mm: tuple[float, float]
    spacing_mm: tuple[Positive, Positive]
    scale_n: Positive
    friction: float
    exponent: list[list[Annotated[int, Meta(ge=0, le=9)]]]
    shape: tuple[int, int, int, int]
    coefficient: bytes


def pack_response(response: Response) -> str:
    """Encode a response for a model's metadata."""
    packed = PackedResponse(
        tuple(response.first_mm.tolist()),
        tuple(response.spacing_mm.tolist()),
        response.scale_n,
        response.friction,
        response.exponent.tolist(),
        response.coefficient.shape,
        response.coefficient.astype("<f4").tobytes(),
    )
    return msgspec.json.encode(packed).decode()


def parse_response(metadata: dict[str, str]) -> Response | None:
    """Read the response in a model's metadata; None if it has none. ValueError says what is wrong with it."""
    if RESPONSE_KEY not in metadata:
        return None
    try:
        packed = msgspec.json.decode(metadata[RESPONSE_KEY], type=PackedResponse)
    except msgspec.DecodeError as error:
        raise ValueError(f"its response is wrong: {error}") from error
    exponent = np.array(packed.exponent, dtype=np.intp)
    coefficient = np.frombuffer(packed.coefficient, dtype="<f4").astype(float)
    fits = exponent.ndim == 2 and exponent.shape[1] in (1, 3) and packed.shape[2:] == (len(exponent), CHANGE)
    if (
        not fits
        or not all(4 <= size <= MOST_KNOTS for size in packed.shape[:2])
        or len(exponent) > MOST_MONOMIALS
        or coefficient.size != prod(packed.shape)
    ):
        raise ValueError("its response has a table of another size than it states")
    possible.PLACE_MM.require(packed.first_mm)
    possible.SPACING_MM.require(packed.spacing_mm)
    possible.FORCE_N.require([packed.scale_n])
    if not np.isfinite(coefficient).all():
        raise ValueError("its response holds values that are not finite")
    return Response(
        np.array(packed.first_mm),
        np.array(packed.spacing_mm),
        packed.scale_n,
        exponent,
        coefficient.reshape(packed.shape),
        packed.friction,
    )


def pack_weights(weights: NDArray[np.float32]) -> str:
    """Encode the weights of a network, as network.h describes them, for a model's metadata."""
    return b64encode(weights.astype("<f4").tobytes()).decode()


def parse_weights(metadata: dict[str, str]) -> NDArray[np.float32] | None:
    """Read the weights in a model's metadata; None: `calibrate` did not write it. ValueError says what is wrong."""
    if WEIGHTS_KEY not in metadata:
        return None
    packed = b64decode(metadata[WEIGHTS_KEY], validate=True)
    weights = np.frombuffer(packed, dtype="<f4").astype(np.float32)
    if len(weights) < 2 or weights[1] not in (len(OUTPUT_ORDER), len(SHEAR_OUTPUT_ORDER)):
        raise ValueError("its weights are of another number of outputs than any model has")
    return weights
