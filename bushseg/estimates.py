"""What labelling a scan will take: time, memory, disk."""

from dataclasses import dataclass

from bushseg.config import PredictConfig
from bushseg.memory import HALO, PROGRAM, READING, TABLE_VOXEL, TILE_VOXEL
from bushseg.parallel import num_workers
from bushseg.room import SCRATCH_VOXEL
from bushseg.subsample import MAX_VOXELS

POINT_SECONDS = 1.4e-6
"""Of two cores: to read a point twice, find its voxel and write it; see `benchmarks/memory.py`."""

VOXEL_SECONDS = 7e-6
"""Of two cores: to find a voxel's neighbors and pass it through a bundled model's network."""

START_SECONDS = 3.0
TILE_POINTS = PredictConfig().tile_points

_CORES = 2


@dataclass(frozen=True, slots=True)
class Estimate:
    """What `bushseg predict` will take with one of the bundled models, and its own settings.

    Attributes:
        model: The model's name.
        voxel_size: Its voxels' edge, metres.
        num_voxels: Voxels of the scan.
        seconds: Time, on cores as fast as those that the figures were measured on.
        memory: Bytes.
        scratch: Bytes of scratch files, beside the output unless told otherwise.
    """

    model: str
    voxel_size: float
    num_voxels: int
    seconds: float
    memory: int
    scratch: int


def estimate(model: str, voxel_size: float, num_points: int, num_voxels: int) -> Estimate:
    """Estimate what labelling takes, from what a scan holds."""
    work = POINT_SECONDS * num_points + VOXEL_SECONDS * num_voxels
    tile = HALO * min(num_voxels, TILE_POINTS)
    memory = max(PROGRAM + TILE_VOXEL * tile, READING + TABLE_VOXEL * min(num_voxels, MAX_VOXELS))
    return Estimate(
        model=model,
        voxel_size=voxel_size,
        num_voxels=num_voxels,
        seconds=START_SECONDS + work * _CORES / num_workers(),
        memory=int(memory),
        scratch=SCRATCH_VOXEL * num_voxels if num_voxels > MAX_VOXELS else 0,
    )
