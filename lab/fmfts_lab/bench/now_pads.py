"""The built pads and the motions with which `bench now` and `study speed-accuracy` judge what a controller acts on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.baseline import Baseline, Mounting
from fmfts.config import PadConfig
from fmfts.contact import ContactModel
from fmfts.pad import Array
from fmfts.pipeline.configured import HOST_S, READ_S, load_contact_model
from fmfts.pipeline.lead import Lead
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.scene.tracking import tracking_model_for
from fmfts.sensor.frame import WireFrame
from fmfts.sensor.wire.packets import EARLY_BYTES, LINE_BITS_PER_BYTE, frame_bytes
from fmfts_lab.bench.drills import RATE_HZ, pad_config
from fmfts_lab.bench.motions import DRAWN, Draw, Motion
from fmfts_lab.bench.now_early import EarlyToo, Sent
from fmfts_lab.bench.tapped import ManyFrames
from fmfts_simulation.baseline import simulated_baseline

BAUD = 460800
# From making a frame to publishing its message: on the line, and in the daemon.
TRANSPORT_S = LINE_BITS_PER_BYTE * frame_bytes(4) / BAUD + HOST_S
BEFORE_S = 0.5  # before the first motion
# The same for a sample that comes before its frame, counted from the end of its conversion.
EARLY_S = READ_S + LINE_BITS_PER_BYTE * EARLY_BYTES / BAUD + HOST_S
READ_EVERY_S = 1e-3  # a controller's period


def drawn(
    seed: int,
    pads: int,
    seconds: float,
    draws: Sequence[Draw] = DRAWN,
    config_of: Callable[[int], PadConfig] = lambda seed: pad_config("drifting", seed),
) -> Iterator[tuple[PadConfig, list[Motion]]]:
    """Each pad with its motions. The same seed draws the same. config_of: a pad from the seed that builds it."""
    random = np.random.default_rng([seed, 19])
    for pad in range(pads):
        yield config_of(1000 * seed + pad), [draw(random, seconds) for draw in draws]


@dataclass(frozen=True, slots=True)
class BuiltPad:
    """A pad that is built within its tolerances, with its baseline."""

    config: PadConfig
    model: ContactModel
    baseline: Baseline
    mounting: Mounting

    @classmethod
    def of(cls, config: PadConfig) -> BuiltPad:
        baseline = simulated_baseline(config)
        return cls(config, load_contact_model(config), baseline, baseline.mounting(config.pad()))

    def pipeline(self, model: ContactModel | None = None) -> PadPipeline:
        """A new pipeline that uses the baseline. model: None, the pad's own."""
        pad, tracking = self.config.pad(), tracking_model_for(self.config.scene, self.config.magnet).tracking
        pipeline = PadPipeline(
            pad, model or self.model, "bench", float(RATE_HZ), tracking, lead=Lead(TRANSPORT_S, EARLY_S)
        )
        pipeline.use(self.baseline, self.mounting)
        return pipeline

    def frames(self, motion: Motion, seconds: float) -> Iterator[WireFrame]:
        """Frames from BEFORE_S before the motion begins to `seconds` after that."""
        source = ManyFrames(self.config)
        source.finger = lambda time_s: motion.finger(time_s - BEFORE_S)
        for frames in source.batches(round((BEFORE_S + seconds) * RATE_HZ)):
            yield from frames

    def packets(self, motion: Motion, seconds: float) -> Iterator[tuple[float, Sent]]:
        """Frames and the samples that come before them, with the times at which their messages are published."""
        source = EarlyToo(self.config, BAUD)
        source.finger = lambda time_s: motion.finger(time_s - BEFORE_S)
        return source.sent(BEFORE_S + seconds)


def published_s(count: int) -> Array:
    """(count,) when the messages of the frames are published, since the motion began."""
    return np.arange(count) / RATE_HZ + TRANSPORT_S - BEFORE_S


def read_s(motion: Motion, published: Array) -> tuple[Array, NDArray[np.intp]]:
    """When a controller reads within the motion's windows, and which message it finds: the newest."""
    moments = np.arange(0.0, published[-1], READ_EVERY_S)
    moments = moments[motion.counts(moments)]
    newest: NDArray[np.intp] = np.searchsorted(published, moments, side="right") - 1
    return moments, newest
