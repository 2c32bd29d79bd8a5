"""The accuracy of calibrations from several tables, on the same held-out presses."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from fmfts.config import PadConfig, SimulatedSource
from fmfts.pad import Array, Pad
from fmfts.sensor.chips import NOISE_T
from fmfts_calibrate.dataset import PAD_SIZE_MM, CalibrationSet, read_calibration_set, read_labelled
from fmfts_calibrate.labelled_poses import LabelledPoses, solver_of
from fmfts_calibrate.likelihood import invert
from fmfts_calibrate.network import train_network
from fmfts_calibrate.samples import Samples, presses_within
from fmfts_calibrate.tracked import Tracked
from fmfts_calibrate.training import PRESSES

FRAMES = 20  # frames of each held-out press, with the noise of single frames
BAR = 1.2  # of ideal data's error


def known(table: Path) -> LabelledPoses:
    """What `calibrate` makes of a table before any training."""
    calibration = read_calibration_set(table, _pad(), PAD_SIZE_MM, None)
    return LabelledPoses.of(str(table), calibration, solver_of(calibration, "drifting", NOISE_T), _mute)


def compare_responses(tables: Mapping[str, Path], held_out: Path) -> None:
    """Through the pad's response alone, inverted by maximum likelihood: without training, so without its scatter."""
    print("the response of each table, inverted: mean absolute errors on held-out presses, and over ideal's")
    errors: dict[str, Array] = {}
    for name, table in tables.items():
        labelled = known(table)
        errors[name] = np.concatenate(
            [
                _mean_error(_inverted(labelled, tracked), press)
                for press, tracked in (_seen(held_out, noisy=noisy) for noisy in (False, True))
            ]
        )
        _tell(name, errors[name], errors["ideal"])


def run_the_verbs(tables: Mapping[str, Path], held_out: Path, config: Path) -> None:
    """`calibrate` and `evaluate` as a person calls them, with their own defaults."""
    print("fmfts-daemon calibrate and evaluate")
    for name, table in tables.items():
        model = _model_of(table)
        if not model.with_suffix(".json").exists():
            _carry_out("calibrate", table, "-o", model, "--config", config)
        found = json.loads(_carry_out("evaluate", held_out, "--model", model, "--config", config, "--json"))
        whole = next(row for row in found["regions"] if row["region"] == "all")
        x, y, force = (whole[f"mae_{what}"] for what in ("x_mm", "y_mm", "force_n"))
        print(f"  {name:18} {x:.4f} mm, {y:.4f} mm, {force:.5f} N; two layers of {_hidden_of(table)}")


def compare_trainings(tables: Mapping[str, Path], held_out: Path, count: int, memory: Path) -> None:
    """The network that `calibrate` makes, trained `count` times from different starts; memory: finished trainings."""
    trained: dict[str, list[list[float]]] = json.loads(memory.read_text()) if memory.exists() else {}
    print(f"networks, each trained {count} times")
    for name, table in tables.items():
        labelled, errors = known(table), trained.setdefault(name, [])
        for seed in range(len(errors), count):
            errors.append(_trained_error(labelled, held_out, _hidden_of(table), seed))
            memory.write_text(json.dumps(trained))
    means = {name: np.mean(errors, axis=0) for name, errors in trained.items()}
    of_mean = {name: np.std(errors, axis=0, ddof=1) / np.sqrt(len(errors)) for name, errors in trained.items()}
    for name in tables:
        _tell(name, means[name], means["ideal"])
    ratio = means["all"] / means["ideal"]
    spread = ratio * np.hypot(*(of_mean[name] / means[name] for name in ("all", "ideal")))
    print("  all over ideal: " + ", ".join(f"{r:.3f} ± {s:.3f}" for r, s in zip(ratio, spread, strict=True)))
    missed = [what for what, value in zip(WHAT, ratio, strict=True) if value > BAR]
    print(f"  bar {BAR:g}: {'missed by ' + ', '.join(missed) if missed else 'held by all'}")


WHAT = [f"{what}, {how}" for how in ("exact fields", "single frames") for what in ("x", "y", "F")]


def _trained_error(labelled: LabelledPoses, held_out: Path, hidden: int, seed: int) -> list[float]:
    random = np.random.default_rng([1, seed])
    response, solver = labelled.response.without_shear(), labelled.solver
    clean = Samples.expected(response, solver, presses_within(response, PRESSES, random))
    network = train_network(clean.noisy(1, random), solver.rest_pose, hidden, seed=seed)
    errors = []
    for noisy in (False, True):
        press, tracked = _seen(held_out, noisy=noisy)
        errors.append(_mean_error(network(tracked.pose), press))
    return [float(error) for error in np.concatenate(errors)]


def _seen(held_out: Path, *, noisy: bool) -> tuple[Array, Tracked]:
    """The held-out presses (K, 3), and their poses, from their own rest as a pad's are from its baseline's."""
    test: CalibrationSet = read_labelled(held_out, _pad(), PAD_SIZE_MM, None)
    press, field_t = test.press[:, :3], test.field_t
    if noisy:
        press, field_t = np.repeat(press, FRAMES, axis=0), np.repeat(field_t, FRAMES, axis=0)
        field_t = field_t + np.random.default_rng(11).normal(0.0, NOISE_T, field_t.shape)
    return press, solver_of(test, "drifting", NOISE_T).solved(field_t)


def _inverted(labelled: LabelledPoses, tracked: Tracked) -> Array:
    change = tracked.pose[:, :5] - labelled.solver.rest_pose[:5]
    return invert(labelled.response.without_shear(), change, tracked.covariance)


def _mean_error(found: Array, press: Array) -> Array:
    error: Array = np.abs(found[:, :3] - press).mean(axis=0)
    return error


def _tell(name: str, error: Array, ideal: Array) -> None:
    for how, part in (("exact fields ", slice(0, 3)), ("single frames", slice(3, 6))):
        x, y, force = error[part]
        over = " ".join(f"{value:6.3f}" for value in error[part] / ideal[part])
        print(f"  {name:18} {how} {x:.4f} mm, {y:.4f} mm, {force:.5f} N; over ideal: {over}", flush=True)


def _model_of(table: Path) -> Path:
    return table.with_suffix(".onnx")


def _hidden_of(table: Path) -> int:
    return int(json.loads(_model_of(table).with_suffix(".json").read_text())["hidden"])


def _carry_out(*words: str | Path) -> str:
    done = subprocess.run([sys.executable, "-m", "fmfts", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{words[0]}: {done.stderr}")
    return done.stdout


def _pad() -> Pad:
    return PadConfig(name="left", source=SimulatedSource()).pad()


def _mute(_: str) -> None:
    """Progress that nobody reads."""
