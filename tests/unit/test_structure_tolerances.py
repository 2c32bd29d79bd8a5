"""What a configuration lets contacts count of a pad's structure, and how a tilt at rest turns its movements."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from bus_messages import status_message
from mounted_world import World
from msgspec import structs
from rich.console import Console

from fmfts.arithmetic.matrix import product
from fmfts.config import Config, ContactConfig, PadConfig, SimulatedSource, ToleranceConfig
from fmfts.config.checks import problems_in
from fmfts.contact.tolerances import StructureTolerance
from fmfts.pad import Pad, Tolerance
from fmfts.pose import State
from fmfts.view.status import render_status
from fmfts_client import Status
from fmfts_simulation.baseline import simulated_baseline


def config(model: str = "default", finger_mm: tuple[float, float] = (3.0, 12.0), **tolerance: float) -> PadConfig:
    return PadConfig(
        name="pad",
        source=SimulatedSource(seed=5, finger="none", turning_deg_per_s=0.0),
        tolerance=ToleranceConfig(**tolerance),
        contact=ContactConfig(model=model, finger_mm=finger_mm),
    )


def test_calibrated_pad_has_known_silicone_but_unknown_finger() -> None:
    shipped, own = (config(name).structure_tolerance() for name in ("shear", "mine.onnx"))
    assert shipped == StructureTolerance(0.2, 0.2e-3, (3e-3, 12e-3))
    assert own == StructureTolerance(0.0, 0.0, (3e-3, 12e-3), probe_m=None)
    assert config("default").structure_tolerance("mine.onnx") == own


def test_silicone_tolerances_of_the_file_apply_to_any_model() -> None:
    said = config("mine.onnx", modulus=0.05, thickness_mm=0.1).structure_tolerance()
    assert (said.modulus, said.thickness_m) == (0.05, pytest.approx(1e-4))
    assert config("default", modulus=0.0).structure_tolerance().modulus == 0.0


def test_finger_farthest_from_the_probe_is_two_deviations_away() -> None:
    """A disc has the second moment w²/16; the probe is 6 mm wide."""
    assert StructureTolerance(finger_m=(3e-3, 12e-3)).finger_mm2 == pytest.approx((144.0 - 36.0) / 16.0 / 2.0)
    assert StructureTolerance(finger_m=(0.0, 6e-3)).finger_mm2 == pytest.approx(36.0 / 16.0 / 2.0)
    assert StructureTolerance().finger_mm2 == 0.0


def test_known_width_is_corrected_but_not_the_shape() -> None:
    wide_mm2, narrow_mm2 = (144.0 - 36.0) / 16.0, (9.0 - 36.0) / 16.0
    disc = StructureTolerance(finger_m=(12e-3, 12e-3))
    assert (disc.known_finger_mm2, disc.finger_mm2) == (pytest.approx(wide_mm2), pytest.approx(wide_mm2 / 3.0))
    assert StructureTolerance(finger_m=(3e-3, 3e-3)).known_finger_mm2 == pytest.approx(narrow_mm2)
    assert StructureTolerance(finger_m=(3e-3, 12e-3)).known_finger_mm2 == 0.0
    some = StructureTolerance(finger_m=(8e-3, 12e-3))
    assert some.known_finger_mm2 == pytest.approx((64.0 - 36.0) / 16.0), "the width nearest to the probe's"
    assert some.finger_mm2 > (wide_mm2 - some.known_finger_mm2) / 2.0


def test_users_own_model_is_not_corrected_for_the_probe() -> None:
    own = config("mine.onnx", finger_mm=(12.0, 12.0)).structure_tolerance()
    assert own.known_finger_mm2 == 0.0
    assert own.finger_mm2 == pytest.approx((144.0 - 36.0) / 16.0 / 2.0), "the width counts in the deviations"


@pytest.mark.parametrize("probe_mm", [6.0, 12.0])
def test_own_model_is_corrected_for_a_finger_if_its_probe_is_known(probe_mm: float) -> None:
    def told(finger_mm: float) -> StructureTolerance:
        pad = config("mine.onnx", finger_mm=(finger_mm, finger_mm))
        contact = structs.replace(pad.contact, probe_mm=probe_mm)
        return structs.replace(pad, contact=contact).structure_tolerance()

    as_pressed, wide, narrow = (told(width_mm) for width_mm in (probe_mm, 15.0, 3.0))
    assert (as_pressed.known_finger_mm2, as_pressed.finger_mm2) == (0.0, 0.0)
    assert wide.known_finger_mm2 == pytest.approx((15.0**2 - probe_mm**2) / 16.0)
    assert narrow.known_finger_mm2 == pytest.approx((3.0**2 - probe_mm**2) / 16.0)
    assert wide.finger_mm2 == pytest.approx(wide.known_finger_mm2 / 3.0)


def test_probe_of_a_shipped_model_is_not_to_be_set() -> None:
    pad = config()
    (problem,) = problems_in(Config(pad=(structs.replace(pad, contact=structs.replace(pad.contact, probe_mm=5.0)),)))
    assert problem[-1] == "the shipped models' probe is 6 mm wide: leave it out"


def test_modulus_off_by_a_factor_is_wider_above_than_below() -> None:
    """Of moduli whose logarithm is normal, 84.1 % are at most one deviation above 1, by drawing them."""
    drawn = np.exp(0.5 * np.random.default_rng(1).standard_normal(400_000))
    assert 1.0 + StructureTolerance(modulus=0.5).force_share == pytest.approx(np.quantile(drawn, 0.84134), rel=0.01)
    assert StructureTolerance(modulus=0.02).force_share == pytest.approx(0.02, rel=0.02)
    assert StructureTolerance(modulus=0.5).scale_deviation == 0.5


def test_widths_in_the_wrong_order_are_named() -> None:
    ((where, text),) = problems_in(Config(pad=(config(finger_mm=(12.0, 3.0)),)))
    assert where[-2:] == ("contact", "finger_mm")
    assert "[3, 12]" in text


def test_rest_tilt_is_corrected_fully_on_average(pad: Pad) -> None:
    """Places and gains look like a tilt, so that the most probable one of 3° has 2° on average; but not what turns."""
    tolerance, left = Tolerance(1e-4, 1e-4, 0.0, 0.005, 0.05, pad_tilt_rad=float(np.radians(1.0))), []
    for seed in range(12):
        world = World(pad, np.random.default_rng(seed))
        along = np.array([np.cos(seed), np.sin(seed)])
        world.rest = State.at_rest(pad).stepped(
            np.array([0.0, 0.0, 0.0, *(np.radians(3.0) * along), 0.0, 0.0, 0.0, 0.0])
        )
        mounting = world.baseline(tolerance).mounting(pad)
        left.append(product(mounting.pad_turn, world.rest.axis)[:2] @ (world.rest.axis[:2] / np.sin(np.radians(3.0))))
    assert abs(np.degrees(np.mean(left))) < 0.5


def test_tilt_of_uncertain_cause_corrects_only_its_share(pad: Pad) -> None:
    turns = []
    for of_magnet, of_pad in ((0.0, 0.02), (0.016, 0.012), (0.02, 0.0)):
        tolerance = Tolerance(1e-4, 1e-4, of_magnet, 0.005, 0.05, pad_tilt_rad=of_pad)
        turns.append(World(pad, np.random.default_rng(3)).baseline(tolerance).mounting(pad).pad_turn[2, :2])
    np.testing.assert_allclose(turns[1], 0.36 * turns[0], rtol=1e-3)
    np.testing.assert_allclose(turns[2], 0.0, atol=1e-15)


def test_tilt_beyond_tolerances_counts_as_the_whole_pads() -> None:
    """The deviation of a pad's tilt under which the found one is most likely, and never a smaller one than is said."""
    usual = Tolerance(1e-4, 1e-4, float(np.radians(0.25)), 0.005, 0.05, pad_tilt_rad=float(np.radians(1.0)))
    small, large = (usual.tilts_given(np.radians([tilt_deg, 0.0]), np.ones(2)) for tilt_deg in (1.0, 5.0))
    assert small.pad_share == pytest.approx(1.0 / (1.0 + 0.25**2))
    assert large.pad_share == pytest.approx(1.0 - 2.0 * 0.25**2 / 5.0**2)
    assert large.unshared_rad == pytest.approx(np.radians(0.25), rel=0.01), "the magnet's own tilt stays unknown"
    cast = replace(usual, magnet_tilt_rad=float(np.radians(5.0)))
    assert cast.tilts_given(np.radians([5.0, 0.0]), np.ones(2)).pad_share == pytest.approx(1.0 / 26.0)
    level = replace(usual, pad_tilt_rad=0.0)
    assert level.tilts_given(np.radians([5.0, 0.0]), np.ones(2)) == (0.0, 0.0)


