"""Makes a force model by each route and by both weighed, judges them on left-out sessions, and chooses one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fmfts.pad import Array
from fmfts_calibrate.evaluation import HONEST, WRONG, Row, rms, rounded
from fmfts_calibrate.field_table import DataError
from fmfts_calibrate.labelled_poses import Say
from fmfts_skin.calibrate.field_fit import LOAD_SHARE
from fmfts_skin.calibrate.force_fit import Presses, fit_maps
from fmfts_skin.force_model import DIRECTIONS, Coverage, ForceMap, ForceModel, FoundForces, Mask

# The stated prior weighs as much as this many left-out sessions.
PRIOR_SESSIONS = 2.0
UNLEARNT = (1.0, 1.0, 1.0)


@dataclass(frozen=True, slots=True)
class Judged:
    """force_n (K, 3): the labels. found: the answers. clipped (K,): rows with a clipped value. session (K,): names."""

    force_n: Array
    found: FoundForces
    clipped: Mask
    session: tuple[str, ...]

    def rows(self) -> list[Row]:
        """Errors of all rows, by session, and with and without clipped values."""
        names = np.array(self.session)
        groups: list[tuple[str, Mask]] = [("all", np.ones(len(names), dtype=np.bool_))]
        if len(set(self.session)) > 1:
            groups += [(f"session {name}", names == name) for name in dict.fromkeys(self.session)]
        if self.clipped.any():
            groups += [("no value clipped", ~self.clipped), ("a value clipped", self.clipped)]
        return [self._row(name, members) for name, members in groups]

    def _row(self, name: str, members: Mask) -> Row:
        answered = members & np.isfinite(self.found.force).all(axis=1)
        row: Row = {"rows": name, "count": int(members.sum()), "answered": int(answered.sum())}
        if answered.any():
            one = coverage_of(self.force_n[answered], self.found.force[answered], self.found.variance[answered])
            row |= dict(zip(("rms_x_n", "rms_y_n", "rms_z_n"), one.rms_n, strict=True))
            row |= {"within_2": one.within_2, "beyond_5": one.beyond_5}
        return row


def coverage_of(force_n: Array, found: Array, variance: Array) -> Coverage:
    error = found - force_n
    in_deviations = np.abs(error) / np.sqrt(variance)
    x, y, z = (rms(error[:, i]) for i in range(DIRECTIONS))
    within, beyond = float(np.mean(in_deviations <= HONEST)), float(np.mean(in_deviations > WRONG))
    return Coverage("sessions", len(error), (x, y, z), rounded(within), rounded(beyond))


@dataclass(frozen=True, slots=True)
class Route:
    """The result of one route: the model of all presses, and its answers to left-out ones."""

    model: ForceModel
    left_out: Judged

    def facts(self) -> dict[str, Any]:
        return {
            "route": self.model.route,
            "powers": [one.power for one in self.model.maps_of(np.ones(len(self.model.names), dtype=np.bool_))],
            "widened": [rounded(one) for one in self.model.widened],
            "left_out": self.model.coverage.left_out,
            "rows": self.left_out.rows(),
        }


def make_routes(
    parts: Sequence[Presses], clipped: Mask, sessions: tuple[str, ...], origin: str, say: Say
) -> list[Route]:
    """Fit each part, and judge fits to some of its rows on what was left out; of two parts, also both weighed.

    parts: the same presses, each by a route. sessions: their names.
    """
    folds = parts[0].folds()
    each = []
    for part in parts:
        by_fold = {one: fit_maps(part.rows(folds != one), origin, _silent) for one in np.unique(folds)}
        each.append(_Fitted(part, fit_maps(part, origin, say), by_fold))
    together = [[one] for one in each] + ([each] if len(each) > 1 else [])
    return [_route(one, clipped, sessions, origin) for one in together]


@dataclass(frozen=True, slots=True)
class _Fitted:
    """maps: of all presses. by_fold: of the presses outside of a fold."""

    presses: Presses
    maps: tuple[ForceMap, ...]
    by_fold: dict[int, tuple[ForceMap, ...]]


def _route(each: Sequence[_Fitted], clipped: Mask, sessions: tuple[str, ...], origin: str) -> Route:
    parts, presses = [one.presses for one in each], each[0].presses
    values, folds = np.concatenate([part.values for part in parts], axis=1), presses.folds()
    several = len(np.unique(presses.session)) > 1
    found = FoundForces(
        np.full(presses.force_n.shape, np.nan), np.full(presses.force_n.shape, np.nan), np.full(len(folds), np.nan)
    )
    for fold in np.unique(folds):
        out = folds == fold
        maps = [one.by_fold[fold] for one in each]
        told = _model([part.rows(~out) for part in parts], maps, UNLEARNT, None, origin)
        for target, answer in zip(found, told.find(values[out]), strict=True):
            target[out] = answer
    names = tuple(sessions[one] for one in presses.session)
    judged = Judged(presses.force_n, found, clipped, names)
    known = np.isfinite(found.force).all(axis=1)
    if not known.any():
        raise DataError(f"{origin}: no left-out row can be answered: too few values are known")
    coverage = coverage_of(presses.force_n[known], found.force[known], found.variance[known])
    if not several:
        coverage = Coverage("eighths of the time", coverage.rows, coverage.rms_n, coverage.within_2, coverage.beyond_5)
    widened = _learnt(presses, found) if several else UNLEARNT
    return Route(_model(parts, [one.maps for one in each], widened, coverage, origin), judged)


def _learnt(presses: Presses, found: FoundForces) -> tuple[float, float, float]:
    """The factor by which errors of left-out sessions exceed the deviations; the prior is 1."""
    square = (found.force - presses.force_n) ** 2 / found.variance
    each = [np.nanmean(square[presses.session == one], axis=0) for one in np.unique(presses.session)]
    factor = np.sqrt((PRIOR_SESSIONS + np.sum(each, axis=0)) / (PRIOR_SESSIONS + len(each)))
    x, y, z = np.maximum(factor, 1.0).tolist()
    return x, y, z


def _model(
    parts: Sequence[Presses],
    maps: Sequence[tuple[ForceMap, ...]],
    widened: tuple[float, float, float],
    coverage: Coverage | None,
    origin: str,
) -> ForceModel:
    unjudged = Coverage("sessions", 0, (0.0, 0.0, 0.0), 0.0, 0.0)
    presses, counts = parts[0], [len(part.names) for part in parts]
    placed = [
        replace(one, known=np.pad(one.known, (sum(counts[:at]), sum(counts[at + 1 :]))))
        for at, own in enumerate(maps)
        for one in own
    ]
    return ForceModel(
        presses.route if len(parts) == 1 else "both",
        sum((part.names for part in parts), ()),
        len(np.unique(presses.session)),
        LOAD_SHARE["force_n"],
        widened,
        float(np.linalg.norm(presses.force_n, axis=1).max()),
        -1.0 if presses.force_n[:, 2].mean() < 0.0 else 1.0,
        coverage or unjudged,
        origin,
        tuple(placed),
    )


def choose(routes: list[Route], only: str | None = None) -> Route:
    """The route `only`, else what a running pad can do with the smallest error on left-out rows, each direction by the
    forces' own size."""
    size = np.sqrt(np.mean(routes[0].left_out.force_n ** 2, axis=0))

    def error(route: Route) -> float:
        return float(np.sum((np.array(route.model.coverage.rms_n) / size) ** 2))

    allowed = ("field", "both") if only is None else (only,)
    return min((one for one in routes if one.model.route in allowed), key=error)


def _silent(_: str) -> None:
    """Fits that only judge print nothing."""
