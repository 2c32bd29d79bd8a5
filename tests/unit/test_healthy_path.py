"""The compiled path against the stages in Python, which are its oracle: the same messages, whatever comes."""

from __future__ import annotations

import tracemalloc
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from test_pipeline import PERIOD_NS, config_of, pipeline_of

from examples import examples
from fmfts.bus.messages import ContactMessage
from fmfts.common.double_table import DoubleTable
from fmfts.common.memory import hand_over
from fmfts.config import PadConfig
from fmfts.contact import ContactModel
from fmfts.pipeline.contact_message import PackedMessage
from fmfts.pipeline.fast import Kind, _fast
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.scene.tracking import tracking_model_for
from fmfts.sensor import Frame
from fmfts.sensor.frame import WireFrame
from fmfts.simulation.baseline import simulated_baseline
from fmfts.simulation.finger import Touch, no_finger
from fmfts.simulation.source import Simulated

# Sums are ordered differently in C. What is near zero (an offset from rest in metres, a field in tesla) has an absolute
# rounding error too: of a thousandth of what a sensor resolves.
RELATIVE = 1e-9
ABSOLUTE = {"position_m": 1e-12, "ambient_t": 1e-15, "axis": 1e-12, "x_m": 1e-9, "y_m": 1e-9, "force_n": 1e-9}
# Small differences of fields over 5 ms.
ABSOLUTE |= {"x_rate_m_per_s": 1e-7, "y_rate_m_per_s": 1e-7, "force_rate_n_per_s": 1e-7}


def python_only(pipeline: PadPipeline) -> PadPipeline:
    assert pipeline._estimator is not None
    pipeline._estimator._path = None
    return pipeline


def assert_same(compiled: ContactMessage, oracle: ContactMessage) -> None:
    for name in ContactMessage.__struct_fields__:
        if name not in ("t_publish_ns", "utc_ns", "pose", "now"):
            assert_equal(name, getattr(compiled, name), getattr(oracle, name))
    for part in ("pose", "now"):
        own, expected = getattr(compiled, part), getattr(oracle, part)
        assert (own is None) == (expected is None), part
        for name, value in {} if expected is None else msgspec.structs.asdict(expected).items():
            assert_equal(name, getattr(own, name), value)


def assert_equal(name: str, value: object, expected: object) -> None:
    if isinstance(expected, tuple) and isinstance(value, tuple):
        for one, other in zip(value, expected, strict=True):
            assert_equal(name, one, other)
    elif isinstance(expected, float) and isinstance(value, float):
        assert abs(value - expected) <= RELATIVE * abs(expected) + ABSOLUTE.get(name, 0.0), name
    else:
        assert value == expected, name


def frames_of(config: PadConfig, seconds: float) -> list[Frame]:
    source = Simulated(config)
    return [frame for step in range(round(seconds * 220)) for frame in source.poll(step * PERIOD_NS)]


def both(config: PadConfig, frames: Iterable[Frame]) -> Counter[Kind | None]:
    """How many messages came from C, by their kind; None: from Python. Each is held against the oracle's."""
    baseline = simulated_baseline(config)
    compiled, oracle = pipeline_of(config, baseline), python_only(pipeline_of(config, baseline))
    return compared(compiled, oracle, frames)


def compared(compiled: PadPipeline, oracle: PadPipeline, frames: Iterable[Frame]) -> Counter[Kind | None]:
    kinds: Counter[Kind | None] = Counter()
    for frame in frames:
        answer = compiled.answer(frame)
        packed = isinstance(answer, PackedMessage)
        kinds[answer.kind if packed else None] += 1
        assert_same(answer.message if packed else answer, oracle.process(frame))
    return kinds


def test_a_session_says_the_same_in_c_and_in_python() -> None:
    kinds = both(config_of(3), frames_of(config_of(3), 16.0)[5 * 220 :])
    assert kinds[None] < 10  # only the first frames, before there are three samples of each axis
    assert min(kinds[kind] for kind in (Kind.QUIET, Kind.TOUCHED, Kind.OVER_RANGE)) > 50


