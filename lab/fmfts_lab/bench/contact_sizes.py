"""How large must a contact network be? Errors on the paper's presses in three folds, and the cost of each size."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from fmfts.contact import ContactModel
from fmfts.sensor.chips import NOISE_T
from fmfts_calibrate.evaluation import rounded
from fmfts_calibrate.export import export
from fmfts_calibrate.fitting import best_roughness
from fmfts_calibrate.labelled_poses import solved, solver_of
from fmfts_calibrate.levenberg import Layers
from fmfts_calibrate.network import ContactNetwork
from fmfts_calibrate.selection import HIDDEN, PRESSES, Candidate, compare, smallest_within_noise
from fmfts_lab.bench.workspace import standard_pad
from fmfts_lab.calibration.standard_set import standard_set

LARGER = (28, 32)  # `calibrate` does not try these: they gain nothing, and take as long as all the others
RUNS = 2000


def sizes(hidden: tuple[int, ...] = (*HIDDEN, *LARGER), presses: int = PRESSES) -> dict[str, Any]:
    """Every candidate's error on left-out presses; for networks also parameters, file size and processor time."""
    calibration = standard_set()
    solver = solver_of(calibration, "drifting", NOISE_T)
    tracked = solved("the standard set", calibration, solver)
    change = tracked.pose[:, :5] - solver.rest_pose[:5]
    roughness = best_roughness(calibration.press, change, tracked.deviation)
    candidates = compare(solver, calibration.press, tracked, roughness, hidden, presses)
    chosen = smallest_within_noise(candidates)
    plain = ContactModel.load("default", standard_pad(), refine=True)
    print("on left-out presses, errors in bounds; against the chosen; processor time of an inference")
    print(f"  {'':22} {'parameters':>10} {'error':>8} {'folds ±':>8} {'':>8} {'bytes':>8} {'µs':>6}")
    facts: dict[str, Any] = {"chosen": chosen.name}
    for one in candidates:
        facts[one.name] = one.facts() | {"folds_deviation": rounded(one.score.std(ddof=1))}
        costs = ""
        if one.hidden is not None:
            size, microseconds = cost(one.hidden, plain)
            facts[one.name] |= {"file_bytes": size, "inference_us": microseconds}
            costs = f" {size:8d} {microseconds:6.2f}"
        mark = "  <- chosen" if one is chosen else ""
        print(f"  {_line(one, chosen)}{costs}{mark}")
    return facts


def _line(one: Candidate, chosen: Candidate) -> str:
    deviation = float(one.score.std(ddof=1))
    gain = one.mean / chosen.mean - 1.0
    return f"{one.name:22} {one.parameters:10d} {one.mean:8.3f} {deviation:8.3f} {gain:+8.1%}"


def cost(hidden: int, shipped: ContactModel) -> tuple[int, float]:
    """Bytes of the file and µs of an inference; the values of the weights do not matter for them."""
    assert shipped.refiner is not None
    place, force = (Layers.drawn((10, hidden, hidden, outputs), np.random.default_rng(0)) for outputs in (2, 1))
    network = ContactNetwork(shipped.rest_pose, np.ones(5), place.beside(force))
    content = export(network, shipped.facts, shipped.refiner.response)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.onnx"
        path.write_bytes(content)
        model = ContactModel.load(str(path), standard_pad())
    model.inference.pose[:] = shipped.rest_pose
    begun = time.process_time()
    for _ in range(RUNS):
        model.inference.run()
    return len(content), rounded((time.process_time() - begun) / RUNS * 1e6)
