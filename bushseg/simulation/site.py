"""A site: what a place holds, and where a sensor may stand or move in it."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from bushseg.points import FloatArray
from bushseg.simulation.config import SimulateConfig
from bushseg.simulation.materials import LAWN, SOIL
from bushseg.simulation.places.builder import Builder
from bushseg.simulation.places.config import PlaceName
from bushseg.simulation.places.farmland import fields, orchard, park
from bushseg.simulation.places.furnish import furnish, grow_layer
from bushseg.simulation.places.ground import BUILT, PLANT, Ground
from bushseg.simulation.places.nursery import Nursery
from bushseg.simulation.places.settlement import garden, village, yard
from bushseg.simulation.places.street import street
from bushseg.simulation.places.ways import road, trail
from bushseg.simulation.places.woods import forest, forest_edge, heath
from bushseg.simulation.scene import Scene
from bushseg.simulation.terrain import Terrain, make_terrain, waves

LAYOUTS: dict[PlaceName, Callable[[Builder], None]] = {
    "garden": garden,
    "orchard": orchard,
    "fields": fields,
    "park": park,
    "road": road,
    "street": street,
    "forest_edge": forest_edge,
    "forest": forest,
    "heath": heath,
    "village": village,
    "trail": trail,
    "yard": yard,
}

STANDING_ROOM = 1.2
"""Stations keep this much from plants and things where they can, metres."""


@dataclass(frozen=True, slots=True)
class Site:
    """A scene and where a sensor may be in it.

    Attributes:
        scene: All that rays can strike.
        terrain: The ground.
        stations: Places for a tripod on free ground, metres, shape (S, 3), float64.
        path: What a walker or vehicle follows, metres, shape (P, 2), float64.
        place: What kind of place it is.
    """

    scene: Scene
    terrain: Terrain
    stations: FloatArray
    path: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    place: PlaceName = "garden"

    def __post_init__(self) -> None:
        """Without a path, go from station to station."""
        if not len(self.path):
            object.__setattr__(self, "path", self.stations[:, :2])


def make_site(rng: np.random.Generator, config: SimulateConfig) -> Site:
    """Draw a site of `config.size` metres with its corner at the origin.

    What stands on it doesn't depend on the sensor, and its first stations not on their number.
    """
    place = config.places.choose(rng) if config.place == "mixed" else config.place
    amounts = getattr(config.places, place).drawn(rng)
    for name in ("slope", "relief"):
        limits = getattr(config.terrain, name)
        amounts[name] = amounts[name] if limits is None else float(rng.uniform(*limits))
    terrain = make_terrain(
        rng,
        config.terrain,
        config.size,
        slope=amounts["slope"],
        relief=amounts["relief"],
        roughness=amounts["roughness"],
    )
    ground = Ground.of(terrain, config.size, LAWN)
    patches = waves(rng, ground.centers(), shortest=3, longest=15)
    ground.lay((patches > 0.9).reshape(ground.taken.shape), SOIL)
    nursery = Nursery(rng, config.plants, amounts, config.size, fruit=place == "orchard")
    builder = Builder(rng, config.size, amounts, ground, nursery, config.structures)
    LAYOUTS[place](builder)
    furnish(builder)
    grow_layer(builder)
    builder.scene.add(ground.surfaces(), "ground", instance=False)
    stations = _stations(rng, ground, config.sensor.stations)
    feet = np.column_stack([stations, terrain.height(stations)])
    return Site(builder.scene, terrain, feet, builder.path, place)


def _stations(rng: np.random.Generator, ground: Ground, number: int) -> FloatArray:
    """Choose places (S, 2) on free ground, each far from those before it."""
    room = np.minimum(ground.clearance(PLANT, PLANT), ground.clearance(BUILT)).ravel()
    places = ground.centers()
    inner = (np.abs(places / ground.size - 0.5) < 0.38).all(axis=1)
    free = inner & (room >= STANDING_ROOM)
    candidates = places[free] if free.any() else places[[int((room * inner).argmax())]]
    liking = rng.uniform(0.6, 1, len(candidates))
    distance = np.linalg.norm(candidates - ground.size / 2, axis=1)
    chosen = [candidates[int((liking * (ground.size - distance)).argmax())]]
    while len(chosen) < number:
        distance = np.linalg.norm(candidates[:, None] - np.array(chosen), axis=2).min(axis=1)
        chosen.append(candidates[int((liking * distance).argmax())])
    return np.array(chosen)
