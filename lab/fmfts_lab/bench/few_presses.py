"""Pads of other silicone, and five to eighteen presses of them: how wrong are forces after `calibrate --correct`?

A gauge with small errors labels the presses, or another pad that was weighed: both press on a peg of 6 mm between them.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec
import numpy as np

from fmfts.baseline import Baseline, BaselineError
from fmfts.baseline.recording import summarise
from fmfts.baseline.request import BaselineRequest
from fmfts.common.names import field_columns
from fmfts.config import PadConfig, ToleranceConfig
from fmfts.pad import Array
from fmfts.pipeline.configured import load_contact_model
from fmfts.sensor.chips import DEFAULT_CHIP
from fmfts_calibrate.command import CorrectionJob, make_corrected_model
from fmfts_calibrate.correct_verb import mounted_pad, starting_model
from fmfts_calibrate.field_table import DataError, write
from fmfts_lab.bench.silicone import RealPad, messages_of
from fmfts_lab.bench.stated_world import StatedMechanics
from fmfts_lab.bench.structure import Cell, Found
from fmfts_lab.bench.tapped import without_baseline
from fmfts_lab.bench.truth import Truth
from fmfts_lab.bench.weigh import Bench, facts_of, line
from fmfts_simulation.finger import no_finger, steady_finger
from fmfts_simulation.finger_shape import FingerShape
from fmfts_simulation.mounted import MountedPad

PRESSES = (5, 9, 18)
PROBE_MM = 6.0  # of the peg
# Errors of the gauge: one factor for all presses, and one for each reading; errors of the places: from a ruler.
GAUGE_SCALE, READING, PLACE_MM = 0.01, 0.01, 0.5
FORCES_N = (0.4, 1.6)
AVERAGED_S, SETTLED_S = 0.3, 0.3

THICKNESSES_MM, FINGERS_MM = (3.6, 4.0, 4.4), (6.0,)
MODULI = (0.5, 0.7, 1.0, 1.4, 2.0)
OTHER_PAD = Cell("the other pad", modulus=1.3)
SEED_OF_OTHER = 1000
Press = tuple[float, float, float]  # x and y in m, force in N


class Pressed:
    """A pad under presses one by one."""

    def __init__(self, bench: Bench, cell: Cell) -> None:
        self.config = bench.config
        self._source = bench.pad(cell)

    def under(self, press: Press | None) -> list:  # type: ignore[type-arg]
        """The frames of a press once it has settled; None: of the untouched pad."""
        self._source.finger = no_finger if press is None else steady_finger(*press)
        self._source.recorded(SETTLED_S)
        return self._source.recorded(AVERAGED_S)


def presses_of(cell: Cell, count: int, random: np.random.Generator) -> list[Press]:
    """All over the pad, each at another of the solved places, by a gauge as wide as the finger."""
    solved = cell.ramps()
    which = random.permutation(len(solved))[:count]
    forces_n = random.uniform(*FORCES_N, count) * min(cell.modulus, 1.0)
    return [(*solved[n].place_m, force) for n, force in zip(which.tolist(), forces_n.tolist(), strict=True)]


def table_of(pressed: Pressed, presses: list[Press], labels: Array, path: Path) -> None:
    """Write the CSV of a set: a row of the untouched pad before each press. labels (K, 3): in mm and N."""
    rows: list[list[str]] = []
    for press, label in zip(presses, labels, strict=True):
        for under, told in ((None, np.zeros(3)), (press, label)):
            field_ut = 1e6 * summarise(pressed.under(under)).mean_t
            rows.append([f"{value:.5f}" for value in (*told, *field_ut.ravel())])
    names = ["x_mm", "y_mm", "force_n", *field_columns(len(rows[0]) // 3 - 1)]
    with path.open("w", newline="") as file:
        write(dict(zip(names, map(list, zip(*rows, strict=True)), strict=True)), file)


def labelled_by_gauge(presses: list[Press], random: np.random.Generator) -> Array:
    labels = np.array(presses) * [1e3, 1e3, 1.0 + random.normal(0.0, GAUGE_SCALE)]
    labels[:, :2] += random.normal(0.0, PLACE_MM, (len(labels), 2))
    labels[:, 2] *= 1.0 + random.normal(0.0, READING, len(labels))
    return labels


class OtherPad:
    """A weighed pad that presses against the one to correct. scale_sd: the deviation of its forces' common scale."""

    def __init__(self, seed: int) -> None:
        self._bench = Bench(OTHER_PAD, PROBE_MM, SEED_OF_OTHER + seed)
        weighed, _ = self._bench.in_the_middle()
        config = self._bench.config
        self._pipeline = without_baseline(config, load_contact_model(config))
        self._pipeline.use(weighed)
        self.scale_sd = self._pipeline.force_scale_sd or 0.0
        self._pressed = Pressed(self._bench, OTHER_PAD)
        self._places = OTHER_PAD.ramps()

    def labels(self, presses: list[Press], random: np.random.Generator) -> Array:
        """Its readings of the same forces, near its middle."""
        labels = labelled_by_gauge(presses, random)
        for row, (_, _, force_n) in enumerate(presses):
            place = self._places[int(random.integers(8))].place_m
            messages_of(self._pipeline, self._pressed.under(None))
            told = messages_of(self._pipeline, self._pressed.under((*place, force_n)))
            labels[row, 2] = np.mean([one.force_n for one in told if one.force_n is not None])
        return labels


