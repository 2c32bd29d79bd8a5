"""Evaluates a contact model for one pose at a time, in buffers that are allocated once."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from fmfts.contact import _contact

POSE = 6


class Inference(ABC):
    """Write `pose` (6,), call run(), then read `contact` (m,) and `jacobian` (m, 6): float32, in the model's units.

    by: what evaluates the model: "compiled" or "onnxruntime".

    It takes no batches: in a batch, onnxruntime rounds each row differently. What a pad publishes would then depend on
    when frames of other pads arrive, and a recording could not be replayed bit by bit.
    """

    by: str

    def __init__(self, outputs: int) -> None:
        self.pose = np.zeros(POSE, dtype=np.float32)
        self.contact = np.zeros(outputs, dtype=np.float32)
        self.jacobian = np.zeros((outputs, POSE), dtype=np.float32)

    @property
    def for_c(self) -> bytes | Inference:
        """The model for C: the weights of a known network, or an object with run()."""
        return self

    @abstractmethod
    def run(self) -> None: ...


class NetworkInference(Inference):
    """Evaluates a graph that `calibrate` writes. network: its weights, as network.h describes them."""

    def __init__(self, network: NDArray[np.float32]) -> None:
        super().__init__(outputs=int(network[1]))
        self.network = network.tobytes()

    @property
    def for_c(self) -> bytes:
        return self.network


class CompiledInference(NetworkInference):
    """Runs network.c."""

    by = "compiled"

    def __init__(self, network: NDArray[np.float32]) -> None:
        super().__init__(network)
        self._buffers = self.pose.data, self.contact.data, self.jacobian.ravel().data
        self.run()

    def run(self) -> None:
        _contact.infer(self.network, *self._buffers)
