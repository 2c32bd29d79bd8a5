"""A pad whose frames go from their bytes to the bus in one call, for benchmarks without a line."""

from __future__ import annotations

from fmfts.bus.publisher import Publisher, contact_topic
from fmfts.config import PadConfig
from fmfts.pipeline import _pad
from fmfts.pipeline.configured import contact_model_of
from fmfts.pipeline.configured import pipeline_of as configured_pipeline
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.runtime.fast_loop import send_function
from fmfts.sensor.patience import BEHIND, IN_TIME
from fmfts.sensor.source import SourceState
from fmfts.sensor.wire.clock import DeviceClock
from fmfts.sensor.wire.link import Link
from fmfts.sources import on_board
from fmfts_lab.bench import latency_rig as rig
from fmfts_lab.bench.latency import pad_of
from fmfts_simulation.baseline import simulated_baseline

NEVER_NS = 1 << 62  # the frames' times are not this computer's, so that none counts as overdue
PERIOD_NS = round(1e9 / rig.RATE_HZ)


class Whole:
    """A pad whose frames go from their bytes to the bus in one call, as in the daemon's loop."""

    LINE = 0  # stands for a descriptor; nothing reads it

    def __init__(self, config: PadConfig, publisher: Publisher, pipeline: PadPipeline | None = None) -> None:
        """pipeline: None: that of the pad alone."""
        self._clock, self._topic = DeviceClock(), contact_topic(config.name)
        self._link = Link({0: on_board(config)}, SourceState("bench"), self._clock)
        self._publisher = publisher
        self._pipeline = pipeline_of(config) if pipeline is None else pipeline
        send = send_function()
        assert send is not None
        self._loop = _pad.Loop(-1, send, publisher.address, IN_TIME, BEHIND)
        self._lent: _pad.Pad | None = None

    def take(self, line: bytes, arrival_ns: int) -> bool:
        return self._lent is not None and self._loop.take(self.LINE, line, arrival_ns)

    def take_in_python(self, line: bytes, arrival_ns: int) -> None:
        """Let Python process a line that the loop left; the loop may take the next lines."""
        if self._lent is not None:
            self._loop.end(self.LINE)
            self._pipeline.end(self._lent)
        for frame in self._link.feed(line, arrival_ns):
            self._publisher.send_encoded(self._topic, self._pipeline.answer(frame).payload)
        self._lent = self._pipeline.begin(self._clock.line, self._topic, 0, NEVER_NS)
        if self._lent is not None:
            self._loop.begin(self.LINE, b"", (self._lent,))


def pipeline_of(config: PadConfig) -> PadPipeline:
    """The pad's pipeline, with its simulated baseline in use."""
    pipeline = configured_pipeline(config, contact_model_of(config), "bench")
    assert isinstance(pipeline, PadPipeline)
    pipeline.use(simulated_baseline(pad_of(0)))
    return pipeline
