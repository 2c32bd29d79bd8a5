"""The chips that the daemon reads. Another one: its file here, its name in `ChipName` and `CHIPS`."""

from typing import Literal

from fmfts.sensor.chips.chip import GAIN_CODES, TESLA_PER_GAUSS, Axes, Chip
from fmfts.sensor.chips.hmc5983 import HMC5883L, HMC5983
from fmfts.sensor.chips.lis3mdl import LIS3MDL
from fmfts.sensor.chips.mlx90393 import ANYSKIN, MLX90393
from fmfts.sensor.chips.mmc5603nj import MMC5603NJ
from fmfts.sensor.chips.mmc5983ma import MMC5983MA
from fmfts.sensor.chips.qmc5883l import QMC5883L
from fmfts.sensor.chips.qmc5883p import QMC5883P

# Names as in the configuration.
ChipName = Literal[
    "hmc5983",
    "hmc5883l",
    "mmc5983ma",
    "mmc5603nj",
    "qmc5883l",
    "qmc5883p",
    "lis3mdl",
    "mlx90393",
    "mlx90393_streamed",
]
CHIPS: dict[str, Chip] = {
    chip.name: chip
    for chip in (HMC5983, HMC5883L, MMC5983MA, MMC5603NJ, QMC5883L, QMC5883P, LIS3MDL, MLX90393, ANYSKIN)
}

# The default chip: of old recordings, tables of fields, studies.
DEFAULT_CHIP = HMC5983
NOISE_T = DEFAULT_CHIP.noise_t

__all__ = [
    "ANYSKIN",
    "CHIPS",
    "DEFAULT_CHIP",
    "GAIN_CODES",
    "HMC5883L",
    "HMC5983",
    "LIS3MDL",
    "MLX90393",
    "MMC5603NJ",
    "MMC5983MA",
    "NOISE_T",
    "QMC5883L",
    "QMC5883P",
    "TESLA_PER_GAUSS",
    "Axes",
    "Chip",
    "ChipName",
]
