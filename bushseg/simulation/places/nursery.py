"""Where a site's plants come from: some of each kind are grown, the rest are copies."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from bushseg.simulation.plants import (
    Plant,
    PlantsConfig,
    Pool,
    grow_dead_wood,
    grow_hedge,
    grow_sapling,
    grow_shrub,
    grow_tree,
)
from bushseg.simulation.plants.config import TreeForm
from bushseg.simulation.plants.distributions import choose, draw
from bushseg.simulation.plants.tree_forms import FORMS

MOST_TRIANGLES = 3_500_000
"""About what a site's plants may have; more plants are drawn with fewer and larger leaves."""

TRIANGLES = {"trees": 26_000, "shrubs": 8_000, "saplings": 8_000, "hedges": 2_500}
"""What one of each (a metre of hedge) has at full detail, roughly."""

LEAST_DETAIL = 0.06

STREET_DETAIL = 0.5
"""Street trees are grown one by one; with fewer and larger leaves that is quick."""

FAVOR = 1.0
"""How much sites differ in what grows: spread of the logarithms of kinds' weights."""

WINTER = 0.85
"""Share of leafless plants where it is winter."""


class Nursery:
    """Pools of plants, all of a site's own draw.

    Attributes:
        config: How plants grow, with as much detail as the site can afford.
    """

    def __init__(
        self,
        rng: np.random.Generator,
        config: PlantsConfig,
        amounts: Mapping[str, float],
        size: float,
        *,
        fruit: bool = False,
    ) -> None:
        """Prepare pools; nothing grows before it is asked for.

        Args:
            rng: Source of randomness.
            config: How plants grow.
            amounts: How many there will be per 1000 square metres, by kind, and their `vigor`, a
                factor on their heights.
            size: Edge of the site, metres.
            fruit: Whether trees are an orchard's.
        """
        detail = config.detail * min(1.0, MOST_TRIANGLES / max(_triangles(amounts, size), 1.0))
        plants = _of_site(rng, config)
        plants = plants.model_copy(update={"detail": max(detail, LEAST_DETAIL)})
        self.config = plants
        self._rng = rng
        self._coarse = plants.model_copy(update={"detail": min(plants.detail, STREET_DETAIL)})
        vigor = (amounts["vigor"], amounts["vigor"], amounts["vigor"])
        self._bare_stems = amounts.get("bare_stems", 0.0)
        self._trees = Pool(lambda: self._tree("fruit" if fruit else None).scaled(vigor), 16)
        self._shrubs = Pool(lambda: grow_shrub(rng, plants).scaled(vigor), 36)
        self._saplings = Pool(lambda: grow_sapling(rng, plants).scaled(vigor), 12)
        self._dead_wood = Pool(lambda: grow_dead_wood(rng, plants), 10)

    def tree(self) -> Plant:
        """A tree."""
        return self._trees.take(self._rng)

    def shrub(self) -> Plant:
        """A shrub."""
        return self._shrubs.take(self._rng)

    def _tree(self, form: TreeForm | None) -> Plant:
        """Grow a tree, with a bare stem where the stand shades its lower boughs away."""
        rng, config = self._rng, self.config
        if form is not None or rng.random() >= self._bare_stems:
            return grow_tree(rng, config, form)
        form = choose(rng, config.tree_forms)
        height = float(np.clip(draw(rng, config.tree_height), *FORMS[form].heights))
        base = rng.uniform(0.3, 0.6) * height
        return grow_tree(rng, config, form, height, low_crown=False, base=base)

    def street_tree(self, base: float) -> Plant:
        """A broad-leaved tree whose crown begins at `base` metres."""
        forms: tuple[TreeForm, ...] = ("round", "columnar", "wide", "fruit")
        height = base * self._rng.uniform(1.8, 4.0)
        form = forms[self._rng.integers(4)]
        return grow_tree(self._rng, self._coarse, form, height, low_crown=False, base=base)

    def sapling(self) -> Plant:
        """A sapling."""
        return self._saplings.take(self._rng)

    def dead_wood(self) -> Plant:
        """A snag, log, stump or brush heap."""
        return self._dead_wood.take(self._rng)

    def hedge(self, length: float, height: float | None = None) -> Plant:
        """A length of hedge along x, metres."""
        return grow_hedge(self._rng, self.config, length, height)


def _of_site(rng: np.random.Generator, config: PlantsConfig) -> PlantsConfig:
    """Draw what grows on one site: some kinds more than others, and all in one season.

    Over many sites the shares are those of the settings.
    """
    chance = rng.random()
    changes: dict[str, Any] = {}
    for name in ("shrub_habits", "tree_forms", "grass_stands", "herb_kinds"):
        weights = getattr(config, name)
        changes[name] = {kind: w * float(rng.lognormal(0, FAVOR)) for kind, w in weights.items()}
    for name in ("tree_leafless", "shrub_leafless"):
        share = getattr(config, name)
        winter = chance < share
        changes[name] = WINTER if winter else share * (1 - WINTER) / max(1 - share, 1e-6)
    return config.model_copy(update=changes)


def _triangles(amounts: Mapping[str, float], size: float) -> float:
    """What a site's plants would have at full detail, roughly."""
    below = amounts["undergrowth"] * amounts["trees"] * TRIANGLES["shrubs"]
    wanted = sum(amounts[kind] * number for kind, number in TRIANGLES.items()) + below
    return wanted * size**2 / 1000
