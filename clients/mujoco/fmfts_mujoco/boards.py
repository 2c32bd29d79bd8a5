"""Makes the frames of several equal pads at once: the chips' reports of each pad's field, by their own clocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from fmfts.config import PadConfig, SimulatedSource
from fmfts.pad import Array
from fmfts.sensor.frame import AGE_UNKNOWN_US, READING_BYTES, Frame, WireFrame
from fmfts_simulation.chip import ChipArray
from fmfts_simulation.imperfections import cast
from fmfts_simulation.mounted import MountedPad
from fmfts_simulation.neighbour import seeded
from fmfts_simulation.source import ROOM_C, Simulated

from fmfts_mujoco.history import History
from fmfts_mujoco.places import ModelError
from fmfts_mujoco.stacked import Stacked

START_S = 1.0  # on the boards' clock at the beginning, so that no sample has a time before its start
NS, US = 1_000_000_000, 1_000_000
SILICONE, CASTING = "silicone", "casting"


@dataclass
class Faults:
    """Faults of one pad. silent, stuck: sensors that no longer answer, or repeat one reading. unplugged: the board."""

    silent: set[int]
    stuck: set[int]
    unplugged: bool = False


def built_of(pad: PadConfig, *, as_built: bool = False) -> MountedPad:
    """The pad as the daemon's own simulation builds it from this seed. ModelError if MuJoCo cannot press it.

    as_built: with errors as large as `[pad.tolerance]` says; else an ideal pad.
    """
    source, name = pad.source, f"pad '{pad.name}'"
    if not isinstance(source, SimulatedSource):
        raise ModelError(f'{name}: a simulator feeds only [pad.source] type = "simulated"')
    if pad.other_magnets or not pad.are_magnets_known:
        raise ModelError(f"{name}: pads with several or unknown magnets are not simulated in MuJoCo")
    if source.warming_k_per_minute or set(source.imperfections) - {SILICONE, CASTING}:
        raise ModelError(f'{name}: of imperfections MuJoCo knows "silicone" and "casting", and no warming')
    good = Simulated(pad).built
    if not as_built:
        return good
    built = MountedPad.built(pad.pad(), seeded(source, "pad"), good.mechanics, pad.tolerance.si())
    return cast(built, seeded(source, "casting")) if CASTING in source.imperfections else built


class Boards:
    """The boards of K pads, all of one kind, that make frames at the same instants."""

    def __init__(self, pads: Sequence[PadConfig], stacked: Stacked) -> None:
        """ModelError where the pads are of different kinds."""
        first = pads[0].source
        for pad in pads[1:]:
            for key in ("rate_hz", "range_gauss", "trigger", "chip", "mechanics", "imperfections"):
                if getattr(pad.source, key) != getattr(first, key):
                    raise ModelError(f"pads '{pads[0].name}' and '{pad.name}' differ in {key}: it must be the same")
            if len(pad.geometry.sensors_mm) != len(pads[0].geometry.sensors_mm) or pad.magnet != pads[0].magnet:
                raise ModelError(f"pads '{pads[0].name}' and '{pad.name}' differ in sensors or magnet")
        self.rate_hz = first.rate_hz
        self._trigger = first.trigger
        self._stacked = stacked
        self._chip = stacked.chip
        self._gain_code = self._chip.gain_code_for_range(first.range_gauss)
        told_k = self._chip.thermometer
        self._temperature_c = None if told_k is None else ROOM_C
        self._pads, self._sensors = stacked.pads, stacked.sensors
        self._everywhere = (1 << self._sensors) - 1
        self.faults = [Faults(set(), set()) for _ in pads]
        self.start(np.random.default_rng(0))

    def start(self, random: np.random.Generator) -> None:
        """Switch the boards on, with other clocks and noise."""
        count = self._pads * self._sensors
        self._chips = ChipArray(count, self.rate_hz, self._trigger, self._chip, self._chip.noise_t, random)
        self._sequence = 0
        self._delivered = np.full(count, np.iinfo(np.int64).min)
        self._counts = np.zeros((count, 3), dtype=np.int16)

    @property
    def oldest_s(self) -> float:
        """No sample of a later frame is from before this time."""
        return (self._sequence - 2.5) / self.rate_hz

    @property
    def due_s(self) -> float:
        """When the next frame is complete."""
        return self._sequence / self.rate_hz

    def frames(self, until_s: float, moved: History, around: History, *, bare: bool = False) -> list[list[Frame]]:
        """The frames (F) of each of K pads until this time. moved: (K, 5) responses; around: (K, N, 3) other fields."""
        count = max(int(np.floor(until_s * self.rate_hz + 1e-6)) + 1 - self._sequence, 0)
        if count == 0:
            return [[] for _ in self.faults]
        now_s = (self._sequence + np.arange(count)) / self.rate_hz
        conversion = self._chips.newest_conversion(now_s[:, None])
        sampled_s = self._chips.time_of(conversion)
        shape = (count, self._pads, self._sensors)
        field_t = self._field(sampled_s.reshape(shape), moved, around, bare)
        counts = self._chips.counts(field_t.reshape(count, -1, 3), self._gain_code, 0.0)
        before = np.concatenate([self._delivered[None], conversion[:-1]])
        fresh = conversion != before
        for number in range(count):
            counts[number] = self._counts = np.where(fresh[number, :, None], counts[number], self._counts)
        self._delivered = conversion[-1]
        first, self._sequence = self._sequence, self._sequence + count
        return self._packed(first, counts.reshape(*shape, 3), sampled_s.reshape(shape), fresh.reshape(shape))

    def _field(self, sampled_s: Array, moved: History, around: History, bare: bool) -> Array:
        """(F, K, N, 3) the field at the chips at their times (F, K, N), in their own axes and times their gain."""
        pad = np.broadcast_to(np.arange(self._pads)[:, None], sampled_s.shape)
        sensor = np.broadcast_to(np.arange(self._sensors), sampled_s.shape)
        field_t = around.at(sampled_s, pad, sensor)
        if not bare:
            field_t = field_t + self._stacked.magnet_field(moved.at(sampled_s, pad))
        return self._stacked.sensed(field_t)

    def _packed(self, first: int, counts: np.ndarray, sampled_s: Array, fresh: np.ndarray) -> list[list[Frame]]:
        for pad, faults in enumerate(self.faults):
            for sensor in faults.stuck:
                counts[:, pad, sensor] = self._chip.largest_count // 2
        newest_s = sampled_s.max(axis=2)
        age_us = np.minimum(np.rint((newest_s[..., None] - sampled_s) * US), AGE_UNKNOWN_US).astype(np.uint16)
        device_us, host_ns = (np.rint((newest_s + START_S) * per_s).astype(np.int64).tolist() for per_s in (US, NS))
        readings = np.concatenate([counts, age_us[..., None].view(np.int16)], axis=3).astype("<i2")
        packed, size = readings.tobytes(), READING_BYTES * self._sensors
        masks = (fresh @ (1 << np.arange(self._sensors))).tolist()
        frames: list[list[Frame]] = []
        for pad, faults in enumerate(self.faults):
            valid = self._everywhere & ~sum(1 << sensor for sensor in faults.silent)
            frames.append([])
            for number in range(0 if faults.unplugged else len(counts)):
                at = (number * self._pads + pad) * size
                frames[-1].append(
                    WireFrame(
                        0,
                        first + number,
                        device_us[number][pad],
                        host_ns[number][pad],
                        (self._gain_code, valid, masks[number][pad] & valid, packed[at : at + size]),
                        self._temperature_c,
                        chip=self._chip,
                    )
                )
        return frames
