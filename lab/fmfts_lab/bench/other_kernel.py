"""Compares the speed of another build of the kernel with this one: `bench speed --beside OTHER/_kernel.abi3.so`.

Both solve the same batch by turns, so that other work of the computer delays both alike.
"""

from __future__ import annotations

from importlib.machinery import ExtensionFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from time import process_time_ns
from types import ModuleType

import numpy as np

from fmfts.pose import STOP_CHI2, Batch, kernel
from fmfts.pose.problem import MAX_ITERATIONS

TURNS = 600


def loaded(path: Path) -> ModuleType:
    """Load a kernel from its file. ImportError if the file is no kernel."""
    loader = ExtensionFileLoader("_kernel", str(path))
    spec = spec_from_loader("_kernel", loader)
    assert spec is not None
    module = module_from_spec(spec)
    loader.exec_module(module)
    return module


def ratio(batch: Batch, other: ModuleType) -> tuple[float, float]:
    """Time of this kernel divided by the other's: for the fastest turn of each, and the median over pairs of turns."""
    own, taken = vars(kernel)["_kernel"], np.empty((TURNS, 2))
    try:
        for turn in range(TURNS):
            for which in (turn % 2, 1 - turn % 2):
                vars(kernel)["_kernel"] = (own, other)[which]
                begun = process_time_ns()
                batch.solve(STOP_CHI2, MAX_ITERATIONS)
                taken[turn, which] = process_time_ns() - begun
    finally:
        vars(kernel)["_kernel"] = own
    fastest = taken.min(axis=0)
    return float(fastest[0] / fastest[1]), float(np.median(taken[:, 0] / taken[:, 1]))
