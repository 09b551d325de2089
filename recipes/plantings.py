"""Real bushes, hedges and trees, many to a ground: what single objects on a flat one can't teach.

Each planting is a made-up ground with slopes and humps. On it stand objects that may teach, drawn
so that bushes and hedges are as frequent as trees, turned, mirrored and cut to a square where they
are long. Surveys see trees from above: a crown's lowest return hangs some way up, so trees are set
down a little above the ground.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from judging import Scan, read_scan
from numpy.typing import NDArray
from objects import ROUGHNESS, SPACING
from real_scans import training_scans

from bushseg.points import PointCloud

SIZE = 60.0
"""Edge of a planting, metres."""

NUM_OBJECTS = 40
"""Objects that are tried to find a place for."""

PIECE = 14.0
"""What is longer is cut to a square of this edge, metres."""

MOST_LIFT = 1.5
"""Metres between the ground and a crown's lowest return, at most."""

BUSHES, TREES = (13, 15), (10, 11, 12)
"""The survey's codes: hedgerow, bush; tree group, tree line, tree."""

GROUND = -1


class _Object(NamedTuple):
    """A real object about its own foot: positions, intensities and its code."""

    xyz: NDArray[np.float64]
    intensity: NDArray[np.generic]
    code: int


def plantings(data: Path, count: int, seed: int) -> list[Scan]:
    """Make some.

    Args:
        data: The folder of real scans.
        count: How many.
        seed: Of everything drawn.

    Returns:
        Scans whose codes are the survey's, :data:`GROUND` for the made-up ground.
    """
    scans = [read_scan(path) for path in training_scans(data) if path.parent.name == "vle"]
    known = [scan for scan in scans if int(scan.codes[0]) in BUSHES + TREES]
    groups = [[scan for scan in known if int(scan.codes[0]) in codes] for codes in (BUSHES, TREES)]
    groups = [group for group in groups if group]
    rng = np.random.default_rng(seed)
    return [_planting(groups, Path(f"planting_{number:02d}"), rng) for number in range(count)]


def _planting(groups: Sequence[Sequence[Scan]], path: Path, rng: np.random.Generator) -> Scan:
    """One planting."""
    heights = _Relief(rng)
    placed: list[tuple[NDArray[np.float64], float]] = []
    parts: list[_Object] = []
    for _ in range(NUM_OBJECTS):
        group = groups[rng.integers(len(groups))]
        it = _drawn(group[rng.integers(len(group))], rng)
        reach = float(np.linalg.norm(it.xyz[:, :2], axis=1).max())
        foot = rng.uniform(0, SIZE, 2)
        if any(np.linalg.norm(foot - other) < reach + its for other, its in placed):
            continue
        placed.append((foot, reach))
        lift = rng.uniform(0, MOST_LIFT) if it.code in TREES else 0.0
        base = np.array([*foot, heights.at(foot[None])[0] + lift])
        parts.append(it._replace(xyz=it.xyz + base))
    steps = np.arange(0, SIZE, SPACING)
    xy = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    xy += rng.uniform(-0.5, 0.5, xy.shape) * SPACING
    z = heights.at(xy) + ROUGHNESS * rng.standard_normal(len(xy))
    own = np.concatenate([part.intensity for part in parts])
    cloud = PointCloud(
        np.concatenate([*(part.xyz for part in parts), np.column_stack([xy, z])]),
        {"intensity": np.concatenate([own, rng.choice(own, len(xy))])},
    )
    codes = np.concatenate(
        [*(np.full(len(part.xyz), part.code) for part in parts), np.full(len(xy), GROUND)]
    )
    return Scan(path, cloud, codes, None, None)


def _drawn(scan: Scan, rng: np.random.Generator) -> _Object:
    """An object, or a piece of it, turned and mirrored, its foot at the origin."""
    xyz = scan.cloud.xyz
    center = xyz[rng.integers(len(xyz)), :2]
    if (np.ptp(xyz[:, :2], axis=0) <= PIECE).all():
        center = (xyz[:, :2].min(axis=0) + xyz[:, :2].max(axis=0)) / 2
    near = (np.abs(xyz[:, :2] - center) <= PIECE / 2).all(axis=1)
    local = xyz[near] - [*center, xyz[near, 2].min()]
    angle = rng.uniform(0, 2 * np.pi)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    local[:, :2] = local[:, :2] @ turn * [rng.choice([-1, 1]), 1]
    return _Object(local, scan.cloud.attributes["intensity"][near], int(scan.codes[0]))


class _Relief:
    """A slope and some humps."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._slope = rng.normal(0, 0.06, 2)
        self._waves = rng.normal(0, 1, (6, 2)) * 2 * np.pi / 25
        self._phases = rng.uniform(0, 2 * np.pi, 6)
        self._amplitudes = rng.uniform(0, 0.25, 6)

    def at(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Heights of some places, shape (N, 2), metres, shape (N,)."""
        humps = np.sin(xy @ self._waves.T + self._phases) @ self._amplitudes
        level: NDArray[np.float64] = xy @ self._slope + humps
        return level
