"""`study stability`: where methods give a wrong answer without a flag, and where they give false alarms."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from fmfts.baseline import BaselineError
from fmfts.bus.messages import ContactMessage
from fmfts.config import SceneConfig
from fmfts.contact import ContactModel, ModelError
from fmfts.pad import Array
from fmfts.pipeline.encoded import message_of
from fmfts_lab.bench.truth import PUBLISHED, WRONG_DEVIATIONS
from fmfts_lab.study import heat_map
from fmfts_lab.study.dimensions import HAZARDS
from fmfts_lab.study.harness import Facts, Request, Row, Study
from fmfts_lab.study.hazards import Cell
from fmfts_lab.study.kernels import daemon
from fmfts_lab.study.method import NOTHING, Answer, Maker
from fmfts_lab.study.pose_methods import DEFAULT, pose_methods
from fmfts_lab.study.world import Sample, World, in_scene

COLUMNS = (
    *("dimension", "condition", "second", "healthy", "method", "frames", "right", "wrong", "flagged"),
    *("worst_deviations", "worst_mm"),
)
SECONDS, QUICK_SECONDS = 1.3, 0.8
WRONG_M = 0.5e-3
DAEMON = "the daemon, whole"
COMPARED = (
    *(DEFAULT, "tracker (gates, faults)", "kernel, 5 unknowns", "kernel, 6 unknowns"),
    *("kernel, 6, from rest (the paper)", "kernel, 8 unknowns", "kernel, 8, χ² gate", "kernel, 9 unknowns"),
    *("leastsq, Jacobian", "extended Kalman", "unscented Kalman", "DIRECT: table + one step, 8", "look-up table"),
    *("4 nearest neighbours", "network from field (20)"),
)
QUICK_COMPARED = (DEFAULT, "kernel, 6 unknowns", "kernel, 8 unknowns", "extended Kalman", "look-up table")


class Daemon:
    """The daemon's whole pipeline as a method. Its contact is judged together with its pose."""

    def __init__(self, world: World) -> None:
        self._pipeline = daemon(world)

    def ask(self, sample: Sample) -> ContactMessage:
        answer = self._pipeline.answer(sample.frame)
        return message_of(answer)

    def told(self, raw: ContactMessage) -> Answer:
        if raw.health not in PUBLISHED or raw.pose is None:
            return NOTHING
        pose = raw.pose
        return Answer(np.array(pose.position_m), np.array(pose.axis), np.array(pose.position_sd_m), False)


def run(request: Request) -> Facts:
    study = Study("stability", request, COLUMNS)
    model = ContactModel.load(request.pad.contact.model, request.pad.pad()).hash
    points: dict[str, Callable[[], list[Row]]] = {}
    for cell in _cells(request):
        # Only the daemon's answers depend on the contact model.
        points[f"{cell.name}, contact model {model}"] = partial(_judge, request, cell, {DAEMON: Daemon})
        points[cell.name] = partial(_judge, request, cell, _others(request))
    with threadpool_limits(1):
        rows = study.measure(points)
    for suffix, figure in heat_map.figures(rows, DAEMON):
        study.draw(figure, suffix)
    return study.conclude(conclusions(rows))


def printed(facts: Facts) -> str:
    lines = ["method                                wrong in cells   frames wrong  flagged  false alarms  available"]
    lines += [
        f"{name:38} {count['cells_wrong']:5d} of {count['cells']:3d} {count['wrong']:10d} {count['flagged']:9d} "
        f"{count['false_alarms']:9d} {count['available_when_healthy']:13.3%}"
        for name, count in facts["methods"].items()
    ]
    lines += ["", *(f"{name}: {one['why']} {one['avoided']}" for name, one in facts["dimensions"].items())]
    return "\n".join(lines)


def conclusions(rows: Sequence[Row]) -> Facts:
    """The counts of every method, the cells in which it was wrong without a flag, and the reason."""
    methods: Facts = {}
    for name in dict.fromkeys(str(row["method"]) for row in rows):
        own = [row for row in rows if row["method"] == name]
        healthy = [row for row in own if row["healthy"]]
        frames = _sum(healthy, "frames")
        methods[name] = {
            "cells": len(own),
            "cells_wrong": sum(1 for row in own if row["wrong"]),
            "frames": _sum(own, "frames"),
            "wrong": _sum(own, "wrong"),
            "flagged": _sum(own, "flagged"),
            "false_alarms": _sum(healthy, "flagged"),
            "wrong_when_healthy": _sum(healthy, "wrong"),
            "available_when_healthy": 1.0 - _sum(healthy, "flagged") / frames if frames else None,
            "wrong_in": [
                f"{row['point']}: {row['wrong']}" if "point" in row else _place(row) for row in own if row["wrong"]
            ],
        }
    told = {hazard.dimension: {"why": hazard.why, "avoided": hazard.avoided} for hazard in HAZARDS}
    return {"methods": methods, "dimensions": told}


