"""The model that ships: what it must be to be loaded, how right it is, and what it says of its own errors."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import msgspec
import numpy as np
import onnx
import onnxruntime
import pytest
from numpy.typing import NDArray
from onnx import TensorProto, helper

from fmfts.calibrate.dataset import read_calibration_set
from fmfts.calibrate.export import export
from fmfts.calibrate.levenberg import Layers
from fmfts.calibrate.network import ContactNetwork
from fmfts.calibrate.simulated import pressed_fields, rest_field_of
from fmfts.calibrate.tracked import FrameSolver, Tracked
from fmfts.contact import ContactEstimate, ContactModel, ModelError
from fmfts.contact.contract import METADATA_KEY, RESPONSE_KEY, SHEAR_OUTPUT_ORDER, SIZE_LIMIT_BYTES, parse_response
from fmfts.contact.response import bound_of
from fmfts.contact.verified import DEFAULT_PATH
from fmfts.pad import Pad
from fmfts.simulate.chip import NOISE_T
from fmfts.simulate.solved_table import standard_mechanics

CALIBRATION = Path(__file__).parents[1] / "data" / "calibration_1.23T.csv"
Array = NDArray[np.float64]
CERTAIN = np.eye(6) * 1e-16  # deviations of 10 nm and 1e-8


@pytest.fixture
def model(pad: Pad) -> ContactModel:
    return ContactModel.load("default", pad)


@dataclass(frozen=True)
class Frames:
    """Single frames of presses (K, 3) in mm and N, solved with eight unknowns."""

    press: Array
    tracked: Tracked

    @classmethod
    def of(cls, pad: Pad, press: Array, noise_t: float = 0.0, remanence_t: float = 1.23, seed: int = 0) -> Self:
        magnet = pad.magnet.with_remanence(remanence_t)
        field = pressed_fields(pad, press, magnet)
        noise = noise_t * np.random.default_rng(seed).standard_normal(field.shape)
        solver = FrameSolver(pad, rest_field_of(pad, magnet), "drifting", NOISE_T)
        return cls(press, solver.solved(field + noise))

    @classmethod
    def drawn(cls, pad: Pad, count: int, lowest_n: float, highest_n: float, reach_m: float, seed: int) -> Self:
        """Noisy frames of presses within a radius."""
        random = np.random.default_rng(seed)
        radius, angle = reach_m * 1e3 * np.sqrt(random.uniform(0, 1, count)), random.uniform(0, 2 * np.pi, count)
        force = random.uniform(lowest_n, highest_n, count)
        press = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), force])
        return cls.of(pad, press, NOISE_T, seed=seed)

    def estimates(self, model: ContactModel) -> list[ContactEstimate]:
        """What the pipeline would make of each, with the covariance that the solver claims."""
        unit, out = np.array([1e-3, 1e-3, 1e-3, 1.0, 1.0]), []
        for pose, covariance in zip(self.tracked.pose, self.tracked.covariance, strict=True):
            full = np.zeros((6, 6))
            full[:5, :5] = covariance * unit * unit[:, None]
            out.append(model.estimate(pose[:3] * 1e-3, pose[3:], full))
        return out

    def found(self, model: ContactModel) -> Array:
        """(K, 3) in mm and N."""
        return np.array([[one.x_m * 1e3, one.y_m * 1e3, one.force_n] for one in self.estimates(model)])


# --- the contract ---


def test_model_that_ships_is_the_one_its_report_describes(model: ContactModel) -> None:
    digest = hashlib.sha256(DEFAULT_PATH.read_bytes()).hexdigest()[:12]
    report = json.loads(DEFAULT_PATH.with_suffix(".json").read_text())
    assert model.hash == report["model"] == digest
    over_all = report["on_the_calibration_set"][0]
    assert model.facts.metrics.items() <= over_all.items()
    assert model.facts.data == report["calibration_set_sha256"] == hashlib.sha256(CALIBRATION.read_bytes()).hexdigest()


def edited(tmp_path: Path, edit: Callable[[onnx.ModelProto], None]) -> str:
    proto = onnx.load(DEFAULT_PATH)
    edit(proto)
    path = tmp_path / "edited.onnx"
    path.write_bytes(proto.SerializeToString())
    return str(path)


def with_facts(change: Callable[[dict[str, object]], None]) -> Callable[[onnx.ModelProto], None]:
    def edit(proto: onnx.ModelProto) -> None:
        (entry,) = (entry for entry in proto.metadata_props if entry.key == METADATA_KEY)
        facts = json.loads(entry.value)
        change(facts)
        entry.value = json.dumps(facts)

    return edit


def set_versions(ir_version: int, opset: int) -> Callable[[onnx.ModelProto], None]:
    def edit(proto: onnx.ModelProto) -> None:
        proto.ir_version = ir_version
        proto.opset_import[0].version = opset

    return edit


def double_output(proto: onnx.ModelProto) -> None:
    proto.graph.node.append(helper.make_node("Cast", ["contact"], ["twice"], to=TensorProto.DOUBLE))
    proto.graph.output[0].name = "twice"
    proto.graph.output[0].type.tensor_type.elem_type = TensorProto.DOUBLE


def fixed_batch(proto: onnx.ModelProto) -> None:
    proto.graph.input[0].type.tensor_type.shape.dim[0].dim_value = 1


def answer_with_nan(proto: onnx.ModelProto) -> None:
    bias = next(tensor for tensor in proto.graph.initializer if tensor.name == "b3")
    bias.raw_data = np.full(3, np.nan, dtype=np.float32).tobytes()


@pytest.mark.parametrize(
    ("edit", "complaint"),
    [
        (set_versions(9, 18), "opset 18, not 9 and 17"),
        (set_versions(10, 17), "IR version 10"),
        (lambda proto: proto.ClearField("metadata_props"), f"no '{METADATA_KEY}'"),
        (with_facts(lambda facts: facts.pop("envelope")), "missing required field `envelope`"),
        (with_facts(lambda facts: facts.update(contract=1)), "contract"),
        (with_facts(lambda facts: facts.update(surprise=1)), "unknown field `surprise`"),
        (with_facts(lambda facts: facts.update(inputs=["m", "n", "p", "a_mm", "b_mm", "c_mm"])), "input order"),
        (with_facts(lambda facts: facts.update(outputs=["y_mm", "x_mm", "force_n"])), "output order"),
        (with_facts(lambda facts: facts["envelope"].update(pose_max=[0, 0, 11, 0, 0, 1])), "zero force"),  # type: ignore[attr-defined]
        (with_facts(lambda facts: facts["own_error"].update(x_mm=[[1.0]])), "row per force"),  # type: ignore[attr-defined]
        (with_facts(lambda facts: facts.update(geometry_hash="0123456789ab")), "other dimensions"),
        (double_output, "its tensors are pose, twice, jacobian"),
        (fixed_batch, "pose has the shape"),
        (answer_with_nan, "does not answer with numbers"),
    ],
)
def test_model_that_breaks_the_contract_is_refused_by_name(
    tmp_path: Path, pad: Pad, edit: Callable[[onnx.ModelProto], None], complaint: str
) -> None:
    with pytest.raises(ModelError, match=r"edited\.onnx") as refusal:
        ContactModel.load(edited(tmp_path, edit), pad)
    assert complaint in str(refusal.value)


def test_model_of_another_shape_is_refused(tmp_path: Path, pad: Pad) -> None:
    """Five pose components and two outputs: a whole graph, valid in itself."""
    inputs = [helper.make_tensor_value_info("pose", TensorProto.FLOAT, ["N", 5])]
    outputs = [helper.make_tensor_value_info(name, TensorProto.FLOAT, ["N", 5]) for name in ("contact", "jacobian")]
    nodes = [helper.make_node("Tanh", ["pose"], [name]) for name in ("contact", "jacobian")]
    proto = helper.make_model(
        helper.make_graph(nodes, "other", inputs, outputs), opset_imports=[helper.make_opsetid("", 17)], ir_version=9
    )
    path = tmp_path / "other.onnx"
    path.write_bytes(proto.SerializeToString())
    with pytest.raises(ModelError, match=r"pose has the shape \['N', 5\], not \['N', 6\]"):
        ContactModel.load(str(path), pad)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_truncated_file_is_refused(tmp_path: Path, pad: Pad, share: float) -> None:
    content = DEFAULT_PATH.read_bytes()
    path = tmp_path / "half.onnx"
    path.write_bytes(content[: int(len(content) * share)])
    with pytest.raises(ModelError, match=r"half\.onnx"):
        ContactModel.load(str(path), pad)


def test_file_that_is_too_large_or_absent_or_no_model_is_refused(tmp_path: Path, pad: Pad) -> None:
    large = tmp_path / "large.onnx"
    with large.open("wb") as stream:
        stream.truncate(SIZE_LIMIT_BYTES + 1)
    with pytest.raises(ModelError, match="larger than 4 MB"):
        ContactModel.load(str(large), pad)
    with pytest.raises(ModelError, match=r"cannot be read \(No such file"):
        ContactModel.load(str(tmp_path / "absent.onnx"), pad)
    text = tmp_path / "text.onnx"
    text.write_text("not a model at all\n")
    with pytest.raises(ModelError, match="not an ONNX file"):
        ContactModel.load(str(text), pad)


def test_model_with_weights_in_another_file_is_refused(tmp_path: Path, pad: Pad) -> None:
    path = tmp_path / "split.onnx"
    whole = onnx.load(str(DEFAULT_PATH))
    onnx.save_model(whole, str(path), save_as_external_data=True, location="weights.bin", size_threshold=0)
    assert (tmp_path / "weights.bin").stat().st_size > 1000
    with pytest.raises(ModelError, match="external data"):
        ContactModel.load(str(path), pad)


def test_pad_of_other_dimensions_is_refused_and_another_magnet_strength_is_not(pad: Pad) -> None:
    other = replace(pad, rest_position_m=pad.rest_position_m + np.array([0.0, 0.0, 1e-3]))
    with pytest.raises(ModelError, match="other dimensions"):
        ContactModel.load("default", other)
    ContactModel.load("default", replace(pad, magnet=pad.magnet.with_remanence(1.28)))


# --- what it answers ---


def test_jacobian_is_the_derivative_of_the_contact(pad: Pad) -> None:
    """Differences over 1/100 of a unit, of answers that float32 rounds to 1e-6 mm: good to 1 % of the largest slope."""
    session = onnxruntime.InferenceSession(DEFAULT_PATH, providers=["CPUExecutionProvider"])
    pose = Frames.drawn(pad, 40, 0.0, 1.9, 14e-3, seed=21).tracked.pose
    _, jacobian = session.run(None, {"pose": pose.astype(np.float32)})
    scale = np.array([0.2, 0.2, 0.6, 0.05, 0.05])
    for column, step in enumerate(np.diag(5e-3 * scale)):
        moved = [
            session.run(None, {"pose": (pose + sign * np.append(step, 0.0)).astype(np.float32)})[0] for sign in (1, -1)
        ]
        slope = (moved[0] - moved[1]) / 2 / 5e-3
        expected = jacobian[:, :, column] * scale[column]
        firm = np.linalg.norm((pose - [0, 0, 12, 0, 0, 1])[:, :5] / scale, axis=1) > 0.2
        assert firm.sum() > 25
        np.testing.assert_allclose(slope[firm], expected[firm], atol=0.01 * np.abs(expected[firm]).max())
    assert not jacobian[:, :, 5].any()  # the axis's last component follows from the others


def test_calibration_set_is_met_on_the_grid(pad: Pad, model: ContactModel) -> None:
    """Noise-free, its inner 8 mm at the paper's two firm forces: 0.1 mm and 20 mN, a fraction of a frame's noise."""
    table = read_calibration_set(CALIBRATION)
    inner = (np.hypot(table.x_m, table.y_m) <= 8e-3) & (table.force_n > 1.0)
    solver = FrameSolver(pad, rest_field_of(pad), "drifting", NOISE_T)
    frames = Frames(table.press[inner], solver.solved(table.field_t[inner]))
    assert (np.abs(frames.found(model) - frames.press) < [0.1, 0.1, 0.02]).all()


def test_new_presses_without_noise_are_met(pad: Pad, model: ContactModel) -> None:
    """Within 8 mm, from the paper's lightest force to its firmest: at most 0.05 mm and 5 mN on average."""
    press = Frames.drawn(pad, 300, 0.28, 1.98, 8e-3, seed=71).press
    error = np.abs(Frames.of(pad, press).found(model) - press).mean(axis=0)
    assert (error < [0.05, 0.05, 0.005]).all()


