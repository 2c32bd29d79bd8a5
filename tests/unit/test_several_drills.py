"""Two of the drills of `bench several --drills`: the faults of a pad with one magnet on one with four."""

from __future__ import annotations

from fmfts_lab.bench.several_drills import Counted
from fmfts_lab.bench.several_faults import drills


def drilled(kind: str, number: int = 0, seed: int = 1) -> Counted:
    (*_, drill) = [drill for drill in drills() if drill.kind == kind][: number + 1]
    counted = Counted()
    counted.drill(drill, "two", seed)
    return counted


def test_wrong_axis_is_named_and_two_fingers_stay_published() -> None:
    counted = drilled("offset 100 mG", 1)
    (seen_ms,), (back_ms,) = counted.seen_ms, counted.back_ms
    assert seen_ms < 10.0  # the second frame: chips run free
    assert counted.named == counted.frames - counted.good > 200
    assert (counted.blamed, counted.wrong, counted.wrong_degraded, counted.silent) == (0, 0, 0, 0)
    assert back_ms < 100.0  # AGREES_FRAMES, and the alignment's one


def test_jump_between_samples_publishes_no_ok_finger() -> None:
    """Two fingers explain samples of which some are from before a magnet lost half its moment, and some from after."""
    counted = drilled("one of four magnets at half", seed=2)
    assert counted.wrong_degraded > 0
    assert counted.wrong == 0
