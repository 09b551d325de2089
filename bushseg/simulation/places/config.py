"""What the places hold: one table of densities each, drawn anew for every site."""

from collections.abc import Mapping
from typing import Any, Literal, Self, get_args

import numpy as np
from pydantic import Field, model_validator

from bushseg.config import Section
from bushseg.simulation.ranges import Range

PlaceName = Literal[
    "garden",
    "orchard",
    "fields",
    "park",
    "road",
    "street",
    "forest_edge",
    "forest",
    "heath",
    "village",
    "trail",
    "yard",
]
PLACE_NAMES: tuple[PlaceName, ...] = get_args(PlaceName)


class PlaceConfig(Section):
    """How much there is of everything: [least, most], drawn for each site.

    Densities are per 1000 square metres unless another unit is named.
    """

    weight: float = Field(1.0, ge=0, description='How often `place = "mixed"` draws this place')
    slope: Range = Field((0, 6), description="Steepest general slope, degrees")
    relief: Range = Field(
        (0.05, 0.3), description="Standard deviation of heights about that slope, metres"
    )
    roughness: Range = Field(
        (0.005, 0.03), description="Standard deviation of heights from cell to cell, metres"
    )
    vigor: Range = Field((0.8, 1.25), description="Factor on the heights of all plants")
    shrubs: Range = Field((5, 25), description="Shrubs in the open")
    clumping: Range = Field((0.3, 0.8), description="Share of shrubs that stand in clumps")
    hedges: Range = Field((0, 10), description="Hedges, metres of length")
    trees: Range = Field((1, 6), description="Trees")
    bare_stems: Range = Field(
        (0, 0.2), description="Share of trees whose crowns begin at 0.3 to 0.6 of their height"
    )
    saplings: Range = Field((0, 6), description="Saplings")
    undergrowth: Range = Field((0, 1), description="Shrubs and saplings below a tree's crown")
    dead_wood: Range = Field((0, 0.5), description="Snags, logs, stumps and brush heaps")
    grass: Range = Field((12, 30), description="Tufts of grass, per square metre")
    herbs: Range = Field((0, 0.4), description="Herbs, per square metre")
    mown: Range = Field((0, 0.5), description="Share of the grass that is kept short")
    rocks: Range = Field((0, 1), description="Rocks, and heaps in yards")
    puddles: Range = Field((0, 0.3), description="Puddles")
    boundaries: Range = Field(
        (0.6, 1.4), description="Fences, walls and guard rails, over what is usual there"
    )
    buildings: Range = Field((0, 0), description="Buildings")
    vehicles: Range = Field((0, 0), description="Vehicles, standing or passing")
    parked: Range = Field(
        (0, 0), description="Share of a street's kerbs, and of drives, with parked cars"
    )
    front_plants: Range = Field(
        (0, 0), description="Share of front gardens and house walls with hedges or shrubs"
    )
    people: Range = Field((0, 1), description="People")
    poles: Range = Field((0, 0.5), description="Lamp posts, signs and markers")
    furniture: Range = Field((0, 0.5), description="Furniture of gardens, parks, farms or yards")

    def drawn(self, rng: np.random.Generator) -> dict[str, float]:
        """Draw all ranges for one site, by name."""
        return {
            name: float(rng.uniform(*value)) for name, value in self if isinstance(value, tuple)
        }

    @classmethod
    def bare(cls, **settings: Any) -> Self:
        """A place that holds nothing but what is given."""
        names = [name for name, value in cls() if isinstance(value, tuple)]
        return cls(**{**dict.fromkeys(names, (0.0, 0.0)), "vigor": (1, 1), **settings})


