"""The paper's two kinds of networks, their sizes chosen as it did, by five-fold cross-validation; how training goes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fmfts.calibrate.regressors import BackPropagation, RadialBasis, Regressor, Span
from fmfts.pad import Array

FOLDS = 5
STEPS = 200
EARLY_STEPS = 40  # what `newff` ends at, whose validation set stops it: fewer outliers, where inputs are many
# As `newrb` does for Figure 7, one curve along the number of neurons; for `newff` along the training's steps.
CURVE_STEPS = (1, 2, 5, 10, 20, 50, 100, 200)
CURVE_CENTRES = (10, 20, 40, 80, 160, 320)


@dataclass(frozen=True, slots=True)
class Choice:
    """A network that could be used; make: untrained."""

    name: str
    make: Callable[[], Regressor]


def back_propagation(quick: bool) -> list[Choice]:
    sizes: Sequence[tuple[int, ...]] = ((10,),) if quick else ((10,), (20,), (30,), (10, 10))
    steps = (60,) if quick else (EARLY_STEPS, STEPS)

    def choice(hidden: tuple[int, ...], most: int) -> Choice:
        name = f"BP {' + '.join(map(str, hidden))}, {most} steps"
        return Choice(name, lambda: BackPropagation(hidden, most))

    return [choice(hidden, most) for hidden in sizes for most in steps]


def radial_basis(quick: bool) -> list[Choice]:
    def choice(centres: int, spread: float | None) -> Choice:
        name = f"RBF {centres}, spread {spread or 'of neighbours'}"
        return Choice(name, lambda: RadialBasis(centres, spread))

    centres = (150,) if quick else (75, 150, 300, 500)
    spreads = (None,) if quick else (None, 0.5, 1.0, 2.0, 4.0)
    return [choice(count, spread) for count in centres for spread in spreads]


def chosen(choices: list[Choice], inputs: Array, target: Array) -> Choice:
    """The one that predicts left-out rows best, in the target's ranges."""
    if len(choices) == 1:
        return choices[0]
    fold = np.random.default_rng(0).permutation(len(inputs)) % FOLDS
    half = Span.of(target).half

    def left_out_error(choice: Choice) -> float:
        total = 0.0
        for out in range(FOLDS):
            kept = fold != out
            found = choice.make().fit(inputs[kept], target[kept]).predict(inputs[~kept])
            total += float(np.sum(((found - target[~kept]) / half) ** 2))
        return total

    return min(choices, key=left_out_error)


def training_curve(kind: str, inputs: Array, target: Array, quick: bool) -> Iterator[tuple[int, float, float]]:
    """Steps or neurons; mean squared error, in ranges of ±1, of the rows trained on and of a fifth left out."""
    out = np.random.default_rng(0).permutation(len(inputs)) % FOLDS == 0
    half = Span.of(target).half
    for size in (CURVE_STEPS if kind == "BP" else CURVE_CENTRES)[: 4 if quick else None]:
        regressor: Regressor = BackPropagation((10,), size) if kind == "BP" else RadialBasis(size)
        regressor.fit(inputs[~out], target[~out])
        square = ((regressor.predict(inputs) - target) / half) ** 2
        yield size, float(square[~out].mean()), float(square[out].mean())
