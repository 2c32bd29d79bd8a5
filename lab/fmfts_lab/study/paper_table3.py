"""The paper's Table 3 and Figures 7 and 8 again: a magnet of 1.28 T, with regressors trained for 1.23 T."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from fmfts.contact import ContactModel
from fmfts.contact.response import CHANGE, Response
from fmfts.pad import Array
from fmfts_calibrate.dataset import standard_pad
from fmfts_calibrate.fitting import fit_response
from fmfts_calibrate.likelihood import invert
from fmfts_lab.calibration.regressors import Regressor
from fmfts_lab.study import paper_chart
from fmfts_lab.study.harness import Facts, Request, Row, Study
from fmfts_lab.study.paper_inputs import INPUTS, Readings
from fmfts_lab.study.paper_networks import STARTS, back_propagation, chosen, radial_basis, training_curve

PAPER_PATH = Path(__file__).with_name("paper_table3.csv")
REMANENCES_T = (1.23, 1.28)
OUTPUTS = ("x_mm", "y_mm", "force_n")
COLUMNS = ("kind", "case", "chosen", "remanence_t", *OUTPUTS, *(f"found_{name}" for name in OUTPUTS),
           "size", "trained_mse", "left_out_mse")  # fmt: skip
NETWORKS = {"BP": back_propagation, "RBF": radial_basis}
# The paper's four cases, by its names for them.
PAPER_CASES = {
    "BP, field": "BP_ftp_1.23",
    "BP, pose": "BP_ptp_1.23",
    "RBF, field": "RBF_ftp_1.23",
    "RBF, pose": "RBF_ptp_1.23",
}


@dataclass(frozen=True, slots=True)
class Sets:
    """The training and test sets, read and solved once."""

    calibration: Readings
    tests: dict[float, Readings]

    @classmethod
    def read(cls) -> Sets:
        return cls(Readings.calibration(), {t: Readings.solved_test(standard_pad(t)) for t in REMANENCES_T})


def run(request: Request) -> Facts:
    """Run the study with the paper's pad instead of `request.pad`. DataError if presses that it needs are missing."""
    sets = Sets.read()
    study = Study("paper-table3", request, COLUMNS)
    points: dict[str, Callable[[], Iterator[Row]]] = {}
    for kind in NETWORKS:
        for name in INPUTS:
            points[f"{kind}, {name}"] = partial(_network_rows, sets, kind, name, request.quick)
    points["table inversion"] = partial(_own_rows, sets, "table inversion", _table(sets.calibration))
    for refine in (False, True):
        name = "shipped model, refined" if refine else "shipped model"
        points[name] = partial(_own_rows, sets, name, _model(refine))
    for case in PAPER_CASES:
        points[f"training of {case}"] = partial(_curve_rows, sets, case, request.quick)
    rows = study.measure(points)
    facts = study.conclude({"table": table(rows), "test_presses": len(sets.tests[REMANENCES_T[0]].press)})
    study.draw(paper_chart.training(rows), "-figure7")
    study.draw(paper_chart.estimates(rows, tuple(PAPER_CASES), REMANENCES_T), "-figure8")
    return facts


def table(rows: list[Row]) -> list[Row]:
    """MAE and RMSE of every case at every remanence, with the paper's figures if it has them."""
    paper = _paper()
    out: list[Row] = []
    for case in dict.fromkeys(row["case"] for row in rows if row["kind"] == "test"):
        for remanence_t in REMANENCES_T:
            mine = [
                row
                for row in rows
                if row["kind"] == "test" and (row["case"], row["remanence_t"]) == (case, remanence_t)
            ]
            error = np.array([[_number(row, f"found_{name}") - _number(row, name) for name in OUTPUTS] for row in mine])
            line: Row = {"case": case, "chosen": mine[0]["chosen"], "remanence_t": remanence_t}
            for column, name in enumerate(OUTPUTS):
                line[f"mae_{name}"] = float(np.abs(error[:, column]).mean())
                line[f"rmse_{name}"] = float(np.sqrt(np.mean(error[:, column] ** 2)))
            theirs = paper.get((PAPER_CASES.get(str(case), ""), remanence_t), {})
            out.append(line | {f"paper_{key}": value for key, value in theirs.items()})
    return out


