"""`make chips-for-a-day`: every driver on its emulated chips for a day of their time; no sample lost, none taken twice.

    .venv/bin/python tests/drills/chips_for_a_day.py --hours 24 --chips mlx90393

It is no part of `make test`, which does 20 s of the same. Each ten minutes have another field, another temperature and
another rate of reading (mostly little above the chips' own, so that readings slide over the conversions slowly), and
end with one axis beyond its range. Rate, noise, field and temperature are held to what the data sheets say.
"""

from __future__ import annotations

import argparse
import gc
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from compiled_emulator import compile_into

for folder in (".", "unit"):  # it is imported in `day`, after the chips were compiled
    sys.path.insert(0, str(Path(__file__).parents[1] / folder))

STRETCH_S, MEASURED_S, BEYOND_S = 600.0, 20.0, 0.5
CLOCK_ERRORS = (-0.03, 0.02)  # share of a chip's period
OTHER_READING_EVERY = 10  # the daemon polls stretches at twice the rate


@dataclass(frozen=True)
class Promise:
    """From the sources of lab/results/chip-facts.md, written here again. frames_hz: rate that the pad requests.

    rate_hz: conversions a second; None if the driver starts each one, so that every frame has a new sample. That holds
    up to twice frames_hz; at 380 Hz a slow chip is late after each check of its registers. noise_gauss: at that rate,
    in the emulated chip. beyond_gauss: beyond its range, by axis. low_steps: the mean's loss through dropped lower
    bits. sensitivity_per_k: relative, from 25 °C; the HMC5983 compensates all of it. has_film: a field beyond the range
    spoils all axes until a set pulse. overwritten: the largest share of samples that the next one replaces before they
    are read: between its status and its axes, where a check of the registers delayed the reading.
    """

    frames_hz: int
    rate_hz: float | None
    noise_gauss: float
    lsb_per_gauss: tuple[float, float, float]
    beyond_gauss: tuple[float, float, float]
    has_thermometer: bool = False
    low_steps: float = 0.0
    sensitivity_per_k: float = 0.0
    has_film: bool = False
    overwritten: float = 0.0


MLX90393_PERIOD_S = (3 * (67 + 64 * (2 + 2**4)) + 67 + 192 + 490) * 1e-6  # its table 18 at DIG_FILT 4
PROMISED = {
    "hmc5983": Promise(220, 220.0, 2e-3, (1370,) * 3, (1.6,) * 3, True),
    "qmc5883l": Promise(200, 200.0, 2e-3, (12000,) * 3, (2.9,) * 3, sensitivity_per_k=-5e-4),
    "lis3mdl": Promise(155, 155.0, 3.2e-3, (6842,) * 3, (4.3,) * 3, True, sensitivity_per_k=-3e-4),
    "qmc5883p": Promise(200, 200.0, 2e-3, (15000,) * 3, (2.1,) * 3, sensitivity_per_k=-5e-4, overwritten=2e-4),
    "mmc5983ma": Promise(
        160, None, 0.8e-3, (4096, 4096, -4096), (8.3,) * 3, low_steps=0.375, sensitivity_per_k=-2e-4, has_film=True
    ),  # 16 of 18 bits, the lower two dropped; left-handed
    "mmc5603nj": Promise(
        160, None, 3.6e-3, (1024, 1024, -1024), (32.3,) * 3, low_steps=0.46875, sensitivity_per_k=-2e-4, has_film=True
    ),  # 16 of 20 bits, the lower four dropped
    "mlx90393": Promise(
        226,
        1.0 / MLX90393_PERIOD_S,
        15e-3,
        (100 / 0.600, 100 / 0.600, 100 / 0.968),
        (140, 140, 224),
        True,
        0.375,
        -3e-4,
    ),  # 16 of 19 bits, the lower two dropped
}


@dataclass
class Found:
    """taken: samples of each chip that were new in a frame. deviations: of measured fields from the true ones, and of
    measured noise from the specified one. wrong: sentences."""

    taken: list[int]
    frames: int = 0
    field_deviations: list[float] = field(default_factory=list)
    noise_ratios: list[float] = field(default_factory=list)
    temperature_errors_c: list[float] = field(default_factory=list)
    saturations: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)


def nothing_found(number_of_chips: int) -> Found:
    return Found([0] * number_of_chips)


