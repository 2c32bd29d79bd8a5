"""Measures what pads cost a simulation, how right their messages are, and how well their deviations cover the errors.

python -m fmfts_mujoco.bench [--quick]
"""

from __future__ import annotations

import argparse
import time

import mujoco
import numpy as np
from fmfts.config import PadConfig, SimulatedSource
from fmfts.pad import Array

from fmfts_mujoco.in_process import Pads

READ_EVERY_S = 0.04
APART_M = 0.05


def table(pads: int) -> mujoco.MjModel:
    """Pads on a table, and a ball of 80 g on each, which slides up and down and along x and y."""
    bodies = []
    for number in range(pads):
        x_m, y_m = APART_M * (number % 4), APART_M * (number // 4)
        slides = "".join(f'<joint type="slide" axis="{axis}" damping="1"/>' for axis in ("0 0 1", "1 0 0", "0 1 0"))
        bodies.append(
            f'<body pos="{x_m} {y_m} 0"><geom type="box" size="0.02 0.02 0.006" pos="0 0 0.008"/>'
            f'<site name="pad{number}"/></body>'
            f'<body pos="{x_m} {y_m} 0.0291">{slides}'
            '<geom type="sphere" size="0.015" mass="0.08" friction="0.3"/></body>'
        )
    options = '<option timestep="0.001" magnetic="0.2 0 -0.45"/>'
    return mujoco.MjModel.from_xml_string(f"<mujoco>{options}<worldbody>{''.join(bodies)}</worldbody></mujoco>")


def pads_on(model: mujoco.MjModel, count: int) -> tuple[Pads, mujoco.MjData]:
    data = mujoco.MjData(model)
    return Pads(
        model, data, [PadConfig(name=f"pad{each}", source=SimulatedSource(seed=each)) for each in range(count)]
    ), data


def cost(count: int, seconds: float) -> tuple[float, float]:
    """Processor time in s of a second of the simulation, without the pads and with them; the same model in turn."""
    model = table(count)
    pads, data = pads_on(model, count)
    spent: dict[bool, list[float]] = {False: [], True: []}
    every = round(READ_EVERY_S / model.opt.timestep)
    for turn in range(2 * round(seconds)):
        felt, begun_s = turn % 2 == 1, time.process_time()
        for step in range(1000):
            mujoco.mj_step(model, data)
            if felt:
                pads.step(data)
                if step % every == every - 1:
                    pads.contacts()
        spent[felt].append(time.process_time() - begun_s)
    return min(spent[False]), min(spent[True])


def coverage(count: int, presses: int) -> tuple[float, float, Array]:
    """Shares of errors within 1.96 deviations of force and place, and the errors themselves (N, m, m) by press.

    Each press is of another place and force, up to 8 mm from the middle and 1.8 N, and looked at after 0.2 s.
    """
    random = np.random.default_rng(1)
    model = table(count)
    pads, data = pads_on(model, count)
    inside, errors = [], []
    for _ in range(presses):
        place_m, force_n = random.uniform(-8e-3, 8e-3, (count, 2)), random.uniform(0.3, 1.8, count)
        data.qpos.reshape(count, 3)[:, 1:] = place_m
        data.qvel[:] = 0.0
        data.xfrc_applied[2::2, 2] = 0.08 * 9.81 - force_n
        for _ in range(200):
            data.qpos.reshape(count, 3)[:, 1:] = place_m
            mujoco.mj_step(model, data)
            pads.step(data)
        told = pads.contacts()
        for number in range(count):
            last = told[f"pad{number}"][-1]
            if not last.valid or last.x_m is None:
                continue
            error = np.array([last.force_n - force_n[number], *((last.x_m, last.y_m) - place_m[number])])
            deviation = np.array([last.force_sd_n, last.x_sd_m, last.y_sd_m])
            inside.append(np.abs(error) < 1.96 * deviation)
            errors.append(error)
    covered = np.array(inside)
    return float(covered[:, 0].mean()), float(covered[:, 1:].mean()), np.array(errors)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--quick", action="store_true", help="a few seconds of each")
    quick = options.parse_args().quick
    for count in (1, 16):
        without_s, with_s = cost(count, 3 if quick else 10)
        print(
            f"{count} pads: a step of 1 ms takes {1e3 * without_s:.1f} µs without and {1e3 * with_s:.1f} µs with them:"
        )
        print(f"  {1e3 * (with_s - without_s):.1f} µs more; {1.0 / with_s:.1f} × real time on one core")
    force, place, errors = coverage(8, 10 if quick else 40)
    print(
        f"{len(errors)} presses: {100 * force:.1f} % of forces and {100 * place:.1f} % of places within 1.96 deviations"
    )
    print(f"  mean errors {np.abs(errors[:, 0]).mean():.3f} N, {1e3 * np.abs(errors[:, 1:]).mean():.2f} mm")


if __name__ == "__main__":
    main()
