"""Pads as people build them: chips turned by hand, gains off, an uneven field; the errors after each baseline."""

from __future__ import annotations

from argparse import Namespace
from bisect import bisect
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from fmfts.baseline import Baseline, BaselineError
from fmfts.baseline.mounting import Mounting
from fmfts.baseline.request import REFINE_S, BaselineRequest
from fmfts.bus.messages import ContactMessage
from fmfts.config import ContactConfig, PadConfig, SceneConfig, SiliconeConfig, SimulatedSource, ToleranceConfig
from fmfts.contact import ContactModel
from fmfts.contact.tolerances import PROBE_M
from fmfts.pipeline.configured import load_contact_model
from fmfts.pipeline.encoded import message_of
from fmfts_lab.bench.built_world import CROSS_AXIS, BuiltSource, Defects, Presses
from fmfts_lab.bench.tapped import without_baseline
from fmfts_lab.bench.truth import PUBLISHED, WRONG_DEVIATIONS, Truth
from fmfts_simulation.finger import Finger, no_finger

Counted = Literal["stated", "shipped", "drawn", "unnamed"]
Kind = Literal["bare + rest", "+ refine", "+ turn", "+ turn + refine"]
KINDS: tuple[Kind, ...] = ("bare + rest", "+ refine", "+ turn", "+ turn + refine")
ROBOTS = ("still", "turning")
ROTATIONS_DEG, GAINS = (0.0, 0.5, 1.0, 2.0), (0.005, 0.05)
# RELEASE_FRAMES quiet frames end a contact, and one frame in a hundred is not quiet by noise alone.
RELEASE_S = 0.2
WITHIN_DEVIATIONS = 2.0
# Touches are counted by force between these (N).
LIGHT_N = (0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0)
# A press above this force is missed if none of its frames reports contact.
MISSED_N = 0.15