def read(pad: Any, clock: Any, duration_s: float, rate_hz: float, found: Found) -> list[Any]:
    """Reads like the reader process: at a rate, and checks one sensor's registers each quarter of a second. Returns the
    samples of the last MEASURED_S."""
    kept, masks, period_s = [], Counter[int](), 1.0 / rate_hz
    next_s = watched_s = clock.now_s
    end_s = next_s + duration_s
    keep_s = end_s - MEASURED_S
    while next_s < end_s:
        if clock.now_s < next_s:
            clock.now_s = next_s
        pad.poll()
        sample = pad.sample()
        masks[sample.fresh] += 1
        if next_s >= keep_s:
            kept.append(sample)
        if clock.now_s - watched_s > 0.25:
            watched_s = clock.now_s
            pad.watch()
        next_s = max(next_s + period_s, clock.now_s)
    for mask, count in masks.items():
        found.frames += count
        for number in range(len(found.taken)):
            found.taken[number] += count * (mask >> number & 1)
    return kept


def check_stretch(promise: Promise, chips: list[Any], temperature_of: Any, kept: list[Any], found: Found) -> None:
    """The measured mean and deviation of the field, compared with the field at each chip."""
    for number, chip in enumerate(chips):
        counts = np.array([sample.counts[number] for sample in kept if sample.fresh >> number & 1], float)
        lsb = np.array(promise.lsb_per_gauss)
        warmth = 1.0 + promise.sensitivity_per_k * (chip.temperature_c - 25.0)
        due = np.array(chip.field_gauss) * warmth * lsb - promise.low_steps
        # Rounding to whole steps adds a twelfth of a step's square, as long as the noise is of its size.
        sigma = np.sqrt((promise.noise_gauss * lsb) ** 2 + 1.0 / 12.0)
        # Smaller noise leaves a bias of rounding: at most half a step, without noise.
        bias = 0.5 * np.exp(-2.0 * (np.pi * promise.noise_gauss * lsb) ** 2)
        deviation = (np.abs(counts.mean(axis=0) - due) - bias) / (sigma / np.sqrt(len(counts)))
        found.field_deviations.append(float(deviation.max()))
        found.noise_ratios += list(counts.std(axis=0) / sigma)
        told = temperature_of(kept[-1].temperature_raw)
        if promise.has_thermometer:
            found.temperature_errors_c.append(abs(told - chip.temperature_c))
        elif told is not None:
            found.wrong.append(f"chip {number} tells {told} °C and has no thermometer that is used")


