"""Makes a contact model and its report from a calibration set."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from fmfts.contact.contract import (
    CONTRACT_VERSION,
    INPUT_ORDER,
    OUTPUT_ORDER,
    Envelope,
    ErrorTables,
    Facts,
)
from fmfts.contact.response import Response
from fmfts.contact.seal import hash_of, unsealed
from fmfts.pad import Array
from fmfts.sensor.chips import NOISE_T
from fmfts.view.progress import Show, unseen
from fmfts_calibrate.dataset import CalibrationSet
from fmfts_calibrate.evaluation import (
    Row,
    firm_and_central,
    force_bins,
    metrics,
    own_error,
    rounded,
    rows,
    tables_of_squares,
)
from fmfts_calibrate.export import export, packed_weights
from fmfts_calibrate.field_table import DataError
from fmfts_calibrate.labelled_poses import LabelledPoses, Say, solver_of
from fmfts_calibrate.network import ContactNetwork, train_network
from fmfts_calibrate.samples import Samples, presses_in_bins, presses_within
from fmfts_calibrate.selection import FOLDS, WORTH_THE_TIME, Candidate, compare, smallest_within_noise
from fmfts_calibrate.sheared import ShearedResponse
from fmfts_calibrate.sweep import Workers
from fmfts_calibrate.tracked import FrameSolver, Scene

COMPARING, TRAINED = 0.6, 0.9  # shares of the time
PRESSES, HELD_OUT, NOISY_COPIES = 20000, 12000, 4
JUDGED_IN_A_BIN = 1500  # samples in each bin of force
# The error that shear causes in a model without it is told of presses this near: beyond, few sets have sheared ones.
SHEAR_TRAINED_MM = 10.5
RULE = (
    f"chosen: the smallest network within {WORTH_THE_TIME:.0%} of the best one, or within what the folds differ by;\n"
    "the daemon runs networks alone: the inversion of the table shows what is possible, and is never chosen"
)
SMALL_SHEAR = 0.1  # share of the normal force; its effect is still proportional


@dataclass(frozen=True, slots=True)
class Options:
    """scene: sets the unknowns of the pad's tracker. hidden: size of the layers; None: by k-fold selection. presses:
    number of training presses. shear: also estimate tangential force. workers: where folds are
    computed."""

    scene: Scene = "drifting"
    noise_t: float = NOISE_T
    hidden: int | None = None
    presses: int = PRESSES
    shear: bool = False
    workers: Workers = field(default_factory=Workers)


@dataclass(frozen=True, slots=True)
class Calibrated:
    """model: the ONNX file; report: facts for people and programs."""

    model: bytes
    report: dict[str, Any]


def calibrate(
    path: str,
    calibration: CalibrationSet,
    options: Options,
    say: Say,
    sheared: tuple[str, CalibrationSet] | None = None,
    show: Show = unseen,
) -> Calibrated:
    """Make a model. path: names the set in errors. show: takes the share of the work that is done.

    sheared: (path, set) of the same pad with shear, from which a model of three outputs gets its error by shear, if
    `calibration` has no shear. Raises DataError for a field that is not of this pad.
    """
    with threadpool_limits(1):  # gives the same file with any number of cores, and leaves the others free
        return _calibrated(path, calibration, options, say, sheared, show)


def _calibrated(
    path: str,
    calibration: CalibrationSet,
    options: Options,
    say: Say,
    sheared: tuple[str, CalibrationSet] | None,
    show: Show,
) -> Calibrated:
    if options.shear:
        _require_shear(*(sheared or (path, calibration)))
    if not calibration.press[:, 3:].any():
        calibration = replace(calibration, press=calibration.press[:, :3])
    elif not options.shear and calibration.press[:, 3:].any(axis=1).all():
        raise DataError(
            f"{path}: columns shear_x_n, shear_y_n: every row has shear, so none shows the effect of a normal press: "
            "add presses without shear, or make a model that estimates it (--shear)"
        )
    known = _labelled_poses(path, calibration, options, say)
    solver, tracked = known.solver, known.tracked
    response = known.response.without_shear()
    if sheared is not None and not options.shear:
        known_shear = _labelled_poses(sheared[0], _where_shear_can_be_told(*sheared), options, say)
    else:
        known_shear = known
    hidden, candidates = options.hidden, list[Candidate]()
    if hidden is None:
        say(f"comparing networks on left-out presses, in {FOLDS} folds: a minute or two of one core")
        candidates = compare(
            solver,
            calibration.press,
            tracked,
            known.roughness,
            workers=options.workers,
            done=lambda folds: show(COMPARING * folds / FOLDS, f"{folds} of {FOLDS} folds compared"),
        )
        chosen = smallest_within_noise(candidates)
        hidden = chosen.hidden
        assert hidden is not None
        say(selection_table(candidates, chosen))
    say(f"training two layers of {hidden} on {options.presses} presses with noise")
    begun = 0.0 if options.hidden else COMPARING
    network = train(
        response, solver, hidden, options.presses, lambda share: show(begun + (TRAINED - begun) * share, "training")
    )
    show(TRAINED, "judging")
    normal = _rows_for(response, calibration.press)
    with_noise, firm_and_central_errors = _on_new_presses(network, response, solver)
    facts = describe(known, response, network, None if options.shear else friction_error(network, known_shear))
    if options.shear:
        of_shear = ShearedResponse.of(known, sheared, options.noise_t, say)
        response, facts = of_shear.response, of_shear.stated_in(facts, solver)
    model = export(network, facts, response)
    judged = calibration.press[normal, :3]
    report = {
        "model": hash_of(unsealed(model), packed_weights(network)),
        "calibration_set_sha256": calibration.digest,
        "sheared_set_sha256": None if sheared is None else sheared[1].digest,
        "presses": len(calibration.press),
        "remanence_t": rounded(solver.remanence_t),
        "scene": options.scene,
        "noise_ut": facts.noise_ut,
        "hidden": hidden,
        "parameters": network.layers.parameters,
        "file_bytes": len(model),
        "roughness": known.roughness,
        "left_out_in_deviations": rounded(known.left_out.in_deviations),
        "on_the_calibration_set": rows(judged, network(tracked.pose[normal])),
        "on_new_presses_with_noise": with_noise,
        "firm_and_central": firm_and_central_errors,
        "friction_error": msgspec.to_builtins(facts.friction_error),
        "compared": [candidate.facts() for candidate in candidates],
    }
    return Calibrated(model, report)


def _labelled_poses(path: str, calibration: CalibrationSet, options: Options, say: Say) -> LabelledPoses:
    return LabelledPoses.of(path, calibration, solver_of(calibration, options.scene, options.noise_t), say)


def _require_shear(path: str, calibration: CalibrationSet) -> None:
    if calibration.press.shape[1] == 3 or not calibration.press[:, 3:].any():
        raise DataError(f"{path}: no row has shear: a model that estimates it needs columns shear_x_n and shear_y_n")


def _where_shear_can_be_told(path: str, calibration: CalibrationSet) -> CalibrationSet:
    """The presses within SHEAR_TRAINED_MM. Raises DataError where none has shear."""
    _require_shear(path, calibration)
    inside = np.flatnonzero((np.abs(calibration.press[:, :2]) <= SHEAR_TRAINED_MM).all(axis=1))
    return replace(
        calibration,
        press=calibration.press[inside],
        field_t=calibration.field_t[inside],
        bound_t=None if calibration.bound_t is None else calibration.bound_t[inside],
        line=tuple(calibration.line[row] for row in inside),
    )


def _rows_for(response: Response, press: Array) -> NDArray[np.bool_]:
    """(K,) whether the response's loads describe each press: those without shear, or all if the response has shear."""
    if response.loads > 1:
        return np.ones(len(press), dtype=np.bool_)
    return np.asarray((press[:, 3:] == 0.0).all(axis=1), dtype=np.bool_)


