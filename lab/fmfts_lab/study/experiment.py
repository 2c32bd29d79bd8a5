"""The paper's experiment (Table 4) in simulation: one pad calibrates, others are pressed; the error by each cause."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from fmfts.baseline import Mounting, Recording
from fmfts.baseline.mounting import estimate_mounting
from fmfts.contact import ContactModel
from fmfts.pad import Array, Pad, SensorArray, Tolerance
from fmfts.pipeline.drawn import in_nominal_frame
from fmfts.pose import FREE_FIELD, solve
from fmfts.sensor.chips import NOISE_T
from fmfts_calibrate.dataset import CalibrationSet, standard_pad
from fmfts_calibrate.training import Options, calibrate
from fmfts_lab.bench import recorded
from fmfts_lab.calibration.simulated import pressed_fields, rest_field_of
from fmfts_lab.study import paper_chart
from fmfts_lab.study.harness import Facts, Request, Row, Study
from fmfts_lab.study.paper_inputs import INPUTS, Readings
from fmfts_lab.study.paper_networks import training_curve
from fmfts_simulation.mounted import (
    CROSS_AXIS,
    EARTH_T,
    GAIN,
    MAGNET_PLACE_M,
    MAGNET_TILT_RAD,
    SENSOR_PLACE_M,
    SENSOR_ROTATION_RAD,
    MountedPad,
)

PAPER_PATH = Path(__file__).with_name("paper_table4.csv")
REMANENCES_T = (1.046, 1.068)
FRAMES, STIFFNESS = 660, 0.03
# The presses with which the paper calibrated its first sensor: 2 mm apart, 0.5 to 4 N. It tested with the same forces.
PLACES_MM, FORCES_N = np.linspace(-14.0, 14.0, 15), np.linspace(0.5, 4.0, 8)
LIGHTEST_N = 0.25
# The paper's baseline only subtracts the ambient field, and takes the pad as drawn.
DRAWING = "drawing"
BASELINES = (*recorded.KINDS, DRAWING)
HIDDEN, TRAINED_ON = 16, 8000  # small, so that two steps of the table lead to the most likely answer
# Each cause alone, all together, and none (a pad exactly as drawn).
CAUSES = ("noise", "gains", "sensors placed", "chips turned", "magnet placed", "tilt", "stiffness", "remanence")
ERRORS = ("mae_x_mm", "mae_y_mm", "mae_f_n")
COLUMNS = ("kind", "baseline", "causes", "pad", *ERRORS, "presses", "case", "size", "trained_mse", "left_out_mse")
TOLERANCE = Tolerance(SENSOR_PLACE_M, MAGNET_PLACE_M, MAGNET_TILT_RAD, GAIN, 0.05, SENSOR_ROTATION_RAD, CROSS_AXIS)


@dataclass(frozen=True, slots=True)
class Made:
    """A pad of the second remanence with the errors of `causes`; softer: how much farther a force moves its magnet."""

    built: MountedPad
    softer: float
    noise_t: float

    @classmethod
    def with_causes(cls, drawing: Pad, causes: tuple[str, ...], random: np.random.Generator) -> Made:
        whole, plain = MountedPad.built(drawing, random), MountedPad.exact(drawing)
        remanence_t = REMANENCES_T[1] if "remanence" in causes else REMANENCES_T[0]
        placed, turned = (
            whole.pad.sensors if cause in causes else drawing.sensors for cause in ("sensors placed", "chips turned")
        )
        tilt = whole if "tilt" in causes else plain
        pad = replace(
            drawing,
            sensors=SensorArray(placed.position_m, turned.axes),
            magnet=drawing.magnet.with_remanence(remanence_t),
            rest_position_m=whole.pad.rest_position_m if "magnet placed" in causes else drawing.rest_position_m,
            rest_axis=tilt.pad.rest_axis,
        )
        gain = random.normal(1.0, GAIN, whole.gain.shape) if "gains" in causes else plain.gain
        cross_axis = whole.cross_axis if "chips turned" in causes else None
        ambient_t = EARTH_T * _direction(random)
        built = MountedPad(pad, gain, ambient_t, tilt.rest_axis_from_z, cross_axis=cross_axis)
        softer = random.normal(1.0, STIFFNESS) if "stiffness" in causes else 1.0
        return cls(built, float(softer), NOISE_T if "noise" in causes else 0.0)

    def field(self, press: Array, random: np.random.Generator) -> Array:
        """The field (N, 3) of one frame under x, y in mm and a force in N."""
        count = len(self.built.pad.sensors)
        x, y, force = (np.full(count, value) for value in (press[0] * 1e-3, press[1] * 1e-3, press[2] * self.softer))
        sensed = self.built.sensed(self.built.magnet_field(x, y, force) + self.built.ambient_t)
        return sensed + random.normal(0.0, self.noise_t, sensed.shape)


def run(request: Request) -> Facts:
    study = Study("paper-table4", request, COLUMNS)
    model = request.out / "first-pad.onnx"
    calibrate_first_pad(model, request.quick)
    pads, presses = (3, 30) if request.quick else (20, 90)
    together: dict[str, tuple[str, ...]] = {"all": CAUSES, "none": ()} | {cause: (cause,) for cause in CAUSES}
    points: dict[str, Callable[[], Iterator[Row]]] = {
        f"{name}, pad {pad}": partial(_rows, model, name, causes, pad, presses, request.seed)
        for name, causes in together.items()
        for pad in range(pads)
    }
    points["training"] = partial(_training_rows, request)
    rows = study.measure(points)
    facts = study.conclude({"table": table(rows), "pads": pads, "presses": presses, "paper": _paper()})
    study.draw(paper_chart.training(rows), "-figure11")
    return facts


def table(rows: list[Row]) -> list[Row]:
    """Means over the pads."""
    out: list[Row] = []
    rows = [row for row in rows if row["kind"] == "test"]
    for causes in dict.fromkeys(row["causes"] for row in rows):
        for baseline in BASELINES:
            mine = [row for row in rows if (row["causes"], row["baseline"]) == (causes, baseline)]
            line: Row = {"causes": causes, "baseline": baseline}
            for name in ERRORS:
                line[name] = float(np.mean([float(row[name] or 0.0) for row in mine]))
            out.append(line)
    return out


def printed(facts: Facts) -> str:
    lines = [
        f"a second pad ({facts['pads']} drawn, {facts['presses']} single frames each), MAE: x, y (mm), force (N)",
        "",
        f"{'errors':16}" + "".join(f"{baseline:>26}" for baseline in BASELINES),
    ]
    found = {(row["causes"], row["baseline"]): row for row in facts["table"]}
    for causes in dict.fromkeys(row["causes"] for row in facts["table"]):
        cells = (found[causes, baseline] for baseline in BASELINES)
        lines.append(
            f"{causes:16}"
            + "".join(f"{cell['mae_x_mm']:10.3f} {cell['mae_y_mm']:6.3f} {cell['mae_f_n']:8.4f}" for cell in cells)
        )
    lines.append("the paper's second sensor: " + ", ".join(f"{name} {value}" for name, value in facts["paper"].items()))
    return "\n".join(lines)


def calibrate_first_pad(target: Path, quick: bool) -> None:
    """Make a model as `fmfts-daemon calibrate` does, from the 1800 presses of the paper's first sensor, noise-free."""
    pad = standard_pad(REMANENCES_T[0])
    press = first_pad_presses()
    known = CalibrationSet(
        pad, press, pressed_fields(pad, press), tuple(range(2, len(press) + 2)), "none", rest_field_of(pad)
    )
    options = Options(hidden=HIDDEN // 2 if quick else HIDDEN, presses=TRAINED_ON // 4 if quick else TRAINED_ON)
    target.write_bytes(calibrate("the first pad's presses", known, options, lambda line: None).model)


def first_pad_presses() -> Array:
    """(1800, 3) x, y in mm, force in N."""
    return np.array([[x, y, force] for x in PLACES_MM for y in PLACES_MM for force in FORCES_N])


def _rows(path: Path, name: str, causes: tuple[str, ...], number: int, presses: int, seed: int) -> Iterator[Row]:
    """Every baseline gets the same presses, errors and noise; each single cause has the same error as among all."""
    drawing = replace(standard_pad(REMANENCES_T[0]), name="second")
    made = Made.with_causes(drawing, causes, np.random.default_rng([seed, number]))
    random = np.random.default_rng([seed, number, 1])
    place, force = random.uniform(-14.0, 14.0, (presses, 2)), random.uniform(LIGHTEST_N, FORCES_N[-1], presses)
    press = np.column_stack([place, force])
    fields = [made.field(one, random) for one in press]
    of_baselines = np.random.default_rng([seed, number, 2])
    mountings = recorded.mountings(made.built, drawing, TOLERANCE, of_baselines, made.noise_t)
    mountings[DRAWING] = _as_drawn(drawing, made.built)
    model = ContactModel.load(str(path), standard_pad(), refine=True)
    for baseline, mounting in mountings.items():
        found = np.array([_answer(model, drawing, mounting, field) for field in fields])
        error = np.abs(found - press).mean(axis=0)
        row: Row = {"kind": "test", "baseline": baseline, "causes": name, "pad": number, "presses": presses}
        yield row | dict(zip(ERRORS, error.tolist(), strict=True))


def _training_rows(request: Request) -> Iterator[Row]:
    """The paper's Figure 11: errors of its network during training, on the first pad's grid, one noisy frame each."""
    random, pad = np.random.default_rng(request.seed), standard_pad(REMANENCES_T[0])
    press = first_pad_presses()
    field = pressed_fields(pad, press)
    readings = Readings.of(pad, press, field + random.normal(0.0, NOISE_T, field.shape), rest_field_of(pad))
    for size, trained, left_out in training_curve("BP", INPUTS["pose"](readings), press, request.quick):
        row: Row = {"kind": "training", "case": "BP, pose, 1800 presses", "size": size}
        yield row | {"trained_mse": trained, "left_out_mse": left_out}


def _as_drawn(drawing: Pad, built: MountedPad) -> Mounting:
    """The mounting as in the paper: the ambient field subtracted, and all as drawn except the magnet's strength."""
    bare = built.sensed(np.tile(built.ambient_t, (len(drawing.sensors), 1)))
    rest = recorded.pressed_field(built, 0.0, 0.0, 0.0)
    believed = Tolerance(1e-9, 1e-9, 1e-9, 0.0, TOLERANCE.remanence)
    mounting = estimate_mounting(drawing, believed, _recording(rest), _recording(bare))
    return replace(mounting, offset_t=bare)


def _recording(mean: Array) -> Recording:
    return Recording(mean, np.full(mean.shape, NOISE_T), np.full(len(mean), FRAMES), 3, 25.0, 3.0)


def _answer(model: ContactModel, drawing: Pad, mounting: Mounting, field: Array) -> Array:
    """x, y (mm) and force (N) from one frame, solved with the unknowns of a drifting ambient field."""
    estimate = solve(mounting.magnet_field(field), mounting.mounted(drawing), mounting.rest, free=FREE_FIELD)
    found = model.estimate(*in_nominal_frame(estimate, mounting.rest, drawing, mounting.pad_turn))
    return np.array([found.x_m * 1e3, found.y_m * 1e3, found.force_n])


def _direction(random: np.random.Generator) -> Array:
    vector = random.standard_normal(3)
    return np.asarray(vector / np.linalg.norm(vector), dtype=np.float64)


def _paper() -> dict[str, float]:
    with PAPER_PATH.open(newline="") as file:
        (row,) = (row for row in csv.DictReader(file) if row["test_sensor"] == "Sensor_2")
    return {name: float(row[name]) for name in ERRORS}