def drive_beyond(pad: Any, clock: Any, promise: Promise, chips: list[Any], turn: int, found: Found) -> None:
    """One axis and one sign of all chips saturates: only that axis is flagged, or all axes of a chip with a film. All
    are valid again afterwards."""
    axis, sign = turn % 3, 1 - 2 * (turn // 3 % 2)
    before = [list(chip.field_gauss) for chip in chips]
    for chip in chips:
        chip.field_gauss[axis] = sign * promise.beyond_gauss[axis]
    for begun in (True, False):
        last = read(pad, clock, BEYOND_S, 2 * promise.frames_hz, found)[-1]
        flags = last.counts == pad.chip.saturated_count
        due = np.zeros((len(chips), 3), bool)
        due[:, slice(None) if promise.has_film else axis] = begun
        if (flags != due).any():
            found.wrong.append(f"axis {axis} {'beyond' if begun else 'within'} its range: {last.counts.tolist()}")
        elif begun:
            found.saturations[f"{'+-'[sign < 0]}{'xyz'[axis]}"] += 1
        for chip, gauss in zip(chips, before, strict=True):
            chip.field_gauss = gauss


def day(kind: str, hours: float, number_of_chips: int) -> dict[str, object]:
    from emulated_bus import Clock, emulated_pad, patched
    from test_chip_drivers import KINDS

    from emulator.chips import Hmc5983
    from fmfts.sensor.chips import CHIPS
    from fmfts.sensor.wire.packets import SensorState

    promise, random, clock, found = PROMISED[kind], Random(kind), Clock(), nothing_found(number_of_chips)
    lightest = min(promise.beyond_gauss)
    with patched(clock):
        chips = [
            (KINDS | {"hmc5983": Hmc5983})[kind](
                clock, clock_error=error, phase_s=1e-4 * number, noise_gauss=promise.noise_gauss, seed=number
            )
            for number, error in enumerate(CLOCK_ERRORS[:number_of_chips])
        ]
        for chip in chips if promise.has_film else ():
            chip.repeatability_gauss = 0.0  # otherwise each set pulse would move the mean, by 1 mG
        pad, bus = emulated_pad(clock, kind, chips, rate_hz=promise.frames_hz)
        read(pad, clock, 1.0, 2 * promise.frames_hz, nothing_found(number_of_chips))
        transfers, made = bus.bus.transfers, [chip.conversions for chip in chips]
        begun_s, begun_cpu_s, stretch = clock.now_s, time.process_time(), 0
        while clock.now_s - begun_s < hours * 3600:
            temperature_c = random.uniform(-10.0, 60.0)
            for chip in chips:
                chip.field_gauss = [random.uniform(-0.5, 0.5) * lightest for _ in range(3)]
                chip.temperature_c = temperature_c
            times = 2.0 if stretch % OTHER_READING_EVERY == 0 else random.uniform(1.12, 1.25)
            kept = read(pad, clock, STRETCH_S - 2 * BEYOND_S, times * promise.frames_hz, found)
            check_stretch(promise, chips, CHIPS[kind].temperature_c, kept, found)
            drive_beyond(pad, clock, promise, chips, stretch, found)
            stretch += 1
            if stretch % 36 == 0:
                print(f"{kind}: {(clock.now_s - begun_s) / 3600:.1f} h, taken {found.taken}", flush=True)
        elapsed_s = clock.now_s - begun_s
        due = [chip.conversions - before for chip, before in zip(chips, made, strict=True)]
    if any(sensor.state != SensorState.OK for sensor in pad.sensors):
        found.wrong.append(f"sensors end as {[sensor.state for sensor in pad.sensors]}")
    if pad.bus_errors or pad.config_repairs:
        found.wrong.append(f"{pad.bus_errors} bus errors, {pad.config_repairs} repairs")
    # One conversion may be under way at either end.
    lost = [one - two for one, two in zip(due, found.taken, strict=True)]
    if min(lost) < -1 or max(lost) > 1 + promise.overwritten * max(due):
        found.wrong.append(f"{due} conversions, {found.taken} taken")
    rate_hz = promise.rate_hz or found.frames / elapsed_s
    # A chip's own clock determines when it converts, but not when the driver starts the next measurement.
    errors = CLOCK_ERRORS if promise.rate_hz else (0.0,) * number_of_chips
    rates = [count / elapsed_s * (1.0 + error) / rate_hz for count, error in zip(due, errors, strict=False)]
    if max(abs(rate - 1.0) for rate in rates) > 1e-4:
        found.wrong.append(f"rates are {rates} of what is due")
    # 20 s have 3000 samples and more: the mean of one axis is 5 deviations off once in 1.7 million, the noise 6 %.
    if max(found.field_deviations) > 5.0 or max(abs(ratio - 1.0) for ratio in found.noise_ratios) > 0.07:
        found.wrong.append("field or noise is not as promised")
    if found.temperature_errors_c and max(found.temperature_errors_c) > 0.13:  # the coarsest has 1/8 °C a step
        found.wrong.append("the temperature is not the chip's")
    return {
        "chip": CHIPS[kind].label,
        "hours": round(elapsed_s / 3600, 2),
        "conversions": due,
        "taken": found.taken,
        "frames": found.frames,
        "transfers": bus.bus.transfers - transfers,
        "rate_over_due": [round(rate, 5) for rate in rates],
        "noise_over_data_sheet": [
            round(float(value), 4) for value in (min(found.noise_ratios), max(found.noise_ratios))
        ],
        "worst_mean_deviations": round(max(found.field_deviations), 2),
        "worst_temperature_c": round(max(found.temperature_errors_c), 3) if found.temperature_errors_c else None,
        "saturations": dict(found.saturations),
        "wrong": found.wrong,
        "cpu_s": round(time.process_time() - begun_cpu_s, 1),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--chips", nargs="+", choices=PROMISED, default=list(PROMISED))
    parser.add_argument("--on-pad", type=int, default=2, choices=(1, 2), help="how many of a kind, behind one mux")
    parser.add_argument("--interpreted", action="store_true", help="do not compile the emulated chips")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        if not options.interpreted:
            compile_into(Path(name))
        wrong = 0
        for kind in options.chips:
            gc.collect()
            gc.freeze()
            facts = day(kind, options.hours, options.on_pad)
            print(facts, flush=True)
            wrong += bool(facts["wrong"])
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