def test_noise_of_recording_is_no_tilt_of_the_pad() -> None:
    """Recordings that determine a third of a tilt find tilts that are √3 times as large as the pads' own. The pad's
    share stays near what the tolerances say. A large tilt is the pad's all the same."""
    given = Tolerance(1e-4, 1e-4, float(np.radians(1.0)), 0.005, 0.05, pad_tilt_rad=float(np.radians(0.5)))
    random, told = np.random.default_rng(1), np.full(2, 1.0 / 3.0)
    found = given.tilt_rad / np.sqrt(told) * random.standard_normal((2000, 2))
    by_noise = np.mean([given.tilts_given(one, np.ones(2)).pad_share for one in found])
    share = np.mean([given.tilts_given(one, told).pad_share for one in found])
    assert 0.2 <= share < 0.4 < 0.5 < by_noise
    large = given.tilts_given(np.radians([8.0, 0.0]), told).pad_share
    assert large == pytest.approx(1.0 - 1.0 / (8.0**2 / 2.0 - 2.0 * 1.25))
    assert given.tilts_given(found[0], np.full(2, 0.01)).pad_share == pytest.approx(0.2), "it tells nothing"


def test_tilt_error_of_a_movement_equals_a_turn_by_that_tilt() -> None:
    """Sideways in both directions, where the magnet moves down."""
    one = config(sensor_rotation_deg=0.0, gain=0.0, cross_axis=0.0)
    leftover = simulated_baseline(one).mounting(one.pad()).leftover
    assert leftover is not None
    solved = np.arange(6)
    none, some = (
        replace(leftover, pad_share=0.0, unshared_tilt_rad=tilt_rad).change_error(solved) for tilt_rad in (0.0, 0.02)
    )
    down = np.array([0.0, 0.0, -1e-3])
    before, after = (
        np.einsum("c,cim->im", down, errors[:3, :3]) @ np.einsum("c,cim->im", down, errors[:3, :3]).T
        for errors in (none, some)
    )
    np.testing.assert_allclose(after - before, np.diag([2e-5**2, 2e-5**2, 0.0]), atol=2e-13)


@pytest.mark.parametrize(
    ("share", "stiffness", "words"),
    [
        (
            0.23,
            None,
            "± 23% of every force from the silicone: its stiffness is not known",
        ),
        (
            0.06,
            1.5,
            "6% of every force from the silicone, which is 1.50 times as stiff as the model's, as a weight showed; "
            "the finger's width adds to it: contact.finger_mm",
        ),
        (0.0, None, "as calibrated"),
        (None, None, "–"),
    ],
)
def test_status_reports_the_force_scale_uncertainty(share: float | None, stiffness: float | None, words: str) -> None:
    out = io.StringIO()
    report = Status.from_message(
        {name: getattr(status_message(), name) for name in status_message().__struct_fields__}
        | {"force_scale_sd": share, "force_scale": stiffness}
    )
    Console(file=out, width=200).print(render_status([report]))
    (row,) = [line for line in out.getvalue().splitlines() if "force scale" in line]
    assert words in row