def test_any_magnet_strength_gives_the_same_contact(pad: Pad, model: ContactModel) -> None:
    press = np.array([[4.0, -3.0, 1.0], [-9.0, 2.0, 0.4], [11.0, 11.0, 1.7]])
    usual = Frames.of(pad, press).found(model)
    for remanence_t in (0.6, 1.18, 1.28, 1.5):
        other = Frames.of(pad, press, remanence_t=remanence_t).found(model)
        np.testing.assert_allclose(other, usual, atol=0.01)  # mm and N: a hundredth of a corner's noise


@pytest.mark.parametrize(("lowest_n", "highest_n", "within"), [(0.05, 0.2, 1.45), (0.2, 0.8, 1.15), (0.8, 1.9, 1.15)])
def test_single_frames_come_near_the_cramer_rao_bound(
    pad: Pad, model: ContactModel, lowest_n: float, highest_n: float, within: float
) -> None:
    """At 2 mG within 8 mm. 500 frames give an rms to 3 %; the rest is the network's own error, and at light touch
    that a place is no longer a linear function of the noise."""
    frames = Frames.drawn(pad, 500, lowest_n, highest_n, 8e-3, seed=31)
    response = parse_response(onnxruntime.InferenceSession(DEFAULT_PATH).get_modelmeta().custom_metadata_map)
    assert response is not None
    _, slope = response.change_and_slope(frames.press)
    bound = bound_of(slope, frames.tracked.covariance)
    share = np.sqrt(np.mean(((frames.found(model) - frames.press) / bound)[:, :2] ** 2))
    assert 0.8 < share < within


