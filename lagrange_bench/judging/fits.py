"""Models of what is wrong with rows, and the rule that chooses one.

A fit offers models. Each has a cost, for it claims more than that the rows are right, and a misfit, the median over rows of what
it leaves unexplained, relative to the size of the quantity:

    score = ln max(misfit, floor) + cost ln 4

The least score wins if it beats the rows as they are read (cost 0) by a further factor 3, and if its misfit is small. Medians,
because the end of a run that blows up means nothing. A factor and not a likelihood, because misfits are systematic, not noise.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from lagrange_bench.judging.vectors import NEAR, ONE, Array, common, nearest_axes, nearest_rotation, size

# a unit of cost must make the misfit so many times smaller
EACH = 4.0
# and the winner must beat the rows as they are read by a further factor
CLEARLY = 3.0
# the largest misfit of a cause that is named
GOOD = 0.1
# a factor nearer to 1 is none
SAME = 5e-3
# of the second singular value to the first: below it vectors are along a line and tell no rotation
LINE = 1e-3


class Model(NamedTuple):
    """A cause with its cost and misfit. value : what the fit found, and needs to put it into words."""

    cost: float
    misfit: float
    value: Any

    def score(self, floor: float) -> float:
        """The logarithm of the misfit and of its price."""
        return math.log(max(self.misfit, floor)) + self.cost * math.log(EACH)


class ModelChoice(NamedTuple):
    """The model that wins, or None, and the rows as they are read. floor : misfits below it say nothing."""

    winner: Model | None
    now: Model
    floor: float

    @property
    def misfits(self) -> tuple[float, float]:
        """The misfits of the rows as they are read, and of the winner."""
        return self.now.misfit, self.winner.misfit if self.winner else math.nan

    @property
    def gain(self) -> float:
        """By how much the winner beats the rows as they are read."""
        return self.now.score(self.floor) - self.winner.score(self.floor) if self.winner else 0.0


def choose(models: Iterable[Model], floor: float) -> ModelChoice:
    """The model with the least score, if it is clearly better than the rows as they are read, and good."""
    known = [model for model in models if math.isfinite(model.misfit)]
    now = min(
        (model for model in known if model.cost == 0), key=lambda model: model.misfit, default=Model(0, math.nan, None)
    )
    best = min(known, key=lambda model: model.score(floor), default=now)
    is_clear = best.score(floor) + math.log(CLEARLY) < now.score(floor) and best.misfit < GOOD if known else False
    return ModelChoice(best if is_clear else None, now, floor)


def maps(a: Array, b: Array, units: Iterable[float] = ()) -> Iterator[Model]:
    """Models of b = M a for vectors (N, 3): M is 1, a factor, signed axes, a rotation, or one of these and a factor.

    units : factors that have a name are cheaper than others.
    """
    good = np.isfinite(a).all(1) & np.isfinite(b).all(1)
    a, b = a[good], b[good]
    if len(a) < 4 or not size(a) or not size(b):
        return
    near, length = common(a) & common(b), size(b)

    def model(cost: float, M: Array) -> Model:
        return Model(cost, size(b - a @ M.T) / length, M)

    H = b[near].T @ a[near]
    yield model(0.0, ONE)
    yield model(1.0, -ONE)
    scale = math.sqrt(float(np.sum(b[near] ** 2) / np.sum(a[near] ** 2)))
    named = [unit for unit in units if abs(scale / unit - 1) < 5 * NEAR]
    scales = [(1.0, 0.0), *((unit, 1.0) for unit in named)]
    if abs(scale - 1) > SAME and not named:
        scales.append((scale, 2.0))
    Q, known = nearest_rotation(H)
    best, second = nearest_axes(H)
    for factor, price in scales:
        if price:
            yield model(price, factor * ONE)
            yield model(price + 1.0, -factor * ONE)
        axes = model(price + 1.5, factor * best)
        if axes.misfit * EACH < model(0, factor * second).misfit:  # a motion in a plane does not tell axes
            yield axes
        if known > LINE:
            yield model(price + 2.5, factor * Q)


def factor_of(M: Array) -> float:
    """The factor in a map of `maps`: negative if M is nothing but a negative factor."""
    scale = float(np.cbrt(abs(np.linalg.det(M))))
    return -scale if np.allclose(M, -scale * ONE) else scale


def name_of(value: float, names: Mapping[str, float]) -> str | None:
    """The name of the number that is near to the value."""
    return next((name for name, known in names.items() if abs(value / known - 1) < NEAR), None)