@pytest.mark.long
def test_a_refined_session_says_the_same_in_c_and_in_python() -> None:
    config = config_of(3)
    pad, scene, baseline = config.pad(), tracking_model_for(config.scene, config.magnet), simulated_baseline(config)
    compiled, oracle = (
        PadPipeline(pad, ContactModel.load("default", pad, refine=True), "boot", 220.0, scene.tracking)
        for _ in range(2)
    )
    for pipeline in (compiled, oracle):
        pipeline.use(baseline)
    kinds = compared(compiled, python_only(oracle), frames_of(config, 8.0))
    assert kinds[None] < 10
    assert kinds[Kind.TOUCHED] > 400


def test_what_friction_may_do_to_a_squeeze_is_the_same_in_c_and_in_python() -> None:
    """A force that rises past the calibrated one, where shear would add most."""
    config = config_of(3)
    pad, scene, baseline = config.pad(), tracking_model_for(config.scene, config.magnet), simulated_baseline(config)
    compiled, oracle = (
        PadPipeline(pad, ContactModel.load("default", pad, friction=0.3), "boot", 220.0, scene.tracking)
        for _ in range(2)
    )
    for pipeline in (compiled, oracle):
        pipeline.use(baseline)
    source = Simulated(config)
    source.finger = lambda time_s: Touch(6e-3, 1e-3, 1.4 * time_s)
    frames = [frame for step in range(2 * 220) for frame in source.poll(step * PERIOD_NS)]
    kinds = compared(compiled, python_only(oracle), frames)
    assert min(kinds[Kind.TOUCHED], kinds[Kind.OVER_RANGE]) > 50


def test_a_warm_pad_is_known_less_well_by_what_the_offsets_of_its_chips_may_have_drifted() -> None:
    """25 K by 400 nT/K are 10 µT on each axis: 50 times a sample's noise, and 70 times that of a mean of two."""
    config, frames = config_of(11), warm_frames(config_of(11), 0.5)
    assert both(config, frames)[None] < 10
    tracking = tracking_model_for(config.scene, config.magnet).tracking
    model, baseline = ContactModel.load("default", config.pad()), simulated_baseline(config)

    def heights_m(offset_t_per_k: float) -> tuple[float, float]:
        """How much they scatter, and their deviation."""
        drifts = replace(tracking, offset_t_per_k=offset_t_per_k)
        pipeline = PadPipeline(config.pad(), model, "boot", 220.0, drifts)
        pipeline.use(baseline)
        poses = [pose for pose in (pipeline.process(frame).pose for frame in frames) if pose is not None][20:]
        return float(np.std([one.position_m[2] for one in poses])), poses[-1].position_sd_m[2]

    noise_m, without_m = heights_m(0.0)
    drifted_m = np.sqrt(heights_m(4e-7)[1] ** 2 - without_m**2)
    assert 50.0 < drifted_m / noise_m < 70.0


def with_faults(frames: Sequence[Frame]) -> Iterator[Frame]:
    """One fault after another, each for a while, and health in between."""
    stuck, before = None, frames[0]
    for index, frame in enumerate(frames):
        phase, counts = index // 110, frame.counts.copy()
        if phase == 1:  # one frame in ten with a saturated axis
            counts[1, 2] = -4096 if index % 10 == 0 else counts[1, 2]
            yield replace(frame, counts=counts)
        elif phase == 3:  # a sensor that is silent
            yield replace(frame, valid=np.array([True, True, False, True]))
        elif phase == 5:  # an axis that is a little off, for as long as it takes to be found
            counts[0, 0] += 20
            yield replace(frame, counts=counts)
        elif phase == 7:  # steel
            counts[:, 2] += np.array([60, -40, 20, -80], dtype=np.int16)
            yield replace(frame, counts=counts)
        elif phase == 9:  # an axis that is stuck
            stuck = counts[3, 1] if stuck is None else stuck
            counts[3, 1] = stuck
            yield replace(frame, counts=counts)
        elif phase == 11:  # samples that are not new, and frames that never come
            if index % 7:
                yield replace(frame, fresh=np.array([True, index % 3 > 0, True, index % 5 > 0]))
        elif phase == 12 and index % 110 == 20:  # the board is reset
            yield replace(frame, device_time_us=1000, age_us=np.zeros(4, np.uint16))
        elif phase == 13 and index % 20 < 3:  # the frames that had a slow chip's samples first never come
            before = frame
        elif phase == 13 and index % 20 == 3:
            counts[2] = before.counts[2]
            age_us = frame.age_us.copy()
            age_us[2] = frame.device_time_us - before.sampled_us[2]
            yield replace(frame, counts=counts, age_us=age_us, fresh=np.array([True, True, False, True]))
        elif phase == 14:  # no thermometer
            yield replace(frame, temperature_c=None)
        else:
            yield frame


