"""Point clouds from a drone's pictures, as multi-view stereo makes them.

Each direction of view gives a depth map of what is seen first; matching smooths it (`depth_maps`),
and the maps are put together and thinned to an even spacing. So nothing lies below crowns, plants
are humps of one closed surface, and what is thin is missing. Cameras are taken to be so far off
that a direction of view is the same all over the site.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from bushseg.points import FloatArray
from bushseg.simulation.scene import CLASS_CODES
from bushseg.simulation.sensors.config import SensorConfig
from bushseg.simulation.sensors.daylight import Daylight
from bushseg.simulation.sensors.depth_maps import matched
from bushseg.simulation.sensors.figures import Figures
from bushseg.simulation.sensors.scanner import Returns
from bushseg.simulation.sensors.target import Target
from bushseg.simulation.site import Site
from bushseg.simulation.terrain import waves

PIXEL = 0.8
"""Edge of a depth map's pixels, as a share of the spacing of points."""

WIDEST = 9
"""A matching window has at most so many pixels; 3 at least."""

ROWS = 1_000_000
"""About so many rays are cast at once."""

LAYERS = 0.5
"""Views add nothing less than about so far above or below what others before them gave, metres."""

EXPOSED = 100.0
"""Brightness that cameras strive for on average, of 255."""

WHITE = 0.3
"""Noise from pixel to pixel, as a share of the noise from window to window."""


@dataclass(frozen=True, slots=True)
class Seen:
    """N points, and the things they were matched on.

    Attributes:
        xyz: Where they are thought to be, metres, shape (N, 3), float64.
        place: Where the thing seen is, metres, shape (N, 3), float32.
        normal: Its normal, shape (N, 3), float32.
        part: Its part of the scene, shape (N,), int32.
    """

    xyz: FloatArray
    place: NDArray[np.float32]
    normal: NDArray[np.float32]
    part: NDArray[np.int32]

    def take(self, kept: NDArray[np.intp] | NDArray[np.bool_]) -> "Seen":
        """Some of them."""
        return Seen(*(getattr(self, field.name)[kept] for field in fields(Seen)))


def reconstruct(
    of_views: np.random.Generator, rng: np.random.Generator, site: Site, config: SensorConfig
) -> Iterator[Returns]:
    """See a site from all sides of above, and make one cloud of it.

    Args:
        of_views: Draws where pictures are taken from.
        rng: Source of all noise; the same states give the same points.
        site: What is seen.
        config: The camera.

    Yields:
        The points, one return a ray, without intensity.
    """
    figures = config.figures
    target = Target(site.scene)
    light = Daylight.draw(rng, figures.visibility, shadows=config.shadows)
    spacing = figures.point_spacing
    views: list[Seen] = []
    taken = np.zeros(0, np.int64)
    for direction in view_directions(of_views, figures):
        view = thinned(_view(rng, target, site, direction, figures), spacing)
        # Of what several pictures show, software keeps one surface.
        view = view.take(~np.isin(_voxels(view.xyz, spacing, LAYERS), taken))
        views.append(view)
        layers = _voxels(view.xyz, spacing, LAYERS)
        taken = np.concatenate([taken, layers - 1, layers, layers + 1])
    seen = Seen(*(np.concatenate([getattr(v, f.name) for v in views]) for f in fields(Seen)))
    # Where a level surface lies between two layers of voxels, both have a point of it.
    seen = thinned(seen, spacing, raised=spacing / 2)
    yield _returns(rng, target, light, seen.take(_textured(rng, target, seen, figures)), config)


def view_directions(rng: np.random.Generator, figures: Figures) -> FloatArray:
    """Unit vectors (V, 3): straight down, and from all around, tilted up to `scan_angle`."""
    around = rng.uniform(0, 2 * np.pi) + np.arange(figures.views - 1) * 2.399963  # golden angle
    tilts = np.radians(figures.scan_angle) * rng.uniform(0.5, 1, figures.views - 1)
    out = np.concatenate([[0.0], np.sin(tilts)])
    around = np.concatenate([[0.0], around])
    return np.stack([np.cos(around) * out, np.sin(around) * out, -np.sqrt(1 - out**2)], axis=1)


def thinned(seen: Seen, spacing: float, raised: float = 0.0) -> Seen:
    """One point a voxel: the mean, which is what the nearest to it is.

    Args:
        seen: Points.
        spacing: Edge of a voxel, metres.
        raised: How high the lattice of voxels lies, metres.
    """
    if not len(seen.xyz):
        return seen
    code = _voxels(seen.xyz - [0, 0, raised], spacing, spacing)
    order = np.argsort(code, kind="stable")
    starts = np.flatnonzero(np.diff(code[order], prepend=-1))
    lengths = np.diff(np.append(starts, len(order)))
    mean = np.add.reduceat(seen.xyz[order], starts) / lengths[:, None]
    off = np.sum((seen.xyz[order] - np.repeat(mean, lengths, axis=0)) ** 2, axis=1)
    best = np.flatnonzero(off == np.repeat(np.minimum.reduceat(off, starts), lengths))
    voxel = np.repeat(np.arange(len(starts)), lengths)[best]
    first = best[np.flatnonzero(np.diff(voxel, prepend=-1))]
    kept = seen.take(order[first])
    return Seen(mean, kept.place, kept.normal, kept.part)


