"""A pad as its driver needs it, with the settings of the chips. `sources.py` makes it from a checked configuration."""

from __future__ import annotations

from dataclasses import dataclass

from fmfts.sensor.chips import Chip


@dataclass(frozen=True, slots=True, kw_only=True)
class WiredPad:
    """`name` is for people, who wrote it in the configuration; `trigger` is "free" or "simultaneous".

    `early`: samples are wanted as they come, before their frames.
    """

    name: str
    sensors: int
    chip: Chip
    rate_hz: int
    range_gauss: float
    trigger: str
    early: bool = False

    @property
    def has_selftest(self) -> bool:
        return self.chip.bias_strap is not None


@dataclass(frozen=True, slots=True, kw_only=True)
class PadOnBoard(WiredPad):
    """`uid`: 24 hex digits of the only board that is the right one; None: any board on `port`.

    `beside`: index and number of sensors of each other pad that is configured on the board.
    """

    port: str
    baud: int
    uid: str | None
    beside: tuple[tuple[int, int], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class PadOnI2c(WiredPad):
    """`mux_addresses` and `channels`: of each sensor's switch; empty where the sensors are straight on the bus.

    `addresses`: of each sensor's chip.
    """

    bus: int
    clock_hz: int
    mux_addresses: tuple[int, ...]
    channels: tuple[int, ...]
    addresses: tuple[int, ...]

    @property
    def has_selftest(self) -> bool:
        return self.chip.bias_strap is not None or self.chip.tested_on_i2c


@dataclass(frozen=True, slots=True)
class Settings:
    """The settings as the wire encodes them: `trigger` 0 free, 1 simultaneous."""

    gain_code: int
    rate_hz: int
    trigger: int

    @classmethod
    def of(cls, pad: WiredPad) -> Settings:
        return cls(pad.chip.gain_code_for_range(pad.range_gauss), pad.rate_hz, int(pad.trigger == "simultaneous"))
