"""Points already in memory, behind the interface that files have."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from bushseg.io.base import CHUNK_POINTS, ScanInfo, ScanReader
from bushseg.points import PointCloud


class MemoryReader(ScanReader):
    """A scan held in memory, such as a robot's LiDAR frame.

    Args:
        cloud: The points.
        sensor: Where the sensor stood, shape (3,); None if unknown. With a sensor at the origin,
            points at exactly (0, 0, 0) are pulses that did not return: nothing is at range 0.
    """

    def __init__(self, cloud: PointCloud, sensor: ArrayLike | None = None) -> None:
        self._cloud = cloud
        self.info = ScanInfo(
            path=Path("points in memory"),
            format="memory",
            num_points=len(cloud),
            attributes={
                name: np.dtype((column.dtype, column.shape[1:]))
                for name, column in cloud.attributes.items()
            },
            sensor_position=None if sensor is None else np.asarray(sensor, dtype=np.float64),
            no_returns_at_origin=sensor is not None and not np.any(sensor),
        )

    def chunks(self, size: int = CHUNK_POINTS) -> Iterator[PointCloud]:
        """Yield slices of the points; nothing is copied."""
        for start in range(0, len(self._cloud), size):
            rows = slice(start, start + size)
            columns = {name: column[rows] for name, column in self._cloud.attributes.items()}
            yield PointCloud(self._cloud.xyz[rows], columns)

    def read(self) -> PointCloud:
        """The points themselves."""
        return self._cloud
