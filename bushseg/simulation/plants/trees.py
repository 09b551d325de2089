"""Trees and saplings: a stem, boughs that reach the rim of a crown, branches, twigs, leaves."""

from dataclasses import replace

import numpy as np

from bushseg.simulation.materials import BROADLEAF, NEEDLES, SHRUB_LEAF, TREE_BARK
from bushseg.simulation.mesh import Mesh, Model, Surface, join
from bushseg.simulation.plants.branches import Branches, blades, rods
from bushseg.simulation.plants.config import PlantsConfig, TreeForm
from bushseg.simulation.plants.crowns import foliage, leaf_material, volume
from bushseg.simulation.plants.distributions import choose, draw
from bushseg.simulation.plants.leaves import LeafKind
from bushseg.simulation.plants.plant import Plant
from bushseg.simulation.plants.tree_forms import FORMS, Form
from bushseg.simulation.plants.tree_wood import TreeSize, TreeWood, tree_wood

NEEDLE_SHOOT = LeafKind(0.09, 0.3, "spherical")
"""A shoot of needles, drawn as one triangle."""

IVY_FROM = 5.0
"""Trees below this height have no ivy, metres."""

LOW_BASE = (0.0, 0.05)
"""Where crowns begin that reach the ground, over the tree's height."""


def grow_tree(
    rng: np.random.Generator,
    config: PlantsConfig,
    form: TreeForm | None = None,
    height: float | None = None,
    low_crown: bool | None = None,
    base: float | None = None,
) -> Plant:
    """Grow a tree: class "tree".

    Args:
        rng: Source of randomness.
        config: Distributions of all that isn't given.
        form: Its kind; None draws a kind.
        height: Metres; None draws a height the form can have.
        low_crown: Whether its crown reaches the ground; None draws that.
        base: Where its crown begins, metres, at most 0.6 of its height; None draws that.
    """
    build = FORMS[choose(rng, config.tree_forms) if form is None else form]
    if height is None:
        height = float(np.clip(draw(rng, config.tree_height), *build.heights))
    if low_crown is None:
        low_crown = rng.random() < config.tree_low_crowns
    if low_crown:
        build = _low(build)
    if base is not None:
        share = min(base / height, 0.6)
        build = replace(build, base=(share, share), slopes=(max(build.slopes[0], 10.0), 60.0))
    return _grow(rng, config, build, height)


def grow_sapling(rng: np.random.Generator, config: PlantsConfig) -> Plant:
    """Grow a young tree, with one stem and a crown that begins low or high: class "tree"."""
    form = choose(rng, config.tree_forms)
    height = draw(rng, config.sapling_height)
    build = FORMS[form]
    slender = rng.uniform(0.6, 1.3)
    build = replace(
        build,
        stems=(1, 1),
        width=(build.width[0] * slender, build.width[1] * slender),
        base=(0.25, 0.55),
        boughs=build.boughs * 2 // 3,
        trunk=max(build.trunk, 0.85),
    )
    if rng.random() < config.sapling_low_crowns:
        build = _low(build)
    return _grow(rng, config, build, height, stoutness=0.6)


def _low(build: Form) -> Form:
    """The same form with a crown that reaches the ground."""
    profile = (max(build.profile[0], 0.8), max(build.profile[1], 0.9), *build.profile[2:])
    if build.needles:  # pines that keep their low boughs are young: cones
        profile = FORMS["cone"].profile
    slopes = (min(build.slopes[0], -5.0), build.slopes[1])
    return replace(build, base=LOW_BASE, profile=profile, slopes=slopes)


def _grow(
    rng: np.random.Generator,
    config: PlantsConfig,
    build: Form,
    height: float,
    stoutness: float = 1.0,
) -> Plant:
    """Grow a tree of a form; `stoutness` is a factor on the stem's thickness."""
    bare = not build.needles and rng.random() < config.tree_leafless
    half = 0.5 * height * rng.uniform(*build.width)
    base = height * rng.uniform(*build.base)
    thick = 0.5 * height * stoutness * draw(rng, config.tree_stem_ratio)
    size = TreeSize(height, half, base, thick)
    wood = tree_wood(rng, build, size, (2.0 if bare else 1.0) * config.detail)
    surfaces: Model = [
        Surface(_wood_mesh(rng, wood), TREE_BARK[rng.integers(len(TREE_BARK))]),
    ]
    if not bare:
        surfaces.append(_leaves(rng, config, build, size, wood))
    if height > IVY_FROM and rng.random() < config.tree_ivy:
        surfaces.append(_ivy(rng, config, size, wood.stems))
    return Plant.of(surfaces, "tree")


def _wood_mesh(rng: np.random.Generator, wood: TreeWood) -> Mesh:
    """Stems with rough bark, and all that grows on them."""
    stems = rods(wood.stems, 10)
    rings = wood.stems.radii.repeat(10, axis=1).ravel()[:, None]
    rough = stems.vertices + 0.05 * rings * rng.standard_normal(stems.vertices.shape)
    parts = [Mesh.of(rough, stems.triangles), rods(wood.boughs, 5), rods(wood.branches, 3)]
    return join([*parts, blades(rng, wood.twigs)])


def _ivy(
    rng: np.random.Generator, config: PlantsConfig, size: TreeSize, stems: Branches
) -> Surface:
    """Leaves that clothe the lower stem, as ivy does and sprouts do."""
    kind = LeafKind(0.06, 0.8, "erectophile")
    top = rng.uniform(0.15, 0.7)
    knots = max(round(top * stems.paths.shape[1]), 2)
    lower = Branches(stems.paths[:, :knots], stems.radii[:, :knots])
    spread = size.thick + rng.uniform(0.03, 0.2)
    area = rng.uniform(1.0, 3.0) * 2 * np.pi * spread * float(lower.lengths().sum())
    most = 0.2 * config.max_tree_leaves * config.detail
    mesh = foliage(rng, lower, kind, area=area, most=most, spread=0.7 * spread, unevenness=0.5)
    return Surface(mesh, SHRUB_LEAF[rng.integers(len(SHRUB_LEAF))])


def _leaves(
    rng: np.random.Generator, config: PlantsConfig, build: Form, size: TreeSize, wood: TreeWood
) -> Surface:
    """All leaves, on the twigs."""
    kind = NEEDLE_SHOOT
    if not build.needles:
        kind = LeafKind(
            draw(rng, config.tree_leaf_length),
            draw(rng, config.leaf_aspect),
            choose(rng, config.leaf_angles),
        )
    density = draw(rng, config.tree_leaf_density) * build.density
    mesh = foliage(
        rng,
        wood.twigs,
        kind,
        area=density * volume(np.array(build.profile), size.half, size.height - size.base),
        most=config.max_tree_leaves * config.detail * min(size.height / 10, 1.0),
        start=1 - build.clumping,
        spread=0.02 + 0.006 * size.height,
        unevenness=config.leaf_unevenness,
    )
    return Surface(mesh, leaf_material(rng, config, NEEDLES if build.needles else BROADLEAF))
