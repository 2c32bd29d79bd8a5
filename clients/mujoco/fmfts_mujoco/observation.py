"""A policy's view of a pad: its last samples as an array of fixed size, the same in process and over the bus."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
from fmfts_client import Contact
from fmfts_client.row import COLUMNS, row_of
from numpy.typing import NDArray

from fmfts_mujoco.told import Told

SAMPLES = 16  # more messages than arrive in 40 ms at 220 Hz
LARGEST = 100.0


class Seen(msgspec.Struct):
    """The values of the columns, decoded in a tenth of the time that a whole Contact takes."""

    t_sample_ns: int
    health: str
    contact: bool | None
    over_range: bool
    force_n: float | None
    force_sd_n: float | None
    x_m: float | None
    x_sd_m: float | None
    y_m: float | None
    y_sd_m: float | None
    shear_x_n: float | None
    shear_x_sd_n: float | None
    shear_y_n: float | None
    shear_y_sd_n: float | None


_decoder = msgspec.msgpack.Decoder(Seen)


class Window:
    """The last samples of one pad."""

    def __init__(self) -> None:
        self._rows = np.zeros((SAMPLES, len(COLUMNS)))
        self._sampled_ns = np.zeros(SAMPLES, dtype=np.int64)

    def add(self, contacts: Sequence[Contact] | Told) -> None:
        """New messages, in order."""
        last = contacts[-SAMPLES:]
        seen = [_decoder.decode(each) for each in last.payloads] if isinstance(last, Told) else last
        if not seen:
            return
        kept = slice(len(seen), None)
        self._rows = np.concatenate([self._rows[kept], np.array([row_of(each) for each in seen])])
        self._sampled_ns = np.concatenate([self._sampled_ns[kept], [each.t_sample_ns for each in seen]])

    def at(self, now_ns: int) -> tuple[NDArray[np.float32], NDArray[np.int8]]:
        """(SAMPLES, columns), the newest last, and (SAMPLES,) 1 where there is a sample."""
        rows = self._rows.copy()
        rows[:, 0] = (now_ns - self._sampled_ns) * 1e-9
        known = self._sampled_ns > 0
        rows[~known] = 0.0
        return np.clip(rows, -LARGEST, LARGEST).astype(np.float32), known.astype(np.int8)
