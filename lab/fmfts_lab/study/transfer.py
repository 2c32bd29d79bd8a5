"""What transfers from the shipped pad to others, whose magnets and silicone differ: the paper's Table 4 over both.

The paper's pads differ in remanence alone. Here stiffness and thickness differ, too: presses are those that CalculiX
has solved (bench/cast_pads.py), chips are turned by hand and gains are off. Every pad has its bare, rest and turn.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import msgspec
import numpy as np

from fmfts.baseline.recording import summarise
from fmfts.config import PadConfig, ToleranceConfig
from fmfts.pad import Array
from fmfts.pipeline.configured import load_contact_model
from fmfts.sensor import Frame
from fmfts.sensor.chips import NOISE_T
from fmfts_calibrate.dataset import CalibrationSet, standard_pad
from fmfts_calibrate.training import Options, calibrate
from fmfts_lab.bench.cast_pads import CastFinger, CastPad, ramps
from fmfts_lab.bench.few_presses import GAUGE_SCALE, PROBE_MM, Pressed, corrected, labelled_by_gauge, presses_of
from fmfts_lab.bench.silicone import messages_of
from fmfts_lab.bench.structure import CALIBRATED_N, FELT_N, Cell
from fmfts_lab.bench.tapped import without_baseline
from fmfts_lab.bench.weigh import Bench
from fmfts_lab.calibration.regressors import BackPropagation
from fmfts_lab.calibration.simulated import pressed_fields, rest_field_of
from fmfts_lab.study import transfer_chart
from fmfts_lab.study.harness import Facts, Request, Row, Study
from fmfts_simulation.finger import Finger

TOLERANCE = ToleranceConfig(gain=0.005, modulus=0.5, remanence=0.2)
SECONDS, QUICK_SECONDS = 14.0, 7.0
FEW = 5
# The user's own calibration: presses at every solved place and its mirror images, labelled by a stage and a gauge.
OWN_FORCES_N, OWN_PLACE_MM, OWN_READING = (0.3, 0.6, 0.9, 1.2, 1.5), 0.05, 0.01
OWN_HIDDEN, OWN_PRESSES = 16, 4000
FIELD_HIDDEN, FIELD_PRESSES, REACH_MM = (16,), 2000, 10.0
COLUMNS = ("pad", "remanence_t", "modulus", "thickness_mm", "method", "force_off", "force_off_90", "place_mm", "frames")


class Kind(NamedTuple):
    """A pad: remanence in T, modulus over the shipped model's, thickness in mm."""

    remanence_t: float
    modulus: float
    thickness_mm: float

    @property
    def name(self) -> str:
        return f"{self.remanence_t:g} T, modulus × {self.modulus:g}, {self.thickness_mm:g} mm"


PADS = (
    Kind(1.23, 1.0, 4.0),
    Kind(1.05, 1.0, 4.0),
    Kind(1.38, 0.5, 4.0),
    Kind(1.1, 2.0, 4.0),
    Kind(1.33, 0.7, 3.6),
    Kind(1.16, 1.4, 4.4),
)
QUICK_PADS = (PADS[0], PADS[3])
FIELD, POSE, WEIGHT, PRESSES, OWN = (
    "field → force",
    "pose → force",
    "pose, one weight",
    "pose, five presses",
    "own calibration",
)
METHODS = (FIELD, POSE, WEIGHT, PRESSES, OWN)


