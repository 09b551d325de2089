"""A scan's voxels and tiles in a scratch folder, taken up by another process or a later run.

scan.json                           what is below, written last: without it nothing counts
keys, xyz, counts, labels, height   arrays as :mod:`bushseg.scratch` makes them, and so on
cubes, columns                      the tiling's
"""

from pathlib import Path
from typing import Annotated, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from bushseg.cache import FORMAT_VERSION, read_json, write_json
from bushseg.codes import UnknownCodes
from bushseg.errors import CacheError
from bushseg.features import FEATURES
from bushseg.grid import VoxelGrid
from bushseg.manifests import CodeCounts, Count
from bushseg.scan import VoxelScan
from bushseg.scratch import Scratch
from bushseg.subsample import Voxels
from bushseg.tiling import Tile, Tiling

MANIFEST = "scan.json"

_Block = Annotated[int, Field(ge=-(2**21), le=2**22)]
_Position = tuple[FiniteFloat, FiniteFloat, FiniteFloat]


class _Manifest(BaseModel):
    """What `scan.json` holds."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    version: int = FORMAT_VERSION
    num_voxels: Annotated[Count, Field(gt=0)]
    origin: _Position
    voxel_size: Annotated[FiniteFloat, Field(gt=0)]
    has_labels: bool
    features: list[str]
    sensor: _Position | None
    num_points: Count
    num_skipped: Count
    unknown_codes: CodeCounts
    invalid_codes: Count
    halo_blocks: Count
    num_cubes: Count
    tiles: list[tuple[_Block, _Block, _Block, _Block, Count]]

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read and check it.

        Raises:
            CacheError: It is missing, damaged or of another version.
        """
        try:
            manifest = cls.model_validate(read_json(path))
        except ValidationError as error:
            detail = error.errors(include_url=False)[0]
            name = ".".join(map(str, detail["loc"]))
            raise CacheError(f"{path}: {name} is no such value ({detail['msg']})") from None
        if unknown := set(manifest.features) - set(FEATURES):
            raise CacheError(f"{path}: names features {sorted(unknown)}, which nobody knows")
        return manifest


def store_scan(scan: VoxelScan, tiling: Tiling) -> None:
    """Complete the scratch folder in which a scan's arrays and tiling were made.

    Raises:
        WriteError: The disk refuses.
    """
    voxels, scratch = scan.voxels, scan.voxels.scratch
    if scratch.folder is None:
        raise ValueError("the scan's arrays were made in memory")
    scratch.sync()
    manifest = _Manifest(
        num_voxels=len(voxels),
        origin=tuple(voxels.grid.origin.tolist()),
        voxel_size=voxels.grid.voxel_size,
        has_labels=voxels.labels is not None,
        features=list(scan.features),
        sensor=None if scan.sensor is None else tuple(scan.sensor.tolist()),
        num_points=scan.num_points,
        num_skipped=scan.num_skipped,
        unknown_codes={str(code): count for code, count in scan.unknown.codes.items()},
        invalid_codes=scan.unknown.invalid,
        halo_blocks=tiling.halo_blocks,
        num_cubes=tiling.num_cubes,
        tiles=[(*tile.low, *tile.high, tile.num_points) for tile in tiling.tiles],
    )
    write_json(scratch.folder / MANIFEST, manifest.model_dump(mode="json"))


def open_stored(folder: Path) -> tuple[VoxelScan, Tiling]:
    """Take up a scan that :func:`store_scan` completed.

    Returns:
        The scan, without the raw values of its voxels; and its tiling.

    Raises:
        CacheError: There is none, or it is damaged.
    """
    manifest, scratch = _Manifest.read(folder / MANIFEST), Scratch(folder)
    size = manifest.num_voxels
    voxels = Voxels(
        grid=VoxelGrid(np.array(manifest.origin), manifest.voxel_size),
        keys=scratch.open("keys", (size,), np.int64),
        xyz=scratch.open("xyz", (size, 3), np.float64),
        values={},
        counts=scratch.open("counts", (size,), np.int64),
        labels=scratch.open("labels", (size,), np.int16) if manifest.has_labels else None,
        scratch=scratch,
    )
    features = {
        name: scratch.open(name, (size, FEATURES[name]), np.float32) for name in manifest.features
    }
    sensor = None if manifest.sensor is None else np.array(manifest.sensor)
    unknown = UnknownCodes(
        {int(code): count for code, count in manifest.unknown_codes.items()}, manifest.invalid_codes
    )
    scan = VoxelScan(voxels, features, sensor, manifest.num_points, manifest.num_skipped, unknown)
    tiles = [Tile((a, b), (c, d), count) for a, b, c, d, count in manifest.tiles]
    return scan, Tiling.opened(tiles, manifest.halo_blocks, manifest.num_cubes, scratch)
