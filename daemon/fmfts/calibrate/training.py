"""From a calibration set to a model file and the report beside it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from fmfts.calibrate.dataset import CalibrationSet, rest_field
from fmfts.calibrate.evaluation import metrics, own_error, rounded, rows
from fmfts.calibrate.export import export
from fmfts.calibrate.fitting import best_roughness, fit_response
from fmfts.calibrate.network import ContactNetwork, train_network
from fmfts.calibrate.samples import Samples, presses_within
from fmfts.calibrate.selection import Candidate, compare, smallest_within_noise
from fmfts.calibrate.tracked import FrameSolver, Scene, Tracked, UnsolvedError
from fmfts.contact.contract import (
    CONTRACT_VERSION,
    INPUT_ORDER,
    OUTPUT_ORDER,
    SHEAR_OUTPUT_ORDER,
    Envelope,
    Facts,
)
from fmfts.contact.response import Response
from fmfts.offline.field_table import DataError

NOISE_T = 2e-7
PRESSES, HELD_OUT = 20000, 12000
# A field that leaves more than this unexplained is no field of this pad: noise is 0.2 µT, the dipole's error as much.
LARGEST_RESIDUAL_T = 5e-6
Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Options:
    """scene: what the pad's tracker leaves unknown. hidden: size of the layers; None: k-fold selection decides.
    presses: how many the network is trained on."""

    scene: Scene = "drifting"
    noise_t: float = NOISE_T
    hidden: int | None = None
    presses: int = PRESSES


@dataclass(frozen=True, slots=True)
class Calibrated:
    """model: the ONNX file; report: facts for people and programs."""

    model: bytes
    report: dict[str, Any]


def calibrate(path: str, calibration: CalibrationSet, options: Options, say: Say) -> Calibrated:
    """`path` names the set in errors. DataError: a field that is none of this pad's."""
    solver = FrameSolver(calibration.pad, rest_field(calibration), options.scene, options.noise_t)
    say(f"solving {len(calibration.press)} poses; magnet of {solver.remanence_t:.4f} T")
    tracked = solved(path, calibration, solver)
    change = tracked.pose[:, :5] - solver.rest_pose[:5]
    say("fitting the pad's response")
    roughness = best_roughness(calibration.press, change, tracked.deviation)
    response = fit_response(calibration.press, change, tracked.deviation, roughness)
    candidates: list[Candidate] = []
    hidden = options.hidden
    if hidden is None:
        say("comparing networks on left-out presses")
        candidates = compare(solver, calibration.press, tracked, roughness)
        chosen = smallest_within_noise(candidates)
        hidden = chosen.hidden
        assert hidden is not None
        say(selection_table(candidates, chosen))
    say(f"training two layers of {hidden} on {options.presses} presses with noise")
    network = train(response, solver, hidden, options.presses)
    facts = describe(calibration, solver, tracked, response, network)
    model = export(network, facts, response)
    found = network(tracked.pose)
    report = {
        "model": hashlib.sha256(model).hexdigest()[:12],
        "calibration_set_sha256": calibration.digest,
        "presses": len(calibration.press),
        "remanence_t": rounded(solver.remanence_t),
        "scene": options.scene,
        "noise_ut": facts.noise_ut,
        "hidden": hidden,
        "parameters": network.layers.parameters,
        "file_bytes": len(model),
        "roughness": roughness,
        "on_the_calibration_set": rows(calibration.press, found),
        "on_new_presses_with_noise": _on_new_presses(network, response, solver),
        "compared": [candidate.facts() for candidate in candidates],
    }
    return Calibrated(model, report)


def solved(path: str, calibration: CalibrationSet, solver: FrameSolver) -> Tracked:
    """The set's poses. DataError names the row that no magnet of this pad explains."""

    def refusal(row: int, left: str) -> DataError:
        return DataError(
            f"{path}: row {calibration.line[row]}, columns b1x_ut …: no magnet of this pad explains the field{left}: "
            "are the sensors in the config's order, is the ambient field subtracted?"
        )

    try:
        tracked = solver.solved(calibration.field_t)
    except UnsolvedError as error:
        raise refusal(error.row, "") from error
    worst = int(np.argmax(tracked.residual_t))
    if not tracked.residual_t[worst] <= LARGEST_RESIDUAL_T:
        raise refusal(worst, f" ({tracked.residual_t[worst] * 1e6:.1f} µT are left)")
    return tracked


def train(response: Response, solver: FrameSolver, hidden: int, presses: int) -> ContactNetwork:
    """The network on `presses` noisy single frames of the response; the same for the same response."""
    random = np.random.default_rng(1)
    clean = Samples.expected(response, solver, presses_within(response, presses, random))
    return train_network(clean.noisy(1, random), solver.rest_pose, hidden)


def describe(
    calibration: CalibrationSet, solver: FrameSolver, tracked: Tracked, response: Response, network: ContactNetwork
) -> Facts:
    """What the model says of itself."""
    press, rest = calibration.press, solver.rest_pose
    poses = np.concatenate([tracked.pose, rest[None]])
    held_out = presses_within(response, HELD_OUT, np.random.default_rng(5), beyond=1.0)
    return Facts(
        contract=CONTRACT_VERSION,
        geometry_hash=calibration.pad.geometry_hash,
        inputs=INPUT_ORDER,
        outputs=OUTPUT_ORDER if press.shape[1] == 3 else SHEAR_OUTPUT_ORDER,
        rest_pose=tuple(rest.tolist()),
        envelope=Envelope(
            pose_min=tuple(poses.min(axis=0).tolist()),
            pose_max=tuple(poses.max(axis=0).tolist()),
            force_max_n=float(press[:, 2].max()),
            x_mm=(float(press[:, 0].min()), float(press[:, 0].max())),
            y_mm=(float(press[:, 1].min()), float(press[:, 1].max())),
        ),
        own_error=own_error(network, Samples.expected(response, solver, held_out)),
        friction_error=None,
        metrics=metrics(press, network(tracked.pose)),
        scene=solver.scene,
        noise_ut=solver.noise_t * 1e6,
        data=calibration.digest,
        made_by="fmfts-daemon calibrate",
    )


def selection_table(candidates: list[Candidate], chosen: Candidate) -> str:
    """What each candidate reached on left-out presses, and what a larger one than the chosen would gain."""
    lines = ["                       parameters  error in bounds  against the chosen"]
    for one in candidates:
        mark = "  <- chosen" if one is chosen else ""
        gain = one.mean / chosen.mean - 1.0
        lines.append(f"{one.name:22} {one.parameters:10d} {one.mean:16.3f} {gain:+18.1%}{mark}")
    return "\n".join(lines)


def _on_new_presses(network: ContactNetwork, response: Response, solver: FrameSolver) -> list[dict[str, float | str]]:
    random = np.random.default_rng(7)
    clean = Samples.expected(response, solver, presses_within(response, HELD_OUT, random, beyond=1.0))
    noisy = clean.noisy(1, random)
    return rows(noisy.press, network(noisy.pose))
