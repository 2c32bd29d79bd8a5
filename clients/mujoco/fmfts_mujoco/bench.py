"""Measures what pads cost a simulation, how right their messages are, and how well their deviations cover the errors.

python -m fmfts_mujoco.bench [--quick]
"""

from __future__ import annotations

import argparse
import os
import time
from contextlib import suppress
from dataclasses import dataclass, field

import mujoco
import numpy as np
from fmfts.config import PadConfig, SimulatedSource
from fmfts.config.sources import Imperfection
from fmfts.pad import Array
from fmfts_client import Contact

from fmfts_mujoco.alike import alike
from fmfts_mujoco.in_process import Pads

READ_EVERY_S = 0.04
APART_M = 0.05
BALL_KG = 0.08


def go_before_others() -> None:
    """Give this process priority, as root. Without it, other programs of this computer affect the result."""
    with suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, -15)


def table(pads: int, friction: float = 0.3) -> mujoco.MjModel:
    """Pads on a table, and a ball of 80 g on each, which slides up and down and along x and y."""
    bodies = []
    for number in range(pads):
        x_m, y_m = APART_M * (number % 4), APART_M * (number // 4)
        slides = "".join(f'<joint type="slide" axis="{axis}" damping="1"/>' for axis in ("0 0 1", "1 0 0", "0 1 0"))
        bodies.append(
            f'<body pos="{x_m} {y_m} 0"><geom type="box" size="0.02 0.02 0.006" pos="0 0 0.008"/>'
            f'<site name="pad{number}"/></body>'
            f'<body pos="{x_m} {y_m} 0.0291">{slides}'
            f'<geom type="sphere" size="0.015" mass="{BALL_KG}" friction="{friction}"/></body>'
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
    go_before_others()
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


@dataclass
class Covered:
    """The results of presses: errors, and published deviations (N, m, m), of the answered ones."""

    presses: int = 0
    errors: list[Array] = field(default_factory=list)
    deviations: list[Array] = field(default_factory=list)

    def __str__(self) -> str:
        error, shares = np.abs(self.errors), np.abs(self.errors) / np.array(self.deviations)
        within = 100.0 * (shares < 1.96).mean(axis=0)
        return (
            f"{self.presses} presses, {100 * len(error) / self.presses:.1f} % answered: {within[0]:.1f} % of forces, "
            f"{within[1:].mean():.1f} % of places within 1.96 deviations, the worst at {shares.max():.1f}\n"
            f"  mean errors {error[:, 0].mean():.3f} N, {1e3 * error[:, 1:].mean():.2f} mm"
        )


def coverage(hands: int, count: int, presses: int, *, as_built: bool) -> Covered:
    """Presses on `hands` times `count` pads, each by its own force of 0.3 to 1.8 N up to 8 mm from the middle, and
    looked at after 0.2 s. as_built: on other pads with other fingers, that creep, and are sheared by up to 0.3 of the
    force, in a pad's configuration as it comes; else on good pads without shear."""
    covered, model = Covered(), table(count, friction=0.6)
    kinds: tuple[Imperfection, ...] = ("silicone",) if as_built else ()
    for hand in range(hands):
        random, data = np.random.default_rng([1, hand]), mujoco.MjData(model)
        sources = [SimulatedSource(seed=hand * count + each, imperfections=kinds) for each in range(count)]
        configs = [PadConfig(name=f"pad{each}", source=source) for each, source in enumerate(sources)]
        pads = Pads(model, data, configs, as_built=as_built)
        pads.reset(hand)
        for _ in range(presses):
            force_n, place_m = random.uniform(0.3, 1.8, count), random.uniform(-8e-3, 8e-3, (count, 2))
            share, towards = 0.3 * as_built * np.sqrt(random.uniform(size=count)), random.uniform(0.0, 2 * np.pi, count)
            shear_n = (share * force_n)[:, None] * np.stack([np.cos(towards), np.sin(towards)], axis=1)
            told = pressed(model, data, pads, place_m, np.column_stack([shear_n, -force_n]))
            covered.presses += count
            for number, last in enumerate(told):
                if not last.valid or last.x_m is None or last.y_m is None:
                    continue
                place = np.subtract((last.x_m, last.y_m), place_m[number])
                covered.errors.append(np.array([last.force_n - force_n[number], *place]))
                covered.deviations.append(np.array([last.force_sd_n, last.x_sd_m, last.y_sd_m]))
            pressed(model, data, pads, place_m, np.tile([0.0, 0.0, 0.05], (count, 1)))
    return covered


def pressed(model: mujoco.MjModel, data: mujoco.MjData, pads: Pads, place_m: Array, load_n: Array) -> list[Contact]:
    """The last message of each pad after 0.2 s under these loads (K, 3). The balls are held where they press."""
    count = len(place_m)
    data.qvel[:] = 0.0
    data.xfrc_applied[2::2, :3] = np.add(load_n, (0.0, 0.0, BALL_KG * 9.81))
    for _ in range(200):
        data.qpos.reshape(count, 3)[:, 1:] = place_m
        mujoco.mj_step(model, data)
        pads.step(data)
    told = pads.contacts()
    return [told[f"pad{number}"][-1] for number in range(count)]


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
    found = [
        alike(PadConfig(name="pad", source=SimulatedSource(seed=seed)), (4e-3, -3e-3, 0.8)) for seed in range(1, 6)
    ]
    apart, noise, deviation = (np.array(each) for each in zip(*found, strict=True))
    print(
        f"a press of 0.8 N here and in the daemon's simulation, 5 pads: means differ by {apart.max():.2f} of a frame's "
        f"noise at most,\n  noises by {100 * np.abs(noise - 1.0).max():.0f} %, deviations by "
        f"{100 * np.abs(deviation - 1.0).max():.1f} %"
    )
    for name, as_built in (("good pads", False), ("pads as built", True)):
        hands = 8 if quick else 16
        print(f"{8 * hands} {name}: {coverage(hands, 8, 2 if quick else 4, as_built=as_built)}")


if __name__ == "__main__":
    main()
