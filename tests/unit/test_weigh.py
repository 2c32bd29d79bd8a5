"""A known weight on a pad tells how stiff its silicone is: pads of another solver, and what is refused."""

from __future__ import annotations

import re
from pathlib import Path

import msgspec
import numpy as np
import pytest

from fmfts.baseline import Baseline, BaselineError
from fmfts.baseline.baseline import load
from fmfts.baseline.files import path_of
from fmfts.baseline.request import BaselineRequest
from fmfts.baseline.silicone import UNWEIGHED, StoredSilicone
from fmfts.config import ContactConfig, PadConfig, SimulatedSource, ToleranceConfig
from fmfts.contact import ContactEstimate, ContactModel
from fmfts.contact.silicone import InOtherNewtons, inference_of
from fmfts.contact.tolerances import StructureTolerance
from fmfts.pad import Array
from fmfts.pipeline.configured import load_contact_model
from fmfts.pipeline.last_pad import ConfiguredPad
from fmfts.pipeline.weighing import Weighing
from fmfts.sensor import Frame
from fmfts.view.facts import fact_lines
from fmfts_lab.bench.structure import Cell, Found
from fmfts_lab.bench.tapped import without_baseline
from fmfts_lab.bench.weigh import ASIDE_M, MIDDLE_M, Bench, facts_of, shaken
from fmfts_simulation.finger import Finger, no_finger, steady_finger

STIFF = Cell("stiff", modulus=1.5)
CONFIG = PadConfig(name="pad", source=SimulatedSource())
WEIGHT_N = 0.981


@pytest.fixture(scope="module")
def bench() -> Bench:
    return Bench(STIFF, by_mm=6.0, seed=2)


@pytest.fixture(scope="module")
def weighed(bench: Bench) -> Baseline:
    return bench.weighed(bench.baseline, WEIGHT_N, steady_finger(*MIDDLE_M, WEIGHT_N))


def test_weight_reports_the_stiffness_within_its_deviation(weighed: Baseline) -> None:
    assert weighed.silicone is not None
    assert abs(np.log(weighed.silicone.stiffness / 1.5)) < 2.0 * weighed.silicone.deviation
    assert weighed.silicone.deviation < 0.06
    assert weighed.silicone.weight_n == WEIGHT_N


def test_weighed_forces_are_right_with_smaller_deviations(bench: Bench, weighed: Baseline) -> None:
    before, after = Found(), Found()
    bench.presses(STIFF, bench.baseline, 6.0, before)
    bench.presses(STIFF, weighed, 6.0, after)
    was, now = facts_of([before]), facts_of([after])
    assert was["force_off_median"] > 0.25
    assert now["force_off_median"] < 0.05
    assert now["force_sd_median"] < 0.6 * was["force_sd_median"]
    assert now["wrong"] == 0
    assert now["felt"] == was["felt"], "silicone that is stiffer makes no touch more or less certain"


@pytest.mark.parametrize("by_mm", [3.0, 12.0])
def test_width_below_the_weight_is_corrected(weighed: Baseline, by_mm: float) -> None:
    other = Bench(STIFF, by_mm, seed=2)
    finger = steady_finger(*MIDDLE_M, WEIGHT_N)
    silicones = [other.weighed(other.baseline, WEIGHT_N, finger, by_m).silicone for by_m in (by_mm * 1e-3, 6e-3)]
    assert weighed.silicone is not None
    told, taken_for_the_probe = (abs(one.stiffness / weighed.silicone.stiffness - 1.0) for one in silicones if one)
    assert told < min(0.6 * taken_for_the_probe, 0.04)


