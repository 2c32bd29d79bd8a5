"""Finds the smallest tracking model that is sufficient for a pad's scene, from the contact error of each model."""

from fmfts.scene.advice import WORTH, WORTH_OF_TERM, advice, configured, placed_beside, recommended
from fmfts.scene.candidate import AMBIENT_CHANGE_T, Cost, Model, Surroundings
from fmfts.scene.error_budget import LOAD_SHARES, PLACES_MM, costs

__all__ = [
    "AMBIENT_CHANGE_T",
    "LOAD_SHARES",
    "PLACES_MM",
    "WORTH",
    "WORTH_OF_TERM",
    "Cost",
    "Model",
    "Surroundings",
    "advice",
    "configured",
    "costs",
    "placed_beside",
    "recommended",
]
