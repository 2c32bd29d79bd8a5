"""Random mistakes of boards, and whether the check with one magnet names them; for the drill and for the tests.

A mistake counts as named if the check is sure, its explanation has every channel's place, axes and scale as built, and
its sentences contain the words that are written here again. If it says that a known pole or a nearer magnet decides,
the person repeats it that way, once.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from magnet_world import GAINS, Built, Person, RefusedStepError, good_board, measured, person

from fmfts_magnet import Board, Readings, TooLittleError, Verdict, instructed_hand, judged, sentences

KINDS = tuple(GAINS)
COUNTS = (4, 4, 4, 4, 5, 8)
QUARTER = {"z": np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
           "x": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
           "y": np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])}  # fmt: skip
DRAWN_QUARTERS = (0, 3, 2, 1, 0)  # chips of a ReSkin board lie in all four directions


@dataclass(frozen=True)
class Mistake:
    """kind: for the table. words: patterns of which each must be found in the sentences, which are as many."""

    kind: str
    built: Built
    words: tuple[str, ...]
    largest_factor: float = 1.0
    turned_pad: np.ndarray | None = None


def _turned(built: Built, channel: int, rotation: np.ndarray) -> Built:
    turned = built.turned.copy()
    turned[channel] = rotation
    return replace(built, turned=turned)


def swapped(built: Built, random: np.random.Generator) -> Mistake:
    one, other = sorted(random.choice(len(built.place_m), 2, replace=False).tolist())
    wired = built.wired.copy()
    wired[[one, other]] = other, one
    words = rf"^Sensors {one + 1} and {other + 1} are swapped"
    return Mistake("two channels swapped", replace(built, wired=wired), (words,))


def cycled(built: Built, random: np.random.Generator) -> Mistake:
    length = int(random.integers(3, min(len(built.place_m), 5) + 1))
    ring = random.choice(len(built.place_m), length, replace=False)
    wired = built.wired.copy()
    wired[ring] = np.roll(ring, 1)
    pairs = [rf"sensor {one + 1} is at the place of {int(wired[one]) + 1}\b" for one in ring.tolist()]
    words = "".join(f"(?=.*{pair})" for pair in pairs)
    return Mistake("three or more channels in a cycle", replace(built, wired=wired), (words,))


def quarter(built: Built, random: np.random.Generator) -> Mistake:
    channel, quarters = int(random.integers(len(built.place_m))), int(random.integers(1, 4))
    rotation = np.linalg.matrix_power(QUARTER["z"], quarters)
    words = rf"^Sensor {channel + 1} is turned by {90 * quarters}° about its z\."
    return Mistake("a chip turned by quarters about z", _turned(built, channel, rotation), (words,))


def upside_down(built: Built, random: np.random.Generator) -> Mistake:
    channel, axis = int(random.integers(len(built.place_m))), str(random.choice(["x", "y"]))
    rotation = QUARTER[axis] @ QUARTER[axis]
    words = rf"^Sensor {channel + 1} is turned by 180° about its {axis} \(mounted upside down\)\."
    return Mistake("a chip upside down", _turned(built, channel, rotation), (words,))


def any_turn(built: Built, random: np.random.Generator) -> Mistake:
    """About a horizontal axis by a quarter turn, or about a diagonal."""
    channel = int(random.integers(len(built.place_m)))
    axis, quarters, after = str(random.choice(["x", "y"])), int(random.choice([1, 3])), int(random.integers(4))
    rotation = np.linalg.matrix_power(QUARTER["z"], after) @ np.linalg.matrix_power(QUARTER[axis], quarters)
    angle = round(np.degrees(np.arccos((np.trace(rotation) - 1.0) / 2.0)))
    words = rf"^Sensor {channel + 1} is turned by {'(90|270)' if angle == 90 else angle}°"
    return Mistake("a chip turned about another axis", _turned(built, channel, rotation), (words,))


def two_quarters(built: Built, random: np.random.Generator) -> Mistake:
    words = []
    for channel in sorted(random.choice(len(built.place_m), 2, replace=False).tolist()):
        quarters = int(random.integers(1, 4))
        built = _turned(built, channel, np.linalg.matrix_power(QUARTER["z"], quarters))
        words.append(rf"^Sensor {channel + 1} is turned by {90 * quarters}° about its z\.")
    return Mistake("two chips turned by quarters", built, tuple(words))


def all_quarters(built: Built, random: np.random.Generator) -> Mistake:
    quarters = int(random.integers(1, 4))
    for channel in range(len(built.place_m)):
        built = _turned(built, channel, np.linalg.matrix_power(QUARTER["z"], quarters))
    return Mistake(
        "all chips turned by quarters", built, (rf"^All chips are turned by {90 * quarters}° about their z\.",)
    )


def turned_pad(built: Built, random: np.random.Generator) -> Mistake:
    """The board lies turned under the person, who moves the magnet along the axes of the drawing."""
    quarters = int(random.integers(1, 4))
    matrix = np.linalg.matrix_power(QUARTER["z"], quarters)
    words = rf"^The whole board is turned by {90 * quarters}° \(counterclockwise"
    return Mistake("the whole board turned", built, (words,), turned_pad=matrix)


def mirrored_pad(built: Built, random: np.random.Generator) -> Mistake:
    factor = built.factor * np.array([1.0, 1.0, -1.0])
    return Mistake("all chips' z mirrored", replace(built, factor=factor), ("^All chips read z with the wrong sign",))


def mirrored_chip(built: Built, random: np.random.Generator) -> Mistake:
    channel, axis = int(random.integers(len(built.place_m))), int(random.integers(3))
    factor = built.factor.copy()
    factor[channel, axis] *= -1.0
    words = rf"^Sensor {channel + 1} is mirrored: it has the wrong sign of {'xyz'[axis]}\."
    return Mistake("one axis' sign of a chip", replace(built, factor=factor), (words,))


def exchanged_axes(built: Built, random: np.random.Generator) -> Mistake:
    channel = int(random.integers(len(built.place_m)))
    one, other = sorted(random.choice(3, 2, replace=False).tolist())
    order = list(range(3))
    order[one], order[other] = other, one
    words = rf"^Sensor {channel + 1} is mirrored: its {'xyz'[one]} and {'xyz'[other]} are exchanged\."
    return Mistake("two axes of a chip exchanged", _turned(built, channel, np.eye(3)[order]), (words,))


def scaled(built: Built, random: np.random.Generator) -> Mistake:
    channel, value = int(random.integers(len(built.place_m))), float(random.choice([0.5, 2.0]))
    factor = built.factor.copy()
    factor[channel] *= value
    words = rf"^Sensor {channel + 1} reads {'half' if value < 1.0 else 'twice'} the field"
    return Mistake("factor 2 or 0.5 of a chip", replace(built, factor=factor), (words,), max(value, 1.0))


def two_scaled(built: Built, random: np.random.Generator) -> Mistake:
    words, factor = [], built.factor.copy()
    for channel in sorted(random.choice(len(built.place_m), 2, replace=False).tolist()):
        value = float(random.choice([0.5, 2.0]))
        factor[channel] *= value
        words.append(rf"^Sensor {channel + 1} reads {'half' if value < 1.0 else 'twice'} the field")
    # Two of four chips reading twice as much look like the others reading half, since the magnet's moment is unknown.
    return Mistake("factor 2 or 0.5 of two chips", replace(built, factor=factor), tuple(words), 2.0)


MISTAKES: tuple[Callable[[Built, np.random.Generator], Mistake], ...] = (
    swapped, cycled, quarter, upside_down, any_turn, two_quarters, all_quarters, turned_pad, mirrored_pad,
    mirrored_chip, exchanged_axes, scaled, scaled,
)  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """verdict: named, open (it reported that it cannot decide), wrong name, or false accusation; good for a good
    board."""

    kind: str
    verdict: str
    said: str
    repeated: bool


def board_of(count: int) -> Built:
    axes = np.array([np.linalg.matrix_power(QUARTER["z"], each) for each in DRAWN_QUARTERS]) if count == 5 else None
    return good_board(count, axes)


def obeyed(built: Built, chip: str, someone: Person, random: np.random.Generator) -> Readings:
    """The readings of a person who follows the hints."""
    for _ in range(4):
        try:
            return measured(built, chip, someone, random)
        except RefusedStepError as refused:
            factors = {"too weak": 1.6, "too strong": 0.7, "move the magnet": 1.0}
            factor = next((value for hint, value in factors.items() if hint in str(refused)), None)
            if factor is None:
                raise
            someone.remanence_t *= factor
    raise TooLittleError("the person found no height that suits all steps")


def tried(
    seed: tuple[int, ...], make: Callable[[Built, np.random.Generator], Mistake] | None, clumsy: float = 1.0
) -> Outcome:
    """One board, with or without a mistake, and one person with one magnet. clumsy: factor of the usual errors."""
    random = np.random.default_rng(seed)
    chip, count = str(random.choice(KINDS)), int(random.choice(COUNTS))
    drawn = board_of(count)
    mistake = Mistake("none", drawn, ()) if make is None else make(drawn, random)
    someone = person(chip, random, mistake.largest_factor)
    someone.jitter_m, someone.tilt_rad = someone.jitter_m * clumsy, someone.tilt_rad * clumsy
    built = mistake.built
    if mistake.turned_pad is not None:
        built = replace(
            built, place_m=built.place_m @ mistake.turned_pad.T, drawn_axes=mistake.turned_pad @ built.drawn_axes
        )
    board = Board(drawn.place_m, drawn.drawn_axes, 3e-4, float(np.radians(1.5)), 0.05)
    verdict, repeated = None, False
    for attempt in range(2):
        try:
            verdict = judged(
                board, obeyed(built, chip, someone, random), instructed_hand(someone.pole if attempt else 0)
            )
        except TooLittleError as error:
            return Outcome(mistake.kind, "open", str(error), repeated)
        if verdict.is_decided:
            break
        said = " ".join(sentences(verdict))
        if "nearer" in said or "lower than" in said:
            someone.height_m *= 0.75
            someone.remanence_t *= 0.5  # a weaker magnet, so that no chip saturates
        repeated = attempt == 0
    assert verdict is not None
    return Outcome(mistake.kind, _judged(mistake, verdict), " ".join(sentences(verdict)), repeated)


def _judged(mistake: Mistake, verdict: Verdict) -> str:
    if not mistake.words:
        return "good" if verdict.is_as_drawn else "false accusation" if verdict.is_decided and verdict.found else "open"
    if not verdict.is_decided:
        return "open"
    said = sentences(verdict)
    is_named = len(said) == len(mistake.words) and all(
        any(re.search(pattern, sentence) for sentence in said) for pattern in mistake.words
    )
    return "named" if is_named and _is_as_built(mistake, verdict) else "wrong name"


def _is_as_built(mistake: Mistake, verdict: Verdict) -> bool:
    """Whether the explanation maps any field to the channels like the board as built."""
    built, one = mistake.built, verdict.found[0].explanation
    matrix = np.eye(3) if mistake.turned_pad is None else mistake.turned_pad
    axes = np.einsum("ij,cjk,ckl->cil", matrix, built.drawn_axes[built.wired], built.turned)
    real = built.factor[:, :, None] * axes.transpose(0, 2, 1)
    places = built.place_m[built.wired] @ matrix.T
    found = one.scale[0][:, None, None] * (one.turn[0] @ verdict.board.axes[one.place[0]].transpose(0, 2, 1))
    return bool(np.allclose(found, real) and np.allclose(verdict.board.place_m[one.place[0]], places))
