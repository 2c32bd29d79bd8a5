"""Makes tests/data/recordings/*.mcap: `make recordings`, or `python tests/data/make_recordings.py [FOLDER]`.

recordings/README.md says what each shows. Frames and contacts come from a simulated pad on a clock that counts from
zero, so that the files do not depend on the time of making.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np
from msgspec.structs import replace as replaced

from fmfts.baseline import Baseline
from fmfts.bus.frame_message import frame_message
from fmfts.config import PadConfig, SceneConfig, SimulatedSource, ToleranceConfig
from fmfts.config.example import ARRAY_PATH
from fmfts.config.file import load
from fmfts.pipeline.configured import contact_model_of, pipeline_of
from fmfts.pipeline.snapshot import state_message
from fmfts.sensor import Frame
from fmfts_recording.file import RecordingWriter
from fmfts_simulation.array import simulated_pad
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import Finger, Touch

FOLDER = Path(__file__).parent / "recordings"
RATE_HZ, SECONDS, BOOT, WHEN = 220, 3.0, "recorded", "1970-01-01T00:00:00+00:00"
PAD = "left"
Fault = Callable[[float, Frame], Frame]


def taps(time_s: float) -> Touch:
    """Three taps of 1.2 N, each 0.4 s long, at three places."""
    number, phase_s = divmod(time_s, 0.9)
    x_m = (-4e-3, 0.0, 5e-3)[min(int(number), 2)]
    force_n = 1.2 * np.sin(np.pi * (phase_s - 0.3) / 0.4) ** 2 if 0.3 < phase_s < 0.7 else 0.0
    return Touch(x_m, 2e-3, float(force_n))


def nobody(time_s: float) -> Touch:
    return Touch(0.0, 0.0, 0.0)


def left_hand(time_s: float) -> Touch:
    """0.9 N from 0.4 to 2.7 s, slid by 2 mm."""
    return Touch(-7e-3 + 1e-3 * time_s, -2e-3, 0.9 * held(time_s, 0.4, 2.7))


def right_hand(time_s: float) -> Touch:
    """0.7 N from 1.0 to 1.8 s, 14 mm beside the other."""
    return Touch(8e-3, 3e-3, 0.7 * held(time_s, 1.0, 1.8))


def held(time_s: float, from_s: float, until_s: float) -> float:
    """The share of the force: it rises and falls within a tenth of a second."""
    share = min(max(min(time_s - from_s, until_s - time_s) / 0.1, 0.0), 1.0)
    return float(np.sin(0.5 * np.pi * share) ** 2)


def whole(time_s: float, frame: Frame) -> Frame:
    return frame


def shifted_then_silent(time_s: float, frame: Frame) -> Frame:
    """Sensor 2 reads 18 µT too much for half a second, and later sensor 0 reads nothing for as long."""
    counts, valid = frame.counts.copy(), frame.valid.copy()
    if 0.7 < time_s < 1.2:
        counts[2] += 120
    if 1.8 < time_s < 2.3:
        valid[0] = False
    return replace(frame, counts=counts, valid=valid)


def sixth_shifted(time_s: float, frame: Frame) -> Frame:
    """Sensor 5 reads 117 µT too much for 0.2 s."""
    counts = frame.counts.copy()
    if 2.1 < time_s < 2.3:
        counts[5] += 270
    return replace(frame, counts=counts)


@dataclass(frozen=True, slots=True)
class Scene:
    """second: another finger, on the second standard pad."""

    finger: Finger
    ambient: SceneConfig
    turning_deg_per_s: float = 0.0
    fault: Fault = whole
    second: Finger | None = None


SCENES = {
    "taps": Scene(taps, SceneConfig(ambient="constant")),
    "fault": Scene(nobody, SceneConfig(ambient="drifting"), fault=shifted_then_silent),
    "turning": Scene(taps, SceneConfig(ambient="drifting"), turning_deg_per_s=60.0),
    "fingers": Scene(
        left_hand, SceneConfig(ambient="drifting"), turning_deg_per_s=20.0, fault=sixth_shifted, second=right_hand
    ),
}


def make(name: str, path: Path) -> None:
    """RecordingError if the file exists."""
    scene = SCENES[name]
    config = standard(scene) if scene.second is None else second_standard(scene)
    pipeline = pipeline_of(config, contact_model_of(config), BOOT)
    pipeline.use(undated(simulated_baseline(config)))
    source, writer = simulated_pad(config), RecordingWriter(path)
    source.finger, source.second_finger = scene.finger, scene.second
    state = replaced(state_message(pipeline, config, BOOT), utc_ns=0)
    writer.add("state", config.name, msgspec.to_builtins(state))
    for number in range(round(SECONDS * RATE_HZ)):
        now_ns = -(-number * 1_000_000_000 // RATE_HZ)
        for healthy in source.poll(now_ns):
            frame = scene.fault(number / RATE_HZ, healthy)
            message = frame_message(frame, config.name, BOOT, now_ns)
            writer.add("frame", config.name, msgspec.to_builtins(message))
            contact = replaced(pipeline.process(frame), t_publish_ns=now_ns, utc_ns=now_ns)
            writer.add("contact", config.name, msgspec.to_builtins(contact))
    writer.finish()
    writer.close()


def standard(scene: Scene) -> PadConfig:
    return PadConfig(
        name=PAD,
        source=SimulatedSource(rate_hz=RATE_HZ, turning_deg_per_s=scene.turning_deg_per_s),
        scene=scene.ambient,
        tolerance=ToleranceConfig(gain=0.005, sensor_rotation_deg=0.0, cross_axis=0.0),
    )


def second_standard(scene: Scene) -> PadConfig:
    """The second standard pad as config/array.toml draws it."""
    (config,) = load(ARRAY_PATH)[0].pad
    assert isinstance(config.source, SimulatedSource)
    source = replaced(config.source, rate_hz=RATE_HZ, turning_deg_per_s=scene.turning_deg_per_s)
    return replaced(config, source=source, scene=scene.ambient)


def undated(baseline: Baseline) -> Baseline:
    """The same file as if the clock had started at zero."""
    assert baseline.bare is not None
    assert baseline.rest is not None
    bare, rest = (replaced(one, utc=WHEN) for one in (baseline.bare, baseline.rest))
    return replaced(baseline, bare=bare, rest=rest).sealed()


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    for name in SCENES:
        path = folder / f"{name}.mcap"
        path.unlink(missing_ok=True)
        make(name, path)
        print(f"{path}: {path.stat().st_size} bytes")


if __name__ == "__main__":
    main()
