"""The MMC5983MA three-axis magnetometer: facts (MEMSIC data sheet rev. A). Its registers: memsic.py."""

from __future__ import annotations

from fmfts.sensor.chips.chip import TESLA_PER_GAUSS, Chip, Film, SetReset
from fmfts.sensor.chips.driver import registers
from fmfts.sensor.chips.memsic import BANDWIDTH, MEASURE_FIELD, PULSE_PAUSE_S, RESET_PULSE, Memsic

CONTROL_0, CONTROL_3 = 0x09, 0x0C
COIL_ONE_WAY, COIL_OTHER_WAY = 0x02, 0x04  # control 3: St_enp, St_enm

_REGISTERS = Memsic(status=0x08, done=0x01, fuses_read=0x10, control_0=CONTROL_0, product=0x2F, reset_s=10e-3)

# "Using set and reset to remove bridge offset", page 18.
_SET_RESET = SetReset(
    stop=bytes((CONTROL_0, 0, BANDWIDTH, 0)),
    set_pulse=_REGISTERS.set_pulse,
    reset_pulse=bytes((CONTROL_0, RESET_PULSE)),
    settle_s=(10e-3, PULSE_PAUSE_S),  # the first is longer than a measurement of 8 ms that may be under way
    measure=bytes((CONTROL_0, MEASURE_FIELD)),
    samples=5,
    coil=(bytes((CONTROL_3, COIL_ONE_WAY)), bytes((CONTROL_3, COIL_OTHER_WAY))),
    largest_zero_gauss=0.5,  # null field output, page 2
    # The coil's field is in no certain source; a public driver has 80 to 175 mG either way. This limit is 20 deviations
    # of the noise of two means of five: an axis below it does not measure the coil.
    least_coil_gauss=10e-3,
)

MMC5983MA = Chip(
    name="mmc5983ma",
    label="MMC5983MA",
    driver=_REGISTERS,
    address=0x30,
    identity=b"\x30\x00\x00",
    ranges_gauss=(8.0,),
    # 16384 of 18 bits. After a set pulse its axes are left-handed: z grows into the board (page 9).
    counts_per_gauss=((4096, 4096, -4096),),
    largest_count=32766,
    saturated_count=-32768,
    paced_by_host=True,
    output_rates_hz=(380.0,),  # 2.2 ms until it is read, and the transfers that read it and start it again
    free_rate_hz=380,
    single_rate_hz=350,
    single_conversion_s=2e-3,
    single_wait_s=2.2e-3,
    clock_tolerance=0.05,
    noise_t=0.8e-3 * TESLA_PER_GAUSS,
    sensitivity_per_k=-0.0002,
    thermometer=None,  # 0.8 °C a step, measured in place of the field; its maker says that it does not work
    bias_strap=None,
    # Page 2: more than 10 G upsets the film, and pulses repeat to 1 mG.
    film=Film(upset_gauss=9.0, doubtful_gauss=5.0, pulse=_REGISTERS.set_pulse, pause_s=PULSE_PAUSE_S),
    set_reset=_SET_RESET,
    board_rates_hz=(380.0,),
    board_single_hz=203,
    dump=registers((0x00, 8), (0x08, 1), (0x09, 4), (0x2F, 1)),
    supply="made; boards 10 to 20 € each",
    remarks="its thermometer (0.8 °C a step) is not used; its settings cannot be read back",
)
