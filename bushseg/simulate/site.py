"""Where everything stands: one garden or field edge, drawn at random."""

from dataclasses import dataclass, field

import numpy as np

from bushseg.points import FloatArray
from bushseg.simulate.config import SimulateConfig
from bushseg.simulate.foliage import meadow
from bushseg.simulate.mesh import placed
from bushseg.simulate.plants import HABITS, Form, bush, tree
from bushseg.simulate.scene import Scene
from bushseg.simulate.structures import car, fence, house, lamp_post, person, wall
from bushseg.simulate.terrain import Terrain, cover, make_terrain

MARGIN = 2.0
CANDIDATES = 60


@dataclass(slots=True)
class Layout:
    """Which places are taken.

    Attributes:
        size: Edge of the site, metres.
        discs: x, y and radius of what is taken, metres.
    """

    size: float
    discs: list[tuple[float, float, float]] = field(default_factory=list)

    def claim(self, candidates: FloatArray, radius: float, keep: float | None = None) -> FloatArray:
        """Take the first free place, or the one that is least in the way.

        Args:
            candidates: Places to try, metres, shape (N, 2).
            radius: Room wanted, metres.
            keep: Room then denied to others, metres; None: as much.

        Returns:
            The place, (2,), metres.
        """
        inside = np.clip(candidates, MARGIN, self.size - MARGIN)
        taken = np.array(self.discs).reshape(-1, 3)
        gaps = np.linalg.norm(inside[:, None] - taken[None, :, :2], axis=2) - taken[:, 2]
        room = gaps.min(axis=1, initial=np.inf)
        free = np.flatnonzero(room >= radius)
        place = inside[free[0] if len(free) else room.argmax()]
        self.discs.append((place[0], place[1], radius if keep is None else keep))
        return place

    def anywhere(self, rng: np.random.Generator) -> FloatArray:
        """Draw candidates all over the site, (N, 2)."""
        return rng.uniform(MARGIN, self.size - MARGIN, (CANDIDATES, 2))

    def near(self, rng: np.random.Generator, place: FloatArray, distance: float) -> FloatArray:
        """Draw candidates about `distance` metres around `place` (2,), (N, 2)."""
        return place + rng.normal(0, distance, (CANDIDATES, 2))


@dataclass(frozen=True, slots=True)
class Site:
    """A scene and where a sensor may stand in it.

    Attributes:
        scene: All that rays can strike.
        terrain: The ground.
        stations: Places for a tripod or robot on the ground, metres, shape (S, 3), float64.
    """

    scene: Scene
    terrain: Terrain
    stations: FloatArray


def make_site(rng: np.random.Generator, config: SimulateConfig) -> Site:
    """Draw a site of `config.size` metres with its corner at the origin."""
    terrain = make_terrain(rng, config)
    layout, scene = Layout(config.size), Scene()
    drive = _build(rng, config, terrain, layout, scene)
    stations = _stations(rng, config, layout)
    _plant_trees(rng, config, terrain, layout, scene)
    _furnish(rng, config, terrain, layout, scene, drive)
    _plant_bushes(rng, config, terrain, layout, scene)
    scene.add(cover(rng, terrain, drive), "ground", instance=False)
    grass = meadow(rng, terrain, config.size, config.grass_density, drive)
    scene.add(grass, "low vegetation", instance=False)
    return Site(scene, terrain, np.column_stack([stations, terrain.height(stations)]))


def _build(
    rng: np.random.Generator,
    config: SimulateConfig,
    terrain: Terrain,
    layout: Layout,
    scene: Scene,
) -> FloatArray | None:
    """Set house, fence and wall; return the ends of the drive (2, 2), or None without a house."""
    size, edge = config.size, 0.8
    corners = np.array([(edge, edge), (size - edge, edge), (size - edge, size - edge)])
    if config.boundary:
        scene.add(fence(terrain, corners[0], corners[1], rng.uniform(1.0, 1.4)), "man-made")
        scene.add(wall(terrain, corners[1], corners[2], rng.uniform(0.8, 1.6)), "man-made")
    if not config.building:
        return None
    length = min(rng.uniform(7, 11), size / 4)
    width = min(rng.uniform(5.5, 7), size / 5)
    radius = float(np.hypot(length, width)) / 2
    middle = np.array([[0.0, size]]) + (radius + MARGIN) * np.array([1, -1])
    middle = middle + rng.uniform(0, 0.05 * size, (1, 2)) * (1, -1)
    place = layout.claim(middle, radius)
    yaw = rng.uniform(-0.2, 0.2)
    model = house(length, width, rng.uniform(2.6, 3.4))
    scene.add(placed(model, terrain.point(place), yaw), "building")
    gate = np.array([place[0] + rng.uniform(0, 0.2) * size, edge])
    return np.array([place - (0, width / 2 + 0.8), gate])


