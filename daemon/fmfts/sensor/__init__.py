"""Where frames come from: hardware over a serial bridge or I2C, or a simulation."""

from fmfts.sensor.frame import Frame
from fmfts.sensor.source import ByteSource, Source, SourceError, SourceState

__all__ = ["ByteSource", "Frame", "Source", "SourceError", "SourceState"]