@pytest.mark.parametrize("scene", ["drifting", pytest.param("constant", marks=pytest.mark.long)])
def test_a_session_with_faults_says_the_same_and_comes_back(scene: str) -> None:
    """The memory goes from C to Python and back, and nothing is lost of it."""
    config = config_of(4, ambient=scene)
    kinds = both(config, with_faults(frames_of(config, 16 * 110 / 220)))
    assert kinds[None] > 200
    assert kinds[Kind.QUIET] + kinds[Kind.TOUCHED] > 500


class Warm(Simulated):
    """Above the temperature of its baseline, and nobody touches it."""

    kelvin = 25.0

    def _warming_k(self, now_s: float) -> float:
        return self.kelvin


def warm_frames(config: PadConfig, seconds: float, kelvin: float = 25.0) -> list[Frame]:
    source = Warm(config)
    source.finger, source.kelvin = no_finger, kelvin
    return [frame for step in range(round(seconds * 220)) for frame in source.poll(step * PERIOD_NS)]


@pytest.mark.parametrize("silent", [range(40, 130), range(70), range(130)], ids=["later", "at first", "throughout"])
def test_a_warm_pad_whose_temperature_is_not_told_is_no_contact(silent: range) -> None:
    """25 K are 3 % of the moment: 220 µm of height, which a thermometer that is silent does not make a touch."""
    config = config_of(11, ambient="drifting")
    frames = [
        replace(frame, temperature_c=None) if number in silent else frame
        for number, frame in enumerate(warm_frames(config, 130 / 220))
    ]
    kinds = both(config, frames)
    assert kinds[Kind.TOUCHED] == kinds[Kind.OVER_RANGE] == 0
    assert kinds[None] < 10 + len(silent)  # Python waits for a temperature, and counts how long the last one is held
    pipeline = pipeline_of(config, simulated_baseline(config))
    messages = [pipeline.process(frame) for frame in frames][10:]
    assert {(message.health, message.contact) for message in messages} == {("ok", False)}
    assert pipeline.mounting is not None
    rest_m, deviations_m = pipeline.mounting.rest.position_m[2], []
    for message in messages:
        assert message.pose is not None
        deviations_m.append(message.pose.position_sd_m[2])
        assert abs(message.pose.position_m[2] - rest_m) < 4.0 * deviations_m[-1]
    # A fifth of the coefficient is open once the temperature was read, 0.5 %; 20 K of all of it before, 2.4 %.
    was_read = len(silent) < len(frames)
    assert (deviations_m[-1] < 1e-4) == was_read
    assert (deviations_m[0] > 1e-4) == (0 in silent)


@given(data=st.data())
@settings(examples(10), phases=[Phase.generate])  # a seed does not shrink
def test_random_frames_are_judged_the_same(data: st.DataObject) -> None:
    config = config_of(5)
    seed, size = data.draw(st.integers(0, 2**32 - 1)), data.draw(st.sampled_from([0.0, 1.0, 5.0, 30.0, 300.0]))
    random = np.random.default_rng(seed)
    frames = frames_of(config, 0.4)
    spoilt = [replace(f, counts=np.rint(f.counts + random.normal(0.0, size, (4, 3))).astype(np.int16)) for f in frames]
    both(config, frames[:40] + spoilt[40:])


