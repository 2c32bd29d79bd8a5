from typing import Any

from numpy.typing import NDArray

def refine(
    response: bytes,
    change: NDArray[Any],
    covariance: NDArray[Any],
    steps: int,
    press: NDArray[Any],
    spread: NDArray[Any],
    /,
) -> bool: ...
