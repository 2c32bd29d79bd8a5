"""A chart of the time of a frame by magnets over sensors, one line for each number of fingers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

STANDARD = "4 over 8"
COLOURS = "tab:grey", "tab:blue", "tab:purple", "tab:red"


def draw(found_us: Mapping[tuple[str, str], float], goals_us: Mapping[str, float], file: Path) -> None:
    """Write an SVG or PNG, by the file's suffix. found_us: by pad and fingers. SystemExit without matplotlib."""
    try:
        import matplotlib
    except ImportError:
        raise SystemExit("no chart: it needs matplotlib (pip install 'fmfts[plot]')") from None
    matplotlib.use("Agg")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 4.2), layout="constrained")
    axes = figure.subplots()
    pads = list(dict.fromkeys(pad for pad, _ in found_us))
    for (fingers, goal_us), colour in zip(goals_us.items(), COLOURS, strict=True):
        places = [number for number, pad in enumerate(pads) if (pad, fingers) in found_us]
        times = [found_us[pads[place], fingers] for place in places]
        axes.plot(places, times, marker="o", color=colour)
        place, own_us, shift = pads.index(STANDARD), found_us[STANDARD, fingers], "offset points"
        aside = -15 if fingers == "one finger" else 6
        last = f"{fingers}, {times[-1]:.0f}"
        axes.annotate(last, (places[-1], times[-1]), (8, -3), textcoords=shift, color=colour)
        axes.annotate(f"{own_us:.0f}", (place, own_us), (0, aside), textcoords=shift, color=colour, ha="center")
        axes.plot([place - 0.3, place + 0.3], [goal_us, goal_us], color=colour, linestyle=":")
    axes.set(yscale="log", ylabel="µs from a frame to its message", xlim=(-0.3, len(pads) + 0.2))
    axes.set_xticks(range(len(pads)), pads)
    axes.set_xlabel("magnets over sensors (dotted: goals for 4 over 8)")
    axes.grid(alpha=0.3, axis="y")
    figure.suptitle(_message(found_us), x=0.02, ha="left")
    figure.savefig(file)


def _message(found_us: Mapping[tuple[str, str], float]) -> str:
    many, few = found_us["4 over 16", "one finger"], found_us[STANDARD, "one finger"]
    search = found_us[STANDARD, "search"] / found_us[STANDARD, "two fingers"]
    return (
        f"Twice as many sensors cost {many / few:.1f} times as much with one finger;\n"
        f"a search costs {search:.0f} times a frame of two fingers"
    )
