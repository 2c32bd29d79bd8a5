"""`probe --magnet`: boards with mistakes and without, before a person with one magnet. tests/unit/magnet_world.py."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from magnet_mistakes import MISTAKES, any_turn, board_of, tried, two_quarters, upside_down
from magnet_world import Built, good_board, measured, person
from scipy.spatial.transform import Rotation

from fmfts_magnet import Board, Readings, TooLittleError, Verdict, instructed_hand, judged, sentences
from fmfts_magnet.geometry import NotWritableError, geometry_of
from fmfts_magnet.picture import picture
from fmfts_magnet.words import magnet

SEED = 3
LEFT_TO_THE_DRILL = two_quarters, upside_down, any_turn  # `make magnet-check`; this file takes some 20 s


def board_for(built: Built) -> Board:
    return Board(built.place_m, built.drawn_axes, 3e-4, float(np.radians(1.5)), 0.05)


def checked(built: Built, seed: int, pole_is_known: bool = False, chip: str = "mmc5983ma") -> Verdict:
    """The verdict about a board that was drawn without mistakes."""
    random = np.random.default_rng(seed)
    someone = person(chip, random, largest_factor=2.0)
    readings = measured(built, chip, someone, random)
    drawn = board_of(len(built.place_m)) if len(built.place_m) == 5 else good_board(len(built.place_m))
    return judged(board_for(drawn), readings, instructed_hand(someone.pole if pole_is_known else 0))


@pytest.mark.parametrize(
    "make", [make for make in dict.fromkeys(MISTAKES) if make not in LEFT_TO_THE_DRILL], ids=lambda make: make.__name__
)
def test_random_mistake_is_named(make) -> None:  # type: ignore[no-untyped-def]
    outcome = tried((SEED, 7, MISTAKES.index(make)), make)
    assert outcome.verdict == "named", outcome


@pytest.mark.parametrize("number", range(2))
def test_good_board_has_no_reported_fault(number: int) -> None:
    outcome = tried((SEED, 50 + number), None)
    assert outcome.verdict == "good", outcome


def test_two_of_four_scales_stay_unknown() -> None:
    """Two chips that read twice, or the two others that read half: nobody knows how strong the magnet is."""
    built = replace(good_board(4), factor=np.array([[2.0] * 3, [1.0] * 3, [1.0] * 3, [2.0] * 3]))
    verdict = checked(built, 4)
    assert not verdict.is_decided
    said = " ".join(sentences(verdict))
    assert "Sensor 1 reads twice" in said
    assert "Sensor 2 reads half" in said
    assert "magnet of unknown strength cannot decide" in said


def test_mirrored_z_and_half_turn_need_a_known_pole() -> None:
    built = replace(good_board(4), factor=np.tile([1.0, 1.0, -1.0], (4, 1)))
    unknown, known = checked(built, 5), checked(built, 5, pole_is_known=True)
    said = " ".join(sentences(unknown))
    assert "All chips read z with the wrong sign" in said
    assert "All chips are turned by 180° about their z" in said
    assert "--pole up or --pole down" in said
    with pytest.raises(NotWritableError, match="did not decide"):
        geometry_of(unknown)
    assert sentences(known) == ["All chips read z with the wrong sign: invert geometry.sensors_mirrored."]
    assert geometry_of(known).is_mirrored


def test_written_geometry_makes_the_board_good() -> None:
    built = good_board(4)
    turned = built.turned.copy()
    turned[2] = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    built = replace(built, turned=turned, wired=np.array([1, 0, 2, 3]))
    random = np.random.default_rng(6)
    someone = person("hmc5983", random)
    readings = measured(built, "hmc5983", someone, random)
    verdict = judged(board_for(good_board(4)), readings, instructed_hand())
    geometry = geometry_of(verdict)
    assert geometry.keys() == {
        "sensors_mm": "[[8, -8, 0], [8, 8, 0], [-8, 8, 0], [-8, -8, 0]]",
        "sensor_rotations_deg": "[[0, 0, 0], [0, 0, 0], [0, 0, 90], [0, 0, 0]]",
        "sensors_mirrored": "false",
    }
    axes = Rotation.from_rotvec(geometry.rotation_deg, degrees=True).as_matrix()
    corrected = replace(board_for(good_board(4)), place_m=geometry.place_m, axes=axes)
    assert judged(corrected, readings, instructed_hand()).is_as_drawn


def test_one_mirrored_chip_cannot_be_written() -> None:
    built = replace(good_board(4), factor=np.array([[1.0] * 3, [-1.0, 1.0, 1.0], [1.0] * 3, [1.0] * 3]))
    with pytest.raises(NotWritableError, match="sensor 2 is not as the others"):
        geometry_of(checked(built, 7))


@pytest.mark.parametrize("axes", [(0, 1, 2), (1,)], ids=["chip", "axis"])
def test_dead_chip_or_axis_is_named(axes: tuple[int, ...]) -> None:
    factor = np.ones((5, 3))
    factor[3, list(axes)] = 0.0
    verdict = checked(replace(board_of(5), factor=factor), 8)
    (said,) = sentences(verdict)
    assert said.startswith("Sensor 4 does not measure the magnet" + (" on y" if len(axes) == 1 else ":")), said
    assert not verdict.is_as_drawn
    assert "4 ✗" in picture(verdict)
    assert "3 ✓" in picture(verdict)


def test_measured_scale_is_told_as_a_factor() -> None:
    factor = np.ones((4, 3))
    factor[1] = 1.6
    (said,) = sentences(checked(replace(good_board(4), factor=factor), 9))
    assert said.startswith("Sensor 2 reads 1."), said
    measured_factor = float(said.split()[3])
    assert measured_factor == pytest.approx(1.6, rel=0.15)


def test_far_magnet_leaves_the_check_open() -> None:
    """At 30 cm all sensors see the same field: nothing tells swapped channels from good ones."""
    built, random = good_board(4), np.random.default_rng(10)
    someone = person("mmc5983ma", random)
    someone.height_m, someone.diameter_m, someone.length_m = 0.3, 0.04, 0.04
    verdict = judged(board_for(built), measured(built, "mmc5983ma", someone, random), instructed_hand())
    assert not verdict.is_decided
    assert "repeat the check with it nearer" in " ".join(sentences(verdict)).lower()


def test_readings_without_magnet_fit_no_explanation() -> None:
    random = np.random.default_rng(11)
    readings = Readings(random.normal(0.0, 1e-4, (3, 4, 3)), np.full((4, 3), 1e-7))
    verdict = judged(board_for(good_board(4)), readings, instructed_hand())
    assert not verdict.found
    assert sentences(verdict)[0].startswith("Nothing that this check knows explains the readings.")
    assert "1 ✗" in picture(verdict)


def test_too_few_sensors_are_refused() -> None:
    change = np.zeros((3, 4, 3))
    change[:, 0] = 1e-4
    change[:, 1] = 1e-4
    with pytest.raises(TooLittleError, match="only 2 of 4 sensors measure the magnet"):
        judged(board_for(good_board(4)), Readings(change, np.full((4, 3), 1e-7)), instructed_hand())


def test_magnet_strength_is_reported_within_a_fifth() -> None:
    """A factor that all chips share shows only as a magnet of another size."""
    random = np.random.default_rng(12)
    someone = person("mmc5983ma", random)
    someone.diameter_m = someone.length_m = 4e-3
    someone.remanence_t, someone.height_m = 1.25, 0.03
    built = good_board(4)
    verdict = judged(board_for(built), measured(built, "mmc5983ma", someone, random), instructed_hand())
    words = magnet(verdict.found[0]).split()
    assert float(words[words.index("mm", words.index("about")) - 1]) == pytest.approx(4.0, rel=0.1)
    assert float(words[4 - 1]) == pytest.approx(30.0, abs=6.0)
