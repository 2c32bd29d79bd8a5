"""The rows of tables on result pages: each from what several seeds gave, as `kept_figures` reads it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from math import inf
from statistics import stdev
from typing import Any

from fmfts_lab.bench.truth import PUBLISHED

Facts = dict[str, Any]
Rows = Sequence[Sequence[Facts]]  # for each row of the table, the result of each seed


def part(seeds: Sequence[dict[str, Any]], key: str, whole: str) -> str:
    """Of all seeds."""
    return f"{sum(one[key] for one in seeds):.0f} of {sum(one[whole] for one in seeds):.0f}"


def spread(values: Iterable[float | None], form: str) -> str:
    """The lowest and the highest, once where both read the same; "–" where a seed has none."""
    found = list(values)
    if any(value is None for value in found):
        return "–"
    told = [format(value, form) for value in (min(found), max(found))]  # type: ignore[type-var]
    return told[0] if told[0] == told[1] else f"{told[0].removesuffix('%')} to {told[1].replace('%', ' %')}"


def markdown(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [columns, ["---"] * len(columns), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def mean(seeds: Sequence[Facts], key: str) -> str:
    """In percent."""
    return f"{100.0 * sum(one[key] for one in seeds) / len(seeds):.1f}"


def percent(values: Iterable[float | None], form: str = ".1%") -> str:
    return re.sub(r" *%", " %", spread(values, form))


def answers(seeds: Sequence[Facts]) -> tuple[str, ...]:
    """Of a row: wrong frames, worst error, coverage and mean errors. The worst is infinite, which JSON writes as null,
    where a lower bound of a force is above the force."""
    return (
        part(seeds, "wrong", "frames"),
        spread((inf if one["worst_sd"] is None else one["worst_sd"] for one in seeds), ".1f"),
        percent(one["within_2_sd"] for one in seeds),
        spread((1e3 * one["place_error_m"] if one["place_error_m"] is not None else None for one in seeds), ".2f"),
        spread((one["force_error_n"] for one in seeds), ".3f"),
    )


ANSWERS = ("wrong", "worst, sd", "within 2 sd", "mm", "N")


def as_built(rows: Rows) -> str:
    """Of pads that are drawn from the tolerances that their deviations count."""
    lines = []
    for seeds in rows:
        first = seeds[0]
        pads = [share for one in seeds for share in one["pads_within_2_sd"]]
        lines.append(
            (
                f"±{100.0 * first['gain']:g} %",
                "turning" if first["turning"] else "still",
                first["kind"],
                *answers(seeds),
                # Each pad has one modulus, one thickness and one finger: pads, not frames, are independent.
                f"{mean(seeds, 'within_2_sd')} ± {100.0 * stdev(pads) / len(pads) ** 0.5:.1f} %",
                f"{mean(seeds, 'place_within_2_sd')}, {mean(seeds, 'force_within_2_sd')} %",
                part(seeds, "missed", "presses"),
                str(sum(sum(one["refused"].values()) for one in seeds)),
            )
        )
    columns = ("gains", "robot", "baseline", *ANSWERS, "mean", "places, forces", "missed", "refused")
    return markdown(columns, lines)


LIGHT_N = ((0.02, 0.05), (0.05, 0.1), (0.1, 0.2), (0.2, 1.0))


def noticed(one: Facts, low_n: float, high_n: float) -> float:
    """The share of frames of such a touch that report contact; the lowest of the ranges between both forces."""
    return float(min(share for low, high, share in one["noticed_shares"] if low_n <= low and high <= high_n))


def shipped(rows: Rows) -> str:
    """Of pads that have less than their deviations count, and how light a touch they notice."""
    lines = []
    for seeds in rows:
        first = seeds[0]
        lines.append(
            (
                f"±{100.0 * first['gain']:g} %",
                "turning" if first["turning"] else "still",
                first["kind"],
                *answers(seeds),
                *(percent((noticed(one, *range_n) for one in seeds), ".0%") for range_n in LIGHT_N),
                part(seeds, "false_contact_frames", "rest_frames"),
            )
        )
    touches = (f"{low:g} to {high:g} N" for low, high in LIGHT_N)
    return markdown(("gains", "robot", "baseline", *ANSWERS, *touches, "false contacts"), lines)


def imperfect(rows: Rows) -> str:
    """Of pads with one effect each that no tolerance names."""
    lines = []
    for seeds in rows:
        told = [one for one in seeds if one["frames"]]  # the others had no pad that was not refused
        published = (sum(one["health"].get(name, 0) for name in PUBLISHED) / one["frames"] for one in told)
        lines.append(
            (
                seeds[0]["effect"],
                seeds[0]["ambient"],
                f"{sum(sum(one['refused'].values()) for one in seeds)} of {sum(one['pads'] for one in seeds)}",
                *((percent(published, ".2%"), *answers(told)) if told else ["–"] * (1 + len(ANSWERS))),
                f"{max(one['longest_false_s'] for one in seeds):.2f} s",
            )
        )
    return markdown(("effect", "scene", "refused", "published", *ANSWERS, "longest false contact"), lines)


def tilted(rows: Rows) -> str:
    """Of pads of which all but the tilt is known."""
    lines = []
    for seeds in rows:
        first = seeds[0]
        lines.append(
            (
                f"{first['friction']:g}",
                f"{first['tilt_deg']:g}°",
                part(seeds, "wrong", "frames"),
                spread((one["worst_sd"] for one in seeds), ".1f"),
                spread((one["place_within_2_sd"] for one in seeds), ".1%"),
                spread((one["force_within_2_sd"] for one in seeds), ".1%"),
                spread((one["along_tilt_mm"] for one in seeds), "+.2f"),
                f"{sum(one['along_tilt_mm'] for one in seeds) / len(seeds):+.2f}",
                str(sum(one["refused"] for one in seeds)),
            )
        )
    columns = (
        "friction",
        "tilt",
        "wrong",
        "worst, sd",
        "places within 2 sd",
        "forces",
        "off along the tilt, mm",
        "mean",
        "refused",
    )
    return markdown(columns, lines)


def structured(rows: Rows) -> str:
    """Of pads of other silicone, thickness and tilt, under other fingers, of which the daemon knows nothing."""
    lines = []
    for seeds in rows:
        first = seeds[0]
        lines.append(
            (
                f"{first['friction']:g}",
                first["cell"],
                part(seeds, "wrong", "frames"),
                f"{max(one['worst_sd'] for one in seeds):.1f}",
                spread((one["place_within_2_sd"] for one in seeds), ".1%"),
                spread((one["force_within_2_sd"] for one in seeds), ".1%"),
                spread((100.0 * one["force_off"] for one in seeds), "+.0f").replace("-", "−"),
                spread((100.0 * one["force_sd"] for one in seeds), ".0f"),
            )
        )
    columns = (
        "friction",
        "pad, finger",
        "wrong",
        "worst, sd",
        "places within 2 sd",
        "forces",
        "force off, %",
        "±, %",
    )
    return markdown(columns, lines)


def warming(rows: Rows) -> str:
    """Of pads whose offsets drift further than the chip's figure says."""
    lines = []
    for seeds in rows:
        first = seeds[0]
        lines.append(
            (
                f"{1e9 * first['t_per_k']:.0f} nT/K",
                first["ambient"],
                spread((one["least_published"] for one in seeds), ".2%").replace("%", " %").replace("  ", " "),
                part(seeds, "wrong", "frames"),
                spread((one["worst_sd"] for one in seeds), ".1f"),
                spread((one["false_onsets"] for one in seeds), "d"),
                part(seeds, "false_frames", "rest_frames"),
            )
        )
    columns = ("drift", "scene", "published by the worst pad", "wrong", "worst, sd", "false onsets", "in frames")
    return markdown(columns, lines)


