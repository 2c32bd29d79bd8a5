"""A chart of latency and processor time by number of pads."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fmfts_lab.bench.latency_run import Run


def draw(runs: dict[str, list[tuple[int, Run]]], file: Path) -> None:
    """Write an SVG or PNG, by the file's suffix. SystemExit if matplotlib is not installed."""
    try:
        import matplotlib
    except ImportError:
        raise SystemExit("no chart: it needs matplotlib (pip install 'fmfts[plot]')") from None
    matplotlib.use("Agg")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 3.6), layout="constrained")
    latency, processor = figure.subplots(1, 2)
    for name, colour in (("echo", "tab:grey"), ("daemon", "tab:blue")):
        counts = sorted({count for count, _ in runs[name]})
        of_count = [[run for count, run in runs[name] if count == wanted] for wanted in counts]
        for percent, style in ((50, "-"), (99, "--")):
            values = [
                np.percentile(np.concatenate([run.to_subscriber_ns for run in group]), percent) for group in of_count
            ]
            latency.plot(counts, np.array(values) / 1e3, style, marker="o", color=colour, label=f"{name}, p{percent}")
        shares = [100.0 * np.mean([run.cpu_share for run in group]) for group in of_count]
        processor.plot(counts, shares, marker="o", color=colour, label=name)
    latency.set(xscale="log", yscale="log", xlabel="pads at 220 Hz", ylabel="frame there → subscriber, µs")
    processor.set(xlabel="pads at 220 Hz", ylabel="processor time, % of one core")
    for axes in (latency, processor):
        axes.grid(alpha=0.3)
        axes.legend(frameon=False)
    figure.savefig(file)
