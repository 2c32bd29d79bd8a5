"""Sets a simulated pad up as a user does, faster than real time: self-test, bare, rest and turn."""

from __future__ import annotations

from collections.abc import Sequence

from fmfts.baseline import Baseline
from fmfts.baseline.file_format import StoredGains
from fmfts.baseline.request import BaselineRequest
from fmfts.config import PadConfig
from fmfts.sensor.frame import Frame
from fmfts.sensor.source import UNSETTLED_FRAMES, CannotError
from fmfts_simulation.array import simulated_pad
from fmfts_simulation.source import Simulated


def set_up(config: PadConfig, beside: Sequence[PadConfig] = ()) -> tuple[Baseline, list[str]]:
    """The baseline of a pad that went through all steps, and the names of the steps. beside: pads whose magnets it
    measures.

    The same seed builds the same pad, so the baseline is of the pad that a daemon simulates with this configuration. A
    chip without a self-test skips it. BaselineError if a recording is not good enough.
    """
    source = simulated_pad(config, beside)
    steps = ["bare", "rest", "turn"]
    gains = _tested(source)
    if gains is not None:
        steps.insert(0, "self-test")
    baseline: Baseline | None = None
    for step in ("bare", "rest", "turn"):
        request = BaselineRequest(
            config.pad(),
            config.tolerance.si(),
            bare=step == "bare",
            replaced=False,
            turn=step == "turn",
            gains=gains,
        )
        baseline, _ = request.make(_recorded(source, request, config.source.rate_hz), baseline)
    assert baseline is not None
    return baseline, steps


def _tested(source: Simulated) -> StoredGains | None:
    try:
        source.request_selftest(0)
    except CannotError:
        return None
    facts = source.selftest_result(0)
    assert facts is not None
    return StoredGains.of(facts) if facts["passed"] and facts["gain_factor_sd"] is not None else None


def _recorded(source: Simulated, request: BaselineRequest, rate_hz: int) -> list[Frame]:
    """The frames of a recording, which ends when the pad was turned enough."""
    hands = source.hands(bare=request.bare, turn=request.turn, refine=request.refine)
    frames: list[Frame] = []
    coverage = request.coverage
    first = round(source.time_s * rate_hz)
    for step in range(first, first + UNSETTLED_FRAMES + round(request.seconds * rate_hz)):
        for frame in source.poll(step * 1_000_000_000 // rate_hz + 1):
            if step >= first + UNSETTLED_FRAMES:
                frames.append(frame)
                if coverage is not None:
                    coverage.take(frame)
        if coverage is not None and coverage.enough:
            break
    hands.let_go()
    return frames
