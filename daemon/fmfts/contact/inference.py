"""One pose in, the contact and its Jacobian out, through buffers that are made once."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

try:
    from fmfts.contact import _network
except ImportError:  # no compiler was there when the package was built
    _network = None  # type: ignore[assignment]

POSE = 6
# FMFTS_SOLVER=numpy leaves everything compiled aside, for comparisons.
AVAILABLE = _network is not None and os.environ.get("FMFTS_SOLVER") != "numpy"
LARGEST_HIDDEN = 256  # network.h; onnxruntime evaluates larger ones


class Inference(ABC):
    """Write `pose` (6,), `run`, read `contact` (m,) and `jacobian` (m, 6): float32, in the model's units.

    by: what evaluates it, "compiled", "numpy" (its reference) or "onnxruntime".

    One pose at a time: onnxruntime rounds differently in a batch, by the row's place in it, and what a pad publishes
    would depend on when other pads' frames happened to arrive. A recording could not be replayed bit by bit.
    """

    by: str

    def __init__(self, outputs: int) -> None:
        self.pose = np.zeros(POSE, dtype=np.float32)
        self.contact = np.zeros(outputs, dtype=np.float32)
        self.jacobian = np.zeros((outputs, POSE), dtype=np.float32)

    @abstractmethod
    def run(self) -> None: ...


class NetworkInference(Inference):
    """Of a graph that `calibrate` writes. network: its weights, see recognition.py; ValueError where it is none."""

    def __init__(self, network: NDArray[np.float32]) -> None:
        super().__init__(outputs=int(network[1]))
        self.network = network.tobytes()


class CompiledInference(NetworkInference):
    """network.c."""

    by = "compiled"

    def __init__(self, network: NDArray[np.float32]) -> None:
        super().__init__(network)
        self._buffers = self.pose.data, self.contact.data, self.jacobian.ravel().data
        self.run()

    def run(self) -> None:
        _network.infer(self.network, *self._buffers)
