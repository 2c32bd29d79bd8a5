"""The first messages of each frozen world are unchanged (`make golden`: all of 269,909 frames)."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np
import pytest

from fmfts.pipeline.encoded import EncodedMessage
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.pipeline.snapshot import restore, snapshot
from fmfts_recording.replay import essence
from golden.__main__ import frozen_file, judged
from golden.noise import noise
from golden.replayed import AS_ALWAYS, Way, answers, pipelines_of, replay
from golden.said import BLOCK, OF_A_DEVIATION, compare, decoded, floor_of
from golden.world import FOLDER, load, names

# So that all of them take some seconds; a frame of a pad with several magnets takes up to a millisecond.
FIRST = {
    "fingers": 400, "fingers-faulty": 300, "poses": 400, "faulty": 1500, "healthy": 2000, "noisy": 200, "cold": 500,
    "turning-constant": 300, "skin": 300,
}  # fmt: skip
FIRST_OF_OTHERS = 700
# This many messages of worlds with different memories, each in the middle of what it remembers.
RECORDED = {
    "cold": 500, "faulty": 750, "fingers-faulty": 160, "growing": 500, "healthy": 400, "leaps": 700, "lifted": 900,
    "neighbours": 300, "poses": 160, "samples-on-board": 800, "skin": 100, "smoothed": 300, "steel-faulty": 900,
    "turning-constant": 400,
}  # fmt: skip
LARGEST_BYTES = 3_000_000


@pytest.mark.parametrize("name", names())
def test_frozen_world_is_answered_as_before(name: str) -> None:
    for pad, verdict in judged(name, FIRST.get(name, FIRST_OF_OTHERS)).items():
        assert verdict.compared > 30, pad
        assert verdict.differences == [], pad


def said_by(name: str, way: Way) -> list[Any]:
    """All values of a world's first messages, except the times of sending."""
    some = islice(answers(load(name)[0], way), RECORDED[name])
    return [(pad, None if message is None else essence(message)) for pad, message, _ in some]


@pytest.mark.parametrize("name", RECORDED)
def test_snapshots_and_a_replay_change_no_bit(name: str) -> None:
    """A snapshot is taken where a recording begins: the pad continues unaffected, and so does a replay."""
    frames = RECORDED[name] // (4 if "samples" in name else len(load(name)[0].pads))
    assert said_by(name, Way(snapshots=50, anew=frames // 2)) == said_by(name, AS_ALWAYS)


def test_snapshot_holds_every_memory_number() -> None:
    random = np.random.default_rng(1)
    with pipelines_of(load("faulty")[0]) as some, pipelines_of(load("faulty")[0]) as others:
        (one,), (other,) = some.values(), others.values()
        assert isinstance(one, PadPipeline)
        assert isinstance(other, PadPipeline)
        memory = one.memory
        for name, values in memory.fields.items():
            drawn = random.normal(size=values.shape) if values.dtype.kind == "f" else random.random(values.shape) < 0.5
            memory.fields[name] = np.asarray(drawn).astype(values.dtype)
        one.recall(memory)
        restore(other, snapshot(one))
        for name, values in other.memory.fields.items():
            assert np.array_equal(values, memory.fields[name]), name


def test_golden_extras_agree_with_their_message() -> None:
    (pad,), told = load("faulty-constant")[0].pads, set()
    with pipelines_of(load("faulty-constant")[0]) as pipelines:
        (pipeline,) = pipelines.values()
        for number, (_, events) in enumerate(islice(pad.events(), 600)):
            answer = pipeline.answer(events[0])
            assert isinstance(answer, EncodedMessage)
            message = answer.message
            for name in ("health", "contact", "over_range", "t_sample_ns", "t_publish_ns"):
                assert getattr(answer, name) == getattr(message, name)
            assert message.t_sample_ns <= message.t_publish_ns
            assert message.seq == number + 1
            told.add((message.health, message.contact))
    assert len(told) > 3


def test_frozen_worlds_are_many_and_small() -> None:
    assert sum(load(name)[0].frames for name in names()) >= 200_000
    assert sum(path.stat().st_size for path in FOLDER.iterdir()) < LARGEST_BYTES
    assert {path.name for path in FOLDER.glob("*.said.xz")} == {frozen_file(name).name for name in names()}


def test_frames_are_those_that_were_frozen() -> None:
    """Of one world: `make golden` checks it for all."""
    world, digest = load("steel")
    assert world.digest == digest
    world.pads[0].stream.counts[1000, 2, 1] += 1
    assert world.digest != digest


def test_noise_is_normal_and_white() -> None:
    drawn = noise(3, 4000, 12, 1320).astype(float)
    # 48,000 numbers: the mean to 5 / sqrt(48000) = 0.023 deviations, the deviation to 1.6 %; rounding adds 1/12.
    assert abs(drawn.mean()) < 0.03
    assert drawn.std() == pytest.approx(np.hypot(1.32, np.sqrt(1.0 / 12.0)), rel=0.02)
    assert np.abs(np.corrcoef(drawn.T) - np.eye(12)).max() < 0.08
    assert abs(np.corrcoef(drawn[:-1, 0], drawn[1:, 0])[0, 1]) < 0.08


def test_golden_finds_only_differences_that_matter() -> None:
    said = replay(load("without-model")[0], 4 * BLOCK)["left"]
    frozen = decoded(frozen_file("without-model").read_bytes())["left"]
    assert compare(said, frozen).differences == []
    place = frozen.names.index("pose.position_m[2]")
    sd_m = frozen.first[2, frozen.names.index("pose.position_sd_m[2]")]
    allowed_m = max(OF_A_DEVIATION * sd_m, floor_of("position_m"))
    for off_m, is_found in ((0.5 * allowed_m, False), (1.5 * allowed_m, True)):
        moved = frozen.first.copy()
        moved[2, place] += off_m
        assert bool(compare(said, replace(frozen, first=moved)).differences) == is_found
        mean = frozen.mean.copy()
        mean[2, place] += off_m
        assert bool(compare(said, replace(frozen, mean=mean)).differences) == is_found
    words = list(frozen.words)
    words[60] = words[60].replace('"health":"ok"', '"health":"lost"')
    (counted, named) = compare(said, replace(frozen, words=words)).differences
    assert counted == "1 messages say something else; there are 4 changes"
    assert named == "message 60: health is 'ok', was 'lost'"