@pytest.mark.parametrize(
    ("said_n", "finger", "words"),
    [
        (
            WEIGHT_N,
            steady_finger(*ASIDE_M, WEIGHT_N),
            r"stands 3\.\d mm from the middle, at \(3\.\d, 1\.\d\) mm: put it",
        ),
        (
            WEIGHT_N,
            shaken(WEIGHT_N),
            "does not stand still: the field moves: .*take the hand off, and give the silicone",
        ),
        (WEIGHT_N, no_finger, "no weight is detected: put it on the middle"),
        (2.0 * WEIGHT_N, steady_finger(*MIDDLE_M, WEIGHT_N), r"3\.\d\d times as stiff .*0\.981 N of .*--anew"),
        (4.0, steady_finger(*MIDDLE_M, 4.0), "more than the contact model knows on this silicone: take half of it"),
        (9.81e-4, steady_finger(*MIDDLE_M, WEIGHT_N), r"\(0\.1 g\) cannot be used: take one of 20 to 408 g"),
    ],
)
def test_useless_weight_is_refused_with_the_cause(
    bench: Bench, weighed: Baseline, said_n: float, finger: Finger, words: str
) -> None:
    with pytest.raises(BaselineError, match=f"pad 'cast': weight refused: .*{words}"):
        bench.weighed(weighed, said_n, finger)


def test_half_weight_is_refused_when_modulus_is_configured(bench: Bench) -> None:
    knows = Bench(Cell("as the model's"), by_mm=6.0, seed=2)
    tolerance = msgspec.structs.replace(knows.config.tolerance, modulus=0.05)
    knows.config = msgspec.structs.replace(knows.config, tolerance=tolerance)
    with pytest.raises(BaselineError, match=r"reads this weight as .* N, and this pad reads 0\.4\d N: compare"):
        knows.weighed(knows.baseline, WEIGHT_N, steady_finger(*MIDDLE_M, WEIGHT_N / 2.0))


@pytest.mark.parametrize(("thickness_mm", "said_n"), [(3.6, WEIGHT_N), (4.4, WEIGHT_N / 2.0)])
def test_half_or_double_mass_is_refused_if_likelier(thickness_mm: float, said_n: float) -> None:
    """These slabs are two deviations off, and make a weight look the more like what is said."""
    knows = Bench(Cell("known", 1.0, thickness_mm), 6.0, 2, ToleranceConfig(gain=0.005, modulus=0.05))
    with pytest.raises(BaselineError, match=r"compare the weight and its unit"):
        knows.weighed(knows.baseline, said_n, steady_finger(*MIDDLE_M, 1.5 * WEIGHT_N - said_n))
    assert knows.weighed(knows.baseline, WEIGHT_N, steady_finger(*MIDDLE_M, WEIGHT_N)).silicone is not None


def test_weight_in_the_middle_is_accepted_where_its_place_is_uncertain() -> None:
    """The daemon reads 0.8 mm from the middle of this thick pad as 2.2 ± 0.25 mm."""
    thick = Bench(Cell("thick", 1.0, 4.4), by_mm=3.0, seed=6)
    weighed = thick.weighed(thick.baseline, WEIGHT_N, steady_finger(*MIDDLE_M, WEIGHT_N))
    assert weighed.silicone is not None
    with pytest.raises(BaselineError, match=r"stands [3-5]\.\d mm from the middle"):
        thick.weighed(thick.baseline, WEIGHT_N, steady_finger(*ASIDE_M, WEIGHT_N))


def test_iron_or_a_shaken_magnet_is_named(bench: Bench) -> None:
    source = bench.pad(STIFF)
    source.finger = steady_finger(*MIDDLE_M, WEIGHT_N)
    frames = source.recorded(3.0)
    moved = [beside_iron(frame) for frame in frames]
    learn = Weighing(bench.config, WEIGHT_N, 6e-3)
    request = BaselineRequest(bench.config.pad(), bench.config.tolerance.si(), False, False, learn=learn)
    with pytest.raises(BaselineError, match=r"the pad is (lost|disturbed|degraded): .*take away what is of iron"):
        request.make(moved, bench.baseline)


def test_weigh_needs_baseline_one_magnet_and_shipped_model(bench: Bench) -> None:
    request = BaselineRequest(CONFIG.pad(), CONFIG.tolerance.si(), False, False, learn=Weighing(CONFIG, WEIGHT_N))
    with pytest.raises(BaselineError, match=r"rest is not recorded: .*then weigh"):
        request.require_rest(None)
    calibrated = msgspec.structs.replace(
        CONFIG, tolerance=msgspec.structs.replace(CONFIG.tolerance, modulus=0.0, thickness_mm=0.0)
    )
    with pytest.raises(BaselineError, match="silicone is as calibrated"):
        Weighing(calibrated, WEIGHT_N).require(CONFIG.pad(), bench.baseline)
    without = msgspec.structs.replace(CONFIG, contact=msgspec.structs.replace(CONFIG.contact, model="none"))
    with pytest.raises(BaselineError, match=r'\[pad.contact\] model is "none"; to get forces, calibrate it'):
        Weighing(without, WEIGHT_N).require(CONFIG.pad(), bench.baseline)


