"""How many fingers press on a pad with four magnets: none, one or two, their ids, and when a finger leaves."""

from __future__ import annotations

import numpy as np
import pytest

from fmfts.pad import Array
from fmfts.several.count import RELEASE_FRAMES, SECOND_GAIN, FingerCounter, are_two, resultant
from fmfts_lab.bench.several import gain_of_second
from fmfts_lab.bench.several_world import BUILT, EXACT, Press, World, world

NOTHING = np.zeros(3)
LEFT, RIGHT = Press(-6.0, -1.0, 1.0), Press(7.0, 2.0, 0.8)


@pytest.fixture(scope="module")
def drawn() -> World:
    return world(1, EXACT)


@pytest.fixture(scope="module")
def built() -> World:
    return world(2, BUILT)


def follow(one: World, counter: FingerCounter, presses: list[Press], frames: int = 1) -> tuple[Array, tuple[int, ...]]:
    for _ in range(frames):
        counted = counter.update(one.measured(one.pressed(presses)), NOTHING)
    return counted.fit.fingers, counted.ids


def test_untouched_pad_has_no_finger(built: World) -> None:
    counter = built.counter()
    assert all(follow(built, counter, [])[1] == () for _ in range(300))


def test_two_fingers_12_mm_apart_are_reported_from_first_frame_on(drawn: World) -> None:
    """Errors are within four of their own deviations: 60 numbers, of which one in 16,000 would be beyond."""
    for seed in range(10):
        random = np.random.default_rng(seed)
        place, angle = random.uniform(-5.0, 5.0, 2), random.uniform(0.0, 2.0 * np.pi)
        away = 6.0 * np.array([np.cos(angle), np.sin(angle)])
        pair = [Press(*(place + away).tolist(), 1.0), Press(*(place - away).tolist(), 1.0)]
        counted = drawn.counter().update(drawn.measured(drawn.pressed(pair)), NOTHING)
        assert len(counted.ids) == 2
        order = 1 if np.abs(counted.fit.fingers[0, :2] - pair[0][:2]).max() < 4.0 else -1
        error = counted.fit.fingers[::order] - np.array([press[:3] for press in pair])
        assert (np.abs(error) < 4.0 * counted.fit.deviation[::order]).all()


def test_weak_second_finger_is_found_beside_a_strong_one(drawn: World) -> None:
    fingers, _ = follow(drawn, drawn.counter(), [Press(3.7, 5.0, 2.0), Press(-10.9, -8.6, 0.2)])
    assert len(fingers) == 2
    assert abs(fingers[:, 2].min() - 0.2) < 0.1


@pytest.mark.parametrize("patch_mm", [4.0, 6.0, 8.0, 10.0])
@pytest.mark.parametrize("share", [0.0, 0.3])
def test_one_wide_or_sliding_finger_is_not_two(patch_mm: float, share: float, built: World) -> None:
    """The threshold of a second finger is three times the largest gain here, so that no frame comes near it."""
    for place in ((0.0, 0.0), (5.0, -2.0), (9.0, 9.0)):
        for force_n in (0.3, 1.0, 2.0):
            press = Press(*place, force_n, share * force_n, 0.0, patch_mm)
            measured = built.measured(built.pressed([press]))
            counted = built.counter().update(measured, NOTHING)
            assert len(counted.ids) == 1
            assert gain_of_second(built, measured) < SECOND_GAIN / 2.0


def test_ignoring_shear_would_split_a_sliding_finger(drawn: World) -> None:
    """One finger stays one because the covariance considers these causes: otherwise friction of 0.3 gains hundreds."""
    measured = drawn.measured(drawn.pressed([Press(0.0, 0.0, 2.0, 0.0, 0.6)]))
    assert gain_of_second(world(1, EXACT, friction=0.0), measured) > 3.0 * SECOND_GAIN
    assert gain_of_second(drawn, measured) < SECOND_GAIN / 2.0


def test_finger_keeps_its_id_while_another_comes_and_goes(drawn: World) -> None:
    counter = drawn.counter()
    _, alone = follow(drawn, counter, [LEFT], 3)
    fingers, both = follow(drawn, counter, [LEFT, RIGHT], 3)
    assert set(both) > set(alone)
    assert fingers[both.index(alone[0]), 0] < 0.0
    _, left = follow(drawn, counter, [LEFT], 2 * RELEASE_FRAMES)
    assert left == alone
    _, again = follow(drawn, counter, [LEFT, RIGHT], 3)
    assert set(again) - set(alone) != set(both) - set(alone)


def test_fingers_that_meet_become_one_and_part_as_two(drawn: World) -> None:
    counter, counts, forces = drawn.counter(), [], []
    way = np.concatenate([np.linspace(14.0, 4.0, 60), np.full(10, 4.0), np.linspace(4.0, 14.0, 60)])
    for apart in way:
        pair = [Press(-6.0, 0.0, 0.8), Press(-6.0 + apart, 0.0, 0.8)]
        fingers, ids = follow(drawn, counter, pair)
        counts.append(len(ids))
        forces.append(resultant(fingers)[2])
    changes = [one for one, before in zip(counts[1:], counts, strict=False) if one != before]
    assert counts[0] == 2
    assert changes == [1, 2]
    # The resultant does not jump by a finger's force when two fingers become one. At this distance, two are known to
    # 0.1 N.
    assert np.abs(np.array(forces) - 1.6).max() < 0.3


def test_released_finger_goes_within_a_few_frames(built: World) -> None:
    counter = built.counter()
    follow(built, counter, [LEFT], 3)
    assert follow(built, counter, [], RELEASE_FRAMES)[1] == ()


def test_forgotten_clock_restarts(built: World) -> None:
    counter = built.counter()
    _, before = follow(built, counter, [LEFT])
    counter.forget()
    assert follow(built, counter, [])[1] == ()
    assert follow(built, counter, [LEFT])[1] != before


def test_second_finger_is_searched_beside_one_without_force(drawn: World) -> None:
    """If the search ends at zero force, its place means nothing, and no matrix may be singular."""
    fitter, measured = drawn.fitter, drawn.measured(drawn.pressed([RIGHT]))
    weightless = np.zeros((1, 3))
    starts = fitter.best_seconds(fitter.whitener(weightless, measured, NOTHING), weightless, measured)
    assert starts
    assert np.abs(starts[0][1, :2] - [7.0, 2.0]).max() <= 2.0


def test_two_reported_fingers_are_apart_and_strong_enough() -> None:
    assert are_two(np.array([[0.0, 0.0, 1.0], [8.1, 0.0, 0.1]]))
    assert not are_two(np.array([[0.0, 0.0, 1.0], [7.9, 0.0, 1.0]]))
    assert not are_two(np.array([[0.0, 0.0, 1.0], [9.0, 0.0, 0.05]]))


def test_resultant_is_the_place_of_an_equal_single_press() -> None:
    assert resultant(np.array([[-6.0, 0.0, 1.0], [6.0, 4.0, 3.0]])).tolist() == [3.0, 3.0, 4.0]
    assert resultant(np.zeros((0, 3))).tolist() == [0.0, 0.0, 0.0]
