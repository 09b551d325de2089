"""Vegetation by rules: stems branch, branches carry twigs, and twigs carry leaves.

Every `grow_` function takes a generator and a `PlantsConfig`, which holds all distributions. What
is a bush and what a tree is decided by how it grows, not by its size: a woody plant with one stem
that is, or will be, a tree is "tree", were it a sapling of 1.5 m; several stems from the ground and
at most about 6 m is "bush". Several stems and taller is a multi-stemmed "tree". Dead stems, logs
and stumps are "tree" as the wood they are; a heap of brush is "bush", as it is to all who must get
past it. Grass and herbs are "low vegetation".
"""

from bushseg.simulation.plants.config import PlantsConfig
from bushseg.simulation.plants.dead_wood import grow_dead_wood
from bushseg.simulation.plants.grass import grow_grass
from bushseg.simulation.plants.hedges import grow_hedge
from bushseg.simulation.plants.herbs import grow_herbs
from bushseg.simulation.plants.plant import Plant, Pool
from bushseg.simulation.plants.scatter import scatter
from bushseg.simulation.plants.shrubs import grow_shrub
from bushseg.simulation.plants.trees import grow_sapling, grow_tree

__all__ = [
    "Plant",
    "PlantsConfig",
    "Pool",
    "grow_dead_wood",
    "grow_grass",
    "grow_hedge",
    "grow_herbs",
    "grow_sapling",
    "grow_shrub",
    "grow_tree",
    "scatter",
]
