"""Scans that are tables, read by NumPy in chunks: binary and ASCII PLY and PCD, text, frames.

What is laid out otherwise (compressed PCD, lists before a PLY's vertices) is left to
:mod:`bushseg.verification.libraries`.
"""

import re
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from bushseg.errors import ReadError
from bushseg.verification.rows import Columns, Scan, columns, find_xyz, lines, records, table

_PLY_TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "float": "f4",
    "double": "f8",
    "float32": "f4",
    "float64": "f8",
}
_COLORS = ["red", "green", "blue"]
_BY_COUNT = {
    4: ["intensity"],
    6: ["red", "green", "blue"],
    7: ["intensity", "red", "green", "blue"],
}
_LABEL_FOLDERS = {
    "velodyne": "labels",
    "os1_cloud_node_kitti_bin": "os1_cloud_node_semantickitti_label_id",
}
_INTEGER = re.compile(r"[+-]?\d+")


def open_ply(path: Path) -> Scan | None:
    """A PLY whose vertices come first or behind rows of one length; None for any other."""
    elements: list[tuple[str, int, list[tuple[str, str]]]] = []
    order, num_lines = "", 0
    with path.open("rb") as file:
        while (raw := file.readline(65536)).strip() != b"end_header":
            words = [word.decode("utf-8", "backslashreplace") for word in raw.split()]
            num_lines += 1
            if not raw or num_lines > 10_000:
                raise ReadError(path, "a header without an end", "a PLY file")
            match words:
                case ["format", kind, _]:
                    order = {"ascii": "=", "binary_big_endian": ">"}.get(kind, "<")
                case ["element", name, num_rows]:
                    elements.append((name, int(num_rows), []))
                case ["property", "list", *_, name]:
                    elements[-1][2].append((name, ""))
                case ["property", kind, name]:
                    elements[-1][2].append((name, order + _PLY_TYPES[kind]))
        offset = file.tell()
    is_text = order == "="
    before = 0
    for name, count, fields in elements:
        has_lists = not all(kind for _, kind in fields)
        if name == "vertex" and not has_lists:
            dtype = np.dtype(fields)
            if is_text:
                return table(partial(lines, path, offset, before, dtype, None, count))
            return table(partial(records, path, offset + before, dtype, count))
        if has_lists and not is_text:
            return None
        before += count if is_text else count * np.dtype(fields).itemsize
    return None


def open_pcd(path: Path) -> Scan | None:
    """A PCD that isn't compressed; None for one that is."""
    entries: dict[str, list[str]] = {}
    with path.open("rb") as file:
        while "DATA" not in entries:
            raw = file.readline(65536)
            if not raw:
                raise ReadError(path, "a header without a DATA line", "a PCD file")
            words = [word.decode("utf-8", "backslashreplace") for word in raw.split()]
            if words and not words[0].startswith("#"):
                entries[words[0].upper()] = words[1:]
        offset = file.tell()
    encoding = entries["DATA"][0].lower()
    if encoding == "binary_compressed":
        return None
    names = entries.get("FIELDS", entries.get("COLUMNS", []))
    counts = [int(word) for word in entries.get("COUNT", ["1"] * len(names))]
    fields = [
        (f"\0{index}" if name == "_" else name, f"<{kind.lower()}{size}", (n,) if n > 1 else ())
        for index, (name, kind, size, n) in enumerate(
            zip(names, entries["TYPE"], entries["SIZE"], counts, strict=True)
        )
    ]
    dtype = np.dtype(fields)
    width, height = (int(entries.get(key, ["1"])[0]) for key in ("WIDTH", "HEIGHT"))
    count = int(entries["POINTS"][0]) if "POINTS" in entries else width * height
    if encoding == "ascii":
        return table(partial(lines, path, offset, 0, dtype, None, count))
    return table(partial(records, path, offset, dtype, count))


def open_frame(path: Path) -> Scan:
    """float32 x, y, z, intensity, with the class and the instance of a `.label` there is for it."""
    dtype = np.dtype([(name, "<f4") for name in ("x", "y", "z", "intensity")])
    count = path.stat().st_size // dtype.itemsize
    folder = _LABEL_FOLDERS.get(path.parent.name, path.parent.name)
    beside = [path.with_suffix(".label")]
    beside.append(path.absolute().parent.parent / folder / beside[0].name)
    labels = next((each for each in beside if each.exists()), None)
    if labels is None:
        return table(partial(records, path, 0, dtype, count))
    codes = np.memmap(labels, "<u4", "r")
    has_instances = any(
        (codes[start : start + 1_000_000] >> 16).any() for start in range(0, len(codes), 1_000_000)
    )

    def chunks(size: int) -> Iterator[Columns]:
        start = 0
        for rows in records(path, 0, dtype, count, size):
            packed = np.asarray(codes[start : start + len(rows)])
            found = columns(rows) | {"label": packed & 0xFFFF}
            yield found | ({"instance": packed >> 16} if has_instances else {})
            start += len(rows)

    return Scan(chunks)


def open_text(path: Path, *, beside: bool = True) -> Scan:
    """Rows of numbers under a header or a comment that names them, or what their number says.

    Args:
        path: The file.
        beside: Whether class codes in a `.labels` beside it are the scan's.
    """
    header: list[str] = []
    comment: list[str] = []
    offset = 0
    delimiter: str | None = None
    words: list[str] = []
    with path.open("rb") as file:
        for raw in file:
            text = raw.decode("utf-8-sig", "replace").strip()
            delimiter = next((mark for mark in ",;" if mark in text), None)
            words = [word.strip().strip('"') for word in text.lstrip("#/").strip().split(delimiter)]
            if text.startswith(("#", "//")):
                comment = words
            elif text and not _are_numbers(words):
                header = words
            elif text and not (len(words) == 1 and _INTEGER.fullmatch(words[0])):
                break
            offset += len(raw)
    names = header or (comment if len(comment) == len(words) and find_xyz(comment) else [])
    if not names:
        usual = ["x", "y", "z", *_BY_COUNT.get(len(words), [])]
        names = [*usual, *(f"c{index}" for index in range(len(usual), len(words)))]
    unique: list[str] = []
    for index, name in enumerate(names[: len(words)]):
        unique.append(f"{name}_{index}" if name in unique or not name else name)
    dtype = np.dtype([(name, "<f8") for name in unique])
    sidecar = path.with_suffix(".labels")
    if not beside or not sidecar.exists():
        return table(partial(lines, path, offset, 0, dtype, delimiter, None))

    def chunks(size: int) -> Iterator[Columns]:
        label = np.dtype([("label", "<i8")])
        name = "label" if "label" not in unique else f"label_of_{sidecar.name}"
        rows, codes = (
            lines(path, offset, 0, dtype, delimiter, None, size),
            lines(sidecar, 0, 0, label, None, None, size),
        )
        for part, added in zip(rows, codes, strict=True):
            yield columns(part) | {name: added["label"]}

    return Scan(chunks)


def _are_numbers(words: Sequence[str]) -> bool:
    try:
        [float(word) for word in words]
    except ValueError:
        return False
    return True
