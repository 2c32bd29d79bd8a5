"""Compares the answers of a pad with several magnets for labelled presses, each as a single frame, with the labels."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import root_of_squares
from fmfts.contact.array_model import ArrayModel
from fmfts.pad import Array
from fmfts.pose import Aligned
from fmfts.several.count import resultant
from fmfts.several.estimator import FingersEstimator
from fmfts.several.field_model import FieldModel, Scene
from fmfts.several.reading import FingersMemory, FingersReading
from fmfts.several.recovery import Recovery
from fmfts_calibrate.array_set import ArraySet
from fmfts_calibrate.evaluation import HONEST, UNITS, WRONG, Row, regions, rounded, rows
from fmfts_calibrate.resultant import deviation_of

Told = Literal["one finger", "two fingers", "no finger", "over range", "more", "disturbed", "lost"]


@dataclass(frozen=True, slots=True)
class ArrayEvaluation:
    """press, found, deviation (K, 3 or 5): labels, the resultant, and its published deviations; NaN where no finger is
    reported. told (K,): what is reported. ok (K,): healthy. chi2 (K,): NaN if nothing explains the frame. model: its
    hash."""

    press: Array
    found: Array
    deviation: Array
    told: tuple[Told, ...]
    ok: NDArray[np.bool_]
    chi2: Array
    model: str

    @property
    def answered(self) -> NDArray[np.bool_]:
        return np.asarray(np.isfinite(self.found).all(axis=1), dtype=np.bool_)

    @property
    def wrong(self) -> NDArray[np.bool_]:
        """Healthy, and place or force more than five deviations off."""
        off = np.abs(self.found - self.press)[:, :3] > WRONG * self.deviation[:, :3]
        return np.asarray(self.ok & off.any(axis=1), dtype=np.bool_)

    def counted(self) -> dict[str, int]:
        return dict(Counter(self.told).most_common())

    def rows(self) -> list[Row]:
        """Errors of the presses that were answered, by region."""
        answered = self.answered
        press, found, deviation = self.press[answered], self.found[answered], self.deviation[answered]
        table = rows(press, found, deviation)
        off = np.abs(found - press) / deviation
        for row, (_, members) in zip(table, regions(press), strict=True):
            for column in range(off.shape[1]):
                row[f"within_2_{UNITS[column]}"] = rounded(np.mean(off[members, column] <= HONEST))
            row["wrong"] = int(self.wrong[answered][members].sum())
        return table

    def facts(self) -> dict[str, Any]:
        return {
            "model": self.model,
            "presses": len(self.press),
            "told": self.counted(),
            "healthy": int(self.ok.sum()),
            "wrong": int(self.wrong.sum()),
            "regions": self.rows() if self.answered.any() else [],
        }


def evaluate_array(data: ArraySet, model: ArrayModel, scene: Scene, rate_hz: float, noise_t: float) -> ArrayEvaluation:
    """noise_t: of one frame's value, for the deviations."""
    count = len(data.pad.sensors)
    shape = (count, 3)
    mounting = replace(data.mounting, noise_t=np.full(shape, noise_t))
    estimator = FingersEstimator(FieldModel(data.pad, mounting, model.response, scene), rate_hz, np.full(shape, np.inf))
    columns = 5 if data.has_shear else 3
    found, deviation = np.full((2, len(data.press), columns), np.nan)
    chi2, ok, told = np.full(len(data.press), np.nan), np.zeros(len(data.press), dtype=np.bool_), list[Told]()
    for row, change_t in enumerate(data.change_t):
        estimator.recall(FingersMemory(Recovery(np.zeros(3 * count))))
        field_t = (mounting.rest_field_t + mounting.offset_t + change_t.reshape(shape)) * mounting.gain
        aligned = Aligned(field_t, np.ones((count, 1)), np.zeros(shape), 0, np.zeros(shape, dtype=np.int64))
        reading = estimator.read(aligned, None, {})
        told.append(_told(reading))
        ok[row] = reading.health == "ok" and told[-1] in ("one finger", "two fingers")
        if reading.fit is None:
            continue
        chi2[row] = reading.fit.chi2
        if told[-1] in ("one finger", "two fingers"):
            fit = reading.fit
            found[row, :3], deviation[row, :3] = resultant(fit.fingers), deviation_of(reading, fit)
            deviation[row, 2] = root_of_squares(deviation[row, 2], estimator.silicone * found[row, 2])
            if columns > 3:
                found[row, 3:], deviation[row, 3:] = fit.shear_n.sum(axis=0), fit.shear_deviation_n.sum(axis=0)
    return ArrayEvaluation(data.press[:, :columns], found, deviation, tuple(told), ok, chi2, model.hash)


def _told(reading: FingersReading) -> Told:
    if reading.health == "lost":
        return "lost"
    if reading.more:
        return "more"
    if reading.fit is None:
        return "disturbed"
    if reading.over_range:
        return "over range"
    return ("no finger", "one finger", "two fingers")[len(reading.fit.fingers)]
