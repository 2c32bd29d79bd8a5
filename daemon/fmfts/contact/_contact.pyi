"""The contact model in C: network.h, refine.h and step.h say what is computed."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from typing_extensions import Buffer

Array = NDArray[np.float64]

PARAMETERS: list[tuple[str, str, int]]  # of fmfts_contact_parameters, as common/record.py takes them
MAX_HIDDEN: int
RELEASE_FRAMES: int

class Evaluated(Protocol):
    """A contact model that Python runs: inference.py. pose, contact, jacobian: buffers of float32."""

    @property
    def pose(self) -> NDArray[np.float32]: ...
    @property
    def contact(self) -> NDArray[np.float32]: ...
    @property
    def jacobian(self) -> NDArray[np.float32]: ...
    def run(self) -> None: ...

def touch(
    onset_chi2: float, release_chi2: float, touched: bool, quiet_frames: int, change: Array, covariance: Array, /
) -> tuple[bool, int, bool]:
    """Whether a pad is touched after a frame with this change (P,) from rest, and its covariance (P, P); how many quiet
    frames there were; and False if the covariance is none. Both empty: the frame has no pose."""

def infer(vector: Buffer, pose: Buffer, contact: Buffer, jacobian: Buffer, /) -> None: ...
def pressed(
    table: Array,
    width: int,
    terms: int,
    first_mm: float,
    spacing_mm: float,
    scale_n: float,
    fingers: Array,
    pressed: Array,
    /,
) -> None: ...
def respond(
    response: bytes, press: NDArray[np.float64], change: NDArray[np.float64], slope: NDArray[np.float64], /
) -> None: ...
def basis(response: bytes, press: NDArray[np.float64], basis: NDArray[np.float64], /) -> None: ...
def refine(
    response: bytes,
    change: Buffer,
    covariance: Buffer,
    steps: int,
    shear_share: float,
    press: Buffer,
    spread: Buffer,
    /,
) -> float | None: ...
def widened(response: bytes, press: Buffer, wider_mm2: float, more: Buffer, /) -> None:
    """Writes what a finger adds to the movement (5,) under `press` (5,), with zeros where the response has no load: its
    second moment along each axis is larger than the probe's by wider_mm2, or smaller where that is negative."""

def estimate(
    parameters: Buffer,
    model: Buffer | Evaluated,
    response: bytes | None,
    pose: Buffer,
    covariance: Buffer,
    places: Buffer,
    deviations: Buffer,
    /,
) -> tuple[bool, bool, float]:
    """Writes place, force and shear, and their deviations, in SI. pose (6,), covariance (6, 6): in the model's units.

    response: None to leave the network's answer as it is. Returns over_range, refused, force_min_n.
    ValueError if the model gives no number; what `model` raises.
    """
