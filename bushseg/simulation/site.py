"""Where everything stands: one garden or field edge, drawn at random."""

from dataclasses import dataclass, field

import numpy as np

from bushseg.points import FloatArray
from bushseg.simulation.config import SimulateConfig
from bushseg.simulation.foliage import GOLDEN_ANGLE, meadow
from bushseg.simulation.mesh import Model, placed
from bushseg.simulation.plants import Form, Habit, bush, tree
from bushseg.simulation.scene import Scene
from bushseg.simulation.structures import car, fence, house, lamp_post, person, wall
from bushseg.simulation.terrain import Terrain, cover, make_terrain

EDGE = 0.8
"""Where the boundary runs, metres from the site's edge."""

MARGIN = 2.0
"""Everything else keeps this much from the site's edge, metres."""

CANDIDATES = 60
"""Places tried for each thing."""

SPREADS: dict[Habit, tuple[float, float]] = {
    "mound": (0.9, 1.5),
    "columnar": (0.35, 0.5),
    "multi-stemmed": (0.7, 1.1),
}
"""Least and greatest width of a bush that stands free, over its height."""

FREE_HABITS = tuple(SPREADS)


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
    return _Builder(rng, config, terrain, Layout(config.size), Scene()).build()


@dataclass(frozen=True, slots=True)
class _Builder:
    """Puts one thing after another where there is room; the order decides who yields."""

    rng: np.random.Generator
    config: SimulateConfig
    terrain: Terrain
    layout: Layout
    scene: Scene

    def build(self) -> Site:
        """Furnish the whole site."""
        if self.config.boundary:
            self._enclose()
        drive = self._build_house() if self.config.building else None
        stations = self._stations()
        self._plant_trees()
        self._park(drive)
        for _ in range(self.config.num_poles):
            self._stand(lamp_post(self.rng.uniform(4, 7)), "man-made")
        for _ in range(self.config.num_people):
            self._stand(person(self.rng), "vehicle or person")
        self._plant_bushes()
        self.scene.add(cover(self.rng, self.terrain, drive), "ground", instance=False)
        grass = meadow(self.rng, self.terrain, self.config, drive)
        self.scene.add(grass, "low vegetation", instance=False)
        heights = self.terrain.height(stations)
        return Site(self.scene, self.terrain, np.column_stack([stations, heights]))

    def _add(self, model: Model, class_name: str, place: FloatArray, yaw: float) -> None:
        """Set a model on the ground at `place` (2,), metres, turned by `yaw` radians."""
        self.scene.add(placed(model, self.terrain.point(place), yaw), class_name)

    def _yaw(self) -> float:
        return self.rng.uniform(0, 2 * np.pi)

    def _enclose(self) -> None:
        """Run a fence along the southern and a wall along the eastern edge."""
        near, far = EDGE, self.config.size - EDGE
        west, corner, north = np.array([(near, near), (far, near), (far, far)])
        pickets = fence(self.terrain, west, corner, self.rng.uniform(1.0, 1.4))
        self.scene.add(pickets, "man-made")
        stones = wall(self.terrain, corner, north, self.rng.uniform(0.8, 1.6))
        self.scene.add(stones, "man-made")

    def _build_house(self) -> FloatArray:
        """Set a house in the north-western corner; return the ends of its drive, (2, 2)."""
        size = self.config.size
        length = min(self.rng.uniform(7, 11), size / 4)
        width = min(self.rng.uniform(5.5, 7), size / 5)
        radius = float(np.hypot(length, width)) / 2
        inward = np.array([1, -1])
        corner = np.array([0, size]) + (radius + MARGIN) * inward
        place = self.layout.claim(
            (corner + self.rng.uniform(0, 0.05 * size, 2) * inward)[None], radius
        )
        model = house(length, width, eaves=self.rng.uniform(2.6, 3.4))
        self._add(model, "building", place, self.rng.uniform(-0.2, 0.2))
        gate = np.array([place[0] + self.rng.uniform(0, 0.2) * size, EDGE])
        return np.array([place - np.array([0, width / 2 + 0.8]), gate])

    def _stations(self) -> FloatArray:
        """Spread stations in a spiral about the middle and keep 2.5 m around each free; (S, 2)."""
        size, number = self.config.size, self.config.sensor.stations
        order = np.arange(number)
        radius = 0.36 * size * np.sqrt((order + 0.5) / number)
        angle = self._yaw() + GOLDEN_ANGLE * order
        aims = size / 2 + radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        near = (self.layout.near(self.rng, aim, 1.0) for aim in aims)
        return np.array([self.layout.claim(candidates, 2.5) for candidates in near])

    def _plant_trees(self) -> None:
        """Plant trees of 4 to 18 m; every other crown begins low."""
        rng = self.rng
        for number in range(self.config.num_trees):
            form: Form = "conifer" if rng.random() < 0.35 else "broadleaf"
            height = rng.uniform(4, 18)
            slenderness = rng.uniform(0.3, 0.4) if form == "conifer" else rng.uniform(0.4, 0.6)
            crown_base = rng.uniform(0.04, 0.15) if number % 2 else rng.uniform(0.3, 0.5)
            model = tree(rng, form, height, slenderness * height, crown_base * height)
            # Crowns keep clear of each other and of the stations; bushes may stand under them.
            room = 0.45 * slenderness * height
            place = self.layout.claim(self.layout.anywhere(rng), room, keep=0.5)
            self._add(model, "tree", place, self._yaw())

    def _plant_bushes(self) -> None:
        """Plant bushes of 0.4 to 3 m: each tenth a hedge, the rest singly or in clumps."""
        rng, last = self.rng, np.full(2, self.config.size / 2)
        for number in range(self.config.num_bushes):
            if number % 10 == 9:
                self._plant_hedge(southern=number % 20 == 9)
                continue
            habit = FREE_HABITS[rng.choice(len(FREE_HABITS), p=(0.5, 0.15, 0.35))]
            height = float(np.clip(rng.lognormal(0.2, 0.5), 0.4, 3.0))
            width = height * rng.uniform(*SPREADS[habit])
            alone = rng.random() < 0.6
            where = self.layout.anywhere(rng) if alone else self.layout.near(rng, last, 1.5)
            last = self.layout.claim(where, 0.4 * width)
            self._add(bush(rng, habit, height, width), "bush", last, self._yaw())

    def _plant_hedge(self, *, southern: bool) -> None:
        """Plant a length of hedge by the southern or the eastern edge."""
        size = self.config.size
        length, height = self.rng.uniform(3, 0.3 * size), self.rng.uniform(0.8, 2.0)
        along = self.rng.uniform(MARGIN + length / 2, size - MARGIN - length / 2)
        place = np.array([along, MARGIN] if southern else [size - MARGIN, along])
        model = bush(self.rng, "hedge", height, length)
        self._add(model, "bush", place, 0.0 if southern else np.pi / 2)

    def _park(self, drive: FloatArray | None) -> None:
        """Park cars on the drive (2, 2), or anywhere where there is none."""
        for _ in range(self.config.num_vehicles):
            where, yaw = self.layout.anywhere(self.rng), self._yaw()
            if drive is not None:
                along = drive[1] - drive[0]
                where = drive[0] + self.rng.uniform(0.25, 0.8, (CANDIDATES, 1)) * along
                yaw = float(np.arctan2(along[1], along[0]))
            place = self.layout.claim(where, 2.3)
            self._add(car(self.rng), "vehicle or person", place, yaw)

    def _stand(self, model: Model, class_name: str) -> None:
        """Stand something slim wherever there is room."""
        place = self.layout.claim(self.layout.anywhere(self.rng), 0.6)
        self._add(model, class_name, place, self._yaw())
