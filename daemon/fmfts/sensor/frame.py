"""One reading of one pad, the same for every source."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fmfts.sensor.chips import DEFAULT_CHIP, Chip
from fmfts.sensor.joints import Joints

AGE_UNKNOWN_US = 65535
READING = np.dtype("<i2")
READING_BYTES = 8


# A reading as firmware/wire.md has it: gain code, masks of valid and of fresh sensors, and 8 bytes for each sensor.
Packed = tuple[int, int, int, bytes]


@dataclass(frozen=True, slots=True)
class Frame:
    """Raw counts of N sensors with all that is needed to read them.

    counts: (N, 3) int16, order x, y, z in the sensor's axes; the chip's saturated count marks a saturated axis.
    age_us: (N,) how much older than `device_time_us` each sample is (free chips differ); AGE_UNKNOWN_US at most.
    fresh: (N,) bool, this sample was not in an earlier frame. valid: (N,) bool, this sample may be used.
    device_time_us: the source's own clock at the newest conversion, 64 bit, never wraps.
    host_time_ns: the same instant on the host's CLOCK_MONOTONIC.
    temperature_c: None where the source has no thermometer.
    run: changes with each restart of the source, which restarts its sequence and clock.
    chip: what made the counts, all of them alike.
    may_search: the pipeline of a pad with several magnets may search fingers anew, which takes long. A recording keeps
    it, so that a replay does the same (runtime/search_turns.py).
    joints: of a recorded frame, the hand's known joints; None: the pipeline's own hold.
    """

    pad_index: int
    sequence: int
    device_time_us: int
    host_time_ns: int
    gain_code: int
    counts: NDArray[np.int16]
    age_us: NDArray[np.uint16]
    fresh: NDArray[np.bool_]
    valid: NDArray[np.bool_]
    temperature_c: float | None
    run: int = 0
    chip: Chip = DEFAULT_CHIP
    may_search: bool = True
    joints: Joints | None = None

    def without_search(self) -> Frame:
        """The same frame, which may not search."""
        return replace(self, may_search=False)

    def at(self, host_time_ns: int) -> Frame:
        """The same frame, at another time on the host's clock."""
        return replace(self, host_time_ns=host_time_ns)

    @property
    def packed(self) -> Packed:
        """The same as the compiled path reads it."""
        readings = np.empty((len(self.counts), 4), READING)
        readings[:, :3] = self.counts
        readings[:, 3] = self.age_us  # its bytes
        return self.gain_code, mask_of(self.valid), mask_of(self.fresh), readings.tobytes()

    @property
    def overflow(self) -> NDArray[np.bool_]:
        """(N, 3) axes that the chip reports as saturated."""
        overflow: NDArray[np.bool_] = self.counts == self.chip.saturated_count
        return overflow

    @property
    def usable(self) -> NDArray[np.bool_]:
        """(N, 3) axes that hold a measurement."""
        return _usable(self.chip, self.counts, self.valid)

    @property
    def impossible(self) -> NDArray[np.bool_]:
        """(N, 3) axes with an impossible count; they hold no measurement."""
        largest = self.chip.largest_count
        impossible: NDArray[np.bool_] = ~self.overflow & ((self.counts > largest) | (self.counts < -largest - 1))
        return impossible

    @property
    def sampled_us(self) -> NDArray[np.int64]:
        """(N,) when each sample was taken, on the source's clock; of sensors that are not valid it means nothing."""
        return self.device_time_us - self.age_us.astype(np.int64)

    @property
    def timed(self) -> NDArray[np.bool_]:
        """(N,) sensors whose sample may be used, and whose time is known."""
        timed: NDArray[np.bool_] = self.valid & (self.age_us < AGE_UNKNOWN_US)
        return timed

    @property
    def field_t(self) -> NDArray[np.float64]:
        """(N, 3) field in tesla, in each sensor's own axes, NaN where an axis holds no measurement."""
        return _field_t(self.chip, self.chip.step_t[self.gain_code], self.counts, self.valid)


def fields_of(frames: Sequence[Frame]) -> NDArray[np.float64]:
    """(F, N, 3) `field_t` of frames of one chip."""
    chip, counts = frames[0].chip, np.array([frame.counts for frame in frames])
    step_t = np.array([chip.step_t[frame.gain_code] for frame in frames]).reshape(len(frames), 1, -1)
    return _field_t(chip, step_t, counts, np.array([frame.valid for frame in frames]))


