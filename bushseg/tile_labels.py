"""What a tile's voxels are labelled as, and the file it is kept in until the scan is done."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError

from bushseg.cache import load_tensors, save_tensors
from bushseg.compiled import compiled
from bushseg.errors import CacheError, WriteError
from bushseg.labeler import TilePrediction


def tile_path(place: Path, number: int) -> Path:
    """Where a tile's labels are kept."""
    return place / f"tile_{number:06d}.safetensors"


@dataclass(frozen=True, slots=True)
class TileLabels:
    """Labels of a tile's core, in the order of its voxels.

    Attributes:
        labels: Class index, (M,) int16.
        confidence: Probability of that class, (M,) float32.
        bush: Probability of bush, (M,) float32; None where the model has no such class.
        num_seen: Voxels that passed the network for it, halo included.
        neighbor_distance: Median distance to the K-th neighbor in the tile, metres.
    """

    labels: NDArray[np.int16]
    confidence: NDArray[np.float32]
    bush: NDArray[np.float32] | None
    num_seen: int
    neighbor_distance: float

    @classmethod
    def of(cls, tile: TilePrediction, bush_index: int | None) -> Self:
        """The likeliest class of each voxel; of equal ones the first.

        Args:
            tile: Probabilities of all classes.
            bush_index: The class whose probability is kept beside the winner's, or None.
        """
        labels = np.empty(len(tile.probabilities), dtype=np.int16)
        confidence = np.empty(len(labels), dtype=np.float32)
        _pick(tile.probabilities, labels, confidence)
        bush = None if bush_index is None else tile.probabilities[:, bush_index].copy()
        return cls(labels, confidence, bush, tile.num_seen, tile.neighbor_distance)

    def save(self, path: Path) -> None:
        """Write them, whole or not at all.

        Raises:
            WriteError: The disk refuses.
        """
        tensors: dict[str, NDArray[Any]] = {
            "labels": self.labels,
            "confidence": self.confidence,
            "num_seen": np.array([self.num_seen]),
            "neighbor_distance": np.array([self.neighbor_distance]),
        }
        if self.bush is not None:
            tensors["bush"] = self.bush
        try:
            save_tensors(path, tensors)
        except (OSError, SafetensorError) as error:
            raise WriteError(
                f"{path}: a finished tile can't be kept ({error}); make room, or name another "
                "scratch folder"
            ) from error

    @classmethod
    def load(cls, path: Path, num_voxels: int, num_classes: int, *, has_bush: bool) -> Self:
        """Read what :meth:`save` wrote.

        Raises:
            CacheError: It is missing, damaged, or of another tile or model.
        """
        tensors = load_tensors(path)
        expected: dict[str, tuple[type[np.generic], int]] = {
            "labels": (np.int16, num_voxels),
            "confidence": (np.float32, num_voxels),
            "num_seen": (np.int64, 1),
            "neighbor_distance": (np.float64, 1),
        }
        if has_bush:
            expected["bush"] = (np.float32, num_voxels)
        for name, (dtype, size) in expected.items():
            column = tensors.get(name)
            if column is None or column.dtype != dtype or column.shape != (size,):
                raise CacheError(f"{path}: its {name} aren't those of this tile")
        labels = tensors["labels"]
        if not ((labels >= 0) & (labels < num_classes)).all():
            raise CacheError(f"{path}: labels a class that the model doesn't have")
        return cls(
            labels=labels,
            confidence=tensors["confidence"],
            bush=tensors.get("bush"),
            num_seen=int(tensors["num_seen"][0]),
            neighbor_distance=float(tensors["neighbor_distance"][0]),
        )


@compiled
def _pick(
    probabilities: NDArray[np.float32],
    labels: NDArray[np.int16],
    confidence: NDArray[np.float32],
) -> None:
    """The likeliest class of each voxel and its probability."""
    for i in range(len(probabilities)):
        best = 0
        for label in range(1, probabilities.shape[1]):
            if probabilities[i, label] > probabilities[i, best]:
                best = label
        labels[i], confidence[i] = best, probabilities[i, best]
