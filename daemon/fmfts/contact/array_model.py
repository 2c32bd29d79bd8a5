"""The contact model of a pad with several magnets: how presses move them, from a file."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from fmfts.common.reading import read_regular
from fmfts.contact.array_response import LARGEST_BYTES, ArrayResponse, ResponseError
from fmfts.contact.contract import ModelError, OtherPadError
from fmfts.pad import Pad

ARRAY_PATH = Path(__file__).with_name("array.response")


@dataclass(frozen=True, slots=True)
class ArrayModel:
    """response: of the pad. hash: of the file's content, as messages and recordings name it."""

    response: ArrayResponse
    hash: str

    @classmethod
    def load(cls, path: Path, pad: Pad) -> Self:
        """ModelError if the file cannot be used, OtherPadError if it is for another pad."""
        try:
            content = read_regular(path, LARGEST_BYTES)
            response = ArrayResponse.of(content, str(path))
        except OSError as error:
            raise ModelError(f"contact model {path}: cannot be read: {error.strerror}") from error
        except ResponseError as error:
            raise ModelError(f"contact model {error}") from error
        if response.geometry_hash != pad.geometry_hash:
            raise OtherPadError(
                f"contact model {path}: is for another pad: its dimensions have the hash {response.geometry_hash}, "
                f"those of pad '{pad.name}' {pad.geometry_hash}: compare [[pad.magnet]] and sensors_mm with "
                "docs/several.md; a pad of another structure needs a table of its own"
            )
        if response.magnets != len(pad.magnets):
            raise ModelError(f"contact model {path}: is of {response.magnets} magnets, the pad has {len(pad.magnets)}")
        return cls(response, hashlib.sha256(content).hexdigest()[:12])
