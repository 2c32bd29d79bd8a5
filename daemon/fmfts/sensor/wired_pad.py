"""A pad as its driver needs it, with the settings of the chips. `sources.py` makes it from the configuration."""

from __future__ import annotations

from dataclasses import dataclass

from fmfts.sensor.chips import Chip
from fmfts.sensor.chips.rates import highest_rate_hz, no_trigger
from fmfts.sensor.source import SourceError


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
        """SourceError if the chip lacks a setting."""
        if pad.trigger == "simultaneous" and not pad.chip.has_trigger:
            raise SourceError(f"pad {pad.name!r}: {no_trigger(pad.chip)}")
        most_hz = highest_rate_hz(pad.chip, pad.trigger, over_bridge=isinstance(pad, PadOnBoard))
        if pad.rate_hz > most_hz:
            asked = f"rate_hz = {pad.rate_hz}, chip = {pad.chip.name!r}, trigger = {pad.trigger!r}"
            raise SourceError(f"pad {pad.name!r}: {asked}: at most {most_hz} Hz are possible; lower rate_hz")
        try:
            gain_code = pad.chip.gain_code_for_range(pad.range_gauss)
        except ValueError as error:
            raise SourceError(f"pad {pad.name!r}: range_gauss: {error}") from None
        return cls(gain_code, pad.rate_hz, int(pad.trigger == "simultaneous"))
