"""How quantities are given in settings, and drawn."""

from collections.abc import Mapping
from typing import Annotated, TypeVar

import numpy as np
from pydantic import AfterValidator

from bushseg.points import FloatArray

Q95 = 1.645
"""The normal distribution's 95 % quantile."""

FARTHEST = 2.2
"""Draws end at this many standard deviations: no shrub is a skyscraper."""


def _ascending(values: tuple[float, float, float]) -> tuple[float, float, float]:
    """Check that a spread is one."""
    low, middle, high = values
    if not 0 < low <= middle <= high < np.inf:
        raise ValueError(
            f"is {list(values)}; expected three positive numbers that ascend: "
            "what 5 %, 50 % and 95 % stay below"
        )
    return values


Spread = Annotated[tuple[float, float, float], AfterValidator(_ascending)]
"""A quantity's 5 %, 50 % and 95 % quantiles."""

Kind = TypeVar("Kind", bound=str)


def _weighty(weights: dict[Kind, float]) -> dict[Kind, float]:
    """Check that weights can be drawn by."""
    values = list(weights.values())
    if not values or min(values) < 0 or not 0 < sum(values) < np.inf:
        raise ValueError(f"is {dict(weights)}; expected weights of 0 or more, one of them above 0")
    return weights


Weights = Annotated[dict[Kind, float], AfterValidator(_weighty)]
"""How often each kind is drawn, relative to the others; a kind left out never is."""


def draw(rng: np.random.Generator, spread: Spread) -> float:
    """Draw one value of a spread: lognormal to either side of the median."""
    return float(draw_many(rng, spread, 1)[0])


def draw_many(rng: np.random.Generator, spread: Spread, number: int) -> FloatArray:
    """Draw `number` values of a spread, (N,), as :func:`draw` does."""
    low, middle, high = np.log(spread)
    z = np.clip(rng.standard_normal(number), -FARTHEST, FARTHEST) / Q95
    return np.exp(middle + np.where(z < 0, z * (middle - low), z * (high - middle)))


def choose(rng: np.random.Generator, weights: Mapping[Kind, float]) -> Kind:
    """Draw a kind by weight."""
    kinds, values = list(weights), np.array(list(weights.values()))
    return kinds[rng.choice(len(kinds), p=values / values.sum())]
