"""The effect of `[pad.contact]` on a model: refined answers, friction, and a model with shear."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from test_contact_model import CERTAIN, Frames
from test_contact_model_file import edited, with_facts

from fmfts.contact import ContactModel
from fmfts.contact.contract import SHEAR_OUTPUT_ORDER
from fmfts.pad import Pad
from fmfts_calibrate.export import export
from fmfts_calibrate.levenberg import Layers
from fmfts_calibrate.network import ContactNetwork
from fmfts_lab.bench.workspace import standard_pad


@pytest.fixture
def model(pad: Pad) -> ContactModel:
    return ContactModel.load("default", pad)


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
    clean = Frames.of(standard_pad(), frames.press[:200])
    assert (np.abs(clean.found(refining) - clean.press).mean(axis=0) < [0.02, 0.02, 0.002]).all()


def test_friction_widens_deviations_of_models_without_shear(tmp_path: Path, pad: Pad) -> None:
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


def test_model_of_five_outputs_reports_shear_and_refuses_edge(tmp_path: Path, pad: Pad) -> None:
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
    facts = msgspec.structs.replace(
        facts, outputs=SHEAR_OUTPUT_ORDER, own_error=own, response_error=None, envelope=envelope
    )
    path = tmp_path / "five.onnx"
    path.write_bytes(export(network, facts, None))
    model = ContactModel.load(str(path), pad)
    inside = model.estimate(pad.rest_position_m, pad.rest_axis, CERTAIN)
    assert inside.shear_n is not None
    np.testing.assert_allclose(inside.shear_n, [0.2, -0.1], rtol=1e-6)
    assert inside.deviations.shape == (5,)
    assert not inside.refused
    moved = replace(network, layers=network.layers.scaled(np.array([6.0, 0.0, 0.0, 0.0, 0.0]), np.ones(5)))
    path.write_bytes(export(moved, facts, None))
    assert ContactModel.load(str(path), pad).estimate(pad.rest_position_m, pad.rest_axis, CERTAIN).refused


def test_refined_deviations_include_the_responses_error(tmp_path: Path, pad: Pad) -> None:
    """A response known to 1 mm and 0.2 N, whatever the network."""

    def tell(facts: dict[str, object]) -> None:
        own = facts["own_error"]
        assert isinstance(own, dict)
        known_to = {"x_mm": 1.0, "y_mm": 1.0, "force_error_n": 0.2}
        facts["response_error"] = own | {
            name: [[value] * len(own["radius_mm"])] * len(own["force_n"]) for name, value in known_to.items()
        }

    refined = ContactModel.load(edited(tmp_path, with_facts(tell)), pad, refine=True)
    (estimate,) = Frames.of(pad, np.array([[2.0, 1.0, 1.6]])).estimates(refined)
    assert estimate.x_sd_m > 1e-3
    assert estimate.force_sd_n > 0.2


def test_friction_in_the_last_bin_counts_up_to_the_largest_force(tmp_path: Path, pad: Pad) -> None:
    """A pad for 6 N whose last bin begins at 1.4 N: shear grows with the force, wherever the bins end."""

    def tell(facts: dict[str, object]) -> None:
        facts["friction_error"] = facts["own_error"]
        facts["envelope"]["force_max_n"] = 6.0  # type: ignore[index]

    path = edited(tmp_path, with_facts(tell))
    of_two, of_six = (ContactModel.load(one, pad, friction=0.3) for one in ("default", path))
    per_newton = np.array(of_six.facts.own_error.force_error_n)[-1]
    np.testing.assert_allclose(of_six.slipping_n, 0.3 * 6.0 / np.sqrt(2.0) * per_newton, rtol=1e-9)
    assert of_two.facts.envelope.force_max_n < 2.0
