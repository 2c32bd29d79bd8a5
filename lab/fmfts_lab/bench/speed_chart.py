"""A chart of the time of a solve by number of sensors and magnets."""

from __future__ import annotations

from pathlib import Path


def draw_growth(sensors_us: dict[int, float], magnets_us: dict[int, float], file: Path) -> None:
    """Write an SVG or PNG, by the file's suffix. SystemExit if matplotlib is not installed."""
    try:
        import matplotlib
    except ImportError:
        raise SystemExit("no chart: it needs matplotlib (pip install 'fmfts[plot]')") from None
    matplotlib.use("Agg")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 3.2), layout="constrained")
    by_sensors, by_magnets = figure.subplots(1, 2)
    by_sensors.plot(list(sensors_us), list(sensors_us.values()), marker="o")
    by_sensors.set(xlabel="sensors (one magnet)", ylabel="eight unknowns, µs", ylim=(0.0, None))
    by_magnets.plot(list(magnets_us), list(magnets_us.values()), marker="o")
    by_magnets.set(xlabel="magnets (four sensors)", xticks=list(magnets_us), ylim=(0.0, None))
    for axes in (by_sensors, by_magnets):
        axes.grid(alpha=0.3)
    most = f"{max(sensors_us.values()):.0f} µs with {max(sensors_us)} sensors, {max(magnets_us.values()):.0f} µs with"
    figure.suptitle(f"A solve takes {most} {max(magnets_us)} magnets", fontsize="medium")
    figure.savefig(file)