@dataclass(slots=True)
class Row:
    """One pad, pressed by fingers as wide as the probe after a correction by so many presses."""

    name: str
    found: Found = field(default_factory=Found)
    refused: list[str] = field(default_factory=list)
    chosen: list[str] = field(default_factory=list)

    def tell(self) -> None:
        words = f"refused {self.refused}" if self.refused else ""
        text = line(facts_of([self.found])) if self.found.frames else ""
        print(f"{self.name}: {', '.join(self.chosen)} {text} {words}", flush=True)


@contextmanager
def corrected(
    config: PadConfig, baseline: Baseline, pressed: Pressed, presses: list[Press], labels: Array, scale_sd: float
) -> Iterator[tuple[PadConfig, str]]:
    """The configuration with the corrected model, and which correction was chosen. DataError where it is refused."""
    with TemporaryDirectory() as folder:
        source, target = Path(folder, "presses.csv"), Path(folder, "own.onnx")
        table_of(pressed, presses, labels, source)
        start = starting_model(config, baseline)
        mounted = mounted_pad(config, baseline, start, DEFAULT_CHIP.noise_t / np.sqrt(100.0 * AVERAGED_S))
        job = CorrectionJob(mounted, start, 40.0, PLACE_MM, scale_sd)
        report = make_corrected_model(source, target, job, lambda _: None)
        as_calibrated = (PROBE_MM, PROBE_MM)  # the gauge is as wide as what presses later
        contact = msgspec.structs.replace(config.contact, model=str(target), finger_mm=as_calibrated)
        own = ToleranceConfig(gain=config.tolerance.gain)
        yield msgspec.structs.replace(config, contact=contact, tolerance=own), str(report["chosen"])


def refined(bench: Bench, cell: Cell, random: np.random.Generator) -> Baseline:
    """The pad's baseline after `--refine`, with unmeasured presses at any place."""
    source = bench.pad(cell)
    source.finger = cell.finger(random)
    request = BaselineRequest(bench.config.pad(), bench.config.tolerance.si(), False, False, refine=True)
    return request.make(source.recorded(request.seconds), bench.baseline)[0]


class PartlyDrawnBench(Bench):
    """without: "mounting": chips and magnet are where the drawing has them; "shape": the silicone moves the magnet as
    the model's does, but for its modulus; "noise": chips have a tenth of it."""

    def __init__(self, cell: Cell, by_mm: float, seed: int, without: Sequence[str]) -> None:
        self._without = without
        self.noise_t = DEFAULT_CHIP.noise_t / 10.0 if "noise" in without else None
        super().__init__(cell, by_mm, seed)

    def pad(self, cell: Cell) -> RealPad:
        source = super().pad(cell)
        if "shape" in self._without:
            drawn: Any = StatedMechanics(RealPad(self.config).built.mechanics, cell.modulus, 0.0, FingerShape())
            source.stands(replace(source.built, mechanics=drawn))
        if "mounting" in self._without:
            built = source.built
            drawn_pad = MountedPad.exact(self.config.pad(), built.mechanics)
            source.stands(replace(drawn_pad, ambient_t=built.ambient_t))
        return source


def trial(cell: Cell, count: int, seed: int, options: Namespace, against: OtherPad | None, row: Row) -> None:
    bench = PartlyDrawnBench(cell, PROBE_MM, seed, options.without)
    random, seconds = np.random.default_rng([seed, count]), options.seconds
    baseline = refined(bench, cell, random) if options.refine else bench.baseline
    presses = presses_of(cell, count, random)
    labels = labelled_by_gauge(presses, random) if against is None else against.labels(presses, random)
    if "labels" in options.without:
        labels = np.array(presses) * [1e3, 1e3, 1.0]
    scale_sd = GAUGE_SCALE if against is None else against.scale_sd
    try:
        with corrected(bench.config, baseline, Pressed(bench, cell), presses, labels, scale_sd) as (config, name):
            row.chosen.append(name)
            pipeline = without_baseline(config, load_contact_model(config))
            pipeline.use(baseline)
            source = bench.pad(cell)
            finger = cell.finger(np.random.default_rng(seed))
            source.finger = finger
            messages = messages_of(pipeline, source.recorded(seconds))
            row.found.saw(messages, Truth(source.built, finger), finger, 0.0)
    except (DataError, BaselineError) as error:
        row.refused.append(str(error))


def run(options: Namespace) -> None:
    against = OtherPad(options.seed) if options.against else None
    for count in PRESSES if options.presses is None else (options.presses,):
        rows = []
        for thickness_mm in THICKNESSES_MM:
            for modulus in MODULI:
                row = Row(f"{count:2d} presses, modulus × {modulus:g}, {thickness_mm:g} mm")
                for finger_mm in FINGERS_MM:
                    cell = Cell(row.name, modulus, thickness_mm, finger_mm)
                    for seed in range(options.seed, options.seed + options.pads):
                        trial(cell, count, seed, options, against, row)
                row.tell()
                rows.append(row)
        print(f"{count} presses, all: {line(facts_of([row.found for row in rows if row.found.frames]))}", flush=True)
