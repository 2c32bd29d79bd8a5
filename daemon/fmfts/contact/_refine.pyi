from typing import Any

from numpy.typing import NDArray

def refine(
    knots_x: int,
    knots_y: int,
    monomials: int,
    loads: int,
    table: NDArray[Any],
    exponent: NDArray[Any],
    coefficient: NDArray[Any],
    change: NDArray[Any],
    covariance: NDArray[Any],
    steps: int,
    press: NDArray[Any],
    spread: NDArray[Any],
    /,
) -> bool: ...
