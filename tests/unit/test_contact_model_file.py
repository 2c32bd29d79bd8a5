"""A contact model's file: the conditions for accepting it, and the sentence of each refusal."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper
from test_contact_model import CALIBRATION

from fmfts.cli.main import main
from fmfts.config import BusConfig, PadConfig, SimulatedSource
from fmfts.config.file import load
from fmfts.contact import ContactModel, ModelError
from fmfts.contact.contract import METADATA_KEY, RESPONSE_KEY, SHEAR_OUTPUT_ORDER, SIZE_LIMIT_BYTES, WEIGHTS_KEY
from fmfts.contact.seal import unsealed, with_seal
from fmfts.contact.shipped import DEFAULT_PATH, STANDARD_DIMENSIONS, STANDARD_HASH
from fmfts.contact.structure import shipped_friction_error
from fmfts.pad import Pad
from fmfts.runtime.daemon import Daemon


def edited(tmp_path: Path, edit: Callable[[onnx.ModelProto], None]) -> str:
    proto = onnx.load_from_string(unsealed(DEFAULT_PATH.read_bytes()))
    edit(proto)
    path = tmp_path / "edited.onnx"
    has_weights = any(entry.key == WEIGHTS_KEY for entry in proto.metadata_props)
    content = proto.SerializeToString()
    path.write_bytes(with_seal(content) if has_weights else content)
    return str(path)


def of_another_program(edit: Callable[[onnx.ModelProto], None]) -> Callable[[onnx.ModelProto], None]:
    """A model without the weights that `calibrate` writes, so that its graph must be checked."""

    def edited_too(proto: onnx.ModelProto) -> None:
        kept = [entry for entry in proto.metadata_props if entry.key != WEIGHTS_KEY]
        proto.ClearField("metadata_props")
        proto.metadata_props.extend(kept)
        edit(proto)

    return edited_too


def with_facts(change: Callable[[dict[str, object]], None]) -> Callable[[onnx.ModelProto], None]:
    def edit(proto: onnx.ModelProto) -> None:
        (entry,) = (entry for entry in proto.metadata_props if entry.key == METADATA_KEY)
        facts = json.loads(entry.value)
        change(facts)
        entry.value = json.dumps(facts)

    return edit


@pytest.fixture
def model(pad: Pad) -> ContactModel:
    return ContactModel.load("default", pad)


def test_model_that_ships_is_the_one_its_report_describes(model: ContactModel) -> None:
    content = unsealed(DEFAULT_PATH.read_bytes())
    weights = onnx.ModelProto(metadata_props=onnx.load_from_string(content).metadata_props[-1:])
    digest = hashlib.sha256(content.removesuffix(weights.SerializeToString())).hexdigest()[:12]
    report = json.loads(DEFAULT_PATH.with_suffix(".json").read_text())
    assert model.hash == report["model"] == digest
    over_all = report["on_the_calibration_set"][0]
    assert model.facts.metrics.items() <= over_all.items()
    assert model.facts.data == report["calibration_set_sha256"] == hashlib.sha256(CALIBRATION.read_bytes()).hexdigest()


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
        (of_another_program(set_versions(9, 18)), "opset 18, not 9 and 17"),
        (of_another_program(set_versions(10, 17)), "IR version 10"),
        (lambda proto: proto.ClearField("metadata_props"), f"no '{METADATA_KEY}'"),
        (with_facts(lambda facts: facts.pop("envelope")), "missing required field `envelope`"),
        (with_facts(lambda facts: facts.update(contract=1)), "contract"),
        (with_facts(lambda facts: facts.update(surprise=1)), "unknown field `surprise`"),
        (with_facts(lambda facts: facts.update(inputs=["m", "n", "p", "a_mm", "b_mm", "c_mm"])), "input order"),
        (with_facts(lambda facts: facts.update(outputs=["y_mm", "x_mm", "force_n"])), "output order"),
        (with_facts(lambda facts: facts["envelope"].update(pose_max=[0, 0, 11, 0, 0, 1])), "zero force"),  # type: ignore[attr-defined]
        (with_facts(lambda facts: facts["own_error"].update(x_mm=[[1.0]])), "row per force"),  # type: ignore[attr-defined]
        (
            with_facts(lambda facts: facts.update(geometry_hash="0123456789ab")),
            "does not say (the model's have the hash 0123456789ab",
        ),
        (
            with_facts(
                lambda facts: facts.update(geometry_hash="0123456789ab", dimensions={"magnet.diameter_mm": [3]})
            ),
            "magnet.diameter_mm is 3 in the model and 2 in the configuration",
        ),
        (of_another_program(double_output), "its tensors are pose, twice, jacobian"),
        (of_another_program(fixed_batch), "pose has the shape"),
        (of_another_program(answer_with_nan), "does not answer with numbers"),
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
    proto.metadata_props.extend(onnx.load_from_string(unsealed(DEFAULT_PATH.read_bytes())).metadata_props)
    path = tmp_path / "other.onnx"
    path.write_bytes(proto.SerializeToString())
    with pytest.raises(ModelError, match=r"pose has the shape \['N', 5\], not \['N', 6\]"):
        ContactModel.load(str(path), pad)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_truncated_file_is_refused(tmp_path: Path, pad: Pad, share: float) -> None:
    content = unsealed(DEFAULT_PATH.read_bytes())
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
    whole = onnx.load_from_string(unsealed(DEFAULT_PATH.read_bytes()))
    onnx.save_model(whole, str(path), save_as_external_data=True, location="weights.bin", size_threshold=0)
    assert (tmp_path / "weights.bin").stat().st_size > 1000
    with pytest.raises(ModelError, match="external data"):
        ContactModel.load(str(path), pad)


def test_other_dimensions_are_refused_but_not_another_strength(pad: Pad) -> None:
    other = replace(pad, rest_position_m=pad.rest_position_m + np.array([0.0, 0.0, 1e-3]))
    with pytest.raises(ModelError, match="other dimensions"):
        ContactModel.load("default", other)
    ContactModel.load("default", replace(pad, magnet=pad.magnet.with_remanence(1.28)))


def without_response(proto: onnx.ModelProto) -> None:
    kept = [entry for entry in proto.metadata_props if entry.key != RESPONSE_KEY]
    proto.ClearField("metadata_props")
    proto.metadata_props.extend(kept)


@pytest.mark.parametrize(
    ("finger_mm", "warns"), [("[12, 12]", True), ("[3, 12]", True), ("[6, 6]", False)], ids=["known", "usual", "probe"]
)
def test_finger_without_effect_is_named(
    finger_mm: str, warns: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By `check-config` and at a start: a model without a response can neither correct a finger nor count it."""
    file, text = tmp_path / "pad.toml", f"finger_mm = {finger_mm} has no effect: the contact model holds no response"
    contact = f'[pad.contact]\nmodel = "{edited(tmp_path, without_response)}"\nfinger_mm = {finger_mm}\n'
    file.write_text('[[pad]]\nname = "one"\n[pad.source]\ntype = "simulated"\n' + contact)
    assert main(["check-config", "--config", str(file)]) == 0
    assert (text in capsys.readouterr().err) == warns
    with Daemon(msgspec.structs.replace(load(file)[0], bus=BusConfig(endpoint=f"ipc://{tmp_path}"))):
        assert (text in capsys.readouterr().err) == warns