def _voxels(xyz: FloatArray, edge: float, height: float) -> NDArray[np.int64]:
    """A number for the voxel of each point, (N,); it grows by 1 a voxel upwards."""
    keys: NDArray[np.int64] = np.floor(xyz / [edge, edge, height]).astype(np.int64) + (1 << 20)
    return (keys[:, 0] << 42) + (keys[:, 1] << 21) + keys[:, 2]


def _view(
    rng: np.random.Generator,
    target: Target,
    site: Site,
    direction: FloatArray,
    figures: Figures,
) -> Seen:
    """What is made of the site by pictures taken in one direction."""
    ground = site.terrain.heights
    size = (len(ground) - 1) * site.terrain.cell
    side = round(size / (PIXEL * figures.point_spacing))
    pixel = size / side
    at = (np.arange(side) + rng.uniform(0, 1)) * pixel
    # Rays start on a level plane above all, from where they fall on their place on the ground.
    level, top = float(ground.mean()), target.top
    shift = direction * (top - level) / direction[2]
    origins = np.stack(
        [*np.meshgrid(at + shift[0], at + shift[1], indexing="ij"), np.full((side, side), top)],
        axis=-1,
    ).reshape(-1, 3)
    depths, part, normal = _cast(target, origins, direction)

    window = 2 * round((figures.matching_window / pixel - 1) / 2) + 1
    window = min(max(window, 3), WIDEST)
    found, could, source = matched(depths.reshape(side, side), window, pixel)
    noise = gaussian_filter(rng.standard_normal((side, side)), window / 2).ravel()
    noise = noise / noise.std() + WHITE * rng.standard_normal(side * side)
    noise = figures.range_noise * noise + figures.registration_noise * rng.standard_normal()
    kept = np.flatnonzero(could.ravel() & (rng.random(side * side) >= figures.dropout))
    struck = source.ravel()[kept]
    # A point lies anywhere in its pixel, on the plane through it: seen askew, walls would have
    # points in rows otherwise.
    off = rng.uniform(-pixel / 2, pixel / 2, (2, len(kept)))
    across, along = (slope.ravel()[kept] for slope in np.gradient(found, pixel))
    reach = (found.ravel() + noise)[kept] + across * off[0] + along * off[1]
    xyz = origins[kept] + reach[:, None] * direction
    xyz[:, :2] += off.T
    inside = ((xyz[:, :2] >= 0) & (xyz[:, :2] <= size)).all(axis=1)
    place = (origins[struck] + depths[struck, None] * direction).astype(np.float32)
    return Seen(xyz, place, normal[struck], part[struck]).take(inside)


def _cast(
    target: Target, origins: FloatArray, direction: FloatArray
) -> tuple[NDArray[np.float32], NDArray[np.int32], NDArray[np.float32]]:
    """What rays from M origins strike: depths in metres or inf, parts, normals (M, 3)."""
    depths = np.empty(len(origins), np.float32)
    part = np.empty(len(origins), np.int32)
    normal = np.empty((len(origins), 3), np.float32)
    for start in range(0, len(origins), ROWS):
        some = slice(start, start + ROWS)
        aims = np.broadcast_to(direction, origins[some].shape)
        depths[some], part[some], normal[some] = target.cast(origins[some], aims)
    return depths, part, normal


def _textured(
    rng: np.random.Generator, target: Target, seen: Seen, figures: Figures
) -> NDArray[np.bool_]:
    """Which points are not on ground so uniform that nothing can be matched, (N,)."""
    kept = np.ones(len(seen.xyz), dtype=bool)
    if figures.untextured:
        ground = np.flatnonzero(target.class_code[seen.part] == CLASS_CODES["ground"])
        patches = waves(rng, seen.xyz[ground, :2], shortest=1.0, longest=6.0)
        if len(ground):
            kept[ground] = patches <= np.quantile(patches, 1 - figures.untextured)
    return kept


def _returns(
    rng: np.random.Generator, target: Target, light: Daylight, seen: Seen, config: SensorConfig
) -> Returns:
    """The points as they are written."""
    figures, number = config.figures, len(seen.xyz)
    color = np.zeros((number, 3))
    if config.color:
        color = light.colors(
            target.caster,
            target.color[seen.part],
            seen.place.astype(np.float64),
            seen.normal.astype(np.float64),
            np.full(number, figures.flight_height),
            station=1,
        )
        color *= EXPOSED * np.exp(0.1 * rng.standard_normal()) / color.mean()
        color += figures.color_noise * rng.standard_normal((number, 1))
    ones = np.ones(number, np.uint8)
    return Returns(
        xyz=seen.xyz,
        class_code=target.class_code[seen.part],
        instance=target.instance[seen.part],
        intensity=np.zeros(number, np.uint16),
        color=np.clip(np.rint(color), 0, 255).astype(np.uint8),
        time=np.zeros(number),
        return_number=ones,
        num_returns=ones,
        station=1,
        ray=np.arange(number),
        num_rays=number,
    )
