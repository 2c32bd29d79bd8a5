"""Light presses on warm pads whose offsets drift: which contacts are published, and how many frames after they begin.

A contact that such a drift explains is published once it has lasted for some frames (`fmfts_doubt_drift` of
contact/touch.c). Until then it is in the pipeline's memory alone: as it was published before there was this doubt.
"""

from __future__ import annotations

import math
from argparse import Namespace
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

from fmfts.contact import ContactModel
from fmfts.contact._contact import RELEASE_FRAMES
from fmfts.pipeline.configured import load_contact_model
from fmfts.pipeline.encoded import message_of
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.sensor.frame import WireFrame
from fmfts_lab.bench.silicone import Effect, RealPad, baseline_of
from fmfts_lab.bench.tapped import without_baseline
from fmfts_lab.bench.warming import WarmingPad, batches
from fmfts_simulation.finger import Finger, Touch, no_finger

SPOTS = {"middle": 0.0, "rim": 9e-3}  # x, of pads that are calibrated within 10 mm
FORCES_N, RATES_N_PER_S = (0.12, 0.3), (0.05, 0.3, 3.0)
WARMS_S, STAYS_S, BEFORE_S, HOLD_S, AFTER_S = 19.0, 1.0, 0.25, 1.0, 2.0
LASTING_FRAMES = RELEASE_FRAMES + 1  # contact/touch.c


class Seen(NamedTuple):
    """A frame. begun: its contact, published or not."""

    begun: bool
    published: bool
    force_n: float
    force_sd_n: float


class WarmPad:
    """It has warmed by `kelvin` since its baseline, untouched, in a constant field."""

    def __init__(
        self, seed: int, kelvin: float, times: float, seconds: float = WARMS_S, stays_s: float = STAYS_S
    ) -> None:
        config = Effect("offset drift", ("offset_drift",)).config("constant", seed)
        model = load_contact_model(config)
        assert isinstance(model, ContactModel)
        self.pipeline: PadPipeline = without_baseline(config, model)
        self.pipeline.use(baseline_of(config, RealPad(config), turn=False))
        self.source = WarmingPad(config)
        self.source.drifts(times)
        self.source.most_k, self.source.seconds, self.source.finger = kelvin, seconds, no_finger
        self.untouched = [seen for frames in batches(self.source, seconds + stays_s) for seen in self.sees(frames)]

    def sees(self, frames: Iterable[WireFrame]) -> list[Seen]:
        seen = []
        for frame in frames:
            message = message_of(self.pipeline.answer(frame))
            begun = float(self.pipeline.memory.fields["in_contact"]) != 0.0
            force = message.force_n, message.force_sd_n
            force_n, force_sd_n = (math.nan if number is None else number for number in force)
            seen.append(Seen(begun, message.contact is True, force_n, force_sd_n))
        return seen

    def pressed(self, x_m: float, force_n: float, rate_n_per_s: float) -> list[Seen]:
        """The frames of a press of `force_n` that rises evenly; the finger then leaves, and the silicone recovers."""
        begins_s, rise_s = self.source.time_s + BEFORE_S, force_n / rate_n_per_s
        self.source.finger = _rising(begins_s, x_m, force_n, rate_n_per_s)
        seen = self.sees(self.source.recorded(BEFORE_S + rise_s + HOLD_S))
        self.source.finger = no_finger
        self.sees(self.source.recorded(AFTER_S))
        return seen


def _rising(begins_s: float, x_m: float, force_n: float, rate_n_per_s: float) -> Finger:
    def finger(time_s: float) -> Touch:
        risen_n = min((time_s - begins_s) * rate_n_per_s, force_n)
        return Touch(x_m, 0.0, risen_n) if risen_n > 0.0 else Touch(0.0, 0.0, 0.0)

    return finger


def lasting_onset(seen: list[Seen]) -> int | None:
    """The first frame of the first contact that lasts."""
    begun = np.array([one.begun for one in seen])
    lasts = np.convolve(begun, np.ones(LASTING_FRAMES), mode="valid") == LASTING_FRAMES
    return int(np.argmax(lasts)) if lasts.any() else None


@dataclass(slots=True)
class Row:
    """The same press on all pads. begun, brief: how many began a contact that lasted, or only briefer ones. published:
    of both. late_frames: of the latest that lasted."""

    kelvin: float
    force_n: float
    spot: str
    rate_n_per_s: float
    presses: int = 0
    begun: int = 0
    brief: int = 0
    published: int = 0
    late_frames: int = 0

    def saw(self, seen: list[Seen]) -> None:
        self.presses += 1
        onset, published = lasting_onset(seen), [one.published for one in seen]
        self.begun += onset is not None
        self.brief += onset is None and any(one.begun for one in seen)
        self.published += any(published)
        if onset is not None and any(published[onset:]):
            self.late_frames = max(self.late_frames, published[onset:].index(True))

    @property
    def line(self) -> str:
        return (
            f"{self.kelvin:2.0f} K {self.force_n:.2f} N {self.spot:6} {self.rate_n_per_s:4.2f} N/s: contact begins in "
            f"{self.begun} of {self.presses} (and briefly in {self.brief}), published in {self.published}, at most "
            f"{self.late_frames} frames later"
        )


def run(options: Namespace) -> None:
    kinds = list(product(options.kelvin, FORCES_N, SPOTS, RATES_N_PER_S))
    rows = {kind: Row(*kind) for kind in kinds}
    for kelvin, seed in product(options.kelvin, range(options.seed, options.seed + options.pads)):
        pad = WarmPad(seed, kelvin, options.times)
        for kind in kinds:
            if kind[0] == kelvin:
                _, force_n, spot, rate_n_per_s = kind
                rows[kind].saw(pad.pressed(SPOTS[spot], force_n, rate_n_per_s))
    for row in rows.values():
        print(row.line)
    if options.out:
        Path(options.out).write_bytes(msgspec.json.format(msgspec.json.encode(list(rows.values()))) + b"\n")
