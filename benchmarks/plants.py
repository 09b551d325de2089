"""What rays find in simulated plants: how many pass, how deep the others get, what a plant costs.

    python benchmarks/plants.py [--number 8] [--seed 0]

For each habit of shrub, form of tree and other kind, `--number` plants are grown and parallel level
rays are sent through each, on a grid of 5 cm (10 cm for plants above 6 m). Rays count if they cross
the plant's silhouette: the outline of all that rays hit, filled row by row and column by column.
Printed a kind:

- height and width in metres, triangles in thousands, milliseconds to grow one;
- pass: the share of those rays that go through, in the whole silhouette;
- rim: that share within the outer fifth of the silhouette's width;
- depth: median of how far the rays that hit got behind the foremost hit within 0.25 m, metres.
"""

import argparse
import time
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter

from bushseg.geometry import open3d
from bushseg.simulation.plants import (
    Plant,
    PlantsConfig,
    grow_dead_wood,
    grow_hedge,
    grow_sapling,
    grow_shrub,
    grow_tree,
)
from bushseg.simulation.plants.shrubs import HABITS
from bushseg.simulation.plants.tree_forms import FORMS
from bushseg.simulation.scene import Scene

FRONT = 0.5
"""Depths count from the foremost hit in a square this wide, metres."""


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--number", type=int, default=8)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    leaved = PlantsConfig(shrub_leafless=0, tree_leafless=0)
    leafless = PlantsConfig(shrub_leafless=1, tree_leafless=1)
    clipped = leaved.model_copy(update={"hedge_clipped": 1.0})
    overgrown = leaved.model_copy(update={"hedge_clipped": 0.0})
    kinds: dict[str, Callable[[np.random.Generator], Plant]] = {
        **{f"shrub {name}": partial(grow_shrub, config=leaved, habit=name) for name in HABITS},
        "shrub, leafless": partial(grow_shrub, config=leafless),
        "hedge, clipped, 5 m": partial(grow_hedge, config=clipped, length=5.0),
        "hedge, overgrown, 5 m": partial(grow_hedge, config=overgrown, length=5.0),
        **{f"tree {name}": partial(grow_tree, config=leaved, form=name) for name in FORMS},
        "tree round, low crown": partial(grow_tree, config=leaved, form="round", low_crown=True),
        "tree round, leafless": partial(grow_tree, config=leafless, form="round"),
        "sapling": partial(grow_sapling, config=leaved),
        "dead wood": partial(grow_dead_wood, config=leaved),
    }
    print(f"{'kind':24} {'height':>6} {'width':>6} {'k tri':>6} {'ms':>6} ", end="")
    print(f"{'pass':>6} {'rim':>6} {'depth':>6}")
    for name, grow in kinds.items():
        rows = []
        for number in range(options.number):
            rng = np.random.default_rng([options.seed, number])
            start = time.perf_counter()
            plant = grow(rng)
            spent = 1000 * (time.perf_counter() - start)
            triangles = sum(len(mesh.triangles) for mesh, _ in plant.model) / 1000
            rows.append((plant.height, 2 * plant.radius, triangles, spent, *penetration(plant)))
        values = np.median(np.array(rows), axis=0)
        cells = (f"{v:6.2f}" if n < 2 or n > 3 else f"{v:6.1f}" for n, v in enumerate(values))
        print(f"{name:24} {' '.join(cells)}")


def penetration(plant: Plant) -> tuple[float, float, float]:
    """Shares of level rays along y that pass, in the silhouette and at its rim; median depth."""
    step = 0.05 if plant.height < 6 else 0.1
    scene = Scene()
    scene.add(plant.model, plant.class_name)
    x = np.arange(-plant.radius, plant.radius, step) + step / 2
    z = np.arange(0.05, plant.height, step)
    xx, zz = np.meshgrid(x, z)
    origins = np.stack([xx, np.full_like(xx, -plant.radius - 1), zz], axis=-1)
    directions = np.broadcast_to([0.0, 1.0, 0.0], origins.shape)
    rays = np.concatenate([origins, directions], axis=-1).astype(np.float32)
    tensor = open3d().core.Tensor.from_numpy(np.ascontiguousarray(rays))
    reach = scene.caster().cast_rays(tensor)["t_hit"].numpy()
    hit = np.isfinite(reach)
    inside, share = silhouette(hit)
    rim = inside & ((share < 0.2) | (share > 0.8))
    front = minimum_filter(reach, size=2 * round(FRONT / 2 / step) + 1)
    passed = float(1 - hit[inside].mean()), float(1 - hit[rim].mean())
    return *passed, float(np.median(reach[hit] - front[hit]))


def silhouette(hit: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """What lies between hits in its row and in its column; how far across the row, 0 to 1."""
    rows = np.maximum.accumulate(hit, 1) & np.maximum.accumulate(hit[:, ::-1], 1)[:, ::-1]
    columns = np.maximum.accumulate(hit, 0) & np.maximum.accumulate(hit[::-1], 0)[::-1]
    inside = rows & columns
    first = rows.argmax(axis=1)[:, None]
    width = np.maximum(rows.sum(axis=1)[:, None], 1)
    return inside, (np.arange(hit.shape[1]) + 0.5 - first) / width


if __name__ == "__main__":
    main()