@pytest.mark.parametrize(("lowest_n", "highest_n"), [(0.1, 0.3), (0.3, 1.0), (1.0, 1.9)])
def test_deviations_are_honest(pad: Pad, model: ContactModel, lowest_n: float, highest_n: float) -> None:
    """Within 8 mm at 2 mG, 95.4 % of errors should be below two deviations; 600 draws give that to 0.9 %."""
    frames = Frames.drawn(pad, 600, lowest_n, highest_n, 8e-3, seed=41)
    estimates = frames.estimates(model)
    error = np.abs(frames.found(model) - frames.press)
    deviation = np.array([[one.x_sd_m * 1e3, one.y_sd_m * 1e3, one.force_sd_n] for one in estimates])
    within = np.mean(error < 2.0 * deviation, axis=0)
    assert (within > 0.925).all()
    assert (within < 0.995).all()
    assert not any(one.over_range for one in estimates)


# --- the envelope ---


def test_rest_and_a_lifted_magnet_are_not_over_range(pad: Pad, model: ContactModel) -> None:
    rest = model.estimate(pad.rest_position_m, pad.rest_axis, CERTAIN)
    assert not rest.over_range
    assert rest.force_min_n is None
    assert abs(rest.force_n) < 0.02
    lifted = model.estimate(pad.rest_position_m + np.array([0.0, 0.0, 0.5e-3]), pad.rest_axis, CERTAIN)
    assert not lifted.over_range
    assert np.isfinite([lifted.x_m, lifted.y_m, lifted.force_n]).all()


