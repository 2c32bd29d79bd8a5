"""How wrong a pad with four magnets is when it is published, and when a controller reads it: `bench now` of that pad.

The motions, their truth, and the errors are those of `now`; one finger presses.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator, Sequence

import msgspec
import numpy as np

from fmfts.bus.messages import ContactMessage
from fmfts.config import PadConfig, SimulatedSource
from fmfts.contact.array_model import ArrayModel
from fmfts.pad import Array
from fmfts.pipeline.configured import HOST_S, READ_S, contact_model_of, several_scene_of
from fmfts.pipeline.lead import Lead
from fmfts.pipeline.several_pipeline import SeveralPipeline
from fmfts.sensor import Frame
from fmfts.sensor.early import EarlySample
from fmfts.sensor.wire.packets import EARLY_BYTES, LINE_BITS_PER_BYTE, frame_bytes
from fmfts_lab.bench import several_now_bound
from fmfts_lab.bench.drills import RATE_HZ, TURNING_DEG_PER_S
from fmfts_lab.bench.motions import Motion
from fmfts_lab.bench.now import HEADER, Errors, Run, told_line
from fmfts_lab.bench.now_pads import BAUD, BEFORE_S, drawn
from fmfts_lab.finite_elements.array_pad import array_config
from fmfts_simulation.array import simulated_pad
from fmfts_simulation.baseline import simulated_baseline

LEAD = Lead(
    HOST_S + LINE_BITS_PER_BYTE * frame_bytes(8) / BAUD, HOST_S + READ_S + LINE_BITS_PER_BYTE * EARLY_BYTES / BAUD
)


def run(options: Namespace) -> None:
    if options.bound:
        several_now_bound.run(options, LEAD.frame_s, LEAD.early_s)
        return
    for samples in (False, True):
        errors = dict[str, Errors]()
        for config, motions in drawn(options.seed, options.pads, options.seconds, config_of=_built):
            for motion in motions:
                found = errors.setdefault(motion.name, Errors())
                found.add(Run.of(motion, *_messages(config, motion, options.seconds, samples)))
        of_samples = f", and {LEAD.early_s * 1e3:.2f} ms after a sample is taken" if samples else ""
        when = f"published {LEAD.frame_s * 1e3:.2f} ms after a frame is made{of_samples}"
        print(f"{options.pads} built pads of four magnets, seed {options.seed}; {when}\n{HEADER}")
        for name, found in errors.items():
            print(told_line(name, found.facts()), flush=True)


def _built(seed: int) -> PadConfig:
    config = array_config(seed=seed)
    assert isinstance(config.source, SimulatedSource)
    source = msgspec.structs.replace(config.source, finger="none", turning_deg_per_s=TURNING_DEG_PER_S)
    return msgspec.structs.replace(config, source=source)


def _messages(
    config: PadConfig, motion: Motion, seconds: float, samples: bool
) -> tuple[Array, Sequence[ContactMessage]]:
    """When the messages are published, since the motion began, and they themselves."""
    model, per_k = contact_model_of(config), config.magnet.temperature_coefficient_per_k
    assert isinstance(model, ArrayModel)
    scene = several_scene_of(config)
    pipeline = SeveralPipeline(config.pad(), model, "bench", float(RATE_HZ), scene, per_k, lead=LEAD)
    pipeline.use(simulated_baseline(config))
    published, messages = list[float](), []
    for at_s, packet in _packets(config, motion, seconds, samples):
        answer = pipeline.early(packet) if isinstance(packet, EarlySample) else pipeline.answer(packet)
        if answer is not None:
            # A sample that is taken while a frame is sent waits for it.
            published.append(max(at_s - BEFORE_S, published[-1] if published else -np.inf))
            messages.append(answer.message)
    return np.array(published), messages


def _packets(
    config: PadConfig, motion: Motion, seconds: float, samples: bool
) -> Iterator[tuple[float, EarlySample | Frame]]:
    """Frames, and with `samples` each chip's sample before the frame that holds it, with the times of publishing."""
    source = simulated_pad(config)
    source.finger = lambda time_s: motion.finger(time_s - BEFORE_S)
    for step in range(round((BEFORE_S + seconds) * RATE_HZ)):
        for frame in source.poll(round(step * 1e9 / RATE_HZ)):
            made_s = frame.sequence / RATE_HZ + LEAD.frame_s
            early = []
            for sensor in np.flatnonzero(frame.fresh & frame.valid).tolist() if samples else ():
                time_us = int(frame.sampled_us[sensor])
                sent_s = time_us * 1e-6 + LEAD.early_s
                x, y, z = frame.counts[sensor].tolist()
                early.append((sent_s, EarlySample(0, sensor, time_us, frame.gain_code, (x, y, z), frame.chip)))
            yield from sorted((one for one in early if one[0] < made_s), key=lambda one: one[0])
            yield made_s, frame
