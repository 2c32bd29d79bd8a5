"""The MMC5603NJ three-axis magnetometer: facts (Linux' driver mmc5633, Zephyr's mmc56x3). Its registers: memsic.py."""

from __future__ import annotations

from fmfts.sensor.chips.chip import TESLA_PER_GAUSS, Chip, Film
from fmfts.sensor.chips.driver import registers
from fmfts.sensor.chips.memsic import PULSE_PAUSE_S, Memsic

_REGISTERS = Memsic(status=0x18, done=0x40, fuses_read=0x10, control_0=0x1B, product=0x39, reset_s=20e-3)

MMC5603NJ = Chip(
    name="mmc5603nj",
    label="MMC5603NJ",
    driver=_REGISTERS,
    address=0x30,  # the MMC5983MA's, too
    identity=b"\x10\x00\x00",
    ranges_gauss=(30.0,),
    counts_per_gauss=((1024, 1024, -1024),),  # 16384 of 20 bits; left-handed like the MMC5983MA (unverified)
    largest_count=30 * 1024,
    saturated_count=-32768,
    paced_by_host=True,
    output_rates_hz=(380.0,),  # 2.2 ms until it is read, and the transfers that read it and start it again
    free_rate_hz=380,
    single_rate_hz=350,
    single_conversion_s=2e-3,
    single_wait_s=2.2e-3,
    clock_tolerance=0.05,
    # 2 mG in the slowest bandwidth, 6.6 ms; here by the square root of the time (unverified).
    noise_t=3.6e-3 * TESLA_PER_GAUSS,
    sensitivity_per_k=-0.0002,  # as the MMC5983MA's (unverified)
    thermometer=None,  # measured in place of the field
    bias_strap=None,
    # Beyond its range the film may be upset. No source gives that limit, so the range is taken, which is safe.
    film=Film(upset_gauss=30.0, doubtful_gauss=15.0, pulse=_REGISTERS.set_pulse, pause_s=PULSE_PAUSE_S),
    board_rates_hz=(380.0,),
    board_single_hz=203,
    dump=registers((0x00, 9), (0x09, 1), (0x18, 2), (0x1A, 4), (0x1E, 3), (0x27, 3), (0x39, 1)),
    supply="made; boards about 6 €, chips under 1 €",
    remarks="handedness and noise are unverified: `probe --magnet` tells the first",
)