@pytest.mark.parametrize("reach_m", [8e-3, 14e-3])
def test_lower_bound_of_a_squeeze_is_below_its_force(pad: Pad, model: ContactModel, reach_m: float) -> None:
    """Up to twice the largest calibrated force; at three deviations one in 700 may fail, of 400 none does."""
    frames = Frames.drawn(pad, 400, 2.05, 4.0, reach_m, seed=51)
    for estimate, force_n in zip(frames.estimates(model), frames.press[:, 2], strict=True):
        assert (estimate.force_min_n is not None) == estimate.over_range
        if estimate.force_min_n is not None:
            assert 1.0 < estimate.force_min_n <= force_n


def test_hard_squeeze_within_8_mm_is_always_over_range_and_known_to_be_hard(pad: Pad, model: ContactModel) -> None:
    frames = Frames.drawn(pad, 300, 2.3, 4.0, 8e-3, seed=52)
    found = frames.estimates(model)
    assert all(estimate.over_range for estimate in found)
    assert min(estimate.force_min_n or 0.0 for estimate in found) > 1.85
    # The place is still the right one: the displacement keeps its direction.
    error_mm = np.linalg.norm(frames.found(model)[:, :2] - frames.press[:, :2], axis=1)
    assert np.median(error_mm) < 0.5


