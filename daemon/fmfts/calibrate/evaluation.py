"""How good a contact model is, on presses that it has not seen, beside what physics allows."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from fmfts.calibrate.samples import Samples
from fmfts.contact.contract import OwnError
from fmfts.pad import Array, Pad
from fmfts.simulate.chip import NOISE_T

Predict = Callable[[Array], Array]
Row = dict[str, float | str]

FORCES_N = (0.2827, 1.131, 1.9792)  # the paper's
REMANENCES_T = (1.23, 1.28)
CENTRE_M = 8e-3
FORCE_BINS_N = (0.05, 0.1, 0.2, 0.4, 0.8, 1.4, 2.0)
RADIUS_BINS_MM = (4.0, 8.0, 12.0, 20.0)


def evaluate(pad: Pad, predict: Predict, count: int = 600) -> Iterator[Row]:
    """One row per magnet, noise, force and area: mean absolute and rms errors at `count` places off the grid.

    `bound_…`: the mean absolute error of an unbiased estimate that reaches the Cramér–Rao bound of one frame.
    """
    random = np.random.default_rng(11)
    for remanence_t in REMANENCES_T:
        for noise_t in (0.0, NOISE_T):
            for force_n in FORCES_N:
                x_m, y_m = random.uniform(-14e-3, 14e-3, (2, count))
                press = (x_m, y_m, np.full(count, force_n))
                samples = Samples.pressed(pad, press, random, noise_t, pad.magnet.with_remanence(remanence_t))
                head: Row = {"magnet_t": remanence_t, "noise_mg": noise_t * 1e7, "force_n": force_n}
                bound = samples.bound() * (noise_t > 0.0)
                error = predict(samples.pose) - labels(samples)
                for area, inside in (("whole pad", x_m < np.inf), ("within 8 mm", np.hypot(x_m, y_m) <= CENTRE_M)):
                    yield {**head, "area": area, **_figures(error[inside], bound[inside])}


def summary(predict: Predict, samples: Samples) -> dict[str, float]:
    """Mean absolute and rms errors over all of `samples`."""
    error = predict(samples.pose) - labels(samples)
    return {name: value for name, value in _figures(error, 0.0 * error).items() if not name.startswith("bound")}


def labels(samples: Samples) -> Array:
    """(K, 3) x (mm), y (mm), force (N)."""
    return np.stack([samples.x_m * 1e3, samples.y_m * 1e3, samples.force_n], axis=1)


def own_error(predict: Predict, samples: Samples) -> OwnError:
    """The model's rms error on noise-free `samples`, by force and by distance from the centre."""
    error = predict(samples.pose) - labels(samples)
    radius_mm = np.hypot(samples.x_m, samples.y_m) * 1e3
    row = np.minimum(np.searchsorted(FORCE_BINS_N, samples.force_n), len(FORCE_BINS_N) - 1)
    column = np.minimum(np.searchsorted(RADIUS_BINS_MM, radius_mm), len(RADIUS_BINS_MM) - 1)

    def table(component: int) -> tuple[tuple[float, ...], ...]:
        return tuple(
            tuple(_rms(error[(row == i) & (column == j), component]) for j in range(len(RADIUS_BINS_MM)))
            for i in range(len(FORCE_BINS_N))
        )

    return OwnError(FORCE_BINS_N, RADIUS_BINS_MM, x_mm=table(0), y_mm=table(1), force_error_n=table(2))


def _figures(error: Array, bound: Array) -> dict[str, float]:
    names = ("x_mm", "y_mm", "force_n")
    mean = np.abs(error).mean(axis=0)
    reachable = np.sqrt(2.0 / np.pi) * bound.mean(axis=0)
    figures = {f"mae_{name}": mean[i] for i, name in enumerate(names)}
    figures |= {f"rmse_{name}": _rms(error[:, i]) for i, name in enumerate(names)}
    figures |= {f"bound_{name}": reachable[i] for i, name in enumerate(names)}
    return {name: round(float(value), 5) for name, value in figures.items()}


def _rms(values: Array) -> float:
    if len(values) == 0:
        raise ValueError("no samples in a bin of the model's own error: draw more")
    return round(float(np.sqrt(np.mean(values**2))), 6)