def _stations(rng: np.random.Generator, config: SimulateConfig, layout: Layout) -> FloatArray:
    """Spread stations in a spiral about the middle and keep 2.5 m around each free; (S, 2)."""
    order = np.arange(config.stations)
    radius = 0.36 * config.size * np.sqrt((order + 0.5) / config.stations)
    angle = rng.uniform(0, 2 * np.pi) + 2.4 * order
    aims = config.size / 2 + radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.array([layout.claim(layout.near(rng, aim, 1.0), 2.5) for aim in aims])


def _plant_trees(
    rng: np.random.Generator,
    config: SimulateConfig,
    terrain: Terrain,
    layout: Layout,
    scene: Scene,
) -> None:
    """Plant trees of 4 to 18 m; every other crown begins low."""
    for number in range(config.num_trees):
        height = rng.uniform(4, 18) if number else rng.uniform(9, 14)
        form: Form = "conifer" if rng.random() < 0.35 else "broadleaf"
        width = (
            height * rng.uniform(0.3, 0.4) if form == "conifer" else height * rng.uniform(0.4, 0.6)
        )
        base = height * (rng.uniform(0.04, 0.15) if number % 2 else rng.uniform(0.3, 0.5))
        # Crowns keep clear of each other and of the stations; bushes may stand under them.
        place = layout.claim(layout.anywhere(rng), 0.45 * width, keep=0.5)
        model = tree(rng, form, height, width, base)
        scene.add(placed(model, terrain.point(place), rng.uniform(0, 2 * np.pi)), "tree")


def _plant_bushes(
    rng: np.random.Generator,
    config: SimulateConfig,
    terrain: Terrain,
    layout: Layout,
    scene: Scene,
) -> None:
    """Plant bushes of 0.4 to 3 m: hedges along the edges, the rest singly or in clumps."""
    last = np.full(2, config.size / 2)
    for number in range(config.num_bushes):
        if number % 10 == 9:
            place, yaw, width, height = _hedge_place(rng, config.size, number)
            model = bush(rng, "hedge", height, width)
            layout.discs.append((*place, 0.5))
        else:
            habit = HABITS[rng.choice(3, p=(0.5, 0.15, 0.35))]
            height = float(np.clip(rng.lognormal(0.2, 0.5), 0.4, 3.0))
            spread = {"mound": (0.9, 1.5), "columnar": (0.35, 0.5), "multi-stemmed": (0.7, 1.1)}
            width, yaw = height * rng.uniform(*spread[habit]), rng.uniform(0, 2 * np.pi)
            alone = rng.random() < 0.6
            where = layout.anywhere(rng) if alone else layout.near(rng, last, 1.5)
            place = layout.claim(where, 0.4 * width)
            model, last = bush(rng, habit, height, width), place
        scene.add(placed(model, terrain.point(place), yaw), "bush")


def _hedge_place(
    rng: np.random.Generator, size: float, number: int
) -> tuple[FloatArray, float, float, float]:
    """A hedge's middle (2,), yaw in radians, length and height in metres, along some edge."""
    length = rng.uniform(3, 0.3 * size)
    along = rng.uniform(MARGIN + length / 2, size - MARGIN - length / 2)
    height = rng.uniform(0.8, 2.0)
    if number % 20 == 9:
        return np.array([along, MARGIN]), 0.0, length, height
    return np.array([size - MARGIN, along]), np.pi / 2, length, height


def _furnish(
    rng: np.random.Generator,
    config: SimulateConfig,
    terrain: Terrain,
    layout: Layout,
    scene: Scene,
    drive: FloatArray | None,
) -> None:
    """Set out cars (on the drive, if there is one), lamp posts and people."""
    for _ in range(config.num_vehicles):
        where, yaw = layout.anywhere(rng), rng.uniform(0, 2 * np.pi)
        if drive is not None:
            along = drive[1] - drive[0]
            where = drive[0] + rng.uniform(0.25, 0.8, (CANDIDATES, 1)) * along
            yaw = float(np.arctan2(along[1], along[0]))
        place = layout.claim(where, 2.3)
        scene.add(placed(car(rng), terrain.point(place), yaw), "vehicle or person")
    for _ in range(config.num_poles):
        place = layout.claim(layout.anywhere(rng), 0.6)
        model = placed(lamp_post(rng.uniform(4, 7)), terrain.point(place), rng.uniform(0, 6.28))
        scene.add(model, "man-made")
    for _ in range(config.num_people):
        place = layout.claim(layout.anywhere(rng), 0.6)
        model = placed(person(rng), terrain.point(place), rng.uniform(0, 6.28))
        scene.add(model, "vehicle or person")
