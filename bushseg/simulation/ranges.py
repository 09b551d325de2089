"""Ranges in settings: a least and a most, between which each site draws its own value."""

from typing import Annotated

from pydantic import AfterValidator, Field


def _ordered(limits: tuple[float, float]) -> tuple[float, float]:
    if limits[0] > limits[1]:
        raise ValueError(f"expected the least first, not {list(limits)}")
    return limits


Bound = Annotated[float, Field(ge=0, allow_inf_nan=False)]

Range = Annotated[tuple[Bound, Bound], AfterValidator(_ordered)]
"""Least and most."""