def test_stiffness_survives_new_rest_and_widens_for_replaced_pad(bench: Bench, weighed: Baseline) -> None:
    source = bench.pad(STIFF)
    source.finger = no_finger
    frames = source.recorded(3.0)
    pad, tolerance = bench.config.pad(), bench.config.tolerance.si()
    again = BaselineRequest(pad, tolerance, False, False).make(frames, weighed)[0]
    another = BaselineRequest(pad, tolerance, False, True).make(frames, weighed)[0]
    assert again.silicone == weighed.silicone
    assert another.silicone is not None
    assert weighed.silicone is not None
    assert another.silicone.stiffness == weighed.silicone.stiffness
    assert 0.1 < another.silicone.deviation < StructureTolerance(0.2, 0.2e-3).force_share
    third = BaselineRequest(pad, tolerance, False, True).make(frames, another)[0]
    assert third.silicone == another.silicone, "each further pad is a cast of the weighed one, not of the last"


def test_replaced_pad_is_never_known_worse_than_an_unweighed_one() -> None:
    rough = StoredSilicone.of("0" * 12, WEIGHT_N, 1.2, 0.2)
    assert rough.of_another_pad().deviation == pytest.approx(UNWEIGHED)
    assert pytest.approx(CONFIG.structure_tolerance().scale_deviation) == UNWEIGHED
    known = msgspec.structs.replace(CONFIG, tolerance=ToleranceConfig(modulus=0.02))
    unweighed = ConfiguredPad(known).unweighed
    precise = StoredSilicone.of("0" * 12, WEIGHT_N, 1.2, 0.03)
    assert precise.of_another_pad(unweighed).deviation == pytest.approx(unweighed)
    assert unweighed < precise.of_another_pad().deviation
    assert rough.of_another_pad(unweighed).deviation == rough.deviation, "nor better than the weighed pad"


def recorded_again(bench: Bench, before: Baseline, finger: Finger, cell: Cell = STIFF) -> list[str]:
    """What `baseline --rest --replaced` warns of."""
    source = bench.pad(cell)
    source.finger = finger
    pad, tolerance = bench.config.pad(), bench.config.tolerance.si()
    request = BaselineRequest(pad, tolerance, False, True, last=ConfiguredPad(bench.config))
    warnings: list[str] = request.record(source.recorded(3.0), before).facts(pad)["warnings"]
    return warnings


