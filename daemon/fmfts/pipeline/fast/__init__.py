"""The fast path: C does for healthy frames what pad_pipeline.py does in Python.

The stages in Python judge every other frame.
"""

from fmfts.pipeline.fast.lane import Kind, Lane, Passed
from fmfts.pipeline.fast.path import FastPath, Judged, Missing, Verdict
from fmfts.pipeline.fast.template import Template

__all__ = ["FastPath", "Judged", "Kind", "Lane", "Missing", "Passed", "Template", "Verdict"]