def _usable(chip: Chip, counts: NDArray[np.int16], valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    largest = chip.largest_count
    told = (counts != chip.saturated_count) & (counts <= largest) & (counts >= -largest - 1)
    usable: NDArray[np.bool_] = told & valid[..., None]
    return usable


def _field_t(chip: Chip, step_t: Any, counts: NDArray[np.int16], valid: NDArray[np.bool_]) -> NDArray[np.float64]:
    field: NDArray[np.float64] = counts.astype(np.float64) * step_t
    field[~_usable(chip, counts, valid)] = np.nan
    return field


class WireFrame(Frame):
    """A frame that stays packed until its arrays are needed; the compiled path does not need them."""

    __slots__ = ("_packed",)
    _packed: Packed

    def __init__(
        self,
        pad_index: int,
        sequence: int,
        device_time_us: int,
        host_time_ns: int,
        packed: Packed,
        temperature_c: float | None,
        *,
        run: int = 0,
        chip: Chip = DEFAULT_CHIP,
        may_search: bool = True,
    ) -> None:
        _put_pad_index(self, pad_index)
        _put_sequence(self, sequence)
        _put_device_time_us(self, device_time_us)
        _put_host_time_ns(self, host_time_ns)
        _put_temperature_c(self, temperature_c)
        _put_run(self, run)
        _put_chip(self, chip)
        _put_may_search(self, may_search)
        _put_joints(self, None)  # not on the wire
        _put_packed(self, packed)

    @property
    def packed(self) -> Packed:
        return self._packed

    def without_search(self) -> WireFrame:
        return self._copied(self.host_time_ns, may_search=False)

    def at(self, host_time_ns: int) -> WireFrame:
        return self._copied(host_time_ns, self.may_search)

    def _copied(self, host_time_ns: int, may_search: bool) -> WireFrame:
        return WireFrame(
            self.pad_index,
            self.sequence,
            self.device_time_us,
            host_time_ns,
            self._packed,
            self.temperature_c,
            run=self.run,
            chip=self.chip,
            may_search=may_search,
        )

    @property
    def gain_code(self) -> int:
        return self._packed[0]

    @property
    def counts(self) -> NDArray[np.int16]:
        return self._readings[:, :3]

    @property
    def age_us(self) -> NDArray[np.uint16]:
        return self._readings[:, 3].view(np.uint16)

    @property
    def valid(self) -> NDArray[np.bool_]:
        return bits(self._packed[1], len(self._packed[3]) // READING_BYTES)

    @property
    def fresh(self) -> NDArray[np.bool_]:
        return bits(self._packed[2], len(self._packed[3]) // READING_BYTES)

    @property
    def _readings(self) -> NDArray[np.int16]:
        return np.frombuffer(self._packed[3], "<i2").reshape(-1, 4)


# A frame is frozen, so that only its slots take values. Their setters are kept: to look them up for each frame takes
# twice as long.
_put_pad_index = Frame.__dict__["pad_index"].__set__
_put_sequence = Frame.__dict__["sequence"].__set__
_put_device_time_us = Frame.__dict__["device_time_us"].__set__
_put_host_time_ns = Frame.__dict__["host_time_ns"].__set__
_put_temperature_c = Frame.__dict__["temperature_c"].__set__
_put_run = Frame.__dict__["run"].__set__
_put_chip = Frame.__dict__["chip"].__set__
_put_may_search = Frame.__dict__["may_search"].__set__
_put_joints = Frame.__dict__["joints"].__set__
_put_packed = WireFrame.__dict__["_packed"].__set__


def mask_of(flags: NDArray[np.bool_]) -> int:
    """Bit i is flags[i]."""
    return _mask_of(flags.tobytes())


@lru_cache(maxsize=1024)
def _mask_of(flags: bytes) -> int:
    """The mask by the bytes of `flags`, which are mostly those of a frame before."""
    return int.from_bytes(np.packbits(np.frombuffer(flags, np.bool_), bitorder="little").tobytes(), "little")


@lru_cache(maxsize=1024)
def bits(mask: int, count: int) -> NDArray[np.bool_]:
    """(count,) bit i of `mask`; not to be written to."""
    spread = (mask >> np.arange(count) & 1).astype(np.bool_)
    spread.setflags(write=False)
    return spread
