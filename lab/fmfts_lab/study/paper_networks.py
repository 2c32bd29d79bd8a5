"""The paper's two kinds of networks, trained as well as its 675 presses allow, and the course of their training.

Cross-validation on these presses alone chooses sizes, spreads and scaling of the inputs, for fields and poses alike.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from fmfts.pad import Array
from fmfts_lab.calibration.regressors import RadialBasis, Regressor, Span
from fmfts_lab.calibration.regularised import BayesianNetwork, RegularisedBasis

FOLDS = 3
STEPS, QUICK_STEPS, STARTS = 200, 30, 3
HIDDEN = ((20,), (10, 10), (15, 15))
SPREADS, RIDGES = (0.25, 0.5, 1.0, 2.0, 4.0), (1e-8, 1e-7, 1e-6, 1e-5, 1e-4)
# The curve for `newrb` is over the number of neurons, as in Figure 7; that for `newff` over the steps of training.
CURVE_STEPS = (1, 2, 5, 10, 20, 50, 100, 200)
CURVE_CENTRES = (10, 20, 40, 80, 160, 320)


@dataclass(frozen=True, slots=True)
class Choice:
    """A candidate network. make: makes it untrained, to be fitted from so many starts."""

    name: str
    make: Callable[[int], Regressor]


def back_propagation(quick: bool) -> list[Choice]:
    def choice(hidden: tuple[int, ...], decorrelated: bool) -> Choice:
        steps = QUICK_STEPS if quick else STEPS
        name = f"BP {' + '.join(map(str, hidden))}, {_scaling(decorrelated)}"
        return Choice(name, lambda starts: BayesianNetwork(hidden, steps, decorrelated, starts))

    return [choice((10, 10), True)] if quick else [choice(*one) for one in product(HIDDEN, (False, True))]


def radial_basis(quick: bool) -> list[Choice]:
    def choice(spread: float, ridge: float, decorrelated: bool) -> Choice:
        name = f"RBF, spread {spread:g}, ridge {ridge:g}, {_scaling(decorrelated)}"
        return Choice(name, lambda starts: RegularisedBasis(spread, ridge, decorrelated))

    return [choice(1.0, 1e-6, True)] if quick else [choice(*one) for one in product(SPREADS, RIDGES, (False, True))]


def chosen(choices: list[Choice], inputs: Array, target: Array) -> Choice:
    """The candidate that predicts left-out rows best, in units of the target's ranges."""
    if len(choices) == 1:
        return choices[0]
    fold = np.random.default_rng(0).permutation(len(inputs)) % FOLDS
    half = Span.of(target).half

    def left_out_error(choice: Choice) -> float:
        total = 0.0
        for out in range(FOLDS):
            kept = fold != out
            found = choice.make(1).fit(inputs[kept], target[kept]).predict(inputs[~kept])
            total += float(np.sum(((found - target[~kept]) / half) ** 2))
        return total

    return min(choices, key=left_out_error)


def training_curve(kind: str, inputs: Array, target: Array, quick: bool) -> Iterator[tuple[int, float, float]]:
    """Number of steps or neurons, and mean squared errors (ranges ±1) of the training rows and of a left-out fifth."""
    out = np.random.default_rng(0).permutation(len(inputs)) % 5 == 0
    half = Span.of(target).half
    for size, regressor in _growing(kind, inputs[~out], target[~out], quick):
        square = ((regressor.predict(inputs) - target) / half) ** 2
        yield size, float(square[~out].mean()), float(square[out].mean())


def _growing(kind: str, inputs: Array, target: Array, quick: bool) -> Iterator[tuple[int, Regressor]]:
    if kind == "RBF":
        for centres in CURVE_CENTRES[: 4 if quick else None]:
            yield centres, RadialBasis(centres).fit(inputs, target)
        return
    network = BayesianNetwork((10, 10) if quick else HIDDEN[-1], QUICK_STEPS if quick else STEPS, decorrelated=True)
    for number, _ in enumerate(network.steps_of(inputs, target), start=1):
        if number in CURVE_STEPS:
            yield number, network


def _scaling(decorrelated: bool) -> str:
    return "principal components" if decorrelated else "ranges"
