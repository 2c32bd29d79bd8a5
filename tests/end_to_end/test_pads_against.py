"""Two pads press on one peg: the forces read by one correct the other's contact model."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import msgspec
import numpy as np
import pytest

from end_to_end.processes import run_command
from fmfts.baseline import Baseline
from fmfts.baseline.files import stored
from fmfts.baseline.job import BaselineJob
from fmfts.baseline.request import BaselineRequest
from fmfts.bus.frame_message import frame_message
from fmfts.common import exit_codes
from fmfts.config import PadConfig
from fmfts.config.file import load
from fmfts.pipeline.configured import load_contact_model, pipeline_of
from fmfts_recording.file import RecordingWriter
from fmfts_simulation.finger import Finger, Touch, no_finger
from fmfts_simulation.source import Simulated

RATE_HZ = 75
CONFIG = "".join(
    f"""
[[pad]]
name = "{name}"
[pad.source]
type = "simulated"
finger = "none"
turning_deg_per_s = 0
rate_hz = {RATE_HZ}
seed = {seed}
"""
    for name, seed in (("left", 3), ("right", 4))
)
BEGUN_NS, STEP_NS = 7_000_000_000, 10_000_000
HELD_S = 2.5  # each press, after a pause of the same length
# On the right pad; the left one is pressed in its middle. In mm and N.
PRESSES = ((0.0, 0.0, 0.5), (4.0, 1.0, 0.8), (-3.0, 3.0, 1.1), (2.0, -5.0, 0.7), (-6.0, -2.0, 0.9), (1.0, 6.0, 1.0))
STIFFER = 1.4  # the right pad's silicone moves like the model's under a force that is smaller by this factor


def record_baseline(pad: PadConfig, source: Simulated) -> int:
    """Returns the time at which it is recorded."""
    source.finger = no_finger
    wanted = BaselineRequest(pad.pad(), pad.tolerance.si(), bare=False, replaced=False)
    with ThreadPoolExecutor(max_workers=1) as executor:
        job = BaselineJob(wanted, None, source, executor)
        now_ns = BEGUN_NS
        while job.share < 1.0:
            now_ns += STEP_NS
            for frame in source.poll(now_ns):
                job.take(frame)
    assert job.facts() is not None
    return now_ns


def pressing(begun_ns: int, is_right: bool) -> Finger:
    def finger(time_s: float) -> Touch:
        number, within = divmod((time_s - (begun_ns - BEGUN_NS) * 1e-9) / HELD_S, 2.0)
        x_mm, y_mm, force_n = PRESSES[max(0, min(int(number), len(PRESSES) - 1))]
        force_n = force_n if within > 1.0 and 0 <= number < len(PRESSES) else 0.0
        return Touch(x_mm * 1e-3, y_mm * 1e-3, force_n / STIFFER) if is_right else Touch(5e-4, 0.0, force_n)

    return finger


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With the baselines of both pads, and a recording of frames and contacts."""
    folder = tmp_path_factory.mktemp("against")
    (folder / "config.toml").write_text(CONFIG)
    pads = load(folder / "config.toml")[0].pad
    sources = {pad.name: Simulated(pad) for pad in pads}
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(folder / "state"))
        now_ns = max(record_baseline(pad, sources[pad.name]) for pad in pads)
        baselines: dict[str, Baseline | None] = {pad.name: stored(pad.pad()) for pad in pads}
    writer = RecordingWriter(folder / "frames.mcap")
    pipelines = {pad.name: pipeline_of(pad, load_contact_model(pad), boot="0" * 8) for pad in pads}
    for pad in pads:
        baseline = baselines[pad.name]
        assert baseline is not None
        pipelines[pad.name].use(baseline)
        sources[pad.name].finger = pressing(now_ns, pad.name == "right")
    end_ns = now_ns + round(1e9 * HELD_S * (2 * len(PRESSES) + 1))
    while now_ns < end_ns:
        now_ns += STEP_NS
        for pad in pads:
            for frame in sources[pad.name].poll(now_ns):
                message = frame_message(frame, pad.name, "0" * 8, frame.host_time_ns)
                writer.add("frame", pad.name, msgspec.to_builtins(message))
                contact = pipelines[pad.name].process(frame)
                writer.add("contact", pad.name, msgspec.to_builtins(contact))
    writer.finish()
    writer.close()
    return folder


def command(folder: Path, *words: object) -> tuple[int, str, str]:
    environment = {"XDG_STATE_HOME": str(folder / "state"), "PATH": ""}
    done = run_command(*words, "--config", folder / "config.toml", "--pad", "right", environment=environment)
    return done.returncode, done.stdout, done.stderr


def test_other_pad_labels_presses_and_corrects_the_model(folder: Path) -> None:
    code, out, error = command(
        folder,
        *("collect", "--against", "left", "--frames", folder / "frames.mcap", "-o", folder / "data.csv", "--json"),
    )
    assert code == 0, error
    facts = json.loads(out)
    assert (facts["collected"], facts["refused"]) == (len(PRESSES), [])
    assert 0.1 < facts["scale_sd"] < 0.6, "nobody weighed the left pad: its silicone may be of any cure"
    (told,) = facts["warnings"]
    assert f"pad 'left' in {folder / 'frames.mcap'} knows its forces to {facts['scale_sd']:.0%} alone" in told
    assert "weigh that pad" in told
    code, out, error = command(
        folder,
        *("calibrate", "--correct", folder / "data.csv", "-o", folder / "own.onnx", "--json"),
        *("--scale-sd", str(min(facts["scale_sd"], 0.3))),
    )
    assert code == 0, error
    report = json.loads(out)
    assert report["stiffness"] == pytest.approx(STIFFER, rel=0.05)
    assert "the places are those that the uncorrected model reads" in error


def test_pad_without_a_press_is_no_gauge(folder: Path) -> None:
    code, _, error = command(
        folder, "collect", "--against", "middle", "--frames", folder / "frames.mcap", "-o", folder / "none.csv"
    )
    assert code == exit_codes.DATA
    assert "pad 'middle' reads no force in it: press both pads on one peg" in error
    assert not (folder / "none.csv").exists()


def test_places_of_such_a_table_are_empty(folder: Path) -> None:
    header, *lines = (folder / "data.csv").read_text().splitlines()
    places = np.array([line.split(",")[1:3] for line in lines])
    assert header.startswith("press,x_mm,y_mm,force_n")
    assert (places == "").all()
