"""How plants grow: every distribution, to be edited for one's own region."""

from typing import Literal

from pydantic import Field

from bushseg.config import Section, Share
from bushseg.simulation.plants.distributions import Spread, Weights

ShrubHabit = Literal[
    "multi_stemmed", "mounded", "columnar", "spreading", "arching", "sparse", "dense"
]
TreeForm = Literal[
    "round", "wide", "columnar", "poplar", "cone", "pine", "willow", "fruit", "multi_stemmed"
]
LeafAngles = Literal["spherical", "planophile", "erectophile", "plagiophile"]
GrassStand = Literal["lawn", "meadow", "tall"]
HerbKind = Literal["nettle", "fern", "dock", "umbel", "cover"]
DeadWood = Literal["snag", "log", "stump", "heap"]

QUANTILES = " (5 %, 50 % and 95 % quantile)"
WEIGHTS = " (weights; a kind left out never grows)"


def _spread(values: tuple[float, float, float], description: str) -> Spread:
    """A field that holds quantiles."""
    return Field(values, description=description + QUANTILES)


class PlantsConfig(Section):
    """Settings of all that grows; defaults are meant for lowland Europe."""

    shrub_height: Spread = _spread((0.5, 1.3, 3.8), "Height of shrubs, metres")
    shrub_habits: Weights[ShrubHabit] = Field(
        {
            "multi_stemmed": 0.24,
            "mounded": 0.2,
            "columnar": 0.08,
            "spreading": 0.12,
            "arching": 0.14,
            "sparse": 0.12,
            "dense": 0.1,
        },
        description="How shrubs grow" + WEIGHTS,
    )
    shrub_leaf_density: Spread = _spread(
        (0.8, 2.0, 4.5), "Leaf area density in shrubs, m² of one leaf side per m³"
    )
    shrub_leaf_length: Spread = _spread((0.02, 0.045, 0.1), "Length of shrubs' leaves, metres")
    shrub_leafless: Share = Field(0.12, description="Share of shrubs of bare twigs")

    shrub_shoots: Share = Field(
        0.35, description="Share of shrubs with long shoots that stand out of the crown"
    )

    hedge_height: Spread = _spread((0.7, 1.5, 3.2), "Height of clipped hedges, metres")
    hedgerow_height: Spread = _spread((1.1, 2.6, 6.0), "Height of overgrown hedges, metres")
    hedge_depth: Spread = _spread((0.45, 0.8, 1.6), "Thickness of clipped hedges, metres")
    hedge_clipped: Share = Field(0.6, description="Share of hedges clipped to flat faces")
    hedge_leaf_density: Spread = _spread(
        (6.0, 11.0, 18.0), "Leaf area density near a clipped hedge's faces, m²/m³"
    )

    tree_height: Spread = _spread((3.2, 9.0, 24.0), "Height of trees, metres")
    tree_forms: Weights[TreeForm] = Field(
        {
            "round": 0.26,
            "wide": 0.12,
            "columnar": 0.1,
            "poplar": 0.04,
            "cone": 0.16,
            "pine": 0.1,
            "willow": 0.06,
            "fruit": 0.08,
            "multi_stemmed": 0.08,
        },
        description="Crown forms of trees" + WEIGHTS,
    )
    tree_leaf_density: Spread = _spread((0.3, 0.65, 1.3), "Leaf area density in crowns, m²/m³")
    tree_leaf_length: Spread = _spread((0.04, 0.07, 0.13), "Length of trees' leaves, metres")
    tree_leafless: Share = Field(0.12, description="Share of broad-leaved trees of bare twigs")
    tree_low_crowns: Share = Field(
        0.3, description="Share of trees whose crowns reach the ground, or nearly"
    )
    tree_stem_ratio: Spread = _spread(
        (0.012, 0.019, 0.03), "Diameter of stems at breast height over the tree's height"
    )

    tree_ivy: Share = Field(
        0.07, description="Share of trees with ivy or sprouts along the lower stem"
    )

    sapling_height: Spread = _spread((1.5, 2.4, 4.0), "Height of saplings, metres")
    sapling_low_crowns: Share = Field(
        0.55, description="Share of saplings with branches from the ground up"
    )

    leaf_aspect: Spread = _spread((0.3, 0.55, 0.85), "Width of broad leaves over their length")
    leaf_angles: Weights[LeafAngles] = Field(
        {"spherical": 0.4, "planophile": 0.25, "erectophile": 0.15, "plagiophile": 0.2},
        description="Distributions of leaf inclinations after de Wit" + WEIGHTS,
    )
    leaf_unevenness: float = Field(
        0.5,
        ge=0,
        le=3,
        description="How unevenly leaves fill a crown: standard deviation of the logarithm of "
        "their density, part by part",
    )
    dead_leaves: Share = Field(0.06, description="Share of leaved plants whose leaves are brown")

    grass_stands: Weights[GrassStand] = Field(
        {"lawn": 0.3, "meadow": 0.5, "tall": 0.2},
        description="Stands of grass where no stand is asked for" + WEIGHTS,
    )
    lawn_height: Spread = _spread((0.03, 0.05, 0.1), "Height of mown grass, metres")
    meadow_height: Spread = _spread((0.15, 0.3, 0.6), "Height of meadows, metres")
    tall_grass_height: Spread = _spread((0.5, 0.8, 1.25), "Height of tall grass and reed, metres")
    grass_blades: int = Field(5, ge=1, le=50, description="Blades of a tuft")
    grass_blade_width: Spread = _spread(
        (0.006, 0.012, 0.025), "Width of blades, metres; a blade stands for some real ones"
    )
    dry_grass: Share = Field(0.25, description="Share of tufts that are dry")
    patch_size: float = Field(
        6.0, gt=0, le=200, description="Typical size of patches of grass and herbs, metres"
    )

    herb_kinds: Weights[HerbKind] = Field(
        {"nettle": 0.28, "fern": 0.22, "dock": 0.2, "umbel": 0.1, "cover": 0.2},
        description="Kinds of herbs; nettle: leafy stems, dock: large leaves from the ground, "
        "umbel: a flat flower head, cover: ground cover" + WEIGHTS,
    )
    nettle_height: Spread = _spread((0.35, 0.65, 1.2), "Height of nettles and the like, metres")
    fern_height: Spread = _spread((0.3, 0.6, 1.2), "Height of ferns and bracken, metres")
    dock_height: Spread = _spread((0.15, 0.3, 0.6), "Height of large-leaved herbs, metres")
    umbel_height: Spread = _spread((0.5, 0.9, 1.4), "Height of umbellifers, metres")
    cover_height: Spread = _spread((0.05, 0.12, 0.25), "Height of ground cover, metres")

    dead_wood: Weights[DeadWood] = Field(
        {"snag": 0.2, "log": 0.35, "stump": 0.25, "heap": 0.2},
        description="Kinds of dead wood; snag: a standing dead stem, heap: cut branches" + WEIGHTS,
    )

    detail: float = Field(
        1.0, gt=0, le=10, description="Factor on the number of leaves and twigs; area is kept"
    )
    max_shrub_leaves: int = Field(7000, ge=10, description="Most leaves of a shrub, times detail")
    max_tree_leaves: int = Field(26000, ge=10, description="Most leaves of a tree, times detail")
