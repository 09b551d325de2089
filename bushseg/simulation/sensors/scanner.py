"""From rays to returns: what each beam strikes, how far, how bright, and what it is."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bushseg.points import FloatArray
from bushseg.simulation.scene import Scene
from bushseg.simulation.sensors.beam import (
    Echoes,
    across,
    counts,
    group,
    near_edges,
    ranks,
    ring,
    select,
)
from bushseg.simulation.sensors.config import SensorConfig
from bushseg.simulation.sensors.daylight import Daylight
from bushseg.simulation.sensors.figures import Figures
from bushseg.simulation.sensors.rays import PULSE_RATE, Rays
from bushseg.simulation.sensors.target import Target

FULL_SCALE = 65535

FLICKER = 0.3
"""Standard deviation of the logarithm of the light that a detector sees, about its threshold."""

SATURATION = 0.2
"""Nearer than this share of its reach, raw intensity no longer grows."""


@dataclass(frozen=True, slots=True)
class Returns:
    """What came back of one batch of M rays, N returns in the order the rays were sent.

    Attributes:
        xyz: Measured positions, metres from the site's origin (a frame's: from its sensor), shape
            (N, 3), float64.
        class_code: Codes of `CLASS_CODES`, shape (N,), uint8.
        instance: The thing struck, shape (N,), uint32; 0 for none.
        intensity: Reflectance times the cosine of incidence, of 65535, shape (N,), uint16.
        color: Red, green and blue, shape (N, 3), uint8.
        time: Seconds since the station began, shape (N,), float64.
        return_number: The return's place in its ray, from 1, shape (N,), uint8.
        num_returns: Returns of its ray, shape (N,), uint8.
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
    return_number: NDArray[np.uint8]
    num_returns: NDArray[np.uint8]
    station: int
    ray: NDArray[np.int64]
    num_rays: int

    def __len__(self) -> int:
        return len(self.xyz)


def scan(
    rng: np.random.Generator, scene: Scene, batches: Iterator[Rays], config: SensorConfig
) -> Iterator[Returns]:
    """Send beams into a scene.

    Occlusion follows from the casting, returns in front of and behind an edge from the beam's
    width. A return is seen or not by its light (reflectance times cosine of incidence times share
    of the beam, over the range's square) against that of a surface of reflectance 0.1 at the
    sensor's `reach`. It is what most of its light came from: its class, its instance, its color.

    Args:
        rng: Source of all noise; the same state gives the same returns.
        scene: What stands on the site.
        batches: Rays, as a sensor sends them.
        config: The sensor.

    Yields:
        One batch of returns for each batch of rays.
    """
    if not scene.parts:
        raise ValueError("the scene is empty; add at least the ground")
    target = Target(scene)
    figures = config.figures
    light = Daylight.draw(rng, figures.visibility, shadows=config.shadows)
    for rays in batches:
        yield _scan_batch(rng, target, rays, config, light)


def _scan_batch(
    rng: np.random.Generator, target: Target, rays: Rays, config: SensorConfig, light: Daylight
) -> Returns:
    """What comes back of one batch."""
    figures = config.figures
    aims = _deflected(rng, rays.directions, figures)
    ranges, part, cosine, normals = _strike(rng, target, rays.origins, aims, figures)
    echoes = group(ranges, target.reflectance[part], cosine, figures.range_resolution)
    echoes = select(echoes.take(_seen(rng, echoes, figures)), figures)

    beam, thing = echoes.beam, part.ravel()[echoes.strongest]
    number = len(echoes)
    growth = np.sqrt(
        (1 + (echoes.range / figures.noise_range) ** 2) / np.maximum(echoes.cosine, 0.1)
    )
    measured = echoes.range + figures.range_noise * growth * rng.standard_normal(number)
    color = np.zeros((number, 3))
    if config.color and config.kind != "spinning":
        where = rays.origins[beam] + echoes.range[:, None] * aims[beam]
        color = light.colors(
            target.caster,
            target.color[thing],
            where,
            normals.reshape(-1, 3)[echoes.strongest].astype(np.float64),
            echoes.range,
            rays.station,
        )
        color += figures.color_noise * rng.standard_normal((number, 1))
    return Returns(
        xyz=rays.reported_origins[beam] + measured[:, None] * rays.reported_directions[beam],
        class_code=target.class_code[thing],
        instance=target.instance[thing],
        intensity=_intensity(rng, echoes, figures),
        color=np.clip(np.rint(color), 0, 255).astype(np.uint8),
        time=(rays.first + beam) / PULSE_RATE,
        return_number=(ranks(beam) + 1).astype(np.uint8),
        num_returns=counts(beam).astype(np.uint8),
        station=rays.station,
        ray=beam,
        num_rays=len(rays),
    )