@dataclass(slots=True)
class Cell:
    """The results of one kind of baseline on all pads of one row."""

    pads: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    frames: int = 0
    health: Counter[str] = field(default_factory=Counter)
    wrong: int = 0
    worst: float = 0.0
    false_contacts: int = 0
    rest_frames: int = 0
    errors: list[list[float]] = field(default_factory=list)  # of x, y and the force
    within: list[float] = field(default_factory=list)  # the share of them within two deviations, of each pad
    off_m: list[float] = field(default_factory=list)
    off_n: list[float] = field(default_factory=list)
    light: Counter[int] = field(default_factory=Counter)  # frames of a touch, by its index in LIGHT_N
    noticed: Counter[int] = field(default_factory=Counter)  # the share of them with contact
    presses: int = 0  # above MISSED_N
    missed: int = 0

    @property
    def line(self) -> str:
        if not self.frames:
            return f"refused {self.refused.total()} of {self.pads}: {dict(self.refused)}"
        published = sum(self.health[name] for name in PUBLISHED) / self.frames
        within = np.mean(np.array(self.errors) <= WITHIN_DEVIATIONS) if self.errors else np.nan
        error = f"{np.mean(self.off_m) * 1e3:.3f} mm {np.mean(self.off_n):.4f} N" if self.off_m else "no contact"
        return (
            f"ok {self.health['ok'] / self.frames:7.2%}, published {published:7.2%}, "
            f"{self.wrong:4d} wrong of {self.frames}, worst {self.worst:5.1f} sd, "
            f"within 2 sd {within:6.2%}, error {error}, "
            f"false contact {self.false_contacts / max(self.rest_frames, 1):.2%}, "
            f"missed {self.missed} of {self.presses} presses, refused {self.refused.total()}\n    touches noticed: "
            + ", ".join(f"{low:g} to {high:g} N {share:.1%}" for low, high, share in self.noticed_shares)
            + "".join(f"\n    {count} × {reason}" for reason, count in self.refused.items())
        )

    @property
    def noticed_shares(self) -> list[tuple[float, float, float]]:
        """A range of forces (N), and the share of published frames of such touches that report contact."""
        bins = list(pairwise(LIGHT_N))
        return [(*bins[place], self.noticed[place] / frames) for place, frames in sorted(self.light.items())]

    @property
    def facts(self) -> dict[str, object]:
        errors = np.array(self.errors) if self.errors else np.full((1, 3), np.nan)
        return {
            "pads": self.pads,
            "refused": dict(self.refused),
            "frames": self.frames,
            "health": dict(self.health),
            "wrong": self.wrong,
            "worst_sd": self.worst,
            "within_2_sd": float(np.mean(errors <= WITHIN_DEVIATIONS)),
            "place_within_2_sd": float(np.mean(errors[:, :2] <= WITHIN_DEVIATIONS)),
            "force_within_2_sd": float(np.mean(errors[:, 2] <= WITHIN_DEVIATIONS)),
            "pads_within_2_sd": self.within,
            "place_error_m": float(np.mean(self.off_m)) if self.off_m else None,
            "force_error_n": float(np.mean(self.off_n)) if self.off_n else None,
            "false_contact_frames": self.false_contacts,
            "rest_frames": self.rest_frames,
            "noticed_shares": self.noticed_shares,
            "presses": self.presses,
            "missed": self.missed,
        }

    def saw(self, messages: Iterable[ContactMessage], truth: Truth, finger: Finger) -> None:
        messages = list(messages)
        deviations = truth.all_deviations(messages)
        self.frames += len(messages)
        self.health.update(message.health for message in messages)
        self.wrong += int((deviations > WRONG_DEVIATIONS).sum())
        self.worst = max(self.worst, float(deviations.max()))
        earlier = len(self.errors)
        felt: bool | None = None  # None: no press
        for message in messages:
            time_s = message.t_sample_ns * 1e-9
            touch = finger(time_s)
            if touch.force_n > MISSED_N:
                felt = bool(felt) or message.contact is True
            elif felt is not None:
                self.presses += 1
                self.missed += not felt
                felt = None
            if touch.force_n == finger(time_s - RELEASE_S).force_n == 0.0:
                self.rest_frames += 1
                self.false_contacts += message.contact is True
            place = bisect(LIGHT_N, touch.force_n) - 1
            if 0 <= place < len(LIGHT_N) - 1 and message.health in PUBLISHED:
                self.light[place] += 1
                self.noticed[place] += message.contact is True
            if (
                message.x_m is not None
                and message.y_m is not None
                and message.force_n is not None
                and touch.force_n > 0.1
            ):
                self.errors.append(truth.contact_errors(message))
                self.off_m += [abs(message.x_m - touch.x_m), abs(message.y_m - touch.y_m)]
                self.off_n.append(abs(message.force_n - touch.force_n))
        if len(self.errors) > earlier:
            self.within.append(float(np.mean(np.array(self.errors[earlier:]) <= WITHIN_DEVIATIONS)))


def pad_config(defects: Defects, refine: bool, counted: Counted) -> PadConfig:
    """counted: what the deviations count besides the gains. "stated": the default tolerances, but for the rotation,
    which is that of the row; pads are drawn from the same. "drawn": only what these pads have, silicone of the model
    and its probe. Only in these two can deviations be as large as errors, and in both no silicone creeps. "shipped":
    all that the daemon counts by default. "unnamed": no rotation and no cross-axis, as before they had tolerances."""
    usual = ToleranceConfig()
    rotation_deg, cross_axis = {
        "stated": (defects.rotation_deg, usual.cross_axis),
        "shipped": (usual.sensor_rotation_deg, usual.cross_axis),
        "drawn": (defects.rotation_deg, CROSS_AXIS),
        "unnamed": (0.0, 0.0),
    }[counted]
    is_drawn = counted == "drawn"
    structure = 0.0 if is_drawn else None
    finger_mm = (1e3 * PROBE_M, 1e3 * PROBE_M) if is_drawn else ContactConfig().finger_mm
    return PadConfig(
        name="built",
        source=SimulatedSource(finger="none", turning_deg_per_s=0.0),
        tolerance=ToleranceConfig(
            gain=defects.gain,
            sensor_rotation_deg=rotation_deg,
            cross_axis=cross_axis,
            modulus=structure,
            thickness_mm=structure,
        ),
        silicone=SiliconeConfig(creep_per_decade=0.0, hysteresis=0.0)
        if counted in ("stated", "drawn")
        else SiliconeConfig(),
        scene=SceneConfig(ambient="drifting" if defects.turning else "constant"),
        # The fingers of these worlds do not shear: otherwise the deviations are twice as wide, and hide errors.
        contact=ContactConfig(refine=refine, friction=0.0, finger_mm=finger_mm),
    )