DEFAULTS: dict[PlaceName, PlaceConfig] = {
    "garden": PlaceConfig(
        slope=(0, 3),
        relief=(0.1, 0.2),
        shrubs=(24, 34),
        hedges=(4, 12),
        trees=(4, 7),
        saplings=(0, 2),
        front_plants=(0.3, 1),
        mown=(0.4, 1),
        rocks=(0, 0.5),
        buildings=(0.7, 1.9),
        vehicles=(0.5, 1.2),
        people=(0.7, 1.6),
        poles=(1, 2.5),
        furniture=(1, 3),
    ),
    "orchard": PlaceConfig(
        slope=(0, 10),
        shrubs=(1, 8),
        hedges=(0, 25),
        trees=(8, 30),
        saplings=(0, 4),
        mown=(0.3, 0.9),
        vehicles=(0, 0.6),
        furniture=(0, 1),
    ),
    "fields": PlaceConfig(
        slope=(0, 8),
        relief=(0.1, 0.5),
        shrubs=(4, 18),
        hedges=(20, 60),
        trees=(0.5, 4),
        saplings=(0, 5),
        grass=(15, 35),
        herbs=(0, 0.8),
        vehicles=(0, 0.4),
        furniture=(0, 1),
    ),
    "park": PlaceConfig(
        slope=(0, 8),
        relief=(0.1, 0.8),
        shrubs=(8, 35),
        clumping=(0.6, 0.95),
        hedges=(0, 20),
        trees=(3, 12),
        bare_stems=(0.1, 0.7),
        undergrowth=(0, 0.6),
        mown=(0.6, 1),
        buildings=(0, 0.3),
        people=(1, 4),
        poles=(0.5, 2),
        furniture=(1, 5),
    ),
    "road": PlaceConfig(
        slope=(0, 8),
        shrubs=(8, 40),
        hedges=(0, 20),
        trees=(1, 8),
        saplings=(1, 10),
        undergrowth=(0, 1.5),
        herbs=(0.1, 0.8),
        mown=(0, 0.3),
        vehicles=(0.5, 3),
        poles=(1, 4),
        people=(0, 0.6),
    ),
    "street": PlaceConfig(
        slope=(0, 4),
        relief=(0.02, 0.2),
        shrubs=(10, 30),
        hedges=(5, 20),
        trees=(1, 5),
        bare_stems=(0.1, 0.6),
        saplings=(0, 3),
        mown=(0.4, 1),
        buildings=(2, 4),
        vehicles=(0.2, 1),
        parked=(0.2, 0.9),
        front_plants=(0.5, 1),
        people=(0.4, 2),
        poles=(0.4, 1.5),
        furniture=(0.3, 1.5),
        boundaries=(0.4, 1.3),
    ),
    "forest_edge": PlaceConfig(
        slope=(0, 14),
        relief=(0.1, 0.8),
        shrubs=(12, 45),
        trees=(15, 45),
        bare_stems=(0, 0.5),
        saplings=(4, 18),
        undergrowth=(0.2, 1.2),
        dead_wood=(0.5, 4),
        herbs=(0.2, 1.2),
        mown=(0, 0.3),
        rocks=(0, 2),
    ),
    "forest": PlaceConfig(
        slope=(0, 22),
        relief=(0.1, 1.2),
        roughness=(0.01, 0.05),
        shrubs=(3, 25),
        trees=(25, 80),
        bare_stems=(0.3, 1),
        saplings=(4, 35),
        undergrowth=(0.1, 1.0),
        dead_wood=(2, 10),
        grass=(1, 10),
        herbs=(0.3, 2.5),
        mown=(0, 0),
        rocks=(0, 4),
    ),
    "heath": PlaceConfig(
        slope=(0, 18),
        relief=(0.2, 1.5),
        roughness=(0.01, 0.05),
        shrubs=(50, 200),
        clumping=(0.4, 0.9),
        trees=(0.3, 5),
        saplings=(1, 12),
        dead_wood=(0, 2),
        grass=(15, 40),
        herbs=(0.1, 1.2),
        mown=(0, 0),
        rocks=(0, 8),
        vigor=(0.6, 1.25),
    ),
    "village": PlaceConfig(
        slope=(0, 8),
        shrubs=(10, 35),
        hedges=(15, 50),
        trees=(1, 6),
        bare_stems=(0, 0.5),
        front_plants=(0.4, 1),
        parked=(0.1, 0.6),
        mown=(0.3, 1),
        buildings=(2, 4),
        vehicles=(1, 4),
        people=(1, 3),
        poles=(1, 3),
        furniture=(1, 4),
    ),
    "trail": PlaceConfig(
        slope=(0, 20),
        relief=(0.1, 1.0),
        roughness=(0.01, 0.05),
        shrubs=(20, 80),
        trees=(2, 20),
        saplings=(2, 15),
        undergrowth=(0.1, 1.5),
        dead_wood=(0.2, 3),
        grass=(15, 40),
        herbs=(0.2, 1.5),
        mown=(0, 0.1),
        rocks=(0.5, 10),
        puddles=(0.5, 4),
        people=(0, 1.2),
        vehicles=(0, 0.4),
    ),
    "yard": PlaceConfig(
        slope=(0, 4),
        shrubs=(4, 30),
        clumping=(0.5, 0.9),
        trees=(0.5, 4),
        saplings=(1, 8),
        grass=(4, 15),
        herbs=(0.1, 0.8),
        mown=(0, 0.2),
        rocks=(0, 3),
        puddles=(0, 2),
        buildings=(0.4, 1.5),
        vehicles=(1, 3),
        people=(0.5, 3),
        furniture=(3, 10),
    ),
}
"""What each place holds unless told otherwise."""


class PlacesConfig(Section):
    """A table a place; a setting that isn't given is that place's own default."""

    garden: PlaceConfig = DEFAULTS["garden"]
    orchard: PlaceConfig = DEFAULTS["orchard"]
    fields: PlaceConfig = DEFAULTS["fields"]
    park: PlaceConfig = DEFAULTS["park"]
    road: PlaceConfig = DEFAULTS["road"]
    street: PlaceConfig = DEFAULTS["street"]
    forest_edge: PlaceConfig = DEFAULTS["forest_edge"]
    forest: PlaceConfig = DEFAULTS["forest"]
    heath: PlaceConfig = DEFAULTS["heath"]
    village: PlaceConfig = DEFAULTS["village"]
    trail: PlaceConfig = DEFAULTS["trail"]
    yard: PlaceConfig = DEFAULTS["yard"]

    @model_validator(mode="before")
    @classmethod
    def _fill(cls, values: Any) -> Any:
        """Lay what is given over the place's defaults, not over those of any place."""
        if not isinstance(values, Mapping):
            return values
        return {
            name: {**dict(DEFAULTS[name]), **given}
            if name in DEFAULTS and isinstance(given, Mapping)
            else given
            for name, given in values.items()
        }

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not any(place.weight for _, place in self):
            raise ValueError("all weights are 0; expected at least one place to be drawn")
        return self

    def choose(self, rng: np.random.Generator) -> PlaceName:
        """Draw a place by weight."""
        weights = np.array([getattr(self, name).weight for name in PLACE_NAMES])
        return PLACE_NAMES[rng.choice(len(PLACE_NAMES), p=weights / weights.sum())]
