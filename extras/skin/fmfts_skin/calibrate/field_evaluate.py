"""Compares the contacts that a field response finds with a set's labels."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from fmfts.pad import Array
from fmfts_calibrate.evaluation import HONEST, WRONG, Row, rms, rounded
from fmfts_calibrate.field_table import DataError
from fmfts_skin.calibrate.field_instance import instance_of
from fmfts_skin.calibrate.field_set import FieldSet
from fmfts_skin.field_contact import ContactFinder
from fmfts_skin.field_response import PLACE, FieldResponse, Instance

LOAD_BANDS = 4


@dataclass(frozen=True, slots=True)
class FieldEvaluation:
    """contact, found, deviation (K, D): of the labelled rows. chi2 (K,). instances: by the names of recordings."""

    axes: tuple[str, ...]
    contact: Array
    found: Array
    deviation: Array
    chi2: Array
    values: int
    instances: dict[str, Instance]

    def rows(self) -> list[Row]:
        """Errors over all, and by quarters of the load."""
        load = self.contact[:, -1]
        edges = np.linspace(load.min(), load.max(), LOAD_BANDS + 1)
        out = [self._row("all", np.ones(len(load), dtype=np.bool_))]
        for low, high in itertools.pairwise(edges):
            members = (load >= low) & ((load < high) | (high == edges[-1]))
            if members.any():
                out.append(self._row(f"{self.axes[-1]} {low:.3g} to {high:.3g}", members))
        return out

    def _row(self, name: str, members: Array) -> Row:
        error = (self.found - self.contact)[members]
        in_deviations = np.abs(error / self.deviation[members])
        row: Row = {"rows": name, "count": len(error)}
        if self.axes[:2] == PLACE:
            distance = np.hypot(error[:, 0], error[:, 1])
            row["place_rms_mm"] = rms(distance)
            row["place_median_mm"] = rounded(np.median(distance))
            row["place_p95_mm"] = rounded(np.quantile(distance, 0.95))
        load = self.axes[-1]
        row[f"rms_{load}"] = rms(error[:, -1])
        row[f"mean_{load}"] = rounded(error[:, -1].mean())
        for number, axis in enumerate(self.axes):
            short = axis.split("_")[0]
            row[f"{short}_within_2"] = rounded(np.mean(in_deviations[:, number] <= HONEST))
            row[f"{short}_beyond_5"] = rounded(np.mean(in_deviations[:, number] > WRONG))
        return row

    def facts(self) -> dict[str, Any]:
        """For --json."""
        return {
            "rows": self.rows(),
            "chi2_of_a_value": rounded(np.median(self.chi2) / self.values),
            "instances": {
                name: {
                    "moment": one.moment,
                    "gain": one.gain,
                    "rest_ut": np.atleast_2d(one.rest_ut).mean(axis=0).round(1).tolist(),
                }
                for name, one in self.instances.items()
            },
        }


def evaluate_field(response: FieldResponse, data: FieldSet, whose: str, learn: bool = True) -> FieldEvaluation:
    """learn: each recording's instance is first learned from its fields; False: only its rest rows, or the table's own
    rest.

    DataError where the set is of another kind than the table.
    """
    names = tuple(axis.name for axis in response.axes)
    if data.axes != names or data.field_ut.shape[1] != len(response.reference_ut):
        raise DataError(
            f"{whose}: has {', '.join(data.axes)} and {data.field_ut.shape[1] // 3} sensors; the model is of "
            f"{', '.join(names)} and {len(response.reference_ut) // 3} sensors"
        )
    if not data.labelled.any():
        raise DataError(f"{whose}: no row has a contact that is known")
    if response.rests and not np.isfinite(data.rest_ut()).all():
        raise DataError(f"{whose}: has a recording without rows of rest (rest = 1); this model counts from the rest")
    finder = ContactFinder(response)
    found, deviation = np.full(data.contact.shape, np.nan), np.full(data.contact.shape, np.nan)
    chi2, instances = np.full(len(data.contact), np.nan), {}
    pairs = instance_of(response, data) if learn else _unlearnt(response, data)
    for rows, instance in pairs:
        answer = finder.find(instance.change_ut(data.field_ut[rows]))
        found[rows], deviation[rows], chi2[rows] = answer.contact, answer.deviation, answer.chi2
        instances[data.recordings[data.recording[np.flatnonzero(rows)[0]]]] = instance
    known = data.labelled
    return FieldEvaluation(
        data.axes, data.contact[known], found[known], deviation[known], chi2[known], data.field_ut.shape[1], instances
    )


def _unlearnt(response: FieldResponse, data: FieldSet) -> list[tuple[Any, Instance]]:
    """Every recording as it is: with its own rest if it has rest rows, else that of the table."""
    rests = data.rest_ut()
    out = []
    for number in range(len(data.recordings)):
        rows = (data.recording == number) & ~data.rest
        known = bool(np.isfinite(rests[rows]).all())
        out.append((rows, Instance(rests[rows] if known else response.reference_ut)))
    return [pair for pair in out if pair[0].any()]
