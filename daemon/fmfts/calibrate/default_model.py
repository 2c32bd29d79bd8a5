"""Make the contact model that ships, with a report of how good it is.

    python -m fmfts.calibrate.default_model [tests/data/calibration_1.23T.csv [OUTPUT.onnx]]

The envelope comes from the calibration set and rest. The training presses lie between its points, on the mechanical
response fitted to it (fmfts.simulate.mechanics), with the noise of single frames; they go on to TRAINED_FORCE_N so that
the predicted force keeps rising where the daemon has to say "over range".
"""

from __future__ import annotations

import hashlib
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from fmfts.calibrate.dataset import CalibrationSet, read_calibration_set
from fmfts.calibrate.evaluation import Row, evaluate, own_error, summary
from fmfts.calibrate.export import export
from fmfts.calibrate.network import Layers, Problem, features
from fmfts.calibrate.samples import Samples
from fmfts.contact.contract import CONTRACT_VERSION, INPUT_ORDER, OUTPUT_ORDER, Envelope, Facts
from fmfts.contact.model import DEFAULT_PATH
from fmfts.pad import Array, Pad

TRAINED_FORCE_N = 2.6
PRESSES, COPIES, HELD_OUT = 15000, 3, 3000
# Errors below these are not worth a network's effort: x, y in mm, force in N.
WORTHWHILE = (0.1, 0.02)


def main(arguments: list[str]) -> int:
    source = Path(arguments[0] if arguments else "tests/data/calibration_1.23T.csv")
    target = Path(arguments[1]) if len(arguments) > 1 else DEFAULT_PATH
    calibration = read_calibration_set(source)
    pad = calibration.pad
    rest_pose = np.concatenate([pad.rest_position_m * 1e3, pad.rest_axis])
    print("solving simulated presses …", file=sys.stderr)
    table, envelope = _envelope(calibration, rest_pose)
    layers, errors = _train(pad, rest_pose)

    def predict(pose: Array) -> Array:
        return layers(features(pose, rest_pose))

    facts = Facts(
        contract=CONTRACT_VERSION,
        geometry_hash=pad.geometry_hash,
        inputs=INPUT_ORDER,
        outputs=OUTPUT_ORDER,
        rest_pose=tuple(rest_pose.tolist()),
        envelope=envelope,
        own_error=own_error(predict, Samples.drawn(pad, 4 * HELD_OUT, envelope.force_max_n, seed=5)),
        metrics=summary(predict, table),
        made_by="fmfts.calibrate.default_model",
    )
    model = export(layers, facts)
    target.write_bytes(model)
    rows = list(evaluate(pad, predict))
    report = {
        "model": hashlib.sha256(model).hexdigest()[:12],
        "calibration_set": source.name,
        "on_the_calibration_set": facts.metrics,
        "held_out_error_per_chunk": errors,
        "off_the_grid": rows,
    }
    target.with_suffix(".json").write_text(json.dumps(report, indent=1) + "\n")
    print(_printed(rows))
    return 0


def _envelope(calibration: CalibrationSet, rest_pose: Array) -> tuple[Samples, Envelope]:
    """The calibration set's own poses, and the box around them and rest."""
    table = Samples.solved(
        calibration.pad, (calibration.x_m, calibration.y_m, calibration.force_n), calibration.field_t
    )
    poses = np.concatenate([table.pose, rest_pose[None]])
    return table, Envelope(
        pose_min=tuple(poses.min(axis=0).tolist()),
        pose_max=tuple(poses.max(axis=0).tolist()),
        force_max_n=float(calibration.force_n.max()),
        x_mm=(float(calibration.x_m.min() * 1e3), float(calibration.x_m.max() * 1e3)),
        y_mm=(float(calibration.y_m.min() * 1e3), float(calibration.y_m.max() * 1e3)),
    )


def _train(pad: Pad, rest_pose: Array) -> tuple[Layers, dict[str, list[float]]]:
    """One network for the place, one for the force, side by side; their held-out errors."""
    random = np.random.default_rng(1)
    unloaded = np.zeros(PRESSES // 10)
    at_rest = Samples.pressed(pad, (unloaded, unloaded, unloaded), random, 0.0, pad.magnet).repeated(COPIES, random)
    noisy, bound = _noisy(Samples.drawn(pad, PRESSES, TRAINED_FORCE_N, seed=2), random)
    judged, judged_bound = _noisy(Samples.drawn(pad, HELD_OUT, TRAINED_FORCE_N, seed=3), random)

    def place_weight(bound: Array) -> Array:
        return _weight(np.sqrt((bound[:, 0] ** 2 + bound[:, 1] ** 2) / 2.0), WORTHWHILE[0])

    inputs, judged_inputs = features(noisy.pose, rest_pose), features(judged.pose, rest_pose)
    place = Problem(
        inputs, _place(noisy), place_weight(bound),
        judged_inputs, _place(judged), place_weight(judged_bound),
    )  # fmt: skip
    # The bound of the force is that of a press at an unknown place; at rest it would be infinite.
    force_weight = _weight(np.minimum(bound[:, 2], 0.5), WORTHWHILE[1])
    force = Problem(
        np.concatenate([inputs, features(at_rest.pose, rest_pose)]),
        np.concatenate([noisy.force_n, at_rest.force_n])[:, None],
        np.concatenate([force_weight, np.full(len(at_rest.force_n), force_weight.max() / 2.0)]),
        judged_inputs, judged.force_n[:, None], _weight(np.minimum(judged_bound[:, 2], 0.5), WORTHWHILE[1]),
    )  # fmt: skip
    print("training two networks …", file=sys.stderr)
    with ProcessPoolExecutor(2) as workers:
        (place_layers, place_errors), (force_layers, force_errors) = workers.map(Problem.train, [place, force])
    return place_layers.beside(force_layers), {"place_mm": place_errors, "force_n": force_errors}


def _noisy(samples: Samples, random: np.random.Generator) -> tuple[Samples, Array]:
    return samples.repeated(COPIES, random), np.repeat(samples.bound(), COPIES, axis=0)


def _place(samples: Samples) -> Array:
    return np.stack([samples.x_m, samples.y_m], axis=1) * 1e3


def _weight(bound: Array, worthwhile: float) -> Array:
    weight = 1.0 / (bound**2 + worthwhile**2)
    scaled: Array = weight / weight.mean()
    return scaled


def _printed(rows: list[Row]) -> str:
    """The rows of the evaluation as a table."""
    columns = list(rows[0])
    lines = [columns, *([str(row[column]) for column in columns] for row in rows)]
    return "\n".join(" ".join(cell.rjust(12) for cell in line) for line in lines)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
