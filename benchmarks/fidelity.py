"""Whether a labelled scan still is the scan it was made from.

Both files are read by `independent.py`, and LAS containers taken apart byte by byte: nothing here
knows how bushseg reads or writes.
"""

import struct
from pathlib import Path
from typing import Any

import laspy
import numpy as np
from independent import Columns, read_columns
from numpy.typing import NDArray

from bushseg.scheme import ClassScheme

# Places in a LAS header (LAS 1.4 R15, table 3) that labelling leaves alone.
_KEPT = {
    "file source id": slice(4, 6),
    "global encoding": slice(6, 8),
    "GUID": slice(8, 24),
    "version": slice(24, 26),
    "system identifier": slice(26, 58),
    "generating software": slice(58, 90),
    "creation date": slice(90, 94),
    "header size": slice(94, 96),
    "scales and offsets": slice(131, 179),
}
_STANDARD_HEADER = {0: 227, 1: 227, 2: 227, 3: 235, 4: 375}  # bytes, by minor version
_EXTRA_BYTES = (b"LASF_Spec", 4)
_LEGACY_CODES = 0x1F
_UNCLASSIFIED = 1
_UNLABELLED_INDEX = 255

Record = tuple[bytes, int, bytes, bytes]  # user id, record id, description, payload


def differences(source: Path, output: Path, scheme: ClassScheme) -> list[str]:
    """Compare a scan with its labelled copy.

    Args:
        source: The scan.
        output: What `predict` made of it.
        scheme: The model's classes.

    Returns:
        What is wrong, a line each; empty if nothing is.
    """
    if output.suffix == ".label":
        return _label_differences(source, output, scheme)
    if output.suffix == ".ply":
        return _ply_differences(source, output, scheme)
    if source.suffix in (".las", ".laz"):
        return _copy_differences(source, output, scheme)
    return _converted_differences(source, output, scheme)


def _copy_differences(source: Path, output: Path, scheme: ClassScheme) -> list[str]:
    """LAS to LAS: all bytes of the header, the records and the points but for the labels."""
    raw, copied = source.read_bytes(), output.read_bytes()
    wrong = [f"header: {name}" for name, place in _KEPT.items() if raw[place] != copied[place]]
    behind = slice(_STANDARD_HEADER[raw[25]], struct.unpack_from("<H", raw, 94)[0])
    if raw[behind] != copied[behind]:
        wrong.append("header: bytes behind the standard fields")
    for kind, walk in (("VLR", _vlrs), ("EVLR", _evlrs)):
        wrong += _record_differences(kind, walk(raw), walk(copied))
    before, after = laspy.read(source).points.array, laspy.read(output)
    if len(before) != len(after.points):
        return [*wrong, f"{len(after.points):,} points, not {len(before):,}"]
    wrong += _point_differences(before, after.points.array)
    return wrong + _count_differences(copied, after) + _label_column_differences(after, scheme)


def _converted_differences(source: Path, output: Path, scheme: ClassScheme) -> list[str]:
    """Another format to LAS: coordinates to half a step, every attribute to be had again."""
    columns, las = read_columns(source), laspy.read(output)
    if len(las.points) != len(columns["xyz"]):
        return [f"{len(las.points):,} points, not {len(columns['xyz']):,}"]
    wrong = []
    if not (np.abs(las.xyz - columns.pop("xyz")) <= las.header.scales * 0.51).all():
        wrong.append("coordinates differ by more than half a step")
    dimensions = set(las.point_format.dimension_names)
    for name, values in columns.items():
        held = f"original_{name}" if f"original_{name}" in dimensions else name
        # LAS colors have 16 bits: 255 becomes 65,535.
        factors = (1, 257) if held in ("red", "green", "blue") else (1,)
        if held not in dimensions or not any(
            np.array_equal(las[held], values.astype(np.float64) * factor) for factor in factors
        ):
            wrong.append(f"attribute {name}")
    return (
        wrong
        + _count_differences(output.read_bytes(), las)
        + _label_column_differences(las, scheme)
    )


def _ply_differences(source: Path, output: Path, scheme: ClassScheme) -> list[str]:
    """A table to PLY: every column equal, and the labels beside them."""
    before, after = read_columns(source), read_columns(output)
    wrong = [
        f"column {name}"
        for name, values in before.items()
        if name not in after or not np.array_equal(after[name], values, equal_nan=True)
    ]
    codes = np.array([info.codes[0] for info in scheme.classes])
    labels = after.get("predicted_label", after["label"])  # the scan may have labels of its own
    return wrong + _index_differences(after, scheme, labels, codes, scheme.unlabelled[0])


def _label_differences(source: Path, output: Path, scheme: ClassScheme) -> list[str]:
    """A frame to `.label`: a code of the scheme for each point."""
    codes, num_points = np.fromfile(output, "<u4"), len(read_columns(source)["xyz"])
    if len(codes) != num_points:
        return [f"{len(codes):,} labels, not {num_points:,}"]
    known = [info.codes[0] for info in scheme.classes] + [scheme.unlabelled[0]]
    return [] if np.isin(codes, known).all() else ["codes that the scheme doesn't know"]