def friction_error(network: ContactNetwork, known: LabelledPoses) -> ErrorTables | None:
    """Error per newton of shear in the answers of a network without shear, averaged over directions.

    None where `known` has no shear.
    """
    fitted, solver = known.response, known.solver
    if fitted.loads == 1:
        return None
    bins = force_bins(fitted.scale_n)
    press = presses_in_bins(fitted.without_shear(), bins, JUDGED_IN_A_BIN // 3, np.random.default_rng(6))
    press = press[press[:, 2] > 0.0]
    still = Samples.expected(fitted, solver, np.column_stack([press, np.zeros((len(press), 2))]))
    # Shear proportional to the force, like friction: the estimated place depends on the direction of the whole load.
    shear_n = SMALL_SHEAR * press[:, 2:]
    errors = []
    for direction in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)):
        moved = Samples.expected(fitted, solver, np.column_stack([press, shear_n * direction]))
        errors.append((network(moved.pose) - network(still.pose)) / shear_n)
    return tables_of_squares(bins, np.tile(press, (len(errors), 1)), np.concatenate(errors) ** 2)


def train(
    response: Response,
    solver: FrameSolver,
    hidden: int,
    presses: int,
    done: Callable[[float], None] = lambda _: None,
) -> ContactNetwork:
    """Train a network on `presses` noisy single frames of the response. The same response gives the same network.

    done: takes the share of the steps that are taken.
    """
    random = np.random.default_rng(1)
    clean = Samples.expected(response, solver, presses_within(response, presses, random))
    return train_network(clean.noisy(1, random), solver.rest_pose, hidden, done=done)


