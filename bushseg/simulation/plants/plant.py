"""A plant, and a pool of plants for sites that hold hundreds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bushseg.simulation.mesh import Model, Surface, instances


@dataclass(frozen=True, slots=True)
class Plant:
    """One plant, standing on z = 0 at the origin; stems reach a little below.

    Attributes:
        model: Its surfaces, metres.
        class_name: A key of `CLASS_CODES`.
        radius: How far it reaches sideways, metres.
        height: Its top, metres.
    """

    model: Model
    class_name: str
    radius: float
    height: float

    @classmethod
    def of(cls, model: Model, class_name: str) -> Plant:
        """Measure a model; surfaces of no triangle are left out."""
        kept = [surface for surface in model if len(surface.mesh.triangles)]
        radius = max(float(np.hypot(*m.vertices[:, :2].T).max()) for m, _ in kept)
        return cls(kept, class_name, radius, max(float(m.vertices[:, 2].max()) for m, _ in kept))

    def scaled(self, factors: tuple[float, float, float]) -> Plant:
        """Stretch the plant along x, y and z; a negative factor mirrors it."""
        origin, scales = np.zeros((1, 3)), np.array([factors])
        model = [Surface(instances(mesh, origin, None, scales), of) for mesh, of in self.model]
        wide = max(abs(factors[0]), abs(factors[1]))
        return Plant(model, self.class_name, wide * self.radius, factors[2] * self.height)


class Pool:
    """Plants grown once and handed out again and again, each time mirrored and stretched."""

    def __init__(self, grow: Callable[[], Plant], size: int) -> None:
        """Take plants from `grow` until there are `size`."""
        self._grow, self._size = grow, size
        self._plants: list[Plant] = []

    def take(self, rng: np.random.Generator) -> Plant:
        """Hand out a plant: a new one as long as the pool isn't full."""
        if len(self._plants) < self._size:
            self._plants.append(self._grow())
            return self._plants[-1]
        plant = self._plants[rng.integers(self._size)]
        wide, high = rng.uniform(0.85, 1.15, 2)
        skew = rng.uniform(0.9, 1.1)
        return plant.scaled((wide * skew * rng.choice((-1, 1)), wide / skew, high))