def test_replaced_pad_is_said_to_be_known_as_well_as_status_shows(
    bench: Bench, weighed: Baseline, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    (said,) = recorded_again(bench, weighed, no_finger)
    stored = load(path_of("cast"), bench.config.pad())
    assert stored is not None
    shares = []
    for one in (stored, weighed):
        pipeline = without_baseline(bench.config, load_contact_model(bench.config))
        pipeline.use(one)
        shares.append(f"± {pipeline.force_scale_sd:.0%}")
    assert shares[0] == "± 19%"
    known = f"{shares[0]} ({shares[1]} on the pad that was weighed)"
    assert f"forces are now known to {known}: `fmfts-daemon weigh`" in said
    assert recorded_again(bench, stored, no_finger) == [said]


def test_replaced_pad_that_is_the_pressed_old_one_is_named(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    (said,) = recorded_again(bench, bench.baseline, steady_finger(*MIDDLE_M, 0.45))
    assert re.match(r"by the last baseline, 0\.\d\d N press on this pad: if it is the same pad and", said)
    assert recorded_again(bench, bench.baseline, no_finger) == []


@pytest.mark.parametrize(("lies_n", "is_rare"), [(WEIGHT_N / 2.0, True), (WEIGHT_N, False)])
def test_rare_stiffness_is_doubted(lies_n: float, is_rare: bool) -> None:
    """Nothing is known of the cure, so that half of the weight is not refused."""
    plain = Bench(Cell("as the model's"), 6.0, 2, ToleranceConfig(gain=0.005))
    source = plain.pad(Cell("as the model's"))
    source.finger = steady_finger(*MIDDLE_M, lies_n)
    facts = Weighing(plain.config, WEIGHT_N, 6e-3).make(plain.config.pad(), source.recorded(3.0), plain.baseline)[2]
    rare = f"{facts['stiffness']:.2f} times as stiff as the model's, which is rare: is the weight right?"
    assert [rare in one for one in facts["warnings"]] == [True] * is_rare
    assert "stiffness, times the model's: " in "\n".join(fact_lines(facts))


def test_model_on_other_silicone_reads_other_newtons_at_same_place() -> None:
    model = load_contact_model(CONFIG)
    stiff = model.on_silicone(1.5, 0.03)
    assert stiff.response is not None
    assert model.response is not None
    press = np.array([[3.0, -2.0, 0.8]])
    change = model.response.without_shear().change(press)[0]
    np.testing.assert_allclose(stiff.response.without_shear().change(press * [1.0, 1.0, 1.5])[0], change, rtol=1e-12)
    drawn, read = (pressed(each, change) for each in (model, stiff))
    np.testing.assert_allclose(read.values, drawn.values * [1.0, 1.0, 1.5], rtol=1e-5)
    np.testing.assert_allclose(read.deviations[:2], drawn.deviations[:2], rtol=0.2)
    assert stiff.facts.envelope.force_max_n == pytest.approx(1.5 * model.facts.envelope.force_max_n)
    covariance = 1e-10 * np.eye(6)
    assert stiff.detection_limit_n(covariance, 20.0) == pytest.approx(1.5 * model.detection_limit_n(covariance, 20.0))
    assert stiff.tolerance.scale_deviation == pytest.approx(0.03)
    assert model.tolerance.force_share > 0.2, "the model of other pads stays as it is"


def test_friction_costs_the_same_share_on_other_silicone() -> None:
    """A newton of shear moves the magnet in stiffer silicone by less; what may shear grows with the force."""
    still = StructureTolerance()
    own = [
        load_contact_model(msgspec.structs.replace(CONFIG, contact=ContactConfig(friction=friction))).with_tolerance(
            still
        )
        for friction in (0.0, 0.3)
    ]
    for stiffness in (0.5, 2.0):
        for model in own:
            scaled = model.on_silicone(stiffness, 0.0)
            np.testing.assert_allclose(
                scaled.own_deviation,
                model.own_deviation * [1.0, 1.0, stiffness],
                rtol=1e-9,
                err_msg=f"{model.friction}",
            )


def test_model_of_another_program_is_scaled_as_the_networks_are() -> None:
    model = load_contact_model(CONFIG)
    ours, theirs = inference_of(model.inference, 0.6), InOtherNewtons(model.inference, 0.6)
    moved = np.array([0.01, 0.02, -0.4, 0.0, 0.01, 0.0])
    for inference in (ours, theirs):
        inference.pose[:] = model.rest_pose + moved
        inference.run()
    np.testing.assert_allclose(ours.contact, theirs.contact, rtol=1e-5)
    np.testing.assert_allclose(ours.jacobian, theirs.jacobian, rtol=1e-4, atol=1e-6)


def beside_iron(frame: Frame) -> Frame:
    """Sensor 1 sees 60 µT that no magnet of the pad makes."""
    counts = frame.counts.copy()
    counts[0] += 400
    times = frame.sequence, frame.device_time_us, frame.host_time_ns, frame.gain_code
    return Frame(0, *times, counts, frame.age_us, frame.fresh, frame.valid, frame.temperature_c)


def pressed(model: ContactModel, change: Array) -> ContactEstimate:
    pose = model.rest_pose.copy()
    pose[:3] += change[:3]
    pose[3:5] += change[3:]
    axis = pose[3:] / np.linalg.norm(pose[3:])
    return model.estimate(pose[:3] * 1e-3, axis, np.diag(np.repeat([1e-12, 1e-6], 3)))
