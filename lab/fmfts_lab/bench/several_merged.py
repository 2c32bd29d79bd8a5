"""Two fingers that approach each other: reported as two, as one, or as unexplained, and the errors of one."""

from __future__ import annotations

from argparse import Namespace
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from fmfts.pad import Array
from fmfts.several.count import resultant
from fmfts.several.reading import FingersReading
from fmfts_calibrate.resultant import deviation_of, deviation_of_each, resultant_deviation
from fmfts_lab.bench.several_world import BUILT, Press, estimator_of, read_once, two_places, worlds

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Told = Literal["two", "one", "more or disturbed"]
TOLD: tuple[Told, ...] = ("two", "one", "more or disturbed")
APART_MM = tuple(float(apart) for apart in range(2, 15))
ABOVE = (
    *(((1.0, 1.0), apart) for apart in (10.0, 11.0, 12.0)),
    ((1.6, 0.4), 14.0),
    *(((0.3, 0.3), apart) for apart in (12.0, 14.0)),
)
FORCES_N = ((1.0, 1.0), (1.6, 0.4), (0.3, 0.3))
FRAMES_OF_A_PAD = 20
WRONG = 5.0  # deviations


@dataclass(slots=True)
class Row:
    """All frames of two fingers so far apart. off (…, 3): of the resultant's place and force, mm and N.

    deviations: of the resultant; each (…, 2, 3): of each finger, where two are told; parabola, parabola_each: without
    what the valleys add (several/valley.py).
    """

    told: Counter[Told] = field(default_factory=Counter)
    off: list[Array] = field(default_factory=list)
    deviations: list[Array] = field(default_factory=list)
    parabola: list[Array] = field(default_factory=list)
    each: list[Array] = field(default_factory=list)
    parabola_each: list[Array] = field(default_factory=list)

    def add(self, reading: FingersReading, presses: list[Press]) -> None:
        fit = reading.fit
        if reading.health != "ok" or reading.more or fit is None:
            self.told["more or disturbed"] += 1
            return
        self.told["two" if len(fit.fingers) == 2 else "one"] += 1
        truth = np.array([press[:3] for press in presses])
        off = resultant(fit.fingers) - resultant(truth)
        self.off.append(off)
        self.deviations.append(off / deviation_of(reading, fit))
        self.parabola.append(off / resultant_deviation(fit))
        if len(fit.fingers) == len(truth):
            ways = fit.fingers - truth, fit.fingers - truth[::-1]
            own = min(ways, key=lambda errors: float(np.abs(errors[:, :2]).sum()))
            self.each.append(own / deviation_of_each(reading, fit))
            self.parabola_each.append(own / fit.deviation)

    def share(self, told: Told) -> float:
        return self.told[told] / self.told.total()

    def line(self, apart_mm: float) -> str:
        shares = " | ".join(f"{self.share(told):.1%}" for told in TOLD)
        off, deviations = np.array(self.off), np.abs(np.array(self.deviations))
        place = np.quantile(np.hypot(off[:, 0], off[:, 1]), 0.9)
        return (
            f"| {apart_mm:g} | {shares} | {place:.2f} | {np.sqrt(np.mean(np.square(off[:, 2]))):.3f} "
            f"| {deviations.max():.1f} | {_wrong(self.deviations)} |"
        )

    def line_of_each(self) -> str:
        """More columns: the effect of the valleys on the resultant and on each finger."""
        worst = np.abs(self.each).max()
        return f" {_wrong(self.parabola)} | {worst:.1f} | {_wrong(self.each)} | {_wrong(self.parabola_each)} |"


def run_above(options: Namespace) -> None:
    """Runs distances at which two are reported in 99 % of the frames, and slightly smaller ones."""
    print(
        f"| as built, mm apart | {' | '.join(TOLD)} | resultant's place, p90 mm | its force, rms N | worst, deviations "
        f"| wrong | wrong by the parabola | each finger: worst, deviations | wrong | wrong by the parabola "
        f"|\n| {' | '.join(['---'] * 12)} |"
    )
    rows: list[Row] = []
    for forces, apart_mm in ABOVE:
        row = _row(options, forces, apart_mm)
        rows.append(row)
        name = f"{forces[0]:g} + {forces[1]:g} N, "
        print(f"| {name}{row.line(apart_mm)[2:]}{row.line_of_each()}", flush=True)
    print("\n" + _in_all(rows))


def _in_all(rows: list[Row]) -> str:
    """The effect of the valleys in all frames of these rows: how many are wrong, and the size of the deviations."""
    told: list[str] = []
    for of_what, names in (("resultant", ("deviations", "parabola")), ("fingers", ("each", "parabola_each"))):
        now, before = ([one for row in rows for one in getattr(row, name)] for name in names)
        # The same errors, each in units of both deviations.
        larger = float(np.mean(np.array(before) / np.array(now))) - 1.0
        told.append(
            f"{of_what}: {_wrong(now)} wrong of {len(now):,}, {_wrong(before)} by the parabola; deviations "
            f"{larger:.0%} larger than its"
        )
    return "; ".join(told)


def _wrong(deviations: list[Array]) -> int:
    """The number of frames in which one of these exceeds `WRONG`."""
    return sum(bool((np.abs(one) > WRONG).any()) for one in deviations)


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
    from matplotlib.figure import Figure as NewFigure

    shares = {
        forces: (list(rows), [[100.0 * row.share(told) for row in rows.values()] for told in TOLD])
        for forces, rows in found.items()
    }
    figure = NewFigure(figsize=(10.0, 3.4), layout="constrained")
    draw_shares(figure, shares)
    figure.savefig(file, metadata={"Date": None} if file.suffix == ".svg" else None)


def draw_shares(figure: Figure, shares: dict[tuple[float, float], tuple[list[float], list[list[float]]]]) -> None:
    """Draws for each pair of forces the distances in mm, and the share in % of each of TOLD there."""
    for axes, (forces, (apart_mm, each)) in zip(
        figure.subplots(1, len(shares), sharey=True), shares.items(), strict=True
    ):
        axes.stackplot(apart_mm, each, colors=("#3b76af", "#9dc3e6", "#d9d9d9"))
        axes.set(title=f"{forces[0]:g} + {forces[1]:g} N", xlabel="mm apart", ylim=(0.0, 100.0))
        axes.margins(x=0.0)
        for word, x_mm, height, colour in (
            ("reported\nas two", 11.5, 40.0, "white"),
            ("reported\nas one", 3.7, 40.0, "black"),
            ("neither", 6.6, 88.0, "black"),
        ):
            axes.text(x_mm, height, word, color=colour, ha="center", va="center", fontsize="small")
    figure.axes[0].set_ylabel("% of frames")
    two = next(iter(shares.values()))
    enough = next(mm for mm, share in zip(two[0], two[1][0], strict=True) if share > 95.0)
    figure.suptitle(f"Two equal fingers of 1 N are reported as two from {enough:g} mm apart on", fontsize="medium")
