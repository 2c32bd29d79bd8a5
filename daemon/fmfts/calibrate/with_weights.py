"""Puts the weights behind a contact model that `calibrate` of a development version wrote; its answers and name stay.

    python -m fmfts.calibrate.with_weights MODEL.onnx

The shipped models got theirs so: `make model` would train new ones.
"""

from __future__ import annotations

import sys
from pathlib import Path

import onnx
from onnx import numpy_helper

from fmfts.calibrate.graph import weights
from fmfts.contact.contract import pack_weights
from fmfts.contact.seal import sealed, unsealed
from fmfts.service.state import write_atomically


def with_weights(content: bytes) -> bytes:
    """The file's new content. ValueError or KeyError if it is no model of `calibrate`."""
    model = unsealed(content)
    constants = {
        tensor.name: numpy_helper.to_array(tensor) for tensor in onnx.load_from_string(model).graph.initializer
    }
    return sealed(model, pack_weights(weights(constants)))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit(__doc__)
    file = Path(sys.argv[1])
    write_atomically(file, with_weights(file.read_bytes()))