def describe(known: LabelledPoses, response: Response, network: ContactNetwork, friction: ErrorTables | None) -> Facts:
    """The facts that a model's file contains. response: the known response, or its part without shear."""
    calibration, solver, tracked = known.calibration, known.solver, known.tracked
    normal = _rows_for(response, calibration.press)
    press, rest = calibration.press[:, :3], solver.rest_pose
    poses = np.concatenate([tracked.pose, rest[None]])
    random = np.random.default_rng(5)
    bins = force_bins(response.scale_n)
    clean = Samples.expected(response, solver, presses_in_bins(response, bins, JUDGED_IN_A_BIN, random))
    first, last = press[:, :2].min(axis=0), press[:, :2].max(axis=0)
    return Facts(
        contract=CONTRACT_VERSION,
        geometry_hash=calibration.pad.geometry_hash,
        dimensions=calibration.pad.dimensions,
        inputs=INPUT_ORDER,
        outputs=OUTPUT_ORDER,
        rest_pose=tuple(rest.tolist()),
        envelope=Envelope(
            pose_min=tuple(poses.min(axis=0).tolist()),
            pose_max=tuple(poses.max(axis=0).tolist()),
            force_max_n=float(press[:, 2].max()),
            x_mm=(float(first[0]), float(last[0])),
            y_mm=(float(first[1]), float(last[1])),
        ),
        own_error=own_error(network, clean, clean.noisy(NOISY_COPIES, random), bins),
        response_error=known.left_out.error(response, clean, bins),
        friction_error=friction,
        metrics=metrics(press[normal], network(tracked.pose[normal])),
        scene=solver.scene,
        noise_ut=solver.noise_t * 1e6,
        data=calibration.digest,
        made_by="fmfts-daemon calibrate",
    )


def selection_table(candidates: list[Candidate], chosen: Candidate) -> str:
    """A table of each candidate's error on left-out presses, also relative to the chosen one."""
    lines = ["                       parameters  error in bounds  against the chosen"]
    for one in candidates:
        mark = "  <- chosen" if one is chosen else ""
        gain = one.mean / chosen.mean - 1.0
        lines.append(f"{one.name:22} {one.parameters:10d} {one.mean:16.3f} {gain:+18.1%}{mark}")
    lines.append(RULE)
    return "\n".join(lines)


def _on_new_presses(network: ContactNetwork, response: Response, solver: FrameSolver) -> tuple[list[Row], str]:
    random = np.random.default_rng(7)
    clean = Samples.expected(response, solver, presses_within(response, HELD_OUT, random, beyond=1.0))
    noisy = clean.noisy(1, random)
    found = network(noisy.pose)
    return rows(noisy.press, found), firm_and_central(noisy.press, found)
