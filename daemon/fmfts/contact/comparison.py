"""Compares the answers of our network with those of onnxruntime, once, when a model is loaded."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmfts.contact.contract import Facts
from fmfts.contact.inference import POSE, NetworkInference

Poses = NDArray[np.float32]
Answers = NDArray[np.float64]

# Random presses, each at several shares of its displacement: near rest the direction changes fast.
RANDOM_POSES = 64
SHARES = (1e-3, 1e-2, 0.1, 0.3, 1.0)
# Both round to 2⁻²⁴ in some 150 additions in a row (two layers of 48, forwards and backwards), in different orders.
# Either differs from double precision by up to 120 × 2⁻²⁴ of the largest answer (default model). They differ from each
# other by up to 500 × 2⁻²⁴ (shear model).
ROUNDING = 4000 * 2.0**-24


def poses_of(facts: Facts) -> Poses:
    """Poses (K, 6) to compare at: rest, the corners of the envelope, and points between them."""
    rest, low, high = (np.array(each) for each in (facts.rest_pose, facts.envelope.pose_min, facts.envelope.pose_max))
    corner = np.array(np.meshgrid(*([0.0, 1.0],) * 5)).reshape(5, -1).T
    random = np.random.default_rng(0).uniform(size=(RANDOM_POSES, 5))
    reached = np.concatenate([corner, random])
    ends = np.column_stack([low[:5] + reached * (high - low)[:5], np.full(len(reached), rest[5])])
    between = [rest + share * (ends - rest) for share in SHARES]
    return np.concatenate([rest[None], *between]).astype(np.float32)


def difference(compiled: NetworkInference, wanted: Answers, facts: Facts) -> str | None:
    """Describes how the network differs from `wanted`, onnxruntime's answers; None if it is only rounding."""
    found = answers(compiled, poses_of(facts))
    for name, part in (("contact", slice(0, 1)), ("Jacobian", slice(1, None))):
        one, other = found[:, :, part], wanted[:, :, part]
        # In units of the largest answer of each output, and of its slope by each component.
        error = np.abs(one - other) / np.maximum(np.abs(other).max(axis=0), np.finfo(np.float32).tiny)
        if not error.max() <= ROUNDING:
            return (
                f"its {name} differs from onnxruntime's by {error.max():.1e} of the largest, rounding by {ROUNDING:.0e}"
            )
    return None


def answers(inference: NetworkInference, poses: Poses) -> Answers:
    """Answers (K, outputs, 1 + 6) of `inference`: the contact, then its Jacobian."""
    found = np.empty((len(poses), len(inference.contact), 1 + POSE))
    for pose, answer in zip(poses, found, strict=True):
        inference.pose[:] = pose
        inference.run()
        answer[:, 0], answer[:, 1:] = inference.contact, inference.jacobian
    return found
