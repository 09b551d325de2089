"""A scene ready for rays, with what its parts are made of."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bushseg.geometry import open3d
from bushseg.points import FloatArray
from bushseg.simulation.scene import Scene


class Target:
    """A scene ready for rays, and its parts' properties as arrays."""

    def __init__(self, scene: Scene) -> None:
        self.caster: Any = scene.caster()
        parts = scene.parts
        self.class_code = np.array([part.class_code for part in parts], np.uint8)
        self.instance = np.array([part.instance for part in parts], np.uint32)
        self.reflectance = np.array([part.material.reflectance for part in parts])
        self.color = np.array([part.material.color for part in parts], np.float64)
        self.top = max(float(part.mesh.vertices[:, 2].max()) for part in parts) + 1.0

    def cast(
        self, origins: FloatArray, directions: FloatArray
    ) -> tuple[FloatArray, NDArray[np.intp], FloatArray]:
        """What rays (M, 3) strike: range in metres or inf, part, and normal (M, 3)."""
        # Rays from high up begin just above the scene: float32 knows the rest to a millimetre.
        height = origins[:, 2] - self.top
        falling = np.minimum(directions[:, 2], -1e-6)
        skipped = np.where((height > 0) & (directions[:, 2] < -1e-6), -height / falling, 0.0)
        beams = np.hstack([origins + skipped[:, None] * directions, directions])
        hits = self.caster.cast_rays(open3d().core.Tensor.from_numpy(beams.astype(np.float32)))
        ranges = hits["t_hit"].numpy().astype(np.float64) + skipped
        part = hits["geometry_ids"].numpy().astype(np.intp)
        part[~np.isfinite(ranges)] = 0
        return ranges, part, hits["primitive_normals"].numpy()
