"""What public recordings of real sensors show: figures, and a chart of each for lab/results/real.md."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from fmfts_lab.real.figures import RECORDINGS, Shown


def run(options: Namespace) -> None:
    """Recordings that the folder does not have are said to be absent."""
    for name, (shows, file) in RECORDINGS.items():
        if not (options.recordings / file).is_file():
            print(f"{name}: {options.recordings / file} is absent: lab/results/real.md says how to get it")
            continue
        shown = shows(options.recordings)
        print(f"{name}: {shown.title}", *shown.lines, sep="\n  ", flush=True)
        if options.charts is not None:
            _draw(shown, options.charts / f"real-{name}.svg")


def _draw(shown: Shown, file: Path) -> None:
    try:
        import matplotlib
    except ImportError:
        raise SystemExit("no chart: it needs matplotlib (pip install 'fmfts[plot]')") from None
    matplotlib.use("Agg")
    from matplotlib.figure import Figure

    with matplotlib.rc_context({"svg.hashsalt": file.stem, "svg.fonttype": "none"}):
        figure = Figure(figsize=(6.0, 2.6), layout="constrained")
        axes = figure.subplots()
        for number, (name, (x, y)) in enumerate(shown.curves.items()):
            style = {"marker": ".", "linestyle": ""} if shown.points else {}
            if name.endswith("deviation"):
                style = {"linestyle": "--", "color": f"C{number // 2}"}
            elif name.endswith("error"):
                style = {"color": f"C{number // 2}"}
            axes.plot(x, y, label=name, linewidth=1.0, **style)  # type: ignore[arg-type]
        if shown.log:
            axes.set(xscale="log", yscale="log")
        axes.set_title(shown.title, fontsize="medium")
        axes.set(xlabel=shown.x, ylabel=shown.y)
        axes.legend(fontsize="x-small")
        figure.savefig(file, metadata={"Date": None})
