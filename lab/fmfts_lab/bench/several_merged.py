"""Two fingers that come near to each other: told as two, as one, or said not to be explained; how wrong one is."""

from __future__ import annotations

from argparse import Namespace
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from fmfts.pad import Array
from fmfts.several.count import resultant
from fmfts.several.reading import FingersReading
from fmfts.several.resultant import deviation_of
from fmfts_lab.bench.several_world import BUILT, Press, estimator_of, read_once, two_places, worlds

Told = Literal["two", "one", "more or disturbed"]
TOLD: tuple[Told, ...] = ("two", "one", "more or disturbed")
APART_MM = tuple(float(apart) for apart in range(2, 15))
ABOVE = (((1.0, 1.0), 10.0), ((1.0, 1.0), 12.0), ((1.6, 0.4), 14.0), ((0.3, 0.3), 12.0), ((0.3, 0.3), 14.0))
FORCES_N = ((1.0, 1.0), (1.6, 0.4), (0.3, 0.3))
FRAMES_OF_A_PAD = 20
WRONG = 5.0  # deviations


@dataclass(slots=True)
class Row:
    """All frames of two fingers so far apart. off (…, 3): of the resultant's place and force, mm and N."""

    told: Counter[Told] = field(default_factory=Counter)
    off: list[Array] = field(default_factory=list)
    deviations: list[Array] = field(default_factory=list)

    def add(self, reading: FingersReading, presses: list[Press]) -> None:
        fit = reading.fit
        if reading.health != "ok" or reading.more or fit is None:
            self.told["more or disturbed"] += 1
            return
        self.told["two" if len(fit.fingers) == 2 else "one"] += 1
        off = resultant(fit.fingers) - resultant(np.array([press[:3] for press in presses]))
        self.off.append(off)
        self.deviations.append(off / deviation_of(reading, fit))

    def share(self, told: Told) -> float:
        return self.told[told] / self.told.total()

    def line(self, apart_mm: float) -> str:
        shares = " | ".join(f"{self.share(told):.1%}" for told in TOLD)
        off, deviations = np.array(self.off), np.abs(np.array(self.deviations))
        place = np.quantile(np.hypot(off[:, 0], off[:, 1]), 0.9)
        wrong = int((deviations > WRONG).any(axis=1).sum())
        return (
            f"| {apart_mm:g} | {shares} | {place:.2f} | {np.sqrt(np.mean(np.square(off[:, 2]))):.3f} "
            f"| {deviations.max():.1f} | {wrong} |"
        )


def run_above(options: Namespace) -> None:
    """Where two are told in 99 % of the frames, and a little below."""
    print(
        f"| as built, mm apart | {' | '.join(TOLD)} | resultant's place, p90 mm | its force, rms N | worst, deviations "
        f"| wrong |\n| {' | '.join(['---'] * 8)} |"
    )
    for forces, apart_mm in ABOVE:
        print(f"| {forces[0]:g} + {forces[1]:g} N, {_row(options, forces, apart_mm).line(apart_mm)[2:]}", flush=True)


def run(options: Namespace) -> None:
    found: dict[tuple[float, float], dict[float, Row]] = {}
    for forces in FORCES_N:
        print(
            f"\n| {forces[0]:g} + {forces[1]:g} N, as built, mm apart | {' | '.join(TOLD)} | resultant's place, p90 mm "
            f"| its force, rms N | worst, deviations | wrong |\n| {' | '.join(['---'] * 8)} |"
        )
        rows = found[forces] = {}
        for apart_mm in APART_MM:
            rows[apart_mm] = _row(options, forces, apart_mm)
            print(rows[apart_mm].line(apart_mm), flush=True)
    if options.chart:
        _draw(found, options.chart)


def _row(options: Namespace, forces: tuple[float, float], apart_mm: float) -> Row:
    row = Row()
    for one in worlds(options.frames, BUILT, options.seed + 3, FRAMES_OF_A_PAD):
        estimator = estimator_of(one)
        for _ in range(FRAMES_OF_A_PAD):
            places = two_places(one.random, apart_mm)
            presses = [Press(x, y, force) for (x, y), force in zip(places.tolist(), forces, strict=True)]
            row.add(read_once(one, one.pressed(presses), estimator), presses)
    return row


def _draw(found: dict[tuple[float, float], dict[float, Row]], file: Path) -> None:
    """Write an SVG or PNG, by the file's suffix. SystemExit if matplotlib is not installed."""
    try:
        import matplotlib
    except ImportError:
        raise SystemExit("no chart: it needs matplotlib (pip install 'fmfts[plot]')") from None
    matplotlib.use("Agg")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 3.2), layout="constrained")
    for axes, (forces, rows) in zip(figure.subplots(1, len(found), sharey=True), found.items(), strict=True):
        shares = [[100.0 * row.share(told) for row in rows.values()] for told in TOLD]
        axes.stackplot(list(rows), shares, labels=TOLD, colors=("#3b76af", "#9dc3e6", "#d9d9d9"))
        axes.set(title=f"{forces[0]:g} + {forces[1]:g} N", xlabel="mm apart", ylim=(0.0, 100.0))
        axes.margins(x=0.0)
    axes.legend(title="told as", loc="lower right")
    figure.axes[0].set_ylabel("% of frames")
    figure.savefig(file, metadata={"Date": None} if file.suffix == ".svg" else None)