def test_pose_far_outside_is_judged_by_the_nearest_one_that_the_model_knows(pad: Pad, model: ContactModel) -> None:
    """Three and ten times a firm press's displacement: the same place, and nearly the calibrated force."""
    displacement_m, axis = standard_mechanics().displacement(np.array([4e-3]), np.array([2e-3]), np.array([1.9]))
    for times in (3.0, 10.0):
        tilt = axis[0, :2] * times
        turned = np.append(tilt, np.sqrt(1.0 - tilt @ tilt))
        estimate = model.estimate(pad.rest_position_m + times * displacement_m[0], turned, CERTAIN)
        assert estimate.over_range
        assert estimate.force_min_n is not None
        assert estimate.force_min_n > 1.8
        assert np.hypot(estimate.x_m - 4e-3, estimate.y_m - 2e-3) < 0.3e-3


def test_presses_up_to_the_calibrated_force_are_in_range(pad: Pad, model: ContactModel) -> None:
    frames = Frames.drawn(pad, 400, 0.0, 1.97, 14e-3, seed=53)
    assert not any(estimate.over_range for estimate in frames.estimates(model))


def test_answer_is_finite_for_any_finite_pose_and_refused_for_others(pad: Pad, model: ContactModel) -> None:
    random = np.random.default_rng(61)
    for size in (1e-6, 1e-3, 1.0, 1e6):
        for _ in range(50):
            axis = random.standard_normal(3)
            root = random.standard_normal((6, 6)) * size
            estimate = model.estimate(random.standard_normal(3) * size, axis / np.linalg.norm(axis), root @ root.T)
            assert np.isfinite([estimate.x_m, estimate.y_m, estimate.force_n]).all()
            assert np.isfinite(estimate.covariance).all()
            assert (np.diagonal(estimate.covariance) > 0.0).all()
            assert estimate.force_min_n is None or 0.0 <= estimate.force_min_n < 2.0
    with pytest.raises(ValueError, match="not finite"):
        model.estimate(np.array([0.0, np.nan, 0.012]), pad.rest_axis, CERTAIN)
    with pytest.raises(ValueError, match="not finite"):
        model.estimate(pad.rest_position_m, pad.rest_axis, CERTAIN * np.nan)


# --- refine, friction, shear ---


def test_refined_answers_are_the_most_likely_and_say_so(pad: Pad, model: ContactModel) -> None:
    """Beyond 11 mm, where the network is least good; deviations are honest there, to the 4 % that 600 errors tell."""
    refining = ContactModel.load("default", pad, refine=True)
    frames = Frames.drawn(pad, 1200, 0.28, 1.98, 14e-3, seed=81)
    outer = np.linalg.norm(frames.press[:, :2], axis=1) > 11.0
    estimates = frames.estimates(refining)
    deviation = np.array([[one.x_sd_m * 1e3, one.y_sd_m * 1e3, one.force_sd_n] for one in estimates])
    error = frames.found(refining) - frames.press
    rms = np.sqrt(np.mean((error / deviation)[outer] ** 2, axis=0))
    assert (rms < 1.15).all()
    assert (rms > 0.85).all()
    clean = Frames.of(pad, frames.press[:200])
    assert (np.abs(clean.found(refining) - clean.press).mean(axis=0) < [0.02, 0.02, 0.002]).all()
    assert not refining.plain
    assert model.plain


def test_model_without_a_response_cannot_be_refined(tmp_path: Path, pad: Pad) -> None:
    def forget(proto: onnx.ModelProto) -> None:
        kept = [entry for entry in proto.metadata_props if entry.key != RESPONSE_KEY]
        proto.ClearField("metadata_props")
        proto.metadata_props.extend(kept)

    path = edited(tmp_path, forget)
    ContactModel.load(path, pad)
    with pytest.raises(ModelError, match="holds no response"):
        ContactModel.load(path, pad, refine=True)


