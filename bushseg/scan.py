"""A scan at voxel resolution: what prepare caches and predict labels both start here."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bushseg.codes import UnknownCodes
from bushseg.errors import DataError
from bushseg.features import Scaling, source_columns, source_values
from bushseg.grid import VoxelGrid
from bushseg.ground import Ground
from bushseg.io.base import ScanReader
from bushseg.progress import SILENT, Progress
from bushseg.room import SCRATCH_VOXEL, check_room
from bushseg.scheme import ClassScheme
from bushseg.scratch import ELSEWHERE
from bushseg.stages import Stages
from bushseg.subsample import MAX_VOXELS, GridSubsampler, Voxels

_ANCHOR_POINTS = 10_001


@dataclass(frozen=True, slots=True)
class VoxelScan:
    """The voxels of one scan with their features.

    Attributes:
        voxels: Positions, labels and counts.
        features: Feature name to (N, columns) float32, scaled for the network; those the scan has.
        sensor: Where the sensor stood, metres from the grid's origin, shape (3,); None if unknown.
        num_points: Raw points read.
        num_skipped: Raw points that no voxel holds: not finite, no-returns, out of reach.
        unknown: Label codes the class scheme doesn't know, with their counts.
    """

    voxels: Voxels
    features: dict[str, NDArray[np.float32]]
    sensor: NDArray[np.float64] | None
    num_points: int
    num_skipped: int
    unknown: UnknownCodes


def mask_no_returns(xyz: NDArray[np.float64], reader: ScanReader) -> NDArray[np.float64]:
    """Coordinates, NaN where a pulse did not return, so that no voxel takes it; (N, 3) float64."""
    if not reader.info.no_returns_at_origin:
        return xyz
    missing = (xyz == 0).all(axis=1)
    if not missing.any():
        return xyz
    return np.where(missing[:, None], np.nan, xyz)


def read_voxels(
    reader: ScanReader,
    voxel_size: float,
    scheme: ClassScheme | None = None,
    label_field: str | None = None,
    progress: Progress = SILENT,
    stages: Stages | None = None,
    *,
    folder: Path | None = None,
    max_voxels: int = MAX_VOXELS,
    on_disk: bool = False,
) -> VoxelScan:
    """Stream a scan into voxels.

    Args:
        reader: The open scan.
        voxel_size: Edge of a voxel, metres.
        scheme: How label codes become class indices; None leaves labels alone.
        label_field: Attribute that holds the codes; None takes the format's own, if it has one.
        progress: Told of the points read.
        stages: Told of the time that reading, sub-sampling and the ground take.
        folder: A scratch folder for a scan of more than `max_voxels`; None holds all in memory.
        max_voxels: How many voxels to hold in memory where there is such a folder.
        on_disk: Whether the scan is to stand in that folder however small it is.

    Returns:
        The scan's voxels. Labels are None where the scan has no label attribute.

    Raises:
        DataError: No point has finite coordinates, or `label_field` is no attribute of the scan.
        ReadError: The file is damaged.
        WriteError: The scratch folder can't hold the voxels, or won't.
    """
    info, stages = reader.info, stages or Stages()
    field = _label_attribute(reader, label_field) if scheme is not None else None
    columns = source_columns(info.attributes)
    progress.start(f"reading {info.path.name}", info.num_points, "points")
    subsampler: GridSubsampler | None = None
    unknown = UnknownCodes()
    num_points = num_early = 0
    checked = False
    for chunk in stages.each("read", reader.chunks()):
        num_points += len(chunk)
        xyz = mask_no_returns(chunk.xyz, reader)
        if subsampler is None:
            anchor = anchor_of(xyz)
            if anchor is None:
                num_early += len(chunk)
                continue
            grid = VoxelGrid.around(anchor, voxel_size)
            num_classes = scheme.num_classes if scheme and field else None
            subsampler = GridSubsampler(grid, num_classes, folder, max_voxels, on_disk=on_disk)
        labels = None
        if scheme is not None and field is not None:
            encoded = scheme.encode(chunk.attributes[field])
            unknown.add(encoded)
            labels = encoded.labels
        with stages.timed("sub-sample"):
            subsampler.add(xyz, source_values(chunk, columns), labels)
        progress.advance(len(chunk))
        if folder is not None and not checked and subsampler.num_spilled:
            checked = True
            voxels_expected = subsampler.num_spilled * info.num_points / num_points
            check_room(folder, SCRATCH_VOXEL * voxels_expected, "scratch data", ELSEWHERE)
    if subsampler is None:
        raise DataError(f"{info.path}: none of its {num_points} points has finite coordinates")
    with stages.timed("sub-sample"):
        voxels = subsampler.finish()
    with stages.timed("ground and features"):
        features = _features(voxels)
    sensor = None if info.sensor_position is None else info.sensor_position - voxels.grid.origin
    skipped = num_early + subsampler.num_outside
    return VoxelScan(voxels, features, sensor, num_points, skipped, unknown)


def _features(voxels: Voxels) -> dict[str, NDArray[np.float32]]:
    """What the network may be told of each voxel."""
    scratch, size = voxels.scratch, len(voxels)
    ground = Ground.below(voxels.xyz, scratch)
    scaling = Scaling.of(voxels.values, scratch)
    features = {
        name: scratch.empty(name, (size, columns), np.float32)
        for name, columns in scaling.features.items()
    }
    for rows in scratch.blocks(size):
        values = {name: column[rows] for name, column in voxels.values.items()}
        scaled = scaling.apply(values, ground.heights(voxels.xyz[rows]))
        for name, columns in scaled.items():
            features[name][rows] = columns
    return features


def _label_attribute(reader: ScanReader, label_field: str | None) -> str | None:
    """The attribute to read codes from."""
    info = reader.info
    if label_field is None:
        return info.label_attribute
    if label_field not in info.attributes:
        known = ", ".join(info.attributes) or "none"
        raise DataError(f"{info.path}: has no attribute {label_field!r}; it has {known}")
    return label_field


def anchor_of(xyz: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Where the grid is fixed: in each axis the median of the first points that are finite.

    Of an even number the lower one, so that it is a coordinate of the scan's and moves with it. The
    first point alone may be a stray one, so far away that the grid wouldn't reach the others.
    """
    finite = xyz[np.isfinite(xyz).all(axis=1)][:_ANCHOR_POINTS]
    if not len(finite):
        return None
    middle = (len(finite) - 1) // 2
    anchor: NDArray[np.float64] = np.partition(finite, middle, axis=0)[middle]
    return anchor
