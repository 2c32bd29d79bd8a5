from typing import Any

from numpy.typing import NDArray

HEAD: dict[str, int]
MOST: dict[str, int]
WORK_BYTES: int
LANES: int

def predict(
    model: NDArray[Any],
    work: NDArray[Any],
    fingers: NDArray[Any],
    field: NDArray[Any],
    slope: NDArray[Any],
    by_pose: NDArray[Any],
    change: NDArray[Any],
    pressed: NDArray[Any],
    /,
) -> bool: ...
def covariance(
    model: NDArray[Any],
    work: NDArray[Any],
    fingers: NDArray[Any],
    field: NDArray[Any],
    slope: NDArray[Any],
    by_pose: NDArray[Any],
    change: NDArray[Any],
    pressed: NDArray[Any],
    variance: NDArray[Any],
    ambient: NDArray[Any],
    covariance: NDArray[Any],
    /,
) -> None: ...
