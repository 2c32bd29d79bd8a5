"""The chips that the daemon reads. Another one: its file here, its name in `ChipName` and `CHIPS`."""

from typing import Literal

from fmfts.sensor.chips.chip import GAIN_CODES, TESLA_PER_GAUSS, Axes, Chip
from fmfts.sensor.chips.hmc5983 import HMC5883L, HMC5983

ChipName = Literal["hmc5983", "hmc5883l"]  # as the configuration writes it
CHIPS: dict[str, Chip] = {chip.name: chip for chip in (HMC5983, HMC5883L)}

# Where nobody names a chip: old recordings, tables of fields, studies.
DEFAULT_CHIP = HMC5983
NOISE_T = DEFAULT_CHIP.noise_t

__all__ = [
    "CHIPS",
    "DEFAULT_CHIP",
    "GAIN_CODES",
    "HMC5883L",
    "HMC5983",
    "NOISE_T",
    "TESLA_PER_GAUSS",
    "Axes",
    "Chip",
    "ChipName",
]
