"""The MMC5603NJ three-axis magnetometer: facts (Linux' driver mmc5633, Zephyr's mmc56x3). Its registers: memsic.py."""

from __future__ import annotations

from dataclasses import replace

from fmfts.sensor.chips.chip import TESLA_PER_GAUSS, Film
from fmfts.sensor.chips.driver import registers
from fmfts.sensor.chips.memsic import PULSE_PAUSE_S, Memsic
from fmfts.sensor.chips.mmc5983ma import MMC5983MA

_REGISTERS = Memsic(status=0x18, done=0x40, fuses_read=0x10, control_0=0x1B, product=0x39, reset_s=20e-3)

MMC5603NJ = replace(
    MMC5983MA,  # address, times and drift with temperature are alike; the last, and that z is inverted, are unverified
    name="mmc5603nj",
    label="MMC5603NJ",
    driver=_REGISTERS,
    identity=b"\x10\x00\x00",
    ranges_gauss=(30.0,),
    counts_per_gauss=((1024, 1024, -1024),),  # 16384 of 20 bits
    largest_count=30 * 1024,
    # 2 mG in the slowest bandwidth, 6.6 ms; here by the square root of the time (unverified).
    noise_t=3.6e-3 * TESLA_PER_GAUSS,
    # Beyond its range the film may be upset. No source gives that limit, so the range is taken, which is safe.
    film=Film(upset_gauss=30.0, doubtful_gauss=15.0, pulse=_REGISTERS.set_pulse, pause_s=PULSE_PAUSE_S),
    set_reset=None,
    dump=registers((0x00, 9), (0x09, 1), (0x18, 2), (0x1A, 4), (0x1E, 3), (0x27, 3), (0x39, 1)),
    supply="made; boards about 6 €, chips under 1 €",
    remarks="handedness and noise are unverified: `probe --magnet` tells the first",
)
