"""Normals of all voxels of a scan, each estimated once, whatever tiles they are cut into later."""

from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bushseg.cache import FORMAT_VERSION, read_json, write_json
from bushseg.errors import CacheError
from bushseg.local_positions import local_positions
from bushseg.neighbors import NeighborIndex, reaches
from bushseg.normals import estimate_normals
from bushseg.scan import VoxelScan
from bushseg.scratch import Scratch
from bushseg.stages import Stages
from bushseg.tiling import Tiling

_TILE_POINTS = 500_000
_HALO = 48  # voxels
_JOURNAL = "normals.json"


def voxel_normals(
    scan: VoxelScan, tiling: Tiling, num_neighbors: int, stages: Stages
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Estimate the normals of a scan's voxels.

    Done in large pieces, so that memory doesn't grow with the scan. Around a piece lie voxels to
    find neighbors among, which get their own normals in their own piece. Of a scan in a scratch
    folder the pieces that are done are noted there: a run that was killed is gone on with.

    Args:
        scan: The scan's voxels.
        tiling: A tiling of them, to be cut into those pieces.
        num_neighbors: K; in one scratch folder always the same.
        stages: Told of the time that tiling, neighbors and normals take.

    Returns:
        Unit normals, shape (N, 3), float32; and the distance to the K-th neighbor, metres, shape
        (N,), float32.

    Raises:
        WriteError: The scratch folder can't hold them.
    """
    voxels, scratch = scan.voxels, scan.voxels.scratch
    with stages.timed("tiling"):
        pieces = tiling.recut(_TILE_POINTS, _HALO)
    num_done, normals, distances = _begin(scratch, len(voxels), len(pieces.tiles))
    for number in range(num_done, len(pieces.tiles)):
        with stages.timed("tiling"):
            indices, is_core = pieces.members(pieces.tiles[number])
            xyz, origin = local_positions(voxels.xyz, indices, voxels.grid.voxel_size)
        core = indices[is_core]
        with stages.timed("neighbors"):
            neighbors = NeighborIndex(xyz).query(xyz[is_core], num_neighbors)
            distances[core] = reaches(xyz, neighbors)
        with stages.timed("normals"):
            sensor = None if scan.sensor is None else scan.sensor - origin
            normals[core] = estimate_normals(xyz, neighbors, sensor)
        if scratch.folder is not None:
            with stages.timed("write"):
                scratch.sync()
                _note(scratch.folder / _JOURNAL, number + 1, len(pieces.tiles))
        scratch.release()
    return normals, distances


def _begin(
    scratch: Scratch, size: int, num_pieces: int
) -> tuple[int, NDArray[np.float32], NDArray[np.float32]]:
    """How many pieces an earlier run did; and the arrays, with what it found or new."""
    arrays: tuple[tuple[str, tuple[int, ...]], ...] = ("normals", (size, 3)), ("distances", (size,))
    if scratch.folder is not None:
        journal = scratch.folder / _JOURNAL
        with suppress(CacheError):
            noted = read_json(journal)
            num_done = noted.get("num_done")
            fits = noted.get("num_pieces") == num_pieces
            if fits and isinstance(num_done, int) and 0 <= num_done <= num_pieces:
                normals, distances = (scratch.open(*array, np.float32) for array in arrays)
                return num_done, normals, distances
        with suppress(OSError):  # what refuses this refuses the arrays as well
            journal.unlink()
    normals, distances = (scratch.empty(*array, np.float32) for array in arrays)
    return 0, normals, distances


def _note(journal: Path, num_done: int, num_pieces: int) -> None:
    """Note how many pieces are done."""
    noted = {"version": FORMAT_VERSION, "num_done": num_done, "num_pieces": num_pieces}
    write_json(journal, noted)