def test_a_session_repeated_is_the_same_bit_by_bit() -> None:
    config = config_of(6)
    frames, baseline, payloads = frames_of(config, 4.0), simulated_baseline(config), []
    for _ in range(2):
        pipeline = pipeline_of(config, baseline)
        messages = [pipeline.process(frame) for frame in frames]
        payloads.append(
            [msgspec.msgpack.encode(msgspec.structs.replace(m, t_publish_ns=0, utc_ns=0)) for m in messages]
        )
    assert payloads[0] == payloads[1]


def test_frames_leave_no_memory_behind() -> None:
    config = config_of(7, ambient="constant")
    pipeline = pipeline_of(config, simulated_baseline(config))
    frames = [
        WireFrame(0, f.sequence, f.device_time_us, f.host_time_ns, f.packed, f.temperature_c)
        for f in frames_of(config, 6.0)
    ]
    for frame in frames[:660]:
        pipeline.answer(frame)
    tracemalloc.start()
    try:
        for frame in frames[660:]:
            pipeline.answer(frame)
        grown, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert grown < 5000  # the last message, and tracemalloc's own; a float kept of each frame would be twice that


def test_a_fault_that_only_the_mean_shows_is_left_to_python() -> None:
    """9 mG on one axis: each frame passes its gate, and a quarter of a second of them does not. Once the sensor is
    found, Python looks at one frame in eight whether it is over."""
    config, offset = config_of(9, ambient="constant"), np.zeros((4, 3), np.int16)
    offset[1, 0] = 6
    frames = frames_of(config, 1.2)
    assert both(config, frames[:150])[None] < 10
    spoilt = [replace(frame, counts=frame.counts + offset) for frame in frames[150:]]
    assert both(config, frames[:150] + spoilt)[None] > 14
    pipeline = pipeline_of(config, simulated_baseline(config))
    assert "sensor 2 still contradicts" in [pipeline.process(frame).reason for frame in frames[:150] + spoilt][-1]


def test_the_memory_comes_back_whole() -> None:
    """Whatever the oracle remembers after the same frames, down to the mean residuals."""
    config = config_of(10)
    baseline = simulated_baseline(config)
    compiled, oracle = pipeline_of(config, baseline), python_only(pipeline_of(config, baseline))
    for frame in frames_of(config, 1.0):
        compiled.answer(frame)
        oracle.answer(frame)
    compiled.hand_back()
    memories = []
    for pipeline in (compiled, oracle):
        assert pipeline._estimator is not None
        table = DoubleTable(_fast.MEMORY)
        hand_over(pipeline.memory, table)
        memories.append(table.values)
    # A mean residual is a small difference of fields: its rounding is that of a field.
    np.testing.assert_allclose(*memories, rtol=1e-8, atol=1e-15)


def test_a_lifted_magnet_is_left_to_python() -> None:
    """C never says that a baseline was refuted: those frames go to Python, which counts for how long."""
    config = config_of(8)
    pipeline, frames = pipeline_of(config, simulated_baseline(config)), frames_of(config, 1.5)
    for frame in frames[:110]:
        pipeline.process(frame)
    # The magnet's field falls with the cube of its distance: 6 % less of it is a quarter of a millimetre higher.
    mounting = pipeline.mounting
    assert mounting is not None
    weaker = np.rint(0.06 * mounting.rest_field_t * mounting.gain / 1e-4 * 660).astype(np.int16)
    lifted = [pipeline.answer(replace(frame, counts=frame.counts - weaker)) for frame in frames[110:]]
    assert not any(isinstance(answer, PackedMessage) for answer in lifted[5:])
    assert isinstance(lifted[-1], ContactMessage)
    assert lifted[-1].health == "no_baseline"