def warm_presses(rows: Rows) -> str:
    """Of light presses on such pads: a row for each place, force and warming, a column for each rate."""
    places: dict[tuple[float, float, str], list[Sequence[Facts]]] = {}
    for seeds in rows:
        first = seeds[0]
        places.setdefault((first["kelvin"], first["force_n"], first["spot"]), []).append(seeds)
    lines = []
    for (kelvin, force_n, spot), rates in places.items():
        begun = [str(sum(one["begun"] + one["brief"] for one in seeds)) for seeds in rates]
        published = [part(seeds, "published", "presses") for seeds in rates]
        late = max(one["late_frames"] for seeds in rates for one in seeds)
        lines.append((f"{kelvin:.0f} K", f"{force_n:g} N", spot, ", ".join(begun), ", ".join(published), str(late)))
    columns = ("warmer by", "force", "place", "begun, at 0.05, 0.3 and 3 N/s", "published", "latest, in frames")
    return markdown(columns, lines)


def learned(rows: Rows) -> str:
    """Of boards that nobody measured, beside the same with known places and rotations: without presses, the first row,
    and with them, the second."""
    lines = []
    for seeds in rows:
        over = (
            spread((one[key] / known[key] for one, known in zip(seeds, beside, strict=True)), ".2f")
            for beside in rows[:2]
            for key in ("place_error_m", "force_error_n")
        )
        refused = sum(sum(one["refused"].values()) for one in seeds)
        lines.append((seeds[0]["kind"], *answers(seeds), *over, f"{refused} of {sum(one['pads'] for one in seeds)}"))
    over_known = ("mm over known", "N over known", "mm over refine", "N over refine")
    return markdown(("baseline", *ANSWERS, *over_known, "refused"), lines)
