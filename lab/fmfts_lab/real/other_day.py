"""Forces of a sold sensor on another day: by field, by pose, by a network and by a polynomial.

The other day is known by its rest alone, by one press of known force, or by five. A known press scales all forces of a
method; five correct each direction's part of each. That correction is the most probable one, with the spread of another
day's forces that `calibrate` states as its prior.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from fmfts.pad import Array
from fmfts_lab.calibration.regressors import BackPropagation
from fmfts_lab.real.sold_sensor import CLIPPED_MT, SESSIONS, written_session
from fmfts_lab.real.unlabelled import FIRST_SHARE, learned_from, poses_of, refined, session_t, untouched
from fmfts_skin.calibrate.field_fit import LOAD_SHARE
from fmfts_skin.calibrate.force_fit import RIDGE, Presses
from fmfts_skin.calibrate.force_judge import coverage_of, make_routes
from fmfts_skin.calibrate.force_pose import AXIS, PART
from fmfts_skin.calibrate.force_set import ForceSet, read_force_set
from fmfts_skin.force_model import Mask, monomials
from fmfts_skin.pose_values import NAMES, unit_of

CORRECTION = LOAD_SHARE["force_n"]
DRAWS = 40  # draws of known presses; a row states their mean
FIRM = 0.5  # known presses are among the harder half
KNOWN = (0, 1, 5)
BOTH = "`calibrate`, both"
UNCLIPPED = "each by the other, no value clipped"
# Each decade of presses of a day softens the elastomer by this share: of 0, 5, 10, 13, 16 and 20 % it leaves least of
# the first day's left-out eighths. EARLIER: presses before the recording. MIDDLE: forces are told as after so many.
SOFTER_BY_DECADE, EARLIER, MIDDLE = 0.1, 10, 300
SOFTENING = "softening counted"
NEURONS = (10,)  # the paper's network
# Of some rows, by others: forces (K, 3) and their variance (K, 3).
Answer = tuple[Array, Array]


@dataclass(frozen=True, slots=True)
class Row:
    """One method on one way. known: presses of known force on the other day; None: left-out eighths of the same day."""

    method: str
    way: str
    known: int | None
    rows: int
    rms_n: tuple[float, float, float]
    within_2: float
    beyond_5: float

    @property
    def states_deviations(self) -> bool:
        """The others are judged by their error on left-out eighths of the day that they learnt."""
        return "calibrate" in self.method or self.method == SOFTENING

    @property
    def size_n(self) -> float:
        """The rms error of the whole force."""
        return float(np.linalg.norm(self.rms_n))


def read(folder: Path) -> ForceSet:
    with TemporaryDirectory() as written:
        files = [written_session(name, folder / file, Path(written)) for name, (file, _) in SESSIONS.items()]
        return read_force_set(files)


def field_presses(data: ForceSet) -> Presses:
    return Presses("field", data.names, data.change(), data.sensor, data.axis, data.force_n, data.session)


def pose_presses(data: ForceSet, folder: Path) -> Presses:
    """By the geometry that unlabelled rows determine: the beginning of the first day, and for the second day its own.

    Each day has its own rest.
    """
    first, second = (session_t(name, folder) for name in SESSIONS)
    learned = learned_from(first[: round(FIRST_SHARE * len(first))])
    height_m = float(learned.drawing.geometry(learned.fit.vector).rest.position_m[2])
    unit = unit_of(height_m)
    values = []
    for own, day in ((learned, first), refined(learned, second)):
        poses = poses_of(own, day)[:, : len(NAMES)]
        values.append((poses - np.median(poses[untouched(day)], axis=0)) / unit)
    return Presses("pose", NAMES, np.concatenate(values), PART, AXIS, data.force_n, data.session)


def by_calibrate(parts: Sequence[Presses], data: ForceSet) -> list[tuple[Answer, Answer]]:
    """The results of `calibrate` on left-out eighths of each day, and on each day by a model of the other: of each
    part, and of both weighed."""
    across = [one.left_out.found for one in make_routes(parts, data.clipped, data.sessions, "another day", _silent)]
    own = [(np.full(data.force_n.shape, np.nan), np.full(data.force_n.shape, np.nan)) for _ in across]
    for number, _ in enumerate(data.sessions):
        day = data.session == number
        alone = [replace(one.rows(day), session=np.zeros(day.sum(), dtype=np.intp)) for one in parts]
        left = make_routes(alone, data.clipped[day], ("",), "one day", _silent)
        for (force, variance), one in zip(own, left, strict=True):
            force[day], variance[day] = one.left_out.found.force, one.left_out.found.variance
    return [(one, (other.force, other.variance)) for one, other in zip(own, across, strict=True)]


def by_softened(parts: Sequence[Presses], data: ForceSet) -> tuple[Answer, Answer]:
    """Both weighed, with forces as they were at the MIDDLE of a day whose presses soften the elastomer."""
    number = np.concatenate([np.arange(np.sum(data.session == one)) for one, _ in enumerate(data.sessions)])
    share = 1.0 - SOFTER_BY_DECADE * np.log10((number[:, None] + EARLIER) / MIDDLE)
    at_middle = [replace(one, force_n=one.force_n / share) for one in parts]
    own, across = ((share * force, share**2 * variance) for force, variance in by_calibrate(at_middle, data)[-1])
    return own, across


def by_fit(fitted: Callable[[Mask, Mask], Array], presses: Presses, data: ForceSet) -> tuple[Answer, Answer]:
    """The same for a method without deviations: it states its error on left-out eighths of the learned day."""
    own, across = np.empty(data.force_n.shape), np.empty(data.force_n.shape)
    own_variance, variance = np.empty(own.shape), np.empty(own.shape)
    for number, _ in enumerate(data.sessions):
        day = data.session == number
        fold = np.full(len(day), -1)
        fold[day] = replace(presses.rows(day), session=np.zeros(day.sum(), dtype=np.intp)).folds()
        for one in range(fold.max() + 1):
            own[fold == one] = fitted(day & (fold != one), fold == one)
        across[~day] = fitted(day, ~day)
        variance[~day] = own_variance[day] = rms(own[day] - data.force_n[day]) ** 2
    return (own, own_variance), (across, variance)


def clipped_at_bound(data: ForceSet) -> Array:
    """(K, V) changes from rest in mT, a clipped value at the end of the range: these methods need every value."""
    ends = np.sign(np.nan_to_num(data.bound_ut)) * 1e3 * CLIPPED_MT
    filled = np.where(np.isfinite(data.field_ut), data.field_ut, ends)
    rest = np.array([data.rest_ut(number) for number in range(len(data.sessions))])
    return np.asarray((filled - rest[data.session]) * 1e-3)


def by_polynomial(data: ForceSet, power: int = 2) -> Callable[[Mask, Mask], Array]:
    values = clipped_at_bound(data)
    basis = monomials(values, np.ones(values.shape[1], dtype=np.bool_), power)

    def fitted(train: Mask, test: Mask) -> Array:
        own = basis[train] / (scale := np.sqrt(np.mean(basis[train] ** 2, axis=0)))
        normal = own.T @ own / len(own) + RIDGE * np.eye(len(scale))
        return np.asarray(basis[test] / scale @ np.linalg.solve(normal, own.T @ data.force_n[train] / len(own)))

    return fitted


def by_network(data: ForceSet) -> Callable[[Mask, Mask], Array]:
    values = clipped_at_bound(data)

    def fitted(train: Mask, test: Mask) -> Array:
        return BackPropagation(NEURONS).fit(values[train], data.force_n[train]).predict(values[test])

    return fitted


def corrected(found: Array, told: Array, variance: Array) -> Array:
    """(3, 3): takes the forces found (K, 3) of known presses to the told ones; a single press gives one factor."""
    if len(found) == 1:
        weight = float((found**2 / variance).sum() + 1.0 / CORRECTION**2)
        return (1.0 + float((found * (told - found) / variance).sum()) / weight) * np.eye(3)
    matrix = np.eye(3)
    for row in range(3):
        weighted = found / variance[:, row : row + 1]
        normal = found.T @ weighted + np.eye(3) / CORRECTION**2
        matrix[row] += np.linalg.solve(normal, weighted.T @ (told - found)[:, row])
    return matrix


def rms(error: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(error * error, axis=0)))


def rows_of(folder: Path) -> Iterator[Row]:
    data = read(folder)
    field = field_presses(data)
    parts = field, pose_presses(data, folder)
    by_field, by_pose, by_both = by_calibrate(parts, data)
    methods: dict[str, Callable[[], tuple[Answer, Answer]]] = {
        "`calibrate`, field": lambda: by_field,
        "`calibrate`, pose": lambda: by_pose,
        BOTH: lambda: by_both,
        SOFTENING: lambda: by_softened(parts, data),
        "network, field": lambda: by_fit(by_network(data), field, data),
        "polynomial, field": lambda: by_fit(by_polynomial(data), field, data),
    }
    for name, answered in methods.items():
        own, across = answered()
        for number, day in enumerate(data.sessions):
            rows = data.session == number
            yield _row(name, f"{day} alone", None, [_of(own, rows, data)])
            for known in KNOWN:
                yield _row(name, f"{day} by the other", known, list(_drawn(*_of(across, rows, data), known)))
        yield _row(name, UNCLIPPED, 0, [_of(across, ~data.clipped, data)])


def _of(answer: Answer, rows: Mask, data: ForceSet) -> tuple[Array, Array, Array]:
    """Labels, forces and variances of those of the rows that are answered."""
    rows = rows & np.isfinite(answer[0]).all(axis=1)
    return data.force_n[rows], answer[0][rows], answer[1][rows]


def _drawn(told: Array, found: Array, variance: Array, known: int) -> Iterator[tuple[Array, Array, Array]]:
    """The rows that were not among the known presses, corrected by these."""
    size = np.linalg.norm(told, axis=1)
    firm, random = np.flatnonzero(size > np.quantile(size, FIRM)), np.random.default_rng(known)
    for _ in range(DRAWS if known else 1):
        chosen = random.choice(firm, known, replace=False)
        matrix = corrected(found[chosen], told[chosen], variance[chosen]) if known else np.eye(3)
        left = np.delete(np.arange(len(found)), chosen)
        yield told[left], found[left] @ matrix.T, variance[left]


def _row(method: str, way: str, known: int | None, draws: list[tuple[Array, Array, Array]]) -> Row:
    each = [coverage_of(*draw) for draw in draws]
    x, y, z = np.mean([one.rms_n for one in each], axis=0).tolist()
    within, beyond = (float(np.mean([getattr(one, name) for one in each])) for name in ("within_2", "beyond_5"))
    return Row(method, way, known, max(one.rows for one in each) + (known or 0), (x, y, z), within, beyond)


def _silent(_: str) -> None:
    """`calibrate` says how it chose the power of a polynomial."""
