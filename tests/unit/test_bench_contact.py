"""The figures of the contact model that lab/results/contact-model.md quotes, on few frames."""

from __future__ import annotations

import numpy as np
import pytest

from fmfts.contact import ContactModel
from fmfts_lab.bench.contact import accuracy
from fmfts_lab.bench.contact_live import motion, squeezes, touch
from fmfts_lab.bench.contact_sizes import sizes
from fmfts_lab.bench.workspace import standard_pad


@pytest.mark.long
def test_shipped_model_is_near_the_best_and_honest() -> None:
    """400 frames: pairwise ratios of mean errors to 2 %, rms in deviations to 4 % (1 σ)."""
    facts = accuracy("default", 400, np.random.default_rng(3))
    assert (np.array(facts["noise_free"]["table"]) < [0.02, 0.02, 0.002]).all()
    assert (np.array(facts["noise_free"]["network_centre"]) < [0.05, 0.05, 0.005]).all()
    for scene in ("drifting", "constant"):
        assert (np.array(facts[scene]["network_over_best"]) < 1.07 + 0.06).all()
        assert (np.array(facts[scene]["refined_over_best"]) < 1.02 + 0.06).all()
        within = np.array(facts[scene]["network_in_sd_within 11 mm"])
        assert (np.abs(within - 1.0) < 0.1 + 0.1).all()
        assert (np.array(facts[scene]["network_in_sd_beyond"]) < 1.3).all()
    # The same noise on a field 4 % stronger: the error is that much smaller, and times the remanence it is the same.
    np.testing.assert_allclose(facts["remanences"]["1.28 T"], 1.0, atol=0.05)


@pytest.mark.long
def test_sizes_stand_beside_what_they_cost() -> None:
    """A larger network mainly adds parameters: 4 bytes each, and as much again for their transposes."""
    facts = sizes((4, 8), presses=300)
    small, large = (facts[f"two layers of {hidden}"] for hidden in (4, 8))
    assert large["file_bytes"] - small["file_bytes"] > 4 * (large["parameters"] - small["parameters"])
    assert min(small["inference_us"], large["inference_us"]) > 0.0
    assert facts["chosen"] == "two layers of 8"
    assert facts["table inversion"]["error_in_bounds"] < 1.1 < large["error_in_bounds"] < small["error_in_bounds"]


def test_smallest_touch_is_millinewtons_and_double_is_immediate() -> None:
    facts = touch(0.01, np.random.default_rng(4))
    smallest = np.array(facts["smallest_n"])
    assert 0.01 < smallest[0, 0] < 0.03
    assert (np.diff(smallest, axis=0) > 0.0).all()
    np.testing.assert_allclose(smallest, smallest.T, rtol=1e-2)
    assert np.max(facts["worst_onset_frames"]) <= 2
    assert facts["false_contacts"] == 0  # in 8,000 frames; one in 790,000 is allowed


@pytest.mark.parametrize("refine", [False, True])
def test_squeeze_is_flagged_and_its_bound_is_below_the_force(refine: bool) -> None:
    facts = squeezes(ContactModel.load("default", standard_pad(), refine=refine), np.random.default_rng(5))
    assert facts["2.6 N"]["flagged_within_11_mm"] > 0.99
    for force in ("4.0 N", "6.0 N"):
        assert facts[force]["flagged"] == 1.0
    assert all(row["bounds_too_high"] == 0 for row in facts.values())


def test_smoothing_leaves_sixty_percent_of_error_of_moving_finger() -> None:
    """4,000 frames whose errors last for eight give ratios to 4 %."""
    facts = motion(ContactModel.load("default", standard_pad()), np.random.default_rng(6))
    assert (np.array(facts["share"]) < 0.6 + 0.05).all()
    assert abs(facts["lag_ms"]) < 10.0
