"""The answer of a contact model."""

from __future__ import annotations

from dataclasses import dataclass

from fmfts.pad import Array


@dataclass(frozen=True, slots=True)
class ContactEstimate:
    """values, deviations (3,) or (5,): x, y (m), force, and shear along x and y (N). All are finite.

    over_range: the pose or the force is beyond what the model was trained on. The values are then those of the nearest
    pose that it knows; only force_min_n, a lower bound of the force, can be trusted. Else that is None.
    refused: the press is where a model of five outputs cannot separate shear from place: none of its numbers can be
    trusted.
    """

    values: Array
    deviations: Array
    over_range: bool
    force_min_n: float | None
    refused: bool = False

    @property
    def x_m(self) -> float:
        return float(self.values[0])

    @property
    def y_m(self) -> float:
        return float(self.values[1])

    @property
    def force_n(self) -> float:
        return float(self.values[2])

    @property
    def shear_n(self) -> Array | None:
        """(2,) along x and y; None from a model of three outputs."""
        return self.values[3:] if len(self.values) > 3 else None

    @property
    def x_sd_m(self) -> float:
        return float(self.deviations[0])

    @property
    def y_sd_m(self) -> float:
        return float(self.deviations[1])

    @property
    def force_sd_n(self) -> float:
        return float(self.deviations[2])
