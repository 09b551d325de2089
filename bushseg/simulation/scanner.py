"""From rays to returns: what each ray strikes, how far, how bright, and what it is."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bushseg.geometry import open3d
from bushseg.points import FloatArray
from bushseg.simulation.config import SimulateConfig
from bushseg.simulation.scene import Scene
from bushseg.simulation.sensors import PULSE_RATE, Rays

SUN = np.array([0.42, -0.48, 0.77])
"""Where daylight comes from, a unit vector."""

FULL_SCALE = 65535


@dataclass(frozen=True, slots=True)
class Returns:
    """What came back of one batch of M rays, N returns in the order the rays were sent.

    Attributes:
        xyz: Measured positions, metres from the site's origin, shape (N, 3), float64.
        class_code: Codes of `CLASS_CODES`, shape (N,), uint8.
        instance: The thing struck, shape (N,), uint32; 0 for none.
        intensity: Reflectance times the cosine of incidence, of 65535, shape (N,), uint16.
        color: Red, green and blue, shape (N, 3), uint8.
        time: Seconds since the station began, shape (N,), float64.
        station: The station's number, from 1.
        ray: Which of the batch's rays each return is of, shape (N,), int64.
        num_rays: M.
    """

    xyz: FloatArray
    class_code: NDArray[np.uint8]
    instance: NDArray[np.uint32]
    intensity: NDArray[np.uint16]
    color: NDArray[np.uint8]
    time: FloatArray
    station: int
    ray: NDArray[np.int64]
    num_rays: int

    def __len__(self) -> int:
        return len(self.xyz)


def scan(
    rng: np.random.Generator, scene: Scene, batches: Iterator[Rays], config: SimulateConfig
) -> Iterator[Returns]:
    """Cast rays into a scene; each ray gives its nearest return or none.

    Occlusion follows from the casting. Positions err along the ray only, by `config.range_noise`.
    Intensity is range-corrected, as most scanners deliver it: reflectance times the cosine of the
    angle between ray and normal, with noise. Colors are the material's in daylight, with noise.

    Args:
        rng: Source of all noise; the same state gives the same returns.
        scene: What stands on the site.
        batches: Rays, as a sensor sends them.
        config: Range limits, drop-out and noise.

    Yields:
        One batch of returns for each batch of rays.
    """
    if not scene.parts:
        raise ValueError("the scene is empty; add at least the ground")
    core = open3d().core
    caster = scene.caster()
    class_codes = np.array([part.class_code for part in scene.parts], np.uint8)
    numbers = np.array([part.instance for part in scene.parts], np.uint32)
    reflectance = np.array([part.material.reflectance for part in scene.parts])
    palette = np.array([part.material.color for part in scene.parts], np.float64)

    for rays in batches:
        beams = np.hstack([rays.origins, rays.directions]).astype(np.float32)
        hits = caster.cast_rays(core.Tensor.from_numpy(beams))
        ranges = hits["t_hit"].numpy().astype(np.float64)
        seen = (ranges >= config.min_range) & (ranges <= config.max_range)
        seen &= rng.random(len(ranges)) >= config.dropout
        ray = np.flatnonzero(seen)

        part = hits["geometry_ids"].numpy()[ray].astype(np.intp)
        normals = hits["primitive_normals"].numpy()[ray].astype(np.float64)
        directions = rays.directions[ray]
        measured = ranges[ray] + config.range_noise * rng.standard_normal(len(ray))
        cosine = np.abs(np.einsum("ij,ij->i", normals, directions))
        speckle = 1 + config.intensity_noise * rng.standard_normal(len(ray))
        brightness = np.clip(reflectance[part] * cosine * speckle, 0, 1)
        daylight = 0.6 + 0.4 * np.abs(normals @ SUN)
        color = palette[part] * daylight[:, None]
        color += config.color_noise * rng.standard_normal((len(ray), 1))
        yield Returns(
            xyz=rays.origins[ray] + measured[:, None] * directions,
            class_code=class_codes[part],
            instance=numbers[part],
            intensity=np.rint(brightness * FULL_SCALE).astype(np.uint16),
            color=np.clip(np.rint(color), 0, 255).astype(np.uint8),
            time=(rays.first + ray) / PULSE_RATE,
            station=rays.station,
            ray=ray,
            num_rays=len(ranges),
        )
