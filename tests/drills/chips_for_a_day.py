"""`make chips-for-a-day`: every driver on its emulated chips for a day of their time; no sample lost, none taken twice.

    .venv/bin/python tests/drills/chips_for_a_day.py --hours 24 --chips mlx90393

A day takes an hour for each chip, so it is no part of `make test`, which does 20 s of the same.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

for folder in (".", "unit"):
    sys.path.insert(0, str(Path(__file__).parents[1] / folder))

from emulated_bus import Clock, emulated_pad, patched, run  # noqa: E402
from test_chip_drivers import KINDS  # noqa: E402

from fmfts.sensor.chips import CHIPS  # noqa: E402
from fmfts.sensor.wire.packets import SensorState  # noqa: E402

RATE_HZ = {"qmc5883l": 200, "lis3mdl": 155, "mmc5983ma": 200, "mlx90393": 226}
STRETCH_S = 600.0


def day(kind: str, hours: float) -> dict[str, object]:
    clock = Clock()
    with patched(clock):
        chips = [
            KINDS[kind](clock, (0.5, -0.3, 0.2), clock_error=error, noise_gauss=0.02, seed=number)
            for number, error in enumerate((-0.03, 0.02))
        ]
        pad, _ = emulated_pad(clock, kind, chips, rate_hz=RATE_HZ[kind])
        run(pad, clock, 1.0, 2 * RATE_HZ[kind])
        made, taken, begun_s, wall_s = [chip.conversions for chip in chips], [0, 0], clock.now_s, time.monotonic()
        while clock.now_s - begun_s < hours * 3600:
            # The registers are checked as the reader does it, once a second for each of four sensors.
            for sample in run(pad, clock, STRETCH_S, 2 * RATE_HZ[kind], watch_s=1.0):
                taken = [count + (sample.fresh >> number & 1) for number, count in enumerate(taken)]
        due = [chip.conversions - before for chip, before in zip(chips, made, strict=True)]
    assert all(sensor.state == SensorState.OK for sensor in pad.sensors)
    return {
        "chip": CHIPS[kind].label,
        "hours": round((clock.now_s - begun_s) / 3600, 2),
        "conversions": due,
        "taken": taken,
        "errors": pad.bus_errors,
        "repairs": pad.config_repairs,
        "wall_s": round(time.monotonic() - wall_s, 1),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--chips", nargs="+", choices=KINDS, default=list(KINDS))
    options = parser.parse_args()
    wrong = 0
    for kind in options.chips:
        facts = day(kind, options.hours)
        print(facts, flush=True)
        differences = [abs(one - two) for one, two in zip(facts["conversions"], facts["taken"], strict=True)]  # type: ignore[call-overload]
        wrong += max(differences) > 1  # one may be under way at either end
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
