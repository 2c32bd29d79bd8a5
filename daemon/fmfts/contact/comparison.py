"""Does the compiled network answer as onnxruntime does? Asked once, when a model is loaded.

onnxruntime answers in a process of its own, which ends with it: it would keep 30 MB in the daemon for nothing.
"""

from __future__ import annotations

import struct
import subprocess
import sys

import numpy as np
from numpy.typing import NDArray

from fmfts.contact.contract import Facts
from fmfts.contact.inference import POSE, NetworkInference

Poses = NDArray[np.float32]

# Presses in between are drawn, each with all shares of its displacement: near rest the direction turns fast.
DRAWN = 64
SHARES = (1e-3, 1e-2, 0.1, 0.3, 1.0)
# Both round to 2⁻²⁴ at each of some 150 additions in a row (two layers of 48, forwards and backwards), in different
# orders. Of double precision either is up to 120 × 2⁻²⁴ of the largest answer away, for the model that ships; of each
# other they are up to 500 × 2⁻²⁴, for the one that tells shear.
ROUNDING = 4000 * 2.0**-24
LONGEST_S = 30.0


class NotComparedError(Exception):
    """onnxruntime gave no answer; the text says why."""


def poses_of(facts: Facts) -> Poses:
    """(K, 6): rest, the corners of the envelope, and what is in between."""
    rest, low, high = (np.array(each) for each in (facts.rest_pose, facts.envelope.pose_min, facts.envelope.pose_max))
    corner = np.array(np.meshgrid(*([0.0, 1.0],) * 5)).reshape(5, -1).T
    drawn = np.random.default_rng(0).uniform(size=(DRAWN, 5))
    reached = np.concatenate([corner, drawn])
    ends = np.column_stack([low[:5] + reached * (high - low)[:5], np.full(len(reached), rest[5])])
    between = [rest + share * (ends - rest) for share in SHARES]
    return np.concatenate([rest[None], *between]).astype(np.float32)


def difference(compiled: NetworkInference, content: bytes, facts: Facts) -> str | None:
    """What is different, None where nothing is but rounding. NotComparedError where nobody knows."""
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
    """(K, outputs, 1 + 6): contact and Jacobian beside each other."""
    found = np.empty((len(poses), len(inference.contact), 1 + POSE))
    for pose, answer in zip(poses, found, strict=True):
        inference.pose[:] = pose
        inference.run()
        answer[:, 0], answer[:, 1:] = inference.contact, inference.jacobian
    return found


def answers_of_onnxruntime(content: bytes, poses: Poses, outputs: int) -> NDArray[np.float64]:
    """The same, from a process of its own. NotComparedError where there is none."""
    command = [
        sys.executable,
        "-P",
        "-m",
        "fmfts.contact.session",
    ]  # -P: nothing is imported from the working directory
    question = struct.pack("<I", len(content)) + content + poses.tobytes()
    try:
        ended = subprocess.run(command, input=question, capture_output=True, timeout=LONGEST_S, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise NotComparedError(str(error)) from error
    if ended.returncode != 0:
        words = ended.stderr.decode(errors="replace").strip().splitlines()
        raise NotComparedError(words[-1] if words else f"it ended with {ended.returncode}")
    return np.frombuffer(ended.stdout, "<f4").astype(np.float64).reshape(len(poses), outputs, 1 + POSE)