Made = tuple[Baseline, Mounting | None]


def baselines_of(
    config: PadConfig, source: BuiltSource, random: np.random.Generator, kinds: Iterable[Kind] = KINDS
) -> dict[Kind, Made | str]:
    """These kinds of baseline with their mountings, or why one was refused; with frames as a daemon records them."""

    def made(earlier: Made | str | None, *, bare: bool = False, turn: bool = False, refine: bool = False) -> Made | str:
        if isinstance(earlier, str):
            return earlier
        before = None if earlier is None else earlier[0]
        request = BaselineRequest(config.pad(), config.tolerance.si(), bare, False, turn=turn, refine=refine)
        source.mounted, source.attitude = not bare, "tumbling" if turn else "still"
        source.finger = Presses(random, REFINE_S / 64) if refine else no_finger
        try:
            baseline, mounting = request.make(source.recorded(request.seconds), before)
            return baseline, mounting if isinstance(mounting, Mounting) else None
        except BaselineError as error:
            return str(error)

    rest = made(made(None, bare=True))
    found: dict[Kind, Made | str] = {"bare + rest": rest}
    if "+ turn" in kinds or "+ turn + refine" in kinds:
        found["+ turn"] = made(rest, turn=True)
    if "+ refine" in kinds:
        found["+ refine"] = made(rest, refine=True)
    if "+ turn + refine" in kinds:
        found["+ turn + refine"] = made(found["+ turn"], refine=True)
    return found


def trial(
    defects: Defects,
    seed: int,
    seconds: float,
    cells: dict[Kind, Cell],
    model: ContactModel,
    refine: bool,
    counted: Counted,
    untouched: bool = False,
) -> None:
    """One pad, after each kind of baseline that has a cell."""
    random = np.random.default_rng(
        [seed, round(defects.rotation_deg * 10), round(defects.gain * 1000), defects.turning]
    )
    config = pad_config(defects, refine, counted)
    source = BuiltSource(config, defects, random)
    baselines = baselines_of(config, source, random, cells)
    for kind, cell in cells.items():
        baseline = baselines[kind]
        cell.pads += 1
        if isinstance(baseline, str):
            cell.refused[baseline.split("refused: ", 1)[-1]] += 1
            continue
        pipeline = without_baseline(config, model)
        pipeline.use(*baseline)
        finger: Finger = no_finger if untouched else Presses(np.random.default_rng(seed))
        source.mounted, source.finger = True, finger
        source.attitude = "turning" if defects.turning else "still"
        answers = [pipeline.answer(frame) for frame in source.recorded(seconds)]
        messages = (message_of(one) for one in answers)
        cell.saw(messages, Truth(source.built, finger), finger)


def run(options: Namespace) -> None:
    found: list[dict[str, object]] = []
    for rotation_deg in options.rotations:
        for gain in options.gains:
            for turning in (robot == "turning" for robot in options.robots):
                defects = Defects(rotation_deg, gain, turning, stated=options.counted == "stated")
                cells: dict[Kind, Cell] = {kind: Cell() for kind in KINDS if kind in options.baselines}
                model = load_contact_model(pad_config(defects, options.refine, options.counted))
                for seed in range(options.seed, options.seed + options.pads):
                    trial(
                        defects,
                        seed,
                        options.seconds,
                        cells,
                        model,
                        options.refine,
                        options.counted,
                        options.untouched,
                    )
                for kind, cell in cells.items():
                    print(f"{defects.label} {kind:15} {cell.line}", flush=True)
                    found.append(
                        {
                            "seed": options.seed,
                            "rotation_deg": rotation_deg,
                            "gain": gain,
                            "turning": turning,
                            "kind": kind,
                        }
                        | cell.facts
                    )
    if options.out:
        Path(options.out).write_bytes(msgspec.json.format(msgspec.json.encode(found)) + b"\n")
