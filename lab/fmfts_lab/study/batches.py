"""How much time batches save: the same solves and inferences in batches of 1 and 64."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from fmfts.contact.session import session_of
from fmfts.contact.shipped import path_of
from fmfts.contact.verified import read
from fmfts.pose import STOP_CHI2
from fmfts.pose.problem import MAX_ITERATIONS
from fmfts_lab.bench.speed import MOVED_M, MOVED_RAD
from fmfts_lab.bench.workspace import batch_of, displaced, in_workspace, readings
from fmfts_lab.study.harness import Request, Row
from fmfts_lab.study.timing import timed

SIZES = (1, 64)
REPEATS = 400


def batch_rows(request: Request) -> list[Row]:
    """Time per frame of the kernel and of the shipped network, for each size."""
    random, pad = np.random.default_rng(request.seed), request.pad.pad()
    session = session_of(read(path_of(request.pad.contact.model)))
    rest_pose = np.append(pad.rest_position_m * 1e3, pad.rest_axis)
    rows = []
    for size in SIZES:
        poses = in_workspace(size, random)
        fields = readings(poses, pad, random)
        for unknowns in (6, 8):
            batch = batch_of(fields, pad, unknowns, False, displaced(poses, MOVED_M, MOVED_RAD, random))
            rows.append(
                _row(f"kernel, {unknowns} unknowns", size, lambda _, b=batch: b.solve(STOP_CHI2, MAX_ITERATIONS))
            )
        inputs = {"pose": np.tile(rest_pose, (size, 1)).astype(np.float32)}
        rows.append(_row("shipped ONNX", size, lambda _, i=inputs, s=session: s.run(None, i)))
    return rows


def _row(name: str, size: int, call: Callable[..., Any]) -> Row:
    _, cost = timed(call, [None] * REPEATS, lambda result: None)
    return {
        "chart": "batch",
        "method": name,
        "batch": size,
        "median_us": round(cost.median_us / size, 3),
        "p99_us": round(cost.p99_us / size, 3),
    }
