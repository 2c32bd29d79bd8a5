"""Compares the traces of a page with the messages that were sent to it: every point of every line."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

from playwright.sync_api import Page

from fmfts.bus.messages import ContactMessage
from page.known_touches import KnownTouches

Points = dict[float, float | None]
READ = """() => Object.fromEntries(fmfts.traces.plots.map(({ trace, plot }) => [
    trace.title,
    trace.lines.map(([name], i) => [name, [...plot.data[0]].map((t, at) => [t, plot.data[i + 1][at] ?? null])]),
]))"""
DATE_S = 1e-6  # a date in ms on the clock of a computer that runs for a year is a double to better than this
GHOST_S = 0.1
SMALL = 1e-9


def _force(one: ContactMessage) -> float | None:
    return 0.0 if one.contact is False else one.force_min_n if one.over_range else one.force_n


def _edge(sign: float) -> Callable[[ContactMessage], float | None]:
    def edge(one: ContactMessage) -> float | None:
        if not one.contact or one.force_n is None or one.force_sd_n is None:
            return None
        return max(one.force_n + sign * 2.0 * one.force_sd_n, 0.0)

    return edge


def _mm(value: float | None) -> float | None:
    return None if value is None else value * 1e3


LINES: dict[str, dict[str, Callable[[ContactMessage], float | None]]] = {
    "Force": {
        "upper edge": _edge(1.0),
        "lower edge": _edge(-1.0),
        "force": _force,
        "over range: at least": lambda one: one.force_min_n if one.over_range else None,
    },
    "Place": {
        "x": lambda one: _mm(one.x_m if one.contact else None),
        "y": lambda one: _mm(one.y_m if one.contact else None),
        "x of another finger": lambda one: None,
        "y of another finger": lambda one: None,
    },
    "Residual": {"χ²": lambda one: None if one.pose is None else one.pose.chi2},
}


class Drawn(NamedTuple):
    """wrong: points with another value than the message of their time, in words. points: how many were compared.

    times: of the line of forces, in s.
    """

    wrong: list[str]
    points: int
    times: list[float]


def drawn(page: Page, bus: KnownTouches) -> Drawn:
    """Read all traces of `page`, and compare each point with the messages of `bus`."""
    read = page.evaluate(READ)
    sent, ghosts = dict(bus.sent), dict(bus.ghosts)  # everything that is drawn, and later messages
    traces: dict[str, dict[str, Points]] = {
        title: {name: dict(points) for name, points in lines} for title, lines in read.items()
    }
    wrong, points = [], 0
    for title, lines in LINES.items():
        for name, value in lines.items():
            points += len(traces[title][name])
            wrong += [f"{title}, {name}: {text}" for text in _wrong(traces[title][name], sent, value)]
    wrong += [f"Age when drawn: {text}" for text in _wrong_ages(traces["Age when drawn"]["age"], sent)]
    wrong += [f"Force, ghost: {text}" for text in _wrong_ghosts(traces["Force"]["ghost"], ghosts)]
    times = [t for t, force in traces["Force"]["force"].items() if t in sent or force is not None]
    return Drawn(wrong, points, times)


def _wrong(
    points: Points, sent: dict[float, ContactMessage], value: Callable[[ContactMessage], float | None]
) -> Iterator[str]:
    for t, shown in points.items():
        right = value(sent[t]) if t in sent else None  # a gap has a time of its own, and no value
        if not _same(shown, right):
            yield f"{shown} at {t:.4f} s, where {right} was sent"


def _wrong_ages(points: Points, sent: dict[float, ContactMessage]) -> Iterator[str]:
    sampled = {round(one.t_sample_ns * 1e-9 / DATE_S) for one in sent.values()}
    for t, age_ms in points.items():
        if age_ms is not None:
            of = round((t - age_ms * 1e-3) / DATE_S)
            if not sampled & {of - 1, of, of + 1}:
                yield f"{age_ms} ms at {t:.4f} s is the age of no sample that was sent"


def _wrong_ghosts(points: Points, ghosts: dict[float, float]) -> Iterator[str]:
    times = sorted(ghosts)
    for t, shown in points.items():
        if shown is not None and not any(_same(shown, ghosts[at]) for at in times if t - GHOST_S <= at <= t):
            yield f"{shown} at {t:.4f} s is what no fixed baseline said in the {GHOST_S} s before"


def _same(one: float | None, other: float | None) -> bool:
    return one is other if one is None or other is None else abs(one - other) <= SMALL