def printed(facts: Facts) -> str:
    lines = [
        f"trained on 675 presses at 1.23 T, tested on {facts['test_presses']} others, solved one by one; MAE",
        "",
        f"{'case':28} {'Br':>5} {'x mm':>9} {'y mm':>9} {'F N':>8}   {'paper: x':>9} {'y':>9} {'F':>8}   chosen",
    ]
    for row in facts["table"]:
        theirs = "".join(
            f" {row[f'paper_mae_{name}']:9.4g}" if f"paper_mae_{name}" in row else f"{'':10}" for name in OUTPUTS
        )
        lines.append(
            f"{row['case']:28} {row['remanence_t']:5.2f} {row['mae_x_mm']:9.4f} {row['mae_y_mm']:9.4f} "
            f"{row['mae_force_n']:8.4f}  {theirs}   {row['chosen']}"
        )
    return "\n".join(lines)


def _network_rows(sets: Sets, kind: str, name: str, quick: bool) -> Iterator[Row]:
    inputs, target = INPUTS[name](sets.calibration), sets.calibration.press
    choice = chosen(NETWORKS[kind](quick), inputs, target)
    network: Regressor = choice.make(STARTS).fit(inputs, target)
    for remanence_t, test in sets.tests.items():
        asked = {name: INPUTS[name](test)}
        if name == "field":  # a field can be scaled for another magnet, if its strength is known
            asked["field over remanence"] = asked[name] * (sets.calibration.remanence_t / test.remanence_t)
        for case, values in asked.items():
            yield from _test_rows(f"{kind}, {case}", choice.name, remanence_t, test, network.predict(values))


def _own_rows(sets: Sets, name: str, answer: Callable[[Readings], Array]) -> Iterator[Row]:
    for remanence_t, test in sets.tests.items():
        yield from _test_rows(name, "", remanence_t, test, answer(test))


def _test_rows(case: str, choice: str, remanence_t: float, test: Readings, found: Array) -> Iterator[Row]:
    for press, estimate in zip(test.press.tolist(), found.tolist(), strict=True):
        row: Row = {"kind": "test", "case": case, "chosen": choice, "remanence_t": remanence_t}
        yield row | dict(zip(COLUMNS[4:10], (*press, *estimate), strict=True))


def _curve_rows(sets: Sets, case: str, quick: bool) -> Iterator[Row]:
    kind, name = case.split(", ")
    for size, trained, left_out in training_curve(kind, INPUTS[name](sets.calibration), sets.calibration.press, quick):
        yield {"kind": "training", "case": case, "size": size, "trained_mse": trained, "left_out_mse": left_out}


def _table(known: Readings) -> Callable[[Readings], Array]:
    """Maximum likelihood with a table of the calibration's own poses."""
    rest = np.array([*standard_pad().rest_position_m * 1e3, 0.0, 0.0])
    deviation = known.daemon.deviation
    response: Response = fit_response(known.press, known.daemon.pose[:, :CHANGE] - rest, deviation)
    return lambda test: invert(response, test.daemon.pose[:, :CHANGE] - rest, test.daemon.covariance)


def _model(refine: bool) -> Callable[[Readings], Array]:
    model = ContactModel.load("default", standard_pad(), refine=refine)

    def answer(test: Readings) -> Array:
        found = []
        for pose, covariance in zip(test.daemon.pose, test.daemon.covariance, strict=True):
            model.inference.pose[:] = pose
            model.inference.run()
            press = model.inference.contact.astype(np.float64)
            if model.refiner is not None:
                press, *_ = model.refiner.refined(press, pose[:CHANGE] - model.rest_pose[:CHANGE], covariance)
            found.append(press)
        return np.array(found)

    return answer


def _paper() -> dict[tuple[str, float], dict[str, float]]:
    """(case in the paper's words, remanence) → the paper's figures."""
    with PAPER_PATH.open(newline="") as file:
        return {
            (row["train_model"], float(row["test_remanence_t"])): {
                f"{kind}_{ours}": float(row[f"{kind}_{theirs}"])
                for kind in ("mae", "rmse")
                for ours, theirs in zip(OUTPUTS, ("x_mm", "y_mm", "f_n"), strict=True)
            }
            for row in csv.DictReader(file)
        }


def _number(row: Row, name: str) -> float:
    value = row[name]
    assert isinstance(value, int | float)
    return float(value)
