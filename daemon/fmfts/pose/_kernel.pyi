from typing import Any

from numpy.typing import NDArray

MAX_MAGNETS: int

def solve(
    pads: int,
    rows: int,
    magnets: int,
    measurements: NDArray[Any],
    magnet_rows: NDArray[Any],
    parts: NDArray[Any],
    start: NDArray[Any],
    prior_mean: NDArray[Any] | None,
    prior_covariance: NDArray[Any] | None,
    rate: NDArray[Any] | None,
    diffusion: NDArray[Any] | None,
    stop_chi2: float,
    max_iterations: int,
    project: bool,
    state: NDArray[Any],
    covariance: NDArray[Any],
    direction: NDArray[Any],
    summary: NDArray[Any],
    /,
) -> None: ...
def move(*arrays: NDArray[Any]) -> None: ...
def fields(*arrays: NDArray[Any]) -> None: ...
def read(*arrays: NDArray[Any]) -> None: ...
def deviations(*arrays: NDArray[Any] | None) -> bool: ...
def dipole(*given: NDArray[Any] | float) -> None: ...
