"""Where frames come from: hardware over a serial bridge or I2C, or a simulation."""

from fmfts.sensor.frame import Frame, step_t
from fmfts.sensor.source import Source, SourceError, SourceState

__all__ = ["Frame", "Source", "SourceError", "SourceState", "step_t"]
