"""What a config asks of a board, or of an I2C bus's reader."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from fmfts.config import BridgeSource, I2cSource, PadConfig
from fmfts.sensor.chips import hmc5983
from fmfts.sensor.chips.rates import highest_rate_hz
from fmfts.sensor.source import SourceError


@dataclass(frozen=True, slots=True)
class Settings:
    """As the wire has them: `trigger` 0 free, 1 simultaneous."""

    gain_code: int
    rate_hz: int
    trigger: int

    @classmethod
    def of(cls, pad: PadConfig) -> Self:
        """SourceError where no chip can do what the config asks."""
        source = pad.source
        assert isinstance(source, BridgeSource | I2cSource)
        most_hz = highest_rate_hz(source.chip, source.trigger, over_bridge=isinstance(source, BridgeSource))
        if source.rate_hz > most_hz:
            asked = f"rate_hz = {source.rate_hz}, chip = {source.chip!r}, trigger = {source.trigger!r}"
            raise SourceError(f"pad {pad.name!r}: {asked}: at most {most_hz} Hz are possible; lower rate_hz")
        try:
            gain_code = hmc5983.gain_code_for_range(source.range_gauss)
        except ValueError as error:
            raise SourceError(f"pad {pad.name!r}: range_gauss: {error}") from None
        return cls(gain_code, source.rate_hz, int(source.trigger == "simultaneous"))
