"""Makes tests/data/recordings/paper.mcap: `make recordings`, or this with another FOLDER.

The paper's readings are shown to the emulated chips of the firmware's host build one after the other; its packets come
over a pty, through the bridge, into the pipeline. Unlike the others, the file differs each time: its clock is real.
"""

from __future__ import annotations

import select
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from end_to_end.paper import readings
from end_to_end.processes import FirmwareHost
from fmfts import baseline as baselines
from fmfts.bus.frame_message import frame_message
from fmfts.config import BridgeSource, PadConfig
from fmfts.pipeline.configured import load_contact_model, pipeline_of
from fmfts.pipeline.snapshot import state_message
from fmfts.sensor import Frame
from fmfts.sensor.bridge.bridge import Bridge
from fmfts.sources import on_board
from fmfts_recording.file import RecordingWriter

FOLDER = Path(__file__).parent / "recordings"
PAD, BOOT, RATE_HZ = "paper", "recorded", 220
BARE_FRAMES, SHOWN_FRAMES = 660, 66  # 3 s, 0.3 s
SETTLING_FRAMES = 12  # until every chip has measured the present field


def frames_of(bridge: Bridge) -> Iterator[Frame]:
    while True:
        descriptor = bridge.fileno()
        select.select([] if descriptor is None else [descriptor], [], [], 0.01)
        yield from bridge.poll(time.monotonic_ns())


def take(frames: Iterator[Frame], count: int) -> list[Frame]:
    return [next(frames) for _ in range(count)]


def make(path: Path, port_folder: Path) -> None:
    with FirmwareHost(port_folder) as host:
        config = PadConfig(name=PAD, source=BridgeSource(port=str(host.port), rate_hz=RATE_HZ))
        drawing = config.pad()
        pipeline = pipeline_of(config, load_contact_model(config), BOOT)
        bridge = Bridge({0: on_board(config)})
        frames = frames_of(bridge)
        host.tell("noise 0 0")
        host.field(np.zeros((4, 3)))
        while not next(frames).valid.all():
            pass
        take(frames, SETTLING_FRAMES)
        nothing = take(frames, BARE_FRAMES)
        bare, before = baselines.summarise(nothing), nothing[-1]
        pipeline.use(baselines.make_bare(drawing, config.tolerance.si(), bare, None))
        writer = RecordingWriter(path)
        state = msgspec.structs.replace(state_message(pipeline, config, BOOT), utc_ns=0)
        writer.add("state", PAD, msgspec.to_builtins(state))
        for reading in readings():
            host.field(reading.field_t)
            while np.array_equal(next(frames).counts, before.counts):
                pass  # sent before the reading
            take(frames, SETTLING_FRAMES)
            shown = take(frames, SHOWN_FRAMES)
            before = shown[-1]
            for frame in shown:
                at_ns = frame.host_time_ns
                writer.add("frame", PAD, msgspec.to_builtins(frame_message(frame, PAD, BOOT, at_ns)))
                contact = msgspec.structs.replace(pipeline.process(frame), t_publish_ns=at_ns, utc_ns=at_ns)
                writer.add("contact", PAD, msgspec.to_builtins(contact))
        writer.finish()
        writer.close()
        bridge.close()


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    path = folder / "paper.mcap"
    with tempfile.TemporaryDirectory() as made:
        make(Path(made) / path.name, Path(made))
        shutil.copyfile(Path(made) / path.name, path)
    print(f"{path}: {path.stat().st_size} bytes")


if __name__ == "__main__":
    main()
