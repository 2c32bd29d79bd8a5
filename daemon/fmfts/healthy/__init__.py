"""The compiled path of a healthy frame: what pipeline.py says, where nothing is wrong, in C.

Every other frame, and every frame where there is no compiler, is judged by the stages in Python.
"""

from fmfts.healthy.path import HealthyPath, Judged, Kind, Lane, Passed
from fmfts.healthy.template import Template

__all__ = ["HealthyPath", "Judged", "Kind", "Lane", "Passed", "Template"]
