"""What public recordings of real sensors show: figures, and a chart of each for lab/results/real.md."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from fmfts_lab.bench.direct_labels import label_ends
from fmfts_lab.real.figures import RECORDINGS, Shown


def run(options: Namespace) -> None:
    """Reports recordings that the folder lacks as absent."""
    for name, (shows, file) in RECORDINGS.items():
        if options.only and name not in options.only:
            continue
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
        figure = Figure(figsize=(7.5, 3.0))
        axes = figure.subplots()
        figure.subplots_adjust(left=0.1, right=0.86, bottom=0.17, top=0.9)
        for number, (name, (x, y)) in enumerate(shown.curves.items()):
            style = {"marker": "."} if shown.points else {}
            if shown.log and shown.points:
                style = {"marker": ".", "linestyle": "", "color": "tab:blue"}
            if name.endswith("deviation"):
                style = {"linestyle": "--", "color": f"C{number // 2}"}
            elif name.endswith("error"):
                style = {"color": f"C{number // 2}"}
            label = "_" if name.endswith("deviation") else name.removesuffix(", error")
            axes.plot(x, y, label=label, linewidth=1.2, **style)  # type: ignore[arg-type]
        if shown.log:
            values = [y for _, y in shown.curves.values()]
            decades = max(map(max, values)) > 10.0 * min(map(min, values))
            axes.set(xscale="log", yscale="log" if decades else "linear")
            for axis in (axes.xaxis, axes.yaxis):
                axis.set_major_formatter(lambda value, _: f"{value:g}")
                axis.set_minor_formatter(lambda *_: "")
        if shown.ticks:
            axes.set_xticks(range(len(shown.ticks)), shown.ticks)
            axes.set_ylim(bottom=0.0)
        axes.set_title(shown.title, fontsize="medium")
        axes.set(xlabel=shown.x, ylabel=shown.y)
        if not (shown.log and shown.points):
            label_ends(axes)
        figure.savefig(file, metadata={"Date": None})
