"""A chip with another scale on each axis, saturation and thermometer: every program takes them from its description."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from msgspec.structs import replace as changed
from pad_frames import frames_of
from test_link import Line, hello, pad, sample
from test_pipeline import PERIOD_NS, config_of, pipeline_of

from fmfts.config import PadConfig, SimulatedSource
from fmfts.sensor.chips import CHIPS, HMC5983
from fmfts.sensor.chips.chip import Thermometer
from fmfts.sensor.chips.rates import highest_rate_hz
from fmfts.sensor.frame import Frame, WireFrame
from fmfts.sensor.wire.framing import encode
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import steady_finger
from fmfts_simulation.source import Simulated

OTHER = replace(
    HMC5983,
    name="other",
    label="OTHER",
    identity=b"XYZ",
    ranges_gauss=(2.5, 5.0),
    counts_per_gauss=((900, 800, 700), (450, 400, 350)),
    largest_count=5000,
    saturated_count=-32768,
    thermometer=Thermometer(at_zero_c=20.0, c_per_count=0.1, range_c=(-40.0, 125.0)),
)


@pytest.fixture
def config(monkeypatch: pytest.MonkeyPatch) -> PadConfig:
    """A simulated pad of such chips."""
    monkeypatch.setitem(CHIPS, OTHER.name, OTHER)
    config = config_of(3)
    assert isinstance(config.source, SimulatedSource)
    return changed(config, source=changed(config.source, chip=OTHER.name))


def test_frame_reads_counts_by_its_chip() -> None:
    counts = np.array([[900, 800, 700], [900, OTHER.saturated_count, HMC5983.saturated_count]], np.int16)
    readings = np.column_stack([counts, [0, 0]]).astype("<i2").tobytes()
    assert WireFrame(0, 0, 0, 0, (0, 3, 3, readings), None).chip is HMC5983
    frame = WireFrame(0, 0, 0, 0, (0, 3, 3, readings), None, chip=OTHER)
    assert frame.overflow.tolist() == [[False] * 3, [False, True, False]]
    assert frame.field_t[0] == pytest.approx([1e-4, 1e-4, 1e-4])
    assert np.isnan(frame.field_t[1]).tolist() == [False, True, False]


def test_impossible_gain_code_gives_no_field() -> None:
    assert np.isnan(OTHER.step_t[2:]).all()
    assert OTHER.step_t.shape == HMC5983.step_t.shape
    with pytest.raises(ValueError, match=r"one of 2\.5, 5\.0"):
        OTHER.gain_code_for_range(4.0)


def test_session_reports_the_force_of_the_finger(config: PadConfig) -> None:
    source = Simulated(config)
    source.finger = steady_finger(1e-3, -2e-3, 0.8)
    frames = [frame for step in range(220) for frame in source.poll(step * PERIOD_NS)]
    assert {frame.chip for frame in frames} == {OTHER}
    pipeline = pipeline_of(config, simulated_baseline(config))
    messages = [pipeline.process(frame) for frame in frames][20:]
    assert {message.health for message in messages} == {"ok"}
    for message in messages:
        assert message.force_n is not None
        assert message.force_sd_n is not None
        assert abs(message.force_n - 0.8) < 5.0 * message.force_sd_n


def test_axis_that_saturates_at_another_count_is_named(config: PadConfig) -> None:
    frames = frames_of(config, 1.0)
    for index in range(100, 110):
        counts = frames[index].counts.copy()
        counts[1, 2] = OTHER.saturated_count
        frames[index] = replace(frames[index], counts=counts)
    pipeline = pipeline_of(config, simulated_baseline(config))
    reasons = [pipeline.process(frame).reason for frame in frames]
    assert ["sensor 2 is saturated on z" in reason for reason in reasons] == [
        100 <= i < 110 for i in range(len(frames))
    ]


def test_fields_and_temperature_follow_the_configured_chip(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(CHIPS, OTHER.name, OTHER)
    for chip, temperature_c in (("hmc5983", 26.0), ("hmc5883l", None), (OTHER.name, 32.8)):
        line = Line(pad(chip=chip, rate_hz=75))
        line.feed(hello(4, identification=CHIPS[chip].identity, gain_code=0, rate_hz=75))
        # The first sample is one packet among others; later samples that come alone take the shorter way.
        followed = sample(temperature_raw=128, sequence=1, time_us=2 * 4545)
        (first,) = line.feed(sample(temperature_raw=128))
        (second,) = line.link.feed(encode(followed), line.now_ns + 4_545_000)
        assert (type(first), type(second)) == (Frame, WireFrame)
        for frame in (first, second):
            assert frame.chip is CHIPS[chip]
            assert frame.temperature_c == (temperature_c if temperature_c is None else pytest.approx(temperature_c))


def test_wrong_identity_is_named_with_the_one_that_is_due() -> None:
    assert OTHER.why_not_identity(b"XYZ") is None
    assert OTHER.why_not_identity(b"H43") == (
        "answers 48 34 33 where an OTHER says 58 59 5a (XYZ): another chip is fitted, or the bus is noisy"
    )


@pytest.mark.parametrize(
    ("kind", "trigger", "most_hz"),
    [
        ("hmc5983", "simultaneous", 152),
        ("mmc5983ma", "simultaneous", 203),
        ("mmc5983ma", "free", 220),
        ("lis3mdl", "simultaneous", 80),
        ("mlx90393", "simultaneous", 155),
        ("hmc5883l", "free", 75),
    ],
)
def test_board_reads_a_chip_no_faster_than_its_firmware_accepts(kind: str, trigger: str, most_hz: int) -> None:
    assert highest_rate_hz(CHIPS[kind], trigger, over_bridge=True) == most_hz
