"""The judge of the hand's demo: what is wrong, what is a contact without a touch, and who is better."""

from __future__ import annotations

from typing import Any

import pytest

from end_to_end.hand_score import GHOST, TITLES, TURNED, UNTURNED, Score, Verdict, is_better, table

MOVES = 30


def score_of(forces_n: list[float]) -> Score:
    """The score of one pad that moves every thirtieth of a second from 0 s on."""
    score = Score(["thumb"], MOVES)
    for number, force_n in enumerate(forces_n):
        score.moved(number / MOVES, [force_n])
    return score


def contact(
    force_n: float | None, sd_n: float | None = 0.05, contact: bool | None = True, **others: Any
) -> dict[str, Any]:
    """Sampled half a second after the first move."""
    return {
        "t_sample_ns": 500_000_000,
        "health": "ok",
        "over_range": False,
        "force_n": force_n,
        "force_sd_n": sd_n,
        "contact": contact,
        **others,
    }


def test_force_beyond_five_deviations_is_wrong() -> None:
    score = score_of([1.0] * MOVES)
    for off_n in (0.24, -0.24, 0.26):
        score.take(TURNED, "thumb", contact(1.0 + off_n))
    verdict = score.ways[TURNED]
    assert (verdict.ok, verdict.wrong, verdict.false_contacts) == (3, 1, 0)
    assert verdict.worst_n == pytest.approx(0.26)


@pytest.mark.parametrize("health", ["ok", "degraded"])
def test_contact_without_a_touch_counts_in_any_health(health: str) -> None:
    score = score_of([0.0] * MOVES)
    score.take(TURNED, "thumb", contact(0.01, health=health))
    score.take(TURNED, "thumb", contact(0.0, contact=False))
    assert (score.ways[TURNED].false_contacts, score.ways[TURNED].untouched) == (1, 2)
    assert len(score.doubtful) == 1


def test_unknown_values_do_not_count_as_wrong() -> None:
    score = score_of([1.0] * MOVES)
    for body in (
        contact(None, None, None, health="disturbed"),
        contact(5.0, health="degraded"),
        contact(2.0, over_range=True),
    ):
        score.take(TURNED, "thumb", body)
    assert (score.ways[TURNED].unknown, score.ways[TURNED].ok, score.ways[TURNED].wrong) == (3, 0, 0)


def test_fixed_baseline_has_a_contact_above_a_usual_limit() -> None:
    score = score_of([0.0] * MOVES)
    for force_n in (0.19, 0.21):
        score.take(GHOST, "thumb", {"t_sample_ns": 500_000_000, "force_n": force_n, "force_sd_n": 0.02})
    assert (score.ways[GHOST].false_contacts, score.ways[GHOST].wrong) == (1, 2)


def test_moments_of_changing_force_are_not_judged() -> None:
    score = score_of([0.05 * number for number in range(MOVES)])
    score.take(TURNED, "thumb", contact(9.0))
    assert score.ways[TURNED] == Verdict()


@pytest.mark.parametrize(
    ("turned", "better"),
    [
        (Verdict(ok=9, worst_n=0.1), True),
        (Verdict(ok=9, worst_n=0.4), False),
        (Verdict(ok=9, worst_n=0.1, wrong=1), False),
        (Verdict(ok=9, worst_n=0.1, false_contacts=1), False),
        (Verdict(), False),
    ],
)
def test_last_line_names_the_better_method(turned: Verdict, better: bool) -> None:
    ways = {GHOST: Verdict(ok=9, worst_n=0.3), UNTURNED: Verdict(ok=9), TURNED: turned}
    assert is_better(ways) is better
    *rows, last = table(ways)
    assert last.startswith("better than a fixed baseline" if better else "NOT BETTER than a fixed baseline")
    assert all(any(row.startswith(title) for row in rows) for title in TITLES.values())


def test_methods_are_shown_side_by_side_if_they_differ() -> None:
    score = score_of([0.0] * MOVES)
    score.take(TURNED, "thumb", contact(0.0, contact=False))
    assert score.beside() == ""
    score.take(GHOST, "thumb", {"t_sample_ns": 500_000_000, "force_n": 1.25, "force_sd_n": 0.02})
    assert score.beside().startswith("thumb, true 0.00 N. fmfts-daemon, turned: 0.00 ± 0.05 N; ")
    assert score.beside().endswith("a fixed baseline: 1.25 ± 0.02 N, contact")
