"""What one would try before a network: a band of heights, and a random forest on shape features.

Both are fitted on the voxels of labelled scans and label as a network does: voxels first, then
every point by its voxel.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from judging import BUSH, BUSH_LABEL, NAMES, Scan
from numpy.typing import NDArray
from shape_features import feature_names, metres_above_ground, voxel_features
from sklearn.ensemble import RandomForestClassifier

import bushseg
from bushseg.errors import DataError
from bushseg.io.memory import MemoryReader
from bushseg.scan import VoxelScan, mask_no_returns, read_voxels

HEIGHT_STEP = 0.05
HIGHEST = 15.0
_GROUND, _LOW, _TREE = (NAMES.index(name) for name in ("ground", "low_vegetation", "tree"))


def read_training(path: Path, voxel_size: float) -> VoxelScan:
    """A labelled scan's voxels."""
    with bushseg.open_scan(path) as reader:
        return read_voxels(reader, voxel_size, BUSH)


def at_points(
    scan: Scan, voxels: VoxelScan, reader: MemoryReader, found: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Give voxels' probabilities (M, 7) to their points, (N, 7); zeros for a point without one."""
    keys = voxels.voxels.grid.keys(mask_no_returns(scan.cloud.xyz, reader))
    padded = np.concatenate([found, np.zeros((1, found.shape[1]), np.float32)])
    return padded[voxels.voxels.find(keys)]


@dataclass(frozen=True)
class HeightBand:
    """Bush is whatever stands between two heights; below is grass and ground, above are trees.

    Attributes:
        edges: Where grass, bush and tree begin, metres above the local ground.
        voxel_size: Metres.
        name: How tables call it.
    """

    edges: tuple[float, float, float]
    voxel_size: float
    name: str = "height band"

    @classmethod
    def fit(cls, scans: Sequence[VoxelScan], voxel_size: float) -> "HeightBand":
        """Take the band with the best bush IoU, and below it the best cut of grass from ground."""
        heights = np.concatenate([metres_above_ground(scan) for scan in scans])
        labels = np.concatenate([_labels(scan) for scan in scans])
        low, high = best_band(heights[labels >= 0], labels[labels >= 0] == BUSH_LABEL)
        below = (labels == _GROUND) | (labels == _LOW)
        cut = best_cut(heights[below], labels[below] == _LOW)
        return cls((min(cut, low), low, high), voxel_size)

    def label(self, scan: Scan) -> NDArray[np.float32]:
        """As :class:`judging.Labeler`; it is always sure."""
        reader = MemoryReader(scan.cloud, scan.sensor)
        voxels = read_voxels(reader, self.voxel_size)
        band = np.digitize(metres_above_ground(voxels), self.edges)
        classes = np.array([_GROUND, _LOW, BUSH_LABEL, _TREE])[band]
        return at_points(scan, voxels, reader, np.eye(len(NAMES), dtype=np.float32)[classes])


class Forest:
    """A random forest on eigenvalue features, density and height.

    Args:
        scans: What it learns from.
        voxel_size: Metres.
        intensity: Whether it is told the intensity.
        per_class: Voxels of each class it learns from, at most, drawn evenly from the scans.
        num_trees: Its trees.
        seed: Of the draw and the trees.
    """

    def __init__(
        self,
        scans: Sequence[VoxelScan],
        voxel_size: float,
        *,
        intensity: bool = False,
        per_class: int = 20_000,
        num_trees: int = 100,
        seed: int = 0,
    ) -> None:
        self.name = "random forest" + " with intensity" * intensity
        self.voxel_size, self.intensity = voxel_size, intensity
        rng = np.random.default_rng(seed)
        share = -(-per_class // len(scans))
        features, labels = [], []
        for scan in scans:
            own = _labels(scan)
            chosen = np.concatenate(
                [_draw(rng, np.flatnonzero(own == label), share) for label in range(len(NAMES))]
            )
            features.append(voxel_features(scan, intensity=intensity, chosen=chosen))
            labels.append(own[chosen])
        self.classifier = RandomForestClassifier(
            num_trees, min_samples_leaf=5, max_features="sqrt", n_jobs=-1, random_state=seed
        )
        self.classifier.fit(np.concatenate(features), np.concatenate(labels))

    def label(self, scan: Scan) -> NDArray[np.float32]:
        """As :class:`judging.Labeler`."""
        reader = MemoryReader(scan.cloud, scan.sensor)
        voxels = read_voxels(reader, self.voxel_size)
        found = np.zeros((len(voxels.voxels), len(NAMES)), np.float32)
        features = voxel_features(voxels, intensity=self.intensity)
        found[:, self.classifier.classes_] = self.classifier.predict_proba(features)
        return at_points(scan, voxels, reader, found)

    def importances(self) -> list[tuple[str, float]]:
        """Its features, the most telling first, with their share of the splits' worth."""
        names = feature_names() + ["intensity"] * self.intensity
        pairs = zip(names, self.classifier.feature_importances_.tolist(), strict=True)
        return sorted(pairs, key=lambda pair: -pair[1])


def best_band(heights: NDArray[np.float32], is_bush: NDArray[np.bool_]) -> tuple[float, float]:
    """The interval of heights with the best bush IoU, on a lattice of 5 cm up to 15 m.

    Args:
        heights: Metres, (N,) float32.
        is_bush: (N,) bool.
    """
    edges = np.arange(0, HIGHEST + HEIGHT_STEP / 2, HEIGHT_STEP)
    # Cumulated counts: what lies below each edge.
    bush, every = (
        np.searchsorted(np.sort(values), edges).astype(np.float64)
        for values in (heights[is_bush], heights)
    )
    hits = bush[None, :] - bush[:, None]
    inside = every[None, :] - every[:, None]
    union = np.count_nonzero(is_bush) + inside - hits
    iou = np.divide(hits, union, out=np.zeros_like(hits), where=union > 0)
    low, high = np.unravel_index(np.argmax(np.triu(iou, 1)), iou.shape)
    return float(edges[low]), float(edges[high])


def best_cut(heights: NDArray[np.float32], is_above: NDArray[np.bool_]) -> float:
    """The height that parts two classes with the fewest errors, on a lattice of 5 cm."""
    edges = np.arange(0, HIGHEST + HEIGHT_STEP / 2, HEIGHT_STEP)
    above, below = (
        np.searchsorted(np.sort(values), edges)
        for values in (heights[is_above], heights[~is_above])
    )
    return float(edges[int(np.argmin(above + (np.count_nonzero(~is_above) - below)))])


def _labels(scan: VoxelScan) -> NDArray[np.int16]:
    """A training scan's labels, (N,) int16."""
    if scan.voxels.labels is None:
        raise DataError("a training scan has no labels; give simulated scans")
    return scan.voxels.labels


def _draw(rng: np.random.Generator, indices: NDArray[np.intp], size: int) -> NDArray[np.intp]:
    """At most `size` of some indices."""
    return rng.choice(indices, size, replace=False) if len(indices) > size else indices
