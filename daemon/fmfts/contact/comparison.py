"""Compares the answers of our network with those of onnxruntime, once, when a model is loaded.

onnxruntime runs in a process that then ends: inside the daemon it would keep 30 MB.
"""

from __future__ import annotations

import struct
import subprocess
import sys

import numpy as np
from numpy.typing import NDArray

from fmfts.common.reading import shortened
from fmfts.contact.contract import Facts
from fmfts.contact.inference import POSE, NetworkInference
from fmfts.contact.operators import require_even

Poses = NDArray[np.float32]

# Random presses, each at several shares of its displacement: near rest the direction changes fast.
RANDOM_POSES = 64
# Nothing is imported from the working directory, which `-c` puts first. Python 3.10 has no -P.
SESSION = "import sys; sys.path = [*filter(None, sys.path)]; from fmfts.contact.session import main; main()"
PROBED_EVERY = 29  # of these poses, by require_modest: from each share, corners and others
SHARES = (1e-3, 1e-2, 0.1, 0.3, 1.0)
# Both round to 2⁻²⁴ in some 150 additions in a row (two layers of 48, forwards and backwards), in different orders.
# Either differs from double precision by up to 120 × 2⁻²⁴ of the largest answer (default model). They differ from each
# other by up to 500 × 2⁻²⁴ (shear model).
ROUNDING = 4000 * 2.0**-24
LONGEST_S = 30.0


class NotComparedError(Exception):
    """onnxruntime gave no answers; the text says why."""


def poses_of(facts: Facts) -> Poses:
    """Poses (K, 6) to compare at: rest, the corners of the envelope, and points between them."""
    rest, low, high = (np.array(each) for each in (facts.rest_pose, facts.envelope.pose_min, facts.envelope.pose_max))
    corner = np.array(np.meshgrid(*([0.0, 1.0],) * 5)).reshape(5, -1).T
    random = np.random.default_rng(0).uniform(size=(RANDOM_POSES, 5))
    reached = np.concatenate([corner, random])
    ends = np.column_stack([low[:5] + reached * (high - low)[:5], np.full(len(reached), rest[5])])
    between = [rest + share * (ends - rest) for share in SHARES]
    return np.concatenate([rest[None], *between]).astype(np.float32)


def difference(compiled: NetworkInference, content: bytes, facts: Facts) -> str | None:
    """Describes the difference; None if it is only rounding. NotComparedError if onnxruntime gives no answers."""
    poses = poses_of(facts)
    wanted = answers_of_onnxruntime(content, poses, len(compiled.contact))
    found = answers(compiled, poses)
    for name, part in (("contact", slice(0, 1)), ("Jacobian", slice(1, None))):
        one, other = found[:, :, part], wanted[:, :, part]
        # In units of the largest answer of each output, and of its slope by each component.
        error = np.abs(one - other) / np.maximum(np.abs(other).max(axis=0), np.finfo(np.float32).tiny)
        if not error.max() <= ROUNDING:
            return (
                f"its {name} differs from onnxruntime's by {error.max():.1e} of the largest, rounding by {ROUNDING:.0e}"
            )
    return None


def answers(inference: NetworkInference, poses: Poses) -> NDArray[np.float64]:
    """Answers (K, outputs, 1 + 6) of `inference`: the contact, then its Jacobian."""
    found = np.empty((len(poses), len(inference.contact), 1 + POSE))
    for pose, answer in zip(poses, found, strict=True):
        inference.pose[:] = pose
        inference.run()
        answer[:, 0], answer[:, 1:] = inference.contact, inference.jacobian
    return found


def answers_of_onnxruntime(content: bytes, poses: Poses, outputs: int) -> NDArray[np.float64]:
    """Like answers(), but from onnxruntime in another process. NotComparedError if that fails."""
    numbers = np.frombuffer(_asked(content, poses), "<f4").astype(np.float64)
    if numbers.size != len(poses) * outputs * (1 + POSE):
        raise NotComparedError(f"it has other outputs than {outputs}")
    return numbers.reshape(len(poses), outputs, 1 + POSE)


def require_modest(content: bytes, facts: Facts) -> None:
    """Let another process evaluate a few poses first: a few bytes of ONNX may ask for any time and memory.

    ValueError: it may take more for other poses. NotComparedError: it takes more than session.py allows, or cannot be
    evaluated at all.
    """
    require_even(content)
    _asked(content, np.concatenate([np.zeros((1, POSE), np.float32), poses_of(facts)[::PROBED_EVERY]]))


def _asked(content: bytes, poses: Poses) -> bytes:
    command = [sys.executable, "-c", SESSION]
    question = struct.pack("<I", len(content)) + content + poses.tobytes()
    try:
        ended = subprocess.run(command, input=question, capture_output=True, timeout=LONGEST_S, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise NotComparedError(f"it did not end: {type(error).__name__}") from error
    if ended.returncode != 0:
        words = ended.stderr.decode(errors="replace").strip().splitlines()
        raise NotComparedError(shortened(words[-1]) if words else f"it ended with {ended.returncode}")
    return ended.stdout
