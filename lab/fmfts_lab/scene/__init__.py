"""Finds the smallest tracking model that is sufficient for a pad's scene, from the contact error of each model."""

from fmfts_lab.scene.candidate import AMBIENT_CHANGE_T, Cost, Model, Surroundings
from fmfts_lab.scene.choice import WORTH, WORTH_OF_TERM, configured, placed_beside, recommended
from fmfts_lab.scene.error_budget import LOAD_SHARES, PLACES_MM, costs

__all__ = [
    "AMBIENT_CHANGE_T",
    "LOAD_SHARES",
    "PLACES_MM",
    "WORTH",
    "WORTH_OF_TERM",
    "Cost",
    "Model",
    "Surroundings",
    "configured",
    "costs",
    "placed_beside",
    "recommended",
]