def test_friction_widens_the_deviations_of_a_model_that_does_not_tell_shear(tmp_path: Path, pad: Pad) -> None:
    """A model that a newton of shear moves by 1 mm and 0.2 N: at µ = 0.3 and 1.6 N, rms shear is 0.3·1.98/√2 N, the
    force being that of the bin's end."""

    def tell(facts: dict[str, object]) -> None:
        own = facts["own_error"]
        assert isinstance(own, dict)
        per_newton = {"x_mm": 1.0, "y_mm": 1.0, "force_error_n": 0.2}
        facts["friction_error"] = own | {
            name: [[value] * len(own["radius_mm"])] * len(own["force_n"]) for name, value in per_newton.items()
        }

    path = edited(tmp_path, with_facts(tell))
    frames = Frames.of(pad, np.array([[2.0, 1.0, 1.6]]))
    without, with_friction = (
        frames.estimates(ContactModel.load(path, pad, friction=friction))[0] for friction in (0.0, 0.3)
    )
    shear_n = 0.3 * 1.9792 / np.sqrt(2.0)
    assert with_friction.x_sd_m**2 - without.x_sd_m**2 == pytest.approx((shear_n * 1e-3) ** 2, rel=1e-3)
    assert with_friction.force_sd_n**2 - without.force_sd_n**2 == pytest.approx((shear_n * 0.2) ** 2, rel=1e-3)
    assert with_friction.x_m == without.x_m


def test_model_of_five_outputs_tells_shear_and_refuses_the_edge(tmp_path: Path, pad: Pad) -> None:
    """A network that answers with constants, at first inside and then outside of where it may."""
    network = ContactNetwork(
        np.array([0.0, 0.0, 12.0, 0.0, 0.0, 1.0]),
        np.ones(5),
        Layers.drawn((10, 2, 2, 5), np.random.default_rng(0)).scaled(
            np.array([3.0, -2.0, 1.0, 0.2, -0.1]), np.zeros(5)
        ),
    )
    facts = ContactModel.load("default", pad).facts
    own = msgspec.structs.replace(facts.own_error, shear_error_n=facts.own_error.force_error_n)
    envelope = msgspec.structs.replace(facts.envelope, x_mm=(-8.0, 8.0), y_mm=(-8.0, 8.0))
    facts = msgspec.structs.replace(facts, outputs=SHEAR_OUTPUT_ORDER, own_error=own, envelope=envelope)
    path = tmp_path / "five.onnx"
    path.write_bytes(export(network, facts, None))
    model = ContactModel.load(str(path), pad)
    inside = model.estimate(pad.rest_position_m, pad.rest_axis, CERTAIN)
    assert inside.shear_n is not None
    np.testing.assert_allclose(inside.shear_n, [0.2, -0.1], rtol=1e-6)
    assert inside.covariance.shape == (5, 5)
    assert not inside.refused
    assert not model.plain
    moved = replace(network, layers=network.layers.scaled(np.array([6.0, 0.0, 0.0, 0.0, 0.0]), np.ones(5)))
    path.write_bytes(export(moved, facts, None))
    assert ContactModel.load(str(path), pad).estimate(pad.rest_position_m, pad.rest_axis, CERTAIN).refused


def test_model_whose_facts_are_of_another_number_of_outputs_is_refused(tmp_path: Path, pad: Pad) -> None:
    def five(facts: dict[str, object]) -> None:
        own = facts["own_error"]
        assert isinstance(own, dict)
        own["shear_error_n"] = own["x_mm"]
        facts["outputs"] = SHEAR_OUTPUT_ORDER

    with pytest.raises(ModelError, match="another number of outputs"):
        ContactModel.load(edited(tmp_path, with_facts(five)), pad)
    only_named = with_facts(lambda facts: facts.update(outputs=SHEAR_OUTPUT_ORDER))
    with pytest.raises(ModelError, match="own error is not told for each"):
        ContactModel.load(edited(tmp_path, only_named), pad)


def test_place_beyond_the_pad_is_as_vague_as_the_pad_is_wide(model: ContactModel) -> None:
    """Light and noisy poses are put there; the Jacobian of a network beyond its training says too little."""
    random = np.random.default_rng(5)
    beyond = 0
    for _ in range(300):
        position_m = np.array([0.0, 0.0, 12e-3]) + random.normal(0.0, [15e-6, 15e-6, 6e-6])
        tilt = random.normal(0.0, 3e-3, 2)
        axis = np.array([*tilt, np.sqrt(1.0 - tilt @ tilt)])
        estimate = model.estimate(position_m, axis, np.diag([15e-6, 15e-6, 6e-6, 3e-3, 3e-3, 0.0]) ** 2)
        for place_m, deviation_m in ((estimate.x_m, estimate.x_sd_m), (estimate.y_m, estimate.y_sd_m)):
            if abs(place_m) > 14e-3:
                beyond += 1
                assert deviation_m == pytest.approx(28e-3 / np.sqrt(12.0))
    assert beyond > 10
