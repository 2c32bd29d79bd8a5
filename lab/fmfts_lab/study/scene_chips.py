"""What each kind of chip is worth at this pad: the contact's error by the Cramér–Rao bound, and saturation.

The bound is that of one frame (scene/error_budget.py), with the noise of a sample at the chip's own rate and that of
its steps, step²/12. A chip that converts faster than it is read gives its newest sample, without averaging. "mean": the
place's error in the mean of the frames of 1/220 s, for a faster reader.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from fmfts.config import PadConfig
from fmfts.sensor.chips import CHIPS, Chip
from fmfts.sensor.chips.rates import BusLoad, i2c_rate_hz
from fmfts_lab.scene import Cost, Surroundings, configured, costs
from fmfts_lab.study.harness import Row
from fmfts_lab.study.scene_facts import largest_field_gauss, recommended_range_gauss

USUAL_HZ = 220
CLOCK_HZ = 400_000  # the fastest clock that every chip and the mux support
HEADER = (
    f"{'chip':10} {'trigger':13} {'rate, Hz':>9} {'noise, µT':>10} {'range, G':>9} {'place, mm':>10} {'force, N':>9} "
    f"{'mean, mm':>9}  saturation, and what it needs"
)


@dataclass(frozen=True, slots=True)
class Setting:
    """A chip as it would be used here. range_gauss: None where no range holds the field."""

    chip: Chip
    rate_hz: int
    trigger: str
    range_gauss: float | None

    @property
    def noise_t(self) -> float:
        """The noise of one sample, including its steps: the mean of the axes."""
        code = 0 if self.range_gauss is None else self.chip.gain_code_for_range(self.range_gauss)
        steps = self.chip.step_t[code]
        return float(np.sqrt(self.chip.noise_at_t(self.rate_hz, self.trigger) ** 2 + np.mean(steps**2) / 12.0))


def chip_rows(surroundings: Surroundings) -> Iterator[Row]:
    """Every chip as `settings` has it, on a bus of 400 kHz."""
    sensors, largest = len(surroundings.config.geometry.sensors_mm), largest_field_gauss(surroundings)
    for chip in CHIPS.values():
        if chip.streamed:
            continue
        of_chip = replace(surroundings, config=_with(surroundings, chip))
        found = recommended_range_gauss(of_chip)
        for setting in settings(chip, sensors, found):
            cost = _cost(of_chip, setting)
            wiring = _wiring(chip, sensors)
            yield {
                "kind": "chip",
                "chip": chip.label,
                "trigger": setting.trigger,
                "rate_hz": setting.rate_hz,
                "noise_ut": setting.noise_t * 1e6,
                "range_gauss": found,
                "noise_mm": cost.noise_mm,
                "noise_n": cost.noise_n,
                "mean_mm": cost.noise_mm * float(np.sqrt(min(1.0, USUAL_HZ / setting.rate_hz))),
                "causes": wiring if found is not None else f"saturates: {largest:.1f} G here; {wiring}",
            }


def settings(chip: Chip, sensors: int, range_gauss: float | None) -> list[Setting]:
    """At 220 Hz or the nearest rate, triggered by the host if that is quieter, and at the best rate."""
    found = []
    for trigger in ("free", "simultaneous") if chip.has_trigger else ("free",):
        most = i2c_rate_hz(chip, trigger, CLOCK_HZ, BusLoad(sensors, 1, _needs_mux(chip, sensors)))
        rates = {min(USUAL_HZ, most), most} if trigger == "free" else {min(USUAL_HZ, most)}
        found += [Setting(chip, rate, trigger, range_gauss) for rate in sorted(rates)]
    quietest_t = min(setting.noise_t for setting in found if setting.trigger == "free")
    return [setting for setting in found if setting.trigger == "free" or setting.noise_t < quietest_t]


def printed(rows: list[Row]) -> list[str]:
    lines = ["what each chip is worth at this pad, by the Cramér–Rao bound of one frame:", "", HEADER]
    for row in rows:
        gauss = "none" if row["range_gauss"] is None else f"±{row['range_gauss']:g}"
        lines.append(
            f"{row['chip']:10} {row['trigger']:13} {row['rate_hz']:9} {row['noise_ut']:10.3f} {gauss:>9} "
            f"{row['noise_mm']:10.3f} "
            f"{row['noise_n']:9.4f} {row['mean_mm']:9.3f}  {row['causes']}"
        )
    return lines


def _with(surroundings: Surroundings, chip: Chip) -> PadConfig:
    config = surroundings.config
    return msgspec.structs.replace(config, source=msgspec.structs.replace(config.source, chip=chip.name))


def _cost(surroundings: Surroundings, setting: Setting) -> Cost:
    model = configured(surroundings)
    found = costs(replace(surroundings, noise_t=setting.noise_t), thorough=False)
    return next(cost for cost in found if cost.model == model)


def _needs_mux(chip: Chip, sensors: int) -> bool:
    return len(chip.addresses) < sensors


def _wiring(chip: Chip, sensors: int) -> str:
    return "a mux" if _needs_mux(chip, sensors) else "no mux"
