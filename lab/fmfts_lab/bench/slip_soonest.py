"""When a slip can be noticed at the soonest, by the noise of the frames alone; beside the delays that were measured."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fmfts.contact import ContactModel
from fmfts.contact.response import Response
from fmfts.sensor.chips import NOISE_T
from fmfts_calibrate.samples import Samples
from fmfts_calibrate.tracked import FrameSolver
from fmfts_lab.bench.drills import RATE_HZ
from fmfts_lab.bench.slip_world import Slide
from fmfts_lab.bench.workspace import standard_pad
from fmfts_lab.calibration.simulated import rest_field_of

NEEDED = np.log(9.0 / 2e-4)  # log odds: BEGINS against FALSE_ODDS of contact/friction.c
FIRM_N, OUTER_MM, WANTED_S = 1.2, 4.0, 0.025


def soonest_s(deviation_mm: float, speed_mm_per_s: float) -> float:
    """When the frames' log odds of a slip of known beginning and speed v beat contact/friction.c's odds against it.

    After the time t they are the sum of (v·t_i)²/2s², t_i = i/rate: v²t³·rate/6s², s the deviation of a frame's place.
    """
    return float((6.0 * NEEDED * (deviation_mm / speed_mm_per_s) ** 2 / RATE_HZ) ** (1.0 / 3.0))


@dataclass(frozen=True, slots=True)
class Timed:
    """A slide of the table. delay_s: infinite if the slip was missed. soonest_s: if each frame has its own shear;
    known_s: if the shear were known."""

    speed_mm_per_s: float
    force_n: float
    radius_mm: float
    delay_s: float
    soonest_s: float
    known_s: float


@dataclass(frozen=True, slots=True)
class Timer:
    """The standard pad's response, and its frames with noise."""

    response: Response
    solver: FrameSolver

    @classmethod
    def standard(cls) -> Timer:
        pad = standard_pad()
        response = ContactModel.load("shear", pad).response
        assert response is not None
        return cls(response, FrameSolver(pad, rest_field_of(pad), "drifting", NOISE_T))

    def timed(self, slide: Slide, delay_s: float) -> Timed:
        """Its deviations are those where the slip begins, along its way."""
        place_mm, speed_mm_per_s = slide.start_m * 1e3, slide.speed_m_per_s * 1e3
        press = np.array([[*place_mm, slide.force_n, *(slide.friction * slide.force_n * slide.along)]])
        covariance = Samples.expected(self.response, self.solver, press).covariance[0]
        slope = self.response.change_and_slope(press)[1][0]
        normal = slope.T @ np.linalg.inv(covariance) @ slope
        unknown, known = (np.linalg.inv(each)[:2, :2] for each in (normal, normal[:3, :3]))
        times = [
            soonest_s(float(np.sqrt(slide.along @ spread @ slide.along)), speed_mm_per_s) for spread in (unknown, known)
        ]
        return Timed(speed_mm_per_s, slide.force_n, float(np.hypot(*place_mm)), delay_s, times[0], times[1])


def lines(timed: list[Timed]) -> Iterator[str]:
    """A row for each speed, force and distance: how many, noticed, and medians of the delays."""
    yield "  speed, force, distance: slides, noticed, delay | soonest, with the shear known (ms) | known within 25 ms"
    for speed in sorted({each.speed_mm_per_s for each in timed}):
        for firm in (False, True):
            for outer in (False, True):
                here = [
                    each
                    for each in timed
                    if each.speed_mm_per_s == speed
                    and (each.force_n >= FIRM_N) == firm
                    and (each.radius_mm >= OUTER_MM) == outer
                ]
                if here:
                    yield _line(here, firm, outer)


def _line(here: list[Timed], firm: bool, outer: bool) -> str:
    delay = np.array([each.delay_s for each in here])
    medians = [np.median([each.soonest_s for each in here]), np.median([each.known_s for each in here])]
    within = np.mean([each.known_s <= WANTED_S for each in here])
    force, distance = ("from" if each else "below" for each in (firm, outer))
    return (
        f"  {here[0].speed_mm_per_s:5g} mm/s, {force:5} {FIRM_N:g} N, {distance:5} {OUTER_MM:g} mm: {len(here):3d}, "
        f"{np.isfinite(delay).mean():5.0%}, {np.median(delay) * 1e3:5.0f} | "
        f"{medians[0] * 1e3:5.0f}, {medians[1] * 1e3:5.0f} | {within:.0%}"
    )
