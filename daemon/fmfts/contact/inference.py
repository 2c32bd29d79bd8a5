"""One inference with buffers that are bound once: what `session.run` costs besides the model is saved."""

from __future__ import annotations

import numpy as np
import onnxruntime

POSE = 6
OUTPUTS = ["contact", "jacobian"]


def last_dimensions(outputs: int) -> dict[str, list[int]]:
    """Of the tensors of a model with so many outputs, without the batch's."""
    return {"pose": [POSE], "contact": [outputs], "jacobian": [outputs, POSE]}


class Inference:
    """Write `pose` (6,), `run`, read `contact` (m,) and `jacobian` (m, 6): float32, in the model's units.

    One pose at a time: onnxruntime rounds differently in a batch, by the row's place in it, and what a pad publishes
    would depend on when other pads' frames happened to arrive. A recording could not be replayed bit by bit.
    """

    def __init__(self, session: onnxruntime.InferenceSession, outputs: int = 3) -> None:
        self.pose = np.zeros(POSE, dtype=np.float32)
        self.contact = np.zeros(outputs, dtype=np.float32)
        self.jacobian = np.zeros((outputs, POSE), dtype=np.float32)
        self._session = session
        self._binding = session.io_binding()
        for name, array in (("pose", self.pose), ("contact", self.contact), ("jacobian", self.jacobian)):
            bind = self._binding.bind_output if name in OUTPUTS else self._binding.bind_input
            bind(name, "cpu", 0, np.float32, [1, *array.shape], array.ctypes.data)

    def run(self) -> None:
        self._session.run_with_iobinding(self._binding)
