"""How large an output will be, at the least."""

from bushseg.io.base import ScanReader
from bushseg.io.las_reader import LasReader

_ADDED = 9  # class_index, confidence, bush_probability
_COORDINATES = 12
_LAS_RECORD = 30
_COMPRESSED = 3  # LAZ: hardly a point takes less once it has a confidence
_LABELS = {".label": 4, ".labels": 2}
_DIGITS = {".txt": 12, ".xyz": 12, ".csv": 12}


def least_bytes(reader: ScanReader, suffix: str) -> int:
    """A lower bound for the size of a labelled copy of a scan, in bytes.

    Args:
        reader: The open scan.
        suffix: The output's.
    """
    if suffix in _LABELS or suffix in _DIGITS:
        per_point = _LABELS.get(suffix) or _DIGITS[suffix]
    elif suffix == ".laz":
        per_point = _COMPRESSED
    elif suffix == ".las":
        record = reader.layout.dtype.itemsize if isinstance(reader, LasReader) else _LAS_RECORD
        per_point = record + _ADDED
    else:
        columns = sum(dtype.itemsize for dtype in reader.info.attributes.values())
        per_point = _COORDINATES + columns
    return per_point * reader.info.num_points
