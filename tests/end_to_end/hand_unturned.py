"""What a daemon would publish from the same frames if the hand had never been turned: the product's own pipelines.

They get every frame that the daemon used, with the baselines from before the turn. A separate process, `python
hand_unturned.py CONFIG BASELINES BASE BIND`, publishes the corresponding `contact/<pad>` on BIND.
"""

from __future__ import annotations

import signal
import sys
from pathlib import Path

import msgspec
import zmq

from fmfts.baseline import load as load_baseline
from fmfts.bus.encoding import encode
from fmfts.bus.frame_message import frame_of
from fmfts.bus.messages import FrameMessage
from fmfts.config import Config
from fmfts.config.file import load
from fmfts.pipeline.configured import Pipeline, contact_model_of, feel_neighbours, pipeline_of
from fmfts.pipeline.encoded import EncodedMessage
from fmfts_client import Subscription


def pipelines_of(config: Config, baselines: Path) -> dict[str, Pipeline]:
    """The pads' pipelines with the baselines in a folder, initialised like the daemon's."""
    pipelines: dict[str, Pipeline] = {}
    for pad in config.pad:
        pipelines[pad.name] = pipeline_of(pad, contact_model_of(pad), "unturned")
        baseline = load_baseline(baselines / f"{pad.name}.json", pad.pad())
        assert baseline is not None, pad.name
        pipelines[pad.name].use(baseline)
    for pad in config.pad:
        feel_neighbours(pad, config.pad, pipelines)
    return pipelines


def publish(config: Path, baselines: Path, base: str, bind: str) -> None:
    """Until SIGTERM."""
    pipelines = pipelines_of(load(config)[0], baselines)
    out = zmq.Context.instance().socket(zmq.PUB)
    with out, Subscription(("frame",), None, base) as frames:
        out.setsockopt(zmq.LINGER, 0)
        out.bind(bind)
        while True:
            message = frames.receive()
            if message is None or message.kind != "frame":
                continue
            frame = msgspec.convert(message.body, FrameMessage)
            if frame.used:
                pipeline = pipelines[message.pad]
                answer = pipeline.answer(frame_of(frame, chip=pipeline.pad.chip))
                payload = answer.payload if isinstance(answer, EncodedMessage) else encode(answer)
                out.send_multipart((f"contact/{message.pad}".encode(), payload))


def main() -> int:
    config, baselines, base, bind = sys.argv[1:]
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        publish(Path(config), Path(baselines), base, bind)
    except KeyboardInterrupt:
        return 0
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
