"""Lets onnxruntime look at a model in a process that then ends: inside the daemon it would keep 30 MB."""

from __future__ import annotations

import subprocess
import sys
from functools import lru_cache
from typing import Literal

import msgspec
import numpy as np

from fmfts.common.reading import shortened
from fmfts.contact.comparison import Answers
from fmfts.contact.inference import POSE

# Nothing is imported from the working directory, which `-c` puts first. Python 3.10 has no -P.
PROCESS = "import sys; sys.path = [*filter(None, sys.path)]; from fmfts.contact import session; session.{}()"
LONGEST_S = 30.0
MODELS = 8  # number of models whose result is kept: each is read only once, for all pads


class Told(msgspec.Struct):
    """What onnxruntime reports about a model. answers: its answers to `poses_of`, float32; empty unless it has
    weights."""

    metadata: dict[str, str]
    answers: bytes

    def answers_of(self, outputs: int) -> Answers:
        """(K, outputs, 1 + 6). ValueError if the graph has another number of outputs."""
        numbers = np.frombuffer(self.answers, "<f4").astype(np.float64)
        if numbers.size % (outputs * (1 + POSE)):
            raise ValueError(f"its graph has another number of outputs than {outputs}, which its weights have")
        return numbers.reshape(-1, outputs, 1 + POSE)


@lru_cache(MODELS)
def told(content: bytes) -> Told:
    """ValueError says why onnxruntime does not read the model."""
    return msgspec.msgpack.decode(_asked("tell", content), type=Told)


@lru_cache(MODELS)
def tried(content: bytes) -> bytes:
    """The checked model. ValueError if it may need more time or memory than a pad has: see operators.py, session.py."""
    return _asked("try_out", content)


def _asked(what: Literal["tell", "try_out"], content: bytes) -> bytes:
    command = [sys.executable, "-c", PROCESS.format(what)]
    try:
        ended = subprocess.run(command, input=content, capture_output=True, timeout=LONGEST_S, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise ValueError(f"the process in which onnxruntime looks at it did not end: {type(error).__name__}") from error
    if ended.returncode != 0:
        words = ended.stderr.decode(errors="replace").strip().splitlines()
        raise ValueError(
            shortened(words[-1]) if words else f"onnxruntime, in a process of its own, ended with {ended.returncode}"
        )
    answer: bytes = ended.stdout
    return answer