def test_model_without_a_response_cannot_be_refined(tmp_path: Path, pad: Pad) -> None:
    path = edited(tmp_path, without_response)
    ContactModel.load(path, pad)
    with pytest.raises(ModelError, match="holds no response"):
        ContactModel.load(path, pad, refine=True)


def test_model_whose_facts_are_of_another_number_of_outputs_is_refused(tmp_path: Path, pad: Pad) -> None:
    def five(facts: dict[str, object]) -> None:
        own = facts["own_error"]
        assert isinstance(own, dict)
        own["shear_error_n"] = own["x_mm"]
        facts["outputs"], facts["response_error"] = SHEAR_OUTPUT_ORDER, None

    with pytest.raises(ModelError, match="another number of outputs"):
        ContactModel.load(edited(tmp_path, with_facts(five)), pad)
    only_named = with_facts(lambda facts: facts.update(outputs=SHEAR_OUTPUT_ORDER))
    with pytest.raises(ModelError, match="lacks its own error for some of its outputs"):
        ContactModel.load(edited(tmp_path, only_named), pad)


def test_dimensions_of_standard_pad_are_those_of_configuration() -> None:
    pad = PadConfig(name="standard", source=SimulatedSource()).pad()
    assert (pad.geometry_hash, pad.dimensions) == (STANDARD_HASH, STANDARD_DIMENSIONS)


def test_shear_of_the_shipped_model_stands_in_its_report_too(pad: Pad) -> None:
    told = shipped_friction_error(pad.geometry_hash)
    assert told is not None
    assert told == ContactModel.load("default", pad).facts.friction_error
    assert shipped_friction_error("0123456789ab") is None


@pytest.mark.parametrize("place", [0.0, 0.2, 0.5, 0.8, 0.95, 1.0])
def test_file_with_one_other_bit_is_refused(place: float, pad: Pad, tmp_path: Path) -> None:
    """Most bits are a weight's, and the model with another weight would answer forces as well."""
    content = bytearray(DEFAULT_PATH.read_bytes())
    content[round(place * (len(content) - 1))] ^= 0x04
    (tmp_path / "damaged.onnx").write_bytes(content)
    with pytest.raises(ModelError, match="damaged"):
        ContactModel.load(str(tmp_path / "damaged.onnx"), pad)


def test_file_whose_seal_and_weights_are_both_damaged_is_refused(pad: Pad, tmp_path: Path) -> None:
    """Otherwise it would count as a model of another program."""
    content = bytearray(DEFAULT_PATH.read_bytes().replace(b"fmfts.sha256", b"fmvts.sha256"))
    content[len(content) // 2] ^= 0x04
    (tmp_path / "damaged.onnx").write_bytes(content)
    with pytest.raises(ModelError, match="damaged"):
        ContactModel.load(str(tmp_path / "damaged.onnx"), pad)


def test_model_of_calibrate_without_its_seal_is_refused(pad: Pad, tmp_path: Path) -> None:
    (tmp_path / "cut.onnx").write_bytes(unsealed(DEFAULT_PATH.read_bytes()))
    with pytest.raises(ModelError, match="its SHA-256 is not at its end"):
        ContactModel.load(str(tmp_path / "cut.onnx"), pad)


def test_sealed_model_without_weights_is_of_another_version(pad: Pad, tmp_path: Path) -> None:
    proto = onnx.load_from_string(unsealed(DEFAULT_PATH.read_bytes()))
    del proto.metadata_props[-1]
    (tmp_path / "older.onnx").write_bytes(with_seal(proto.SerializeToString()))
    with pytest.raises(ModelError, match="of another version wrote it"):
        ContactModel.load(str(tmp_path / "older.onnx"), pad)
