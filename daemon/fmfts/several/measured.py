"""The measured field, from which fingers are estimated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import SingularError
from fmfts.several.arrays import finite

Array = NDArray[np.float64]

NOTHING = np.empty(0)


@dataclass(slots=True)  # a frozen one takes three times as long, and a frame makes four
class Measured:
    """A field's change since rest (3N,), its variance by noise (3N,), and which values there are (3N,).

    The others may be NaN. foreign_t2 (3N, 3N): covariance of what was subtracted for neighbouring pads; None: nothing.
    """

    field_t: Array
    variance_t2: Array
    used: NDArray[np.bool_]
    foreign_t2: Array | None = None

    @classmethod
    def room(cls, values: int, foreign_t2: Array | None = None) -> Measured:
        """For C to fill."""
        return cls(np.empty(values), np.empty(values), np.empty(values, np.bool_), foreign_t2)

    @property
    def arrays(self) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
        """All as C reads them, which refuses what is not contiguous."""
        return self.field_t, self.variance_t2, self.foreign, self.used

    @property
    def there(self) -> NDArray[np.bool_]:
        """`used` as C reads it."""
        return np.ascontiguousarray(self.used, dtype=np.bool_)

    @property
    def foreign(self) -> Array:
        """`foreign_t2` as C reads it: empty if there is none."""
        return NOTHING if self.foreign_t2 is None else np.ascontiguousarray(self.foreign_t2, dtype=np.float64)

    def only(self, used: NDArray[np.bool_]) -> Measured:
        """The same for these axes (N, 3)."""
        return Measured(self.field_t, self.variance_t2, used.ravel(), self.foreign_t2)

    def checked(self, *names: str, **others: Array) -> None:
        """ValueError that names a present value of the fields `names`, or a number of `others`, that is not finite."""
        finite(**{name: np.where(self.used, getattr(self, name), 0.0) for name in names}, **others)


def refuse(wrong: str | None, size: int, measured: Measured, **others: Array) -> None:
    """Raises NumPy's error for a failure that C reports."""
    if wrong == "input":
        measured.checked("field_t", "variance_t2", **others)
    if wrong is not None:
        raise SingularError(f"a matrix of {size} × {size} is not {wrong}")