def _strike(
    rng: np.random.Generator,
    target: Target,
    origins: FloatArray,
    aims: FloatArray,
    figures: Figures,
) -> tuple[FloatArray, NDArray[np.intp], FloatArray, FloatArray]:
    """What M beams strike with each of their S rays: the middle one and those around it.

    Returns:
        Ranges in metres, inf for nothing, parts, cosines of incidence, each (M, S), and normals,
        (M, S, 3).
    """
    ranges, part, normals = target.cast(origins, aims)
    cosine = np.abs(np.einsum("ij,ij->i", normals, aims))
    # A beam that isn't split strikes with all its rays what the middle one does.
    all_ranges = np.repeat(ranges[:, None], figures.sub_rays, axis=1)
    all_parts = np.repeat(part[:, None], figures.sub_rays, axis=1)
    all_cosines = np.repeat(cosine[:, None], figures.sub_rays, axis=1)
    all_normals = np.repeat(normals[:, None], figures.sub_rays, axis=1)
    if figures.sub_rays > 1:
        split = np.flatnonzero(near_edges(ranges)) if figures.split == "edges" else slice(None)
        starts, directions = ring(rng, origins[split], aims[split], figures)
        around = directions.shape[:2]
        ranges, part, normals = target.cast(starts.reshape(-1, 3), directions.reshape(-1, 3))
        cosine = np.abs(np.einsum("ij,ij->i", normals, directions.reshape(-1, 3)))
        all_ranges[split, 1:] = ranges.reshape(around)
        all_parts[split, 1:] = part.reshape(around)
        all_cosines[split, 1:] = cosine.reshape(around)
        all_normals[split, 1:] = normals.reshape(*around, 3)
    return all_ranges, all_parts, np.minimum(all_cosines, 1), all_normals


def _deflected(rng: np.random.Generator, directions: FloatArray, figures: Figures) -> FloatArray:
    """Where rays (M, 3) really go, by the noise of the mirror's angles."""
    if not figures.angular_noise:
        return directions
    u, v = across(directions)
    off = np.radians(figures.angular_noise) * rng.standard_normal((2, len(directions), 1))
    aims: FloatArray = directions + off[0] * u + off[1] * v
    return aims / np.linalg.norm(aims, axis=1, keepdims=True)


def _seen(rng: np.random.Generator, echoes: Echoes, figures: Figures) -> NDArray[np.bool_]:
    """Which echoes the detector notices."""
    within = (echoes.range >= figures.min_range) & (echoes.range <= figures.max_range)
    excess = echoes.light / 0.1 * (figures.reach / np.maximum(echoes.range, 1e-3)) ** 2
    bright = excess * np.exp(FLICKER * rng.standard_normal(len(echoes))) > 1
    kept: NDArray[np.bool_] = rng.random(len(echoes)) >= figures.dropout
    return within & bright & kept


def _intensity(rng: np.random.Generator, echoes: Echoes, figures: Figures) -> NDArray[np.uint16]:
    """Light as the sensor delivers it, of 65535."""
    brightness = echoes.light * (1 + figures.intensity_noise * rng.standard_normal(len(echoes)))
    if figures.intensity == "raw":
        brightness *= np.minimum(1, SATURATION * figures.reach / echoes.range) ** 2
    scaled: NDArray[np.uint16] = np.rint(np.clip(brightness, 0, 1) * FULL_SCALE).astype(np.uint16)
    return scaled
