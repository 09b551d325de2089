"""A site's ground while it is being laid out: its shape, its cover and what is taken."""

from dataclasses import dataclass, field
from typing import Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter

from bushseg.points import FloatArray
from bushseg.simulation.materials import Material
from bushseg.simulation.mesh import Mesh, Model, Surface
from bushseg.simulation.places.lines import nearest
from bushseg.simulation.terrain import Terrain

MARGIN = 1.0
"""Things keep this much from the site's edge, metres."""

FREE, PLANT, WAY, BUILT = range(4)
"""What a cell of the ground holds: nothing, a plant's foot, a way to be kept free, a thing."""

Value = TypeVar("Value", bound=np.generic)


@dataclass(slots=True)
class Ground:
    """A terrain that is still worked on, and a map of what it holds, cell by cell.

    Attributes:
        terrain: Its heights are changed in place.
        size: Edge of the site, metres.
        cover: Materials by the number in `covered`.
        covered: What a cell is covered with, shape (C, C), uint8.
        taken: `FREE`, `PLANT`, `WAY` or `BUILT`, shape (C, C), uint8.
    """

    terrain: Terrain
    size: float
    cover: list[Material]
    covered: NDArray[np.uint8] = field(init=False)
    taken: NDArray[np.uint8] = field(init=False)
    _rooms: dict[tuple[int, int], FloatArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        side = len(self.terrain.heights) - 1
        self.covered = np.zeros((side, side), np.uint8)
        self.taken = np.zeros((side, side), np.uint8)

    @classmethod
    def of(cls, terrain: Terrain, size: float, material: Material) -> Self:
        """Begin with one material everywhere and nothing taken."""
        return cls(terrain, size, [material])

    @property
    def cell(self) -> float:
        """Grid spacing, metres."""
        return self.terrain.cell

    def centers(self) -> FloatArray:
        """Middles of all cells, metres, shape (C * C, 2)."""
        at = (np.arange(len(self.taken)) + 0.5) * self.cell
        return np.stack(np.meshgrid(at, at, indexing="ij"), axis=-1).reshape(-1, 2)

    def corners(self) -> FloatArray:
        """Corners of all cells, where heights are known, metres, shape (M * M, 2)."""
        at = np.arange(len(self.terrain.heights)) * self.cell
        return np.stack(np.meshgrid(at, at, indexing="ij"), axis=-1).reshape(-1, 2)

    def at(self, values: NDArray[Value], xy: FloatArray) -> NDArray[Value]:
        """A map's values (C, C) at places (N, 2); beyond the edge the nearest cell's."""
        i, j = np.clip((xy / self.cell).astype(np.intp), 0, len(values) - 1).T
        return values[i, j]

    def within(self, line: FloatArray, half: float) -> NDArray[np.bool_]:
        """Cells at most `half` metres from a line (P, 2), shape (C, C)."""
        distance, _, _ = nearest(line, self.centers())
        return (np.abs(distance) <= half).reshape(self.taken.shape)

    def lay(self, cells: NDArray[np.bool_], material: Material) -> None:
        """Cover cells (C, C) with a material."""
        if material not in self.cover:
            self.cover.append(material)
        self.covered[cells] = self.cover.index(material)

    def clear(self, line: FloatArray, half: float) -> None:
        """Keep a way `half` metres to both sides of a line (P, 2) free."""
        self.reserve(self.within(line, half), WAY)

    def reserve(self, cells: NDArray[np.bool_], what: int) -> None:
        """Mark cells (C, C) as holding `what`, or more where they already do."""
        np.maximum(self.taken, np.where(cells, what, FREE), out=self.taken, casting="unsafe")
        self._forget(what)

    def _forget(self, what: int) -> None:
        """Drop the clearances that something new of kind `what` changes."""
        self._rooms = {key: room for key, room in self._rooms.items() if what < key[0]}

    def clearance(self, least: int = WAY, most: int = BUILT) -> FloatArray:
        """How far each cell is from what holds `least` to `most`, metres, shape (C, C)."""
        key = (least, most)
        if key not in self._rooms:
            free = (self.taken < least) | (self.taken > most)
            self._rooms[key] = (
                np.full(free.shape, self.size)
                if free.all()
                else distance_transform_edt(free) * self.cell
            )
        return self._rooms[key]

    def claim(
        self, candidates: FloatArray, radius: float, least: int = PLANT, keep: float | None = None
    ) -> FloatArray | None:
        """Take the first place that has room, or the one with most room if that is about half.

        Args:
            candidates: Places to try, metres, shape (N, 2).
            radius: Room wanted, metres.
            least: What counts as being in the way, and all above it.
            keep: Room then taken, metres; None: as much as was wanted.

        Returns:
            The place, (2,), metres; None where there is no room.
        """
        edge = min(max(MARGIN, radius), 0.4 * self.size)
        inside = np.clip(candidates, edge, self.size - edge)
        room = self.at(self.clearance(least), inside)
        roomy = np.flatnonzero(room >= radius)
        if room.max() < 0.5 * radius:
            return None
        place: FloatArray = inside[roomy[0] if len(roomy) else int(room.argmax())]
        self.take(place[None], np.array([radius if keep is None else keep]), BUILT)
        return place

    def take(self, xy: FloatArray, radii: FloatArray, what: int) -> None:
        """Mark discs around places (N, 2) with `radii` (N,), metres, as holding `what`."""
        for (x, y), radius in zip(xy, radii, strict=True):
            low = np.maximum((np.array((x - radius, y - radius)) / self.cell).astype(int), 0)
            high = (np.array((x + radius, y + radius)) / self.cell).astype(int) + 1
            at = [(np.arange(a, b) + 0.5) * self.cell for a, b in zip(low, high, strict=True)]
            part = self.taken[low[0] : high[0], low[1] : high[1]]
            if not part.size:
                continue
            inside = np.hypot((at[0] - x)[:, None], at[1] - y)[: part.shape[0], : part.shape[1]]
            part[(inside <= max(radius, 0.7 * self.cell)) & (part < what)] = what
        self._forget(what)

    # Earthworks: before anything is set on the ground.

    def grade(self, line: FloatArray, half: float, shoulder: float, lift: float = 0.0) -> None:
        """Level the ground across a way and smooth it along, `lift` metres above what was there.

        Beyond `half` metres from the line it runs out into the ground as it was over `shoulder`
        metres: a cutting or an embankment where the ground is steep.
        """
        distance, on, _ = nearest(line, self.corners())
        heights = self.terrain.heights
        smooth = Terrain(gaussian_filter(heights, 3.0 / self.cell, mode="nearest"), self.cell)
        way = smooth.height(on) + lift
        share = np.clip((np.abs(distance) - half) / shoulder, 0, 1)
        share = share**2 * (3 - 2 * share)
        flat = heights.ravel()
        rough = 0.004 * np.sin(37.0 * self.corners().sum(axis=1))
        heights[:] = (share * flat + (1 - share) * (way + rough)).reshape(heights.shape)

    def trench(self, line: FloatArray, half: float, depth: float) -> None:
        """Cut a ditch or a rut of rounded section, `depth` metres, `half` to each side."""
        distance, _, _ = nearest(line, self.corners())
        section = np.clip(1 - np.abs(distance) / half, 0, 1)
        cut = depth * section * (2 - section)
        self.terrain.heights[:] -= cut.reshape(self.terrain.heights.shape)

    def bank(self, line: FloatArray, half: float, height: float) -> None:
        """Raise a bank of `height` metres, as hedges and terraces stand on."""
        distance, _, _ = nearest(line, self.corners())
        section = np.exp(-2 * (distance / half) ** 2)
        self.terrain.heights[:] += height * section.reshape(self.terrain.heights.shape)

    def level(self, center: FloatArray, radius: float, shoulder: float = 3.0) -> None:
        """Make a level pad of `radius` metres around `center` (2,), for a building."""
        out = np.linalg.norm(self.corners() - center, axis=1).reshape(self.terrain.heights.shape)
        share = np.clip((out - radius) / shoulder, 0, 1)
        share = share**2 * (3 - 2 * share)
        pad = self.terrain.height(center[None])[0]
        self.terrain.heights[:] = share * self.terrain.heights + (1 - share) * pad

    def puddle(self, center: FloatArray, radii: FloatArray, yaw: float, water: Material) -> None:
        """Fill a hollow of `radii` (2,), metres, with water: level, and dark to the laser."""
        cos, sin = np.cos(yaw), np.sin(yaw)
        turn = np.array([[cos, -sin], [sin, cos]])
        out = np.linalg.norm((self.corners() - center) @ turn / radii, axis=1)
        out = out.reshape(self.terrain.heights.shape)
        inside = out <= 1
        if not inside.any():
            return
        surface = np.percentile(self.terrain.heights[inside], 20)
        self.terrain.heights[inside] = surface
        wet = inside[:-1, :-1] & inside[1:, :-1] & inside[:-1, 1:] & inside[1:, 1:]
        self.lay(wet, water)
        self.reserve(wet, WAY)

    def surfaces(self) -> Model:
        """The whole ground by material, each triangle once."""
        mesh = self.terrain.mesh()
        kind = self.covered.ravel().repeat(2)
        return [
            Surface(Mesh(mesh.vertices, mesh.triangles[kind == number]), material)
            for number, material in enumerate(self.cover)
            if np.any(kind == number)
        ]
