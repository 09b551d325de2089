"""The columns an evaluation compares: found in their files, and walked side by side.

Predictions and truth may come from two scans in different formats, from a scan and a file of bare
codes, or from two columns of one scan. Here they become pairs of blocks of equal length, checked to
be the same points.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bushseg.codes import LabelArray, UnknownCodes
from bushseg.errors import DataError
from bushseg.io import ScanInfo, ScanReader, label_sidecar, open_scan, read_codes
from bushseg.io.base import CHUNK_POINTS
from bushseg.io.table import PREDICTED_LABEL
from bushseg.points import AttributeArray, FloatArray, PointCloud
from bushseg.scheme import ClassScheme

CLASS_INDEX = "class_index"
"""The column in which a labelled file holds positions in the class scheme."""

CONFIDENCE = "confidence"
"""The column that says how sure each of those positions is."""

_TOLERANCE = 1e-3  # metres: what writing text or another scale may cost
_MAX_UNKNOWN_CODES = 65_536
_Block = tuple[AttributeArray, ...]  # of consecutive points: coordinates, values, confidences
_CODE_SUFFIXES = {".label", ".labels"}


@dataclass
class LabelColumn:
    """A column of labels in an open file.

    Attributes:
        reader: The file.
        name: The column: `class_index` holds positions in the scheme, any other source codes.
        scheme: What they mean.
        unknown: What the scheme didn't know among the values encoded so far.
    """

    reader: ScanReader
    name: str
    scheme: ClassScheme
    unknown: UnknownCodes = field(default_factory=UnknownCodes)

    def __post_init__(self) -> None:
        info = self.reader.info
        if self.name not in info.attributes:
            raise DataError(f"{info.path}: no column {self.name!r}; {_choices(info)}")
        if info.attributes[self.name].kind not in "buif":
            raise DataError(
                f"{info.path}: column {self.name!r} has dtype {info.attributes[self.name]}; "
                "expected class codes as numbers"
            )

    def encode(self, values: AttributeArray) -> LabelArray:
        """Turn some of the column's values into labels.

        Raises:
            DataError: The column can't be one of classes.
        """
        indexed = self.name == CLASS_INDEX
        encoded = self.scheme.encode_indices(values) if indexed else self.scheme.encode(values)
        self.unknown.add(encoded)
        if len(self.unknown.codes) > _MAX_UNKNOWN_CODES:
            raise DataError(
                f"{self.reader.info.path}: column {self.name!r} holds more than "
                f"{_MAX_UNKNOWN_CODES:,} different values; expected class codes; "
                f"{_choices(self.reader.info)}"
            )
        return encoded.labels


class _BareCodes(ScanReader):
    """A `.label` or `.labels` file as a scan whose coordinates are unknown: NaN."""

    def __init__(self, path: Path) -> None:
        self._codes = read_codes(path)
        self.info = ScanInfo(
            path=path,
            format="class codes",
            num_points=len(self._codes),
            attributes={"label": self._codes.dtype},
            label_attribute="label",
        )

    def chunks(self, size: int = CHUNK_POINTS) -> Iterator[PointCloud]:
        for start in range(0, len(self._codes), size):
            codes = self._codes[start : start + size]
            yield PointCloud(np.full((len(codes), 3), np.nan), {"label": codes})


def open_labels(path: Path) -> ScanReader:
    """Open a scan, or a file that holds class codes only and no coordinates.

    Raises:
        ReadError: The file is missing, damaged or of no known format.
    """
    return _BareCodes(path) if path.suffix.lower() in _CODE_SUFFIXES else open_scan(path)


def prediction_column(reader: ScanReader, name: str | None, scheme: ClassScheme) -> LabelColumn:
    """Choose the column of predictions: the one named, else the first of those `predict` writes.

    These are `class_index`, `predicted_label`, and the format's own label column.

    Raises:
        DataError: The file has none of them, or the one named isn't there or holds no numbers.
    """
    own = (CLASS_INDEX, PREDICTED_LABEL, reader.info.label_attribute)
    found = next((candidate for candidate in own if candidate in reader.info.attributes), None)
    return _column(reader, name or found, scheme)


def truth_column(reader: ScanReader, name: str | None, scheme: ClassScheme) -> LabelColumn:
    """Choose the column of true labels: the one named, else the format's own.

    Raises:
        DataError: The file has none, or the one named isn't there or holds no numbers.
    """
    return _column(reader, name or reader.info.label_attribute, scheme)


def _column(reader: ScanReader, name: str | None, scheme: ClassScheme) -> LabelColumn:
    if name is None:
        raise DataError(f"{reader.info.path}: no column of labels; {_choices(reader.info)}")
    return LabelColumn(reader, name, scheme)


def _choices(info: ScanInfo) -> str:
    return f"name one of {', '.join(info.attributes)}" if info.attributes else "it has none"


def is_same_column(predicted: LabelColumn, true: LabelColumn) -> bool:
    """Whether both are the same values: a column twice, or a scan and the file of its own labels.

    The latter is what a prediction named after its frame turns into.
    """
    ours, theirs = predicted.reader.info.path, true.reader.info
    if ours.samefile(theirs.path):
        return predicted.name == true.name
    own = label_sidecar(theirs.path)
    return own is not None and own.samefile(ours) and true.name == theirs.label_attribute


def in_step(
    predicted: LabelColumn, true: LabelColumn
) -> Iterator[tuple[LabelArray, LabelArray, FloatArray]]:
    """Walk two columns point by point: predictions, labels and confidences in equal blocks.

    Both may be columns of one file. Where two files have coordinates they must agree to 1 mm and
    the files' own resolution: comparing points in another order gives scores without a meaning.
    Confidences are NaN where the predictions have none.

    Raises:
        ReadError: A file is damaged.
        DataError: The files differ in their number of points, or in where a point lies.
    """
    if predicted.reader is true.reader:
        for chunk in true.reader.chunks():
            codes, true_codes = (chunk.attributes[column.name] for column in (predicted, true))
            yield predicted.encode(codes), true.encode(true_codes), _confidence(predicted, chunk)
        return
    files = f"{predicted.reader.info.path} and {true.reader.info.path}"
    counts = predicted.reader.info.num_points, true.reader.info.num_points
    if counts[0] != counts[1]:
        raise DataError(
            f"{files} hold {counts[0]:,} and {counts[1]:,} points; expected the same points in the "
            "same order"
        )
    tolerance = _TOLERANCE + max(_resolution(predicted.reader), _resolution(true.reader))
    num_done = 0
    for ours, (true_xyz, true_codes, _) in _aligned(_blocks(predicted), _blocks(true)):
        xyz, codes, confidence = ours
        # NaN (bare codes, a PCD's invalid points) compares as false: such points pass.
        with np.errstate(invalid="ignore"):
            distances = np.abs(xyz - true_xyz).max(axis=1)
        apart = distances > tolerance
        if apart.any():
            first = int(apart.argmax())
            raise DataError(
                f"{files}: point {num_done + first:,} (from 0) lies {distances[first]:.4g} apart "
                f"in them; expected the same points in the same order, to {tolerance:.4g}"
            )
        yield predicted.encode(codes), true.encode(true_codes), confidence
        num_done += len(codes)


def _blocks(column: LabelColumn) -> Iterator[_Block]:
    return (
        (chunk.xyz, chunk.attributes[column.name], _confidence(column, chunk))
        for chunk in column.reader.chunks()
    )


def _confidence(column: LabelColumn, chunk: PointCloud) -> FloatArray:
    """How sure each point's class index is, NaN where the file doesn't say."""
    values = chunk.attributes.get(CONFIDENCE)
    if column.name != CLASS_INDEX or values is None or values.dtype.kind != "f":
        return np.full(len(chunk), np.nan)
    return values.astype(np.float64)


def _aligned(left: Iterator[_Block], right: Iterator[_Block]) -> Iterator[tuple[_Block, _Block]]:
    """Cut two walks over equally many points into blocks of equal length."""
    rest: _Block = (np.empty((0, 3)), np.empty(0), np.empty(0))
    for block in right:
        while len(block[1]):
            if not len(rest[1]):
                rest = next(left)
                continue
            size = min(len(rest[1]), len(block[1]))
            yield tuple(part[:size] for part in rest), tuple(part[:size] for part in block)
            rest, block = (tuple(part[size:] for part in whole) for whole in (rest, block))


def _resolution(reader: ScanReader) -> float:
    """The step of the integers a LAS file stores its coordinates as; 0 for other formats."""
    from bushseg.io.las_reader import LasReader

    return float(np.abs(reader.header.scales).max()) if isinstance(reader, LasReader) else 0.0
