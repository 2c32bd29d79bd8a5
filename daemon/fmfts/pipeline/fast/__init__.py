"""The compiled path of a healthy frame: what pad_pipeline.py says, where nothing is wrong, in C.

Every other frame, and every frame where there is no compiler, is judged by the stages in Python.
"""

from fmfts.pipeline.fast.path import FastPath, Judged, Kind, Lane, Passed
from fmfts.pipeline.fast.template import Template

__all__ = ["FastPath", "Judged", "Kind", "Lane", "Passed", "Template"]
