"""What layouts build with: a site under construction."""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bushseg.points import FloatArray
from bushseg.simulation.mesh import Model, Surface, join, placed
from bushseg.simulation.places.ground import BUILT, MARGIN, PLANT, WAY, Ground
from bushseg.simulation.places.lines import beside, length, spaced, stretch
from bushseg.simulation.places.nursery import Nursery
from bushseg.simulation.plants import Plant
from bushseg.simulation.plants.distributions import choose, draw
from bushseg.simulation.scene import Scene
from bushseg.simulation.structures.barriers import BARRIERS
from bushseg.simulation.structures.buildings import Building, BuildingForm, building
from bushseg.simulation.structures.config import StructuresConfig, VehicleKind
from bushseg.simulation.structures.vehicles import VEHICLES

CANDIDATES = 80
"""Places tried for each thing."""

FOLLOWING = 3.0
"""Plants follow the slope below this height, the less the higher, metres."""

REFERENCE_AREA = 1000.0
"""Densities are per so many square metres."""


@dataclass(slots=True)
class Builder:
    """Puts one thing after another where there is room; the order decides who yields.

    Attributes:
        rng: Source of randomness.
        size: Edge of the site, metres.
        amounts: What the site draws from its place's ranges, by name.
        ground: The terrain and what it holds.
        nursery: Where plants come from.
        structures: How what people made differs.
        scene: What is built so far.
        path: What a walker or vehicle follows, metres, shape (P, 2); a layout sets it.
        woods: Where trees may stand, a share a cell, shape (C, C).
        scrub: The same for shrubs, saplings and tall herbs.
        mown: Where grass is short, shape (C, C), bool.
        bare: Where no grass grows, shape (C, C), bool.
        trunks: Places and crown radii of the trees, rows of (3,), metres.
    """

    rng: np.random.Generator
    size: float
    amounts: dict[str, float]
    ground: Ground
    nursery: Nursery
    structures: StructuresConfig = field(default_factory=StructuresConfig)
    scene: Scene = field(default_factory=Scene)
    path: FloatArray = field(init=False)
    woods: FloatArray = field(init=False)
    scrub: FloatArray = field(init=False)
    mown: NDArray[np.bool_] = field(init=False)
    bare: NDArray[np.bool_] = field(init=False)
    trunks: list[tuple[float, float, float]] = field(default_factory=list)

    def __post_init__(self) -> None:
        shape = self.ground.taken.shape
        self.path = np.zeros((0, 2))
        self.woods, self.scrub = np.ones(shape), np.ones(shape)
        self.mown, self.bare = np.zeros(shape, bool), np.zeros(shape, bool)

    def count(self, name: str, share: float = 1.0) -> int:
        """How many of something the site holds: its density times area, rounded by chance."""
        wanted = share * self.amounts[name] * self.size**2 / REFERENCE_AREA
        return int(wanted) + bool(self.rng.random() < wanted % 1)

    def fenced(self, chance: float) -> bool:
        """Whether a fence or wall that is usual with a `chance` stands on this site."""
        return bool(self.rng.random() < chance * self.amounts["boundaries"])

    def has(self, name: str) -> bool:
        """Whether the site holds any of something."""
        return self.amounts[name] > 0

    def yaw(self) -> float:
        """Any direction, radians."""
        return float(self.rng.uniform(0, 2 * np.pi))

    def anywhere(self, number: int = CANDIDATES) -> FloatArray:
        """Draw places all over the site, (N, 2)."""
        return self.rng.uniform(0, self.size, (number, 2))

    def along(self, line: FloatArray, distance: float, number: int = CANDIDATES) -> FloatArray:
        """Draw places about `distance` metres to either side of a line, (N, 2)."""
        side = distance * self.rng.choice((-1, 1)) * self.rng.uniform(0.9, 1.2)
        points, _ = spaced(beside(line, side), 1.0)
        return points[self.rng.integers(len(points), size=number)]

    def add(self, model: Model, class_name: str, place: FloatArray, yaw: float = 0.0) -> None:
        """Set a model on the ground at `place` (2,), metres, turned by `yaw` radians."""
        self.scene.add(placed(model, self.ground.terrain.point(place), yaw), class_name)

    def stand(
        self,
        model: Model,
        class_name: str,
        radius: float,
        candidates: FloatArray | None = None,
        yaw: float | None = None,
    ) -> None:
        """Stand something where there is room for it, or nowhere."""
        where = self.anywhere() if candidates is None else candidates
        place = self.ground.claim(where, radius)
        if place is not None:
            self.add(model, class_name, place, self.yaw() if yaw is None else yaw)

    def vehicle(self, kind: VehicleKind | None = None) -> Model:
        """A vehicle of some kind; None draws one by weight."""
        name = choose(self.rng, self.structures.vehicle_kinds) if kind is None else kind
        return VEHICLES[name](self.rng, draw(self.rng, self.structures.vehicle_scale))

    def build(
        self, form: BuildingForm, candidates: FloatArray, yaw: float
    ) -> tuple[FloatArray, float] | None:
        """Level a pad and build on it, smaller where room is short.

        Returns:
            The middle (2,) and the radius of the circle around the building, metres; None where
            there is no room at all.
        """
        ground, house = self.ground, building(self.rng, form, largest=self.size / 3.5)
        inside = np.clip(candidates, 0.9 * house.radius, self.size - 0.9 * house.radius)
        room = float(ground.at(ground.clearance(PLANT), inside).max())
        if room < 0.95 * house.radius:
            house = building(self.rng, form, largest=1.4 * room)
            if house.length < 2 or room < 0.9 * house.radius:
                return None
        place = ground.claim(inside, 0.9 * house.radius, keep=0.0)
        if place is None:
            return None
        ground.level(place, 0.85 * house.radius)
        ground.reserve(self.footprint(house, place, yaw, 0.3), BUILT)
        self.add(house.model, "building", place, yaw)
        return place, house.radius

    def erect(self, house: Building, place: FloatArray, yaw: float) -> bool:
        """Set up a building where its whole plan is free, the ground as it is.

        It may reach beyond the site's edge, as long as its middle doesn't.

        Returns:
            Whether there was room.
        """
        if (place < MARGIN).any() or (place > self.size - MARGIN).any():
            return False
        covered = self.footprint(house, place, yaw, -0.2)
        if (self.ground.taken[covered] >= WAY).any():
            return False
        self.ground.reserve(self.footprint(house, place, yaw, 0.2), BUILT)
        self.add(house.model, "building", place, yaw)
        return True

    def footprint(
        self, house: Building, place: FloatArray, yaw: float, more: float
    ) -> NDArray[np.bool_]:
        """Cells under a building and `more` metres around it, (C, C)."""
        cos, sin = np.cos(yaw), np.sin(yaw)
        off = np.abs((self.ground.centers() - place) @ np.array([[cos, -sin], [sin, cos]]))
        covered = (off <= (house.length / 2 + more, house.width / 2 + more)).all(axis=1)
        return covered.reshape(self.ground.taken.shape)

    def enclose(self, line: FloatArray, kind: str, height: float) -> None:
        """Run a wall or fence along a line; where a way crosses, it stays open."""
        if length(line) < 2:
            return
        corners, _ = spaced(line, 2.0)
        model: Model = []
        stands = []
        for a, b in pairwise(corners):
            on = a + np.linspace(0, 1, 9)[:, None] * (b - a)
            outside = ((on < 0.2) | (on > self.size - 0.2)).any()
            if outside or (self.ground.at(self.ground.taken, on) >= WAY).any():
                continue
            model += BARRIERS[kind](self.ground.terrain, a, b, height)
            stands.append(on)
        if model:
            self.scene.add(merged(model), "man-made")
            feet = np.concatenate(stands)
            self.ground.take(feet, np.full(len(feet), 0.15), BUILT)

    def plant(self, plant: Plant, place: FloatArray, yaw: float | None = None) -> None:
        """Set a plant so that its lower parts follow the ground; where it fills is then taken."""
        turned = placed(plant.model, (*place, 0.0), self.yaw() if yaw is None else yaw)
        terrain = self.ground.terrain
        base = terrain.height(place[None])[0]
        for mesh, _ in turned:
            low = mesh.vertices[:, 2] < FOLLOWING
            below = mesh.vertices[low].astype(np.float64)
            rise = terrain.height(below[:, :2]) - base
            mesh.vertices[:, 2] += base
            mesh.vertices[low, 2] += rise * np.clip(1 - below[:, 2] / FOLLOWING, 0, 1)
        self.scene.add(turned, plant.class_name)
        self.ground.take(place[None], np.array([0.8 * low_reach(plant)]), PLANT)

    def tree_at(self, place: FloatArray) -> None:
        """Plant a tree at a place (2,), metres, unless that is taken."""
        self.tree_among(place[None])

    def tree_among(self, candidates: FloatArray) -> None:
        """Plant a tree at the first place with room for its stem, or at none.

        Crowns may touch and overlap as they do in stands; branches within reach of a walker
        keep off the ways.
        """
        tree = self.nursery.tree()
        inside = candidates[((candidates > 0.5) & (candidates < self.size - 0.5)).all(axis=1)]
        if not len(inside):
            return
        room = self.ground.at(self.ground.clearance(WAY, WAY), inside) - low_reach(tree)
        room = np.minimum(
            room, self.ground.at(self.ground.clearance(BUILT), inside) - 0.4 * tree.radius
        )
        others = np.array(self.trunks).reshape(-1, 3)
        apart = np.linalg.norm(inside[:, None] - others[:, :2], axis=2)
        apart -= 0.45 * (others[:, 2] + tree.radius)
        good = np.flatnonzero((room > 0) & (apart.min(axis=1, initial=np.inf) > 0))
        if not len(good):
            # A full stand takes a tree where there is most room left, if there is some.
            good = np.array([np.where(room > 0, apart.min(axis=1, initial=np.inf), -9).argmax()])
            if apart[good[0]].min(initial=np.inf) < -0.25 * tree.radius or room[good[0]] <= 0:
                return
        place = inside[good[0]]
        self.plant(tree, place)
        self.trunks.append((place[0], place[1], tree.radius))

    def hedgerow(self, line: FloatArray) -> None:
        """Grow a hedge along a line, with shrubs that stick out of it and trees in it."""
        self.hedge(line)
        for place in spaced(line, 4.0)[0]:
            aside = np.clip(place + self.rng.normal(0, 0.7, (1, 2)), 0.3, self.size - 0.3)
            if self.rng.random() < 0.35:
                self.shrub_among(aside)
            elif self.rng.random() < 0.12:
                self.tree_at(aside[0])

    def shrub_among(self, candidates: FloatArray, plant: Plant | None = None) -> None:
        """Plant a shrub, or what is given, at the first place that leaves ways and walls free."""
        plant = self.nursery.shrub() if plant is None else plant
        inside = candidates[((candidates > 0.3) & (candidates < self.size - 0.3)).all(axis=1)]
        if not len(inside):
            return
        ways = self.ground.at(self.ground.clearance(WAY, WAY), inside)
        built = self.ground.at(self.ground.clearance(BUILT), inside)
        good = (ways > 0.85 * low_reach(plant)) & (built > 0.25 * min(plant.radius, 3.0))
        if good.any():
            self.plant(plant, inside[int(good.argmax())])

    def hedge(self, line: FloatArray, height: float | None = None) -> None:
        """Grow a hedge along a line, in lengths of about 6 m; ways and walls interrupt it."""
        pieces = max(round(length(line) / 6), 1)
        for number in range(pieces):
            part = stretch(line, number / pieces, (number + 1) / pieces)
            a, b = part[0], part[-1]
            middle, long = (a + b) / 2, float(np.linalg.norm(b - a))
            if long < 1 or self.ground.at(self.ground.clearance(WAY), part).min() < 0.6:
                continue
            plant = self.nursery.hedge(1.04 * long, height)
            self.plant(plant, middle, float(np.arctan2(*(b - a)[::-1])))


def merged(model: Model) -> Model:
    """Surfaces of the same material made one."""
    materials = list(dict.fromkeys(material for _, material in model))
    return [
        Surface(join([mesh for mesh, of in model if of == material]), material)
        for material in materials
    ]


def low_reach(plant: Plant) -> float:
    """How far a plant reaches sideways below 2.2 m, metres."""
    reach = 0.0
    for mesh, _ in plant.model:
        some = mesh.vertices[::5]
        low = some[some[:, 2] < 2.2, :2]
        if len(low):
            reach = max(reach, float(np.quantile(np.hypot(*low.T), 0.98)))
    return reach
