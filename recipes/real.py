"""Real scans that may teach, written with the codes of the `bush` scheme.

Which those are is settled in `benchmarks/real_scans.py`. Objects cut out of surveys lack their
ground: they are set on a made-up one. Of survey tiles ground and buildings are labels; their
classes of vegetation are bands of height, which say nothing of bush and tree: they are unlabelled.
"""

from pathlib import Path

import laspy
import numpy as np
from judging import Scan, read_scan
from numpy.typing import NDArray
from objects import set_on_ground
from plantings import plantings
from real_scans import training_scans

from bushseg.files import atomic_path

_OBJECT_CODES = {10: 5, 11: 5, 12: 5, 13: 4, 15: 4, -1: 2}
"""Tree groups, tree lines, trees; hedgerows, bushes; the made-up ground. Woody edges (14) are of
both and so unlabelled."""

_TILE_CODES = {2: 2, 6: 6}
_UNLABELLED = 1

NUM_PLANTINGS = 20
"""Of 60 x 60 m, about a tenth of what the airborne model learns from."""


def write_real_scans(data: Path, output: Path) -> Path:
    """Write each of them as a LAZ file.

    Args:
        data: The folder of real scans.
        output: Where to.

    Returns:
        `output`.
    """
    for path in training_scans(data):
        scan = read_scan(path)
        is_object = path.parent.name == "vle"
        if is_object:
            scan = set_on_ground(scan)
        codes = _OBJECT_CODES if is_object else _TILE_CODES
        _write(output / f"{path.parent.name}_{path.stem}.laz", scan, _recoded(scan.codes, codes))
    return output


def write_plantings(data: Path, output: Path) -> Path:
    """Write plantings of the objects that may teach, each as a LAZ file.

    Args:
        data: The folder of real scans.
        output: Where to.

    Returns:
        `output`.
    """
    for scan in plantings(data, NUM_PLANTINGS, seed=0):
        _write(output / f"{scan.path.name}.laz", scan, _recoded(scan.codes, _OBJECT_CODES))
    return output


def _recoded(codes: NDArray[np.int64], meaning: dict[int, int]) -> NDArray[np.uint8]:
    known = np.full(len(codes), _UNLABELLED, np.uint8)
    for theirs, ours in meaning.items():
        known[codes == theirs] = ours
    return known


def _write(path: Path, scan: Scan, codes: NDArray[np.uint8]) -> None:
    header = laspy.LasHeader(version="1.4", point_format=6)
    xyz = scan.cloud.xyz
    header.scales, header.offsets = np.full(3, 0.001), np.floor(xyz.min(axis=0))
    las = laspy.LasData(header)
    las.x, las.y, las.z = xyz.T
    las.classification = codes
    if "intensity" in scan.cloud.attributes:
        las.intensity = scan.cloud.attributes["intensity"]
    with atomic_path(path) as partial:
        las.write(partial, do_compress=True)