def _place(row: Row) -> str:
    where = " ".join(str(row[name]) for name in ("dimension", "condition", "second") if row[name])
    return f"{where}: {row['wrong']} of {row['frames']}"


def _sum(rows: Sequence[Row], name: str) -> int:
    return sum(int(row[name] or 0) for row in rows)


def _cells(request: Request) -> Iterator[Cell]:
    config = in_scene(request.pad, SceneConfig())
    seconds = QUICK_SECONDS if request.quick else SECONDS
    for number, hazard in enumerate(HAZARDS):
        random = np.random.default_rng([request.seed, number])
        cells = list(hazard.cells(config, random, seconds))
        yield from cells[:: max(len(cells) // 3, 1)] if request.quick else cells


def _others(request: Request) -> dict[str, Maker]:
    wanted = QUICK_COMPARED if request.quick else COMPARED
    return {entry.name: entry.make for entry in pose_methods() if entry.name in wanted}


def _judge(request: Request, cell: Cell, makers: Mapping[str, Maker]) -> list[Row]:
    """Judge all methods on the same samples of one cell."""
    random = np.random.default_rng([request.seed, *cell.name.encode()])
    samples = cell.world.samples(cell.path, random)
    return [_row(cell, name, _outcome(cell, make, samples)) for name, make in makers.items()]


def _outcome(cell: Cell, make: Maker, samples: Sequence[Sample]) -> Array:
    """(K, 2) error in published deviations (NaN without deviations) and in m; both NaN if flagged."""
    errors = np.full((len(samples), 2), np.nan)
    try:
        method = make(cell.world)
    except (BaselineError, ModelError):
        return errors  # the method refused this pad before the first frame
    for number, sample in enumerate(samples):
        raw = method.ask(sample)
        answer = method.told(raw)
        if answer.flagged:
            continue
        error = answer.position_m - cell.path.position_m[number]
        errors[number, 1] = np.sqrt(error @ error)
        if answer.deviation_m is not None:
            errors[number, 0] = np.max(np.abs(error) / answer.deviation_m)
        if isinstance(raw, ContactMessage):
            errors[number, 0] = max(errors[number, 0], _contact_deviations(raw, cell.path.press[number]))
    return errors


def _contact_deviations(message: ContactMessage, press: Array) -> float:
    """The largest error of place and force in published deviations; zero if there is no press to compare with."""
    if np.isnan(press).any():
        return 0.0
    if message.force_min_n is not None and message.force_min_n > press[2]:
        return float("inf")
    said: list[tuple[Any, Any, float]] = [
        (message.x_m, message.x_sd_m, press[0] * 1e-3),
        (message.y_m, message.y_sd_m, press[1] * 1e-3),
        (message.force_n, message.force_sd_n, press[2]),
    ]
    return max((abs(value - true) / sd for value, sd, true in said if value is not None), default=0.0)


def _row(cell: Cell, method: str, errors: Array) -> Row:
    errors = errors[cell.judged]
    flagged = np.isnan(errors[:, 1])
    publishes = np.isfinite(errors[:, 0]) | np.isinf(errors[:, 0])
    wrong = np.where(publishes, errors[:, 0] > WRONG_DEVIATIONS, errors[:, 1] > WRONG_M) & ~flagged
    answered = errors[~flagged]
    worst = np.nanmax(answered[:, 0]) if publishes.any() else None
    return {
        "dimension": cell.dimension,
        "condition": cell.condition,
        "second": cell.second,
        "healthy": cell.healthy,
        "method": method,
        "frames": len(errors),
        "right": int((~flagged & ~wrong).sum()),
        "wrong": int(wrong.sum()),
        "flagged": int(flagged.sum()),
        "worst_deviations": None if worst is None else round(float(worst), 2),
        "worst_mm": round(float(answered[:, 1].max()) * 1e3, 4) if len(answered) else None,
    }
