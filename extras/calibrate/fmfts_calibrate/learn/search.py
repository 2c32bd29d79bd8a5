"""Searches the geometry from several starts, excludes presses that fit none, and reports what stays undetermined."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fmfts.common.chi2 import quantile
from fmfts_calibrate.learn.drawing import OCTUPOLE, Drawing
from fmfts_calibrate.learn.fit import Bundle, Fields, Fit, misfits
from fmfts_calibrate.learn.uniqueness import is_another, mirrored, open_directions

Array = NDArray[np.float64]
Which = NDArray[np.bool_]

STARTS = 6
FAR_START = 1.5  # largest distance of a start from the drawing, in its tolerances: beyond, the drawing counts as wrong
# One fitting press in ten thousand is excluded. If presses scatter by more than their noise, deviations grow.
FALSE_OUTLIER = 1e-4
LARGEST_MISFIT, MOST_OUTLIERS = 5.0, 0.2
# Two answers are alike unless one is a hundred times as probable: in −2 ln.
ALIKE = 9.2
ROUNDS = 3  # of leaving presses out
EVALUATIONS, EVALUATIONS_TO_COMPARE = 150, 40
# The octupole is estimated from the presses if that lowers the misfit of left-out presses by this.
OCTUPOLE_WORTH = 0.98
LEFT_OUT = 4  # every fourth press


class LearnError(Exception):
    """The presses do not determine a geometry; the text says why, with the figure."""


@dataclass(frozen=True, slots=True)
class Learned:
    """fit, of the presses `used` (K,), and its covariance (M, M) in SI, wider where the presses scatter by more than
    their noise (`inflation`). agreeing: of so many `starts` that ended there. open: what stays undetermined, as
    sentences: if there are any, the answer is one of several."""

    drawing: Drawing
    fit: Fit
    used: Which
    inflation: float
    starts: int
    agreeing: int
    open: list[str]

    @property
    def covariance(self) -> Array:
        scale = self.drawing.deviation
        return np.asarray(covariance_of(self.fit, self.inflation) * scale * scale[:, None])


def learn(drawing: Drawing, fields: Fields, starts: int = STARTS, seed: int = 0) -> Learned:
    """The most probable geometry. LearnError if no geometry explains the presses."""
    vectors = list(_starts(drawing, starts, seed))
    tried = [_settled(drawing, fields, vector, EVALUATIONS_TO_COMPARE) for vector in vectors]
    best, used, inflation = _cleaned(drawing, fields, min(tried, key=_typical_chi2))
    kept = fields.only(used)
    # The other answers are judged by the same presses.
    others = [Bundle(drawing, kept).fit(one.vector, EVALUATIONS_TO_COMPARE) for one in tried]
    inverted = mirrored(drawing, best.vector)
    if inverted is not None:
        others.append(Bundle(drawing, kept).fit(inverted, EVALUATIONS))
    for one in others:
        if one.chi2 < best.chi2 - 1.0:
            best = Bundle(drawing, kept).fit(one.vector, EVALUATIONS)
    widened = replace(best, information=information_of(best, inflation))
    alike = [one for one in others if (one.chi2 - best.chi2) / inflation**2 < ALIKE]
    rivals = [one for one in alike if one.settled and is_another(widened, one)]
    told = open_directions(drawing, widened, rivals)
    return Learned(drawing, best, used, inflation, len(vectors), len(alike) - len(rivals), told)


def with_octupole(learned: Learned, fields: Fields) -> Learned:
    """The same with the magnet's octupole from the presses, too, where presses that were left out then fit better."""
    kept = fields.only(learned.used)
    if len(kept.press_t) < 2 * LEFT_OUT:
        return learned
    out = np.arange(len(kept.press_t)) % LEFT_OUT == 0
    wider = replace(learned.drawing, free_octupole=True)
    missed = []
    for drawing in (learned.drawing, wider):
        fit = Bundle(drawing, kept.only(~out)).fit(learned.fit.vector, EVALUATIONS_TO_COMPARE)
        missed.append(float(np.sum(misfits(drawing, fit.vector, kept.only(out))[0] ** 2)))
    if missed[1] > OCTUPOLE_WORTH * missed[0]:
        return learned
    fit = Bundle(wider, kept).fit(learned.fit.vector, EVALUATIONS)
    return replace(learned, drawing=wider, fit=fit, inflation=_inflation(fit, kept))


def information_of(fit: Fit, inflation: float) -> Array:
    """The information (M, M) on the vector, if the fields' deviations are larger than claimed by the factor
    `inflation`.
    """
    prior = np.eye(len(fit.vector))
    return np.asarray((fit.information - prior) / inflation**2 + prior)


def covariance_of(fit: Fit, inflation: float) -> Array:
    return np.asarray(np.linalg.inv(information_of(fit, inflation)), dtype=np.float64)


def octupole_factor(learned: Learned) -> float | None:
    """κ as a multiple of the drawing's; None if the drawing's was kept."""
    if not learned.drawing.free_octupole:
        return None
    found = learned.drawing.geometry(learned.fit.vector).octupole_m2
    return float(found / learned.drawing.pad.magnet.octupole_m2)


def _starts(drawing: Drawing, count: int, seed: int) -> list[Array]:
    random = np.random.default_rng(seed)
    size = len(drawing.deviation)
    drawn = [np.clip(random.standard_normal(size), -FAR_START, FAR_START) for _ in range(count - 1)]
    for vector in drawn:
        vector[OCTUPOLE] = 0.0
    return [np.zeros(size), *drawn]


def _settled(drawing: Drawing, fields: Fields, start: Array, evaluations: int) -> Fit:
    """From one start, with less weight for presses that fit badly."""
    return Bundle(drawing, fields).fit(start, evaluations, robust=True)


def _typical_chi2(fit: Fit) -> float:
    """χ² if all presses fitted as the better three quarters do, drawing included."""
    each = np.sort((fit.residual**2).sum(axis=1))
    kept = each[: max(1, round((1.0 - MOST_OUTLIERS) * len(each)))]
    return float(kept.mean() * len(each) + fit.vector @ fit.vector)


def _cleaned(drawing: Drawing, fields: Fields, fit: Fit) -> tuple[Fit, Which, float]:
    """Fitted to the presses that fit, which these are, and by how much they scatter more than their noise."""
    for _ in range(ROUNDS):
        residual, freedom = misfits(drawing, fit.vector, fields)
        chi2 = (residual**2).sum(axis=1)
        told = freedom > 0  # a press with too many clipped values carries no information
        inflation = max(1.0, float(np.sqrt(np.median(chi2[told] / freedom[told])))) if told.any() else np.inf
        limit = np.array([quantile(FALSE_OUTLIER, max(int(one), 1)) for one in freedom])
        used = told & (chi2 < limit * inflation**2)
        fit = Bundle(drawing, fields.only(used)).fit(fit.vector, EVALUATIONS)
    inflation = _inflation(fit, fields.only(used))
    outliers = int((told & ~used).sum())
    if inflation > LARGEST_MISFIT or outliers > MOST_OUTLIERS * len(used):
        raise LearnError(
            f"the presses do not fit one magnet above these sensors: {outliers} of {len(used)} are off, "
            f"the median by {inflation:.1f} times its noise"
        )
    return fit, used, inflation


def _inflation(fit: Fit, fields: Fields) -> float:
    there = np.isfinite(fields.press_t).reshape(len(fields.press_t), -1).sum(axis=1) - 5
    return max(1.0, float(np.sqrt((fit.residual**2).sum() / max(int(there.sum()), 1))))