@dataclass(frozen=True)
class OfPad:
    """One pad, and the frames under presses that every method answers. found: force (N) and place (mm) of each
    frame.
    """

    kind: Kind
    seed: int
    seconds: float
    bench: Bench

    @classmethod
    def of(cls, kind: Kind, seed: int, seconds: float) -> OfPad:
        cell = Cell(kind.name, kind.modulus, kind.thickness_mm)
        return cls(kind, seed, seconds, Bench(cell, PROBE_MM, seed, TOLERANCE, kind.remanence_t))

    @property
    def cell(self) -> Cell:
        return Cell(self.kind.name, self.kind.modulus, self.kind.thickness_mm)

    @property
    def finger(self) -> CastFinger:
        solved = ramps(CastPad(self.kind.thickness_mm, PROBE_MM), sheared=False)
        return CastFinger(solved, CALIBRATED_N * self.kind.modulus, np.random.default_rng(self.seed))

    def row(self, method: str, true: Array, found: Array) -> Row:
        off = np.abs(found[:, 2] / true[:, 2] - 1.0)
        away = np.hypot(*(found[:, :2] - true[:, :2]).T)
        return {
            "pad": self.kind.name,
            **self.kind._asdict(),
            "method": method,
            "force_off": round(float(np.median(off)), 4),
            "force_off_90": round(float(np.quantile(off, 0.9)), 4),
            "place_mm": round(float(np.median(away)), 3),
            "frames": len(true),
        }

    def told(self, config: PadConfig, weighed: bool = False) -> tuple[Array, Array]:
        """Truth and answers (K, 3) of frames under a press: x, y in mm, force in N."""
        pipeline = without_baseline(config, load_contact_model(config))
        pipeline.use(self.bench.in_the_middle()[0] if weighed else self.bench.baseline)
        source, finger = self.bench.pad(self.cell), self.finger
        source.finger = finger
        pairs = []
        for one in messages_of(pipeline, source.recorded(self.seconds)):
            true = _touch(finger, one.t_sample_ns * 1e-9)
            if true[2] >= FELT_N and one.x_m is not None and one.y_m is not None and one.force_n is not None:
                pairs.append((true, (one.x_m * 1e3, one.y_m * 1e3, one.force_n)))
        true, found = np.array(pairs).transpose(1, 0, 2)
        return true, found

    def from_field(self) -> tuple[Array, Array]:
        """By a network that learned the shipped pad's fields without their rest."""
        rest = self.bench.baseline.rest
        assert rest is not None
        rest_t, pairs = rest.recording().mean_t, []
        for frame, true in self._frames(self.bench.config):
            if true[2] >= FELT_N:
                pairs.append((true, (frame.field_t - rest_t).ravel()))
        true, change_t = zip(*pairs, strict=True)
        return np.array(true), _field_network().predict(np.array(change_t))

    def _frames(self, config: PadConfig) -> Iterator[tuple[Frame, tuple[float, float, float]]]:
        """The frames that `told` answers, and the truth at each."""
        pipeline = without_baseline(config, load_contact_model(config))
        pipeline.use(self.bench.baseline)
        source, finger = self.bench.pad(self.cell), self.finger
        source.finger = finger
        frames = source.recorded(self.seconds)
        for frame, one in zip(frames, messages_of(pipeline, frames), strict=True):
            yield frame, _touch(finger, one.t_sample_ns * 1e-9)

    def five_presses(self) -> tuple[Array, Array]:
        random = np.random.default_rng([self.seed, FEW])
        presses = presses_of(self.cell, FEW, random)
        labels, pressed = labelled_by_gauge(presses, random), Pressed(self.bench, self.cell)
        with corrected(self.bench.config, self.bench.baseline, pressed, presses, labels, GAUGE_SCALE) as (config, _):
            return self.told(config)

    def own(self) -> tuple[Array, Array]:
        """By a model that `calibrate` makes from a grid of presses on this pad."""
        random, pressed = np.random.default_rng(self.seed), Pressed(self.bench, self.cell)
        pad = self.bench.config.pad()
        mounting = self.bench.baseline.mounting(pad)
        press, fields = [], []
        for ramp in ramps(CastPad(self.kind.thickness_mm, PROBE_MM), sheared=False):
            for share in OWN_FORCES_N:
                force_n = share * min(self.kind.modulus, 1.2)
                mean_t = summarise(pressed.under((*ramp.place_m, force_n))).mean_t
                fields.append(mounting.magnet_field(mean_t))
                place_mm = np.array(ramp.place_m) * 1e3 + random.normal(0.0, OWN_PLACE_MM, 2)
                press.append([*place_mm, force_n * (1.0 + random.normal(0.0, OWN_READING))])
        lines = tuple(range(2, len(press) + 2))
        grid = CalibrationSet(pad, np.array(press), np.array(fields), lines, "0" * 64, mounting.rest_field_t, mounting)
        options = Options(scene="constant", hidden=OWN_HIDDEN, presses=OWN_PRESSES)
        made = calibrate("own", grid, options, lambda _: None)
        with TemporaryDirectory() as folder:
            path = Path(folder, "own.onnx")
            path.write_bytes(made.model)
            contact = msgspec.structs.replace(self.bench.config.contact, model=str(path), refine=True)
            return self.told(msgspec.structs.replace(self.bench.config, contact=contact))

    def rows(self) -> Iterator[Row]:
        asked: dict[str, Callable[[], tuple[Array, Array]]] = {
            FIELD: self.from_field,
            POSE: partial(self.told, self.bench.config),
            WEIGHT: partial(self.told, self.bench.config, weighed=True),
            PRESSES: self.five_presses,
            OWN: self.own,
        }
        for method, ask in asked.items():
            yield self.row(method, *ask())


def _touch(finger: Finger, time_s: float) -> tuple[float, float, float]:
    touch = finger(time_s)
    return touch.x_m * 1e3, touch.y_m * 1e3, touch.force_n


@cache
def _field_network() -> BackPropagation:
    """From the change of the field to the press, learned on the shipped pad as drawn."""
    pad, random = standard_pad(), np.random.default_rng(8)
    force_n = random.uniform(0.05, CALIBRATED_N, FIELD_PRESSES)
    press = np.column_stack([random.uniform(-REACH_MM, REACH_MM, (FIELD_PRESSES, 2)), force_n])
    change_t = (pressed_fields(pad, press) - rest_field_of(pad)).reshape(FIELD_PRESSES, -1)
    network = BackPropagation(FIELD_HIDDEN)
    network.fit(change_t + random.normal(0.0, NOISE_T, change_t.shape), press)
    return network


def run(request: Request) -> Facts:
    study = Study("transfer", request, COLUMNS)
    kinds, seconds = (QUICK_PADS, QUICK_SECONDS) if request.quick else (PADS, SECONDS)

    def rows_of(kind: Kind) -> Sequence[Row]:
        return list(OfPad.of(kind, request.seed, seconds).rows())

    rows = study.measure({kind.name: partial(rows_of, kind) for kind in kinds})
    study.draw(transfer_chart.draw(rows, METHODS))
    return study.conclude({"medians": medians(rows)})


def medians(rows: Sequence[Row]) -> dict[str, dict[str, float]]:
    """The errors on the pads, for each method."""
    return {
        method: {
            column: round(float(np.median([float(row[column] or 0.0) for row in rows if row["method"] == method])), 4)
            for column in ("force_off", "force_off_90", "place_mm")
        }
        for method in METHODS
    }


def printed(facts: Facts) -> str:
    lines = ["method                force off: median, 90 %    place off"]
    for method, one in facts["medians"].items():
        lines.append(f"{method:20} {one['force_off']:15.1%} {one['force_off_90']:9.1%} {one['place_mm']:12.2f} mm")
    return "\n".join(lines)