def _record_differences(kind: str, before: list[Record], after: list[Record]) -> list[str]:
    """Records that are gone, changed or new; those of the copy's own compression don't count."""
    copied = [record for record in after if record[0] not in (b"laszip encoded", b"copc")]
    wrong = []
    for record in before:
        if record[0] in (b"laszip encoded", b"copc"):
            continue
        if record in copied:
            copied.remove(record)
        elif not (record[:2] == _EXTRA_BYTES and _grown(record, copied)):
            wrong.append(f"{kind} {record[0].decode('latin-1')} {record[1]}")
    allowed = [record for record in copied if record[:2] == _EXTRA_BYTES]
    if len(copied) > len(allowed) or len(allowed) > 1:
        wrong.append(f"{kind}s that the source doesn't have")
    return wrong


def _grown(record: Record, copied: list[Record]) -> bool:
    """Whether a record of extra bytes still begins as it did."""
    return any(other[:2] == record[:2] and other[3].startswith(record[3]) for other in copied)


def _point_differences(before: NDArray[np.void], after: NDArray[np.void]) -> list[str]:
    """Fields of the source that aren't bit-equal, class codes aside."""
    length = before.dtype.itemsize
    old = np.frombuffer(before.tobytes(), np.uint8).reshape(len(before), length)
    new = np.frombuffer(after.tobytes(), np.uint8).reshape(len(after), -1)[:, :length]
    changed = old ^ new
    fields = before.dtype.fields or {}
    if "raw_classification" in fields:
        changed[:, fields["raw_classification"][1]] &= ~np.uint8(_LEGACY_CODES)
    else:
        changed[:, fields["classification"][1]] = 0
    found = []
    for name, (dtype, at, *_) in fields.items():
        num_points = int(changed[:, at : at + dtype.itemsize].any(axis=1).sum())
        if num_points:
            found.append(f"field {name} of {num_points:,} points")
    return found


def _count_differences(raw: bytes, las: laspy.LasData) -> list[str]:
    """Whether the header counts and bounds the points that are there."""
    is_legacy = las.point_format.id < 6
    returns = np.bincount(np.asarray(las.return_number), minlength=16)[1:].tolist()
    wrong = []
    legacy = [len(las.points), *returns[:5]] if is_legacy else [0] * 6
    if list(struct.unpack_from("<6I", raw, 107)) != legacy:
        wrong.append("header: legacy counts")
    if raw[25] >= 4 and list(struct.unpack_from("<16Q", raw, 247)) != [len(las.points), *returns]:
        wrong.append("header: counts")
    bounds = np.array(struct.unpack_from("<6d", raw, 179)).reshape(3, 2).T
    found = np.stack([las.xyz.max(axis=0), las.xyz.min(axis=0)])
    if (np.abs(bounds - found) > np.abs(las.header.scales) * 0.51).any():
        wrong.append("header: bounds")
    return wrong


def _label_column_differences(las: laspy.LasData, scheme: ClassScheme) -> list[str]:
    """Added dimensions and classification, which have to say the same."""
    codes = np.array([info.asprs for info in scheme.classes])
    if las.point_format.id < 6:
        codes[codes > _LEGACY_CODES] = _UNCLASSIFIED
    columns = {name: np.asarray(las[name]) for name in las.point_format.extra_dimension_names}
    return _index_differences(columns, scheme, np.asarray(las.classification), codes, _UNCLASSIFIED)


def _index_differences(
    columns: Columns,
    scheme: ClassScheme,
    labels: NDArray[Any],
    codes: NDArray[Any],
    unlabelled: int,
) -> list[str]:
    """Whether `class_index` is a class at every point, and the format's own label is its code."""
    expected = {"class_index": np.uint8, "confidence": np.float32}
    if scheme.bush_index is not None:
        expected["bush_probability"] = np.float32
    wrong = [
        f"added column {name}"
        for name, dtype in expected.items()
        if name not in columns or columns[name].dtype != dtype
    ]
    if wrong:
        return wrong
    index = columns["class_index"]
    if not ((index < scheme.num_classes) | (index == _UNLABELLED_INDEX)).all():
        return ["class_index beyond the scheme's classes"]
    table = np.full(_UNLABELLED_INDEX + 1, unlabelled)
    table[: len(codes)] = codes
    if not np.array_equal(table[index], labels):
        wrong.append("class codes that contradict class_index")
    for name in expected:
        values = columns[name]
        if name != "class_index" and not ((values >= 0) & (values <= 1)).all():
            wrong.append(f"{name} outside 0 to 1")
    return wrong


def _vlrs(raw: bytes) -> list[Record]:
    start, count = struct.unpack_from("<H", raw, 94)[0], struct.unpack_from("<I", raw, 100)[0]
    return _walk(raw, start, count, "<H16sHH32s")


def _evlrs(raw: bytes) -> list[Record]:
    if raw[25] < 4:
        return []
    start, count = struct.unpack_from("<QI", raw, 235)
    return _walk(raw, start, count, "<H16sHQ32s")


def _walk(raw: bytes, at: int, count: int, layout: str) -> list[Record]:
    records = []
    for _ in range(count):
        _, user_id, record_id, length, description = struct.unpack_from(layout, raw, at)
        at += struct.calcsize(layout)
        payload = raw[at : at + length]
        records.append((user_id.rstrip(b"\0"), record_id, description, payload))
        at += length
    return records
