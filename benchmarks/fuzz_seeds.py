"""Small sound files for `fuzz.py` to damage, made on the spot, and where their numbers stand.

A seed knows the places of its header's numbers, so that a mutation can lie in one field and leave
all else sound: that gets farther than flipping bits does.
"""

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import laspy
import lazrs
import numpy as np
from laspy.vlrs.known import WktCoordinateSystemVlr
from laspy.vlrs.vlrlist import VLRList

NUM_POINTS = 30
_LAS_HEADER = "HHIHH8sBB32s32sHHHIIBHI5I12dQQIQ15Q"  # from byte 4
_VLR, _EVLR = "H16sHH32s", "H16sHQ32s"
_LASZIP = "HHBBHIIqqH"
_DESCRIPTOR = "HBB32sI24s24s24s3d3d32s"


@dataclass(frozen=True)
class Seed:
    """A sound file.

    Attributes:
        name: Its file name; the suffix says which reader it is for.
        raw: Its bytes.
        fields: Position and struct code of each number in it that a reader believes.
        text_start: Where its text begins.
        text_end: Where its text ends; 0 if it has none.
        container: What wraps it, a key of `fuzz_containers.CONTAINERS`, or "".
    """

    name: str
    raw: bytes
    fields: tuple[tuple[int, str], ...] = ()
    text_end: int = 0
    text_start: int = 0
    container: str = ""


def las_seeds(folder: Path) -> Iterator[Seed]:
    """LAS of several versions and point formats, with VLRs, EVLRs and extra bytes."""
    for minor, point_format in ((2, 3), (3, 4), (4, 6), (4, 7), (4, 10)):
        raw = _las(folder / "a.las", f"1.{minor}", point_format)
        yield Seed("a.las", raw, tuple(las_fields(raw)))


def laz_seeds(folder: Path) -> Iterator[Seed]:
    """LAZ, point-wise and layered, of one chunk and of several."""
    for minor, point_format in ((2, 1), (2, 3), (4, 6), (4, 8)):
        raw = _las(folder / "a.laz", f"1.{minor}", point_format)
        yield Seed("a.laz", raw, tuple(las_fields(raw)))
        raw = _chunked(folder / "a.las", f"1.{minor}", point_format, copc=False)
        yield Seed("a.laz", raw, tuple(las_fields(raw)))


def copc_seeds(folder: Path) -> Iterator[Seed]:
    """COPC: chunks of various sizes, an info VLR and a page of the hierarchy."""
    for point_format in (6, 7, 8):
        raw = _chunked(folder / "a.las", "1.4", point_format, copc=True)
        yield Seed("a.copc.laz", raw, tuple(las_fields(raw)))


def ply_seeds(_: Path) -> Iterator[Seed]:
    """PLY in all three encodings, with an element of lists before the vertices or behind them."""
    rng = np.random.default_rng(1)
    rows = [(*rng.normal(size=3), *rng.integers(0, 99, 2)) for _ in range(NUM_POINTS)]
    vertex = (
        f"element vertex {NUM_POINTS}\nproperty float x\nproperty double y\nproperty float z\n"
        "property uchar red\nproperty short label\n"
    )
    for encoding, order in (
        ("ascii", ""),
        ("binary_little_endian", "<"),
        ("binary_big_endian", ">"),
    ):
        if order:
            points = b"".join(struct.pack(order + "fdfBh", *row) for row in rows)
            faces = struct.pack(order + "BiiiBi", 3, 0, 1, 2, 1, 5)
        else:
            points = "".join(" ".join(map(str, row)) + "\n" for row in rows).encode()
            faces = b"3 0 1 2\n1 5\n"
        face = "element face 2\nproperty list uchar int vertex_indices\n"
        for parts, body in (((vertex, face), points + faces), ((face, vertex), faces + points)):
            head = f"ply\nformat {encoding} 1.0\ncomment a\n{''.join(parts)}end_header\n".encode()
            yield Seed("a.ply", head + body, (), len(head) if order else len(head + body))


def pcd_seeds(_: Path) -> Iterator[Seed]:
    """PCD in all three encodings."""
    rng = np.random.default_rng(2)
    dtype = np.dtype([("x", "<f4"), ("y", "<f8"), ("z", "<f4"), ("rgb", "<u1", 3), ("l", "<i2")])
    table = np.zeros(NUM_POINTS, dtype)
    for name in "xyz":
        table[name] = rng.normal(size=NUM_POINTS)
    table["l"] = rng.integers(0, 9, NUM_POINTS)
    for encoding in ("ascii", "binary", "binary_compressed"):
        head = (
            "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z rgb label\nSIZE 4 8 4 1 2\nTYPE F F F U I\n"
            f"COUNT 1 1 1 3 1\nWIDTH {NUM_POINTS // 2}\nHEIGHT 2\nVIEWPOINT 1 2 3 1 0 0 0\n"
            f"POINTS {NUM_POINTS}\nDATA {encoding}\n"
        ).encode()
        if encoding == "ascii":
            lines = (" ".join(map(str, (*row[:3], *row[3], row[4]))) for row in table.tolist())
            yield Seed("a.pcd", whole := head + "\n".join(lines).encode() + b"\n", (), len(whole))
        elif encoding == "binary":
            yield Seed("a.pcd", head + table.tobytes(), (), len(head))
        else:
            columns = b"".join(table[name].tobytes() for name in dtype.names or ())
            packed = _lzf(columns)
            sizes = struct.pack("<II", len(packed), len(columns))
            fields = tuple(_fields("II", len(head)))
            yield Seed("a.pcd", head + sizes + packed, fields, len(head))


def kitti_seeds(_: Path) -> Iterator[Seed]:
    """A KITTI frame; it has no header."""
    points = np.random.default_rng(3).normal(size=(NUM_POINTS, 4)).astype("<f4")
    yield Seed("a.bin", points.tobytes(), tuple(_fields("f" * 120)))


def text_seeds(_: Path) -> Iterator[Seed]:
    """Semantic3D's rows, a CSV with a header, rows under a comment and under a count."""
    rng = np.random.default_rng(4)
    rows = np.column_stack([rng.normal(size=(NUM_POINTS, 3)), rng.integers(0, 9, (NUM_POINTS, 4))])
    for name, head, separator in (
        ("a.txt", "", " "),
        ("a.csv", "X,Y,Z,intensity,red,green,class\n", ","),
        ("a.xyz", "# x y z i r g label\n\n", "\t"),
        ("a.txt", f"{NUM_POINTS}\n// a comment\n", " "),
        ("a.csv", "x;y;z;i;r;g;label\r\n", ";"),
    ):
        lines = (separator.join(f"{value:g}" for value in row) for row in rows)
        raw = (head + ("\r\n" if ";" in head else "\n").join(lines)).encode()
        yield Seed(name, raw, (), len(raw))


def las_fields(raw: bytes) -> Iterator[tuple[int, str]]:
    """Each number of a LAS or LAZ file's header, records and chunk table, with its place."""
    minor = raw[25]
    end = {2: 227, 3: 235, 4: 375}[minor]
    yield from (field for field in _fields(_LAS_HEADER, 4) if field[0] < end)
    position, points, num_vlrs = struct.unpack_from("<HII", raw, 94)
    walks = [(position, num_vlrs, _VLR)]
    if minor == 4:
        start, count = struct.unpack_from("<QI", raw, 235)
        walks.append((start, count, _EVLR))
    for position, count, layout in walks:
        for _ in range(count):
            yield from _fields(layout, position)
            _, user, record, length, _ = struct.unpack_from("<" + layout, raw, position)
            position += struct.calcsize("<" + layout)
            if user.startswith(b"laszip"):
                yield from _fields(_LASZIP + "H" * 12, position)
            elif user.startswith(b"LASF_Spec") and record == 4:
                yield from _fields(_DESCRIPTOR, position)
            elif user.startswith(b"copc"):
                yield from _fields("d" * 5 + "QQ" if record == 1 else "iiiiQii" * 2, position)
            position += length
    if raw[104] & 0x80:
        (table,) = struct.unpack_from("<q", raw, points)
        yield from _fields("q", points)
        yield from _fields("IIBBBB", table)
        (length,) = struct.unpack_from("<H", raw, 105)
        yield from _fields("I" * 11, points + 8 + length)  # a layered chunk's count and sizes


def _fields(layout: str, start: int = 0) -> Iterator[tuple[int, str]]:
    """Position and code of each number that a struct layout describes."""
    digits = ""
    for code in layout:
        if code.isdigit():
            digits += code
            continue
        for _ in range(1 if code == "s" else int(digits or 1)):
            if code != "s":
                yield start, code
            start += int(digits) if code == "s" else struct.calcsize("<" + code)
        digits = ""


def _las(path: Path, version: str, point_format: int, count: int = NUM_POINTS) -> bytes:
    header = laspy.LasHeader(version=version, point_format=point_format)
    header.scales, header.offsets = [0.01, 0.02, 0.003], [1e6, 6.6e6, -100]
    header.vlrs.append(WktCoordinateSystemVlr('PROJCRS["a"]'))
    header.vlrs.append(laspy.VLR("LASF_Projection", 34735, "", struct.pack("<8H", *[1] * 8)))
    header.add_extra_dim(laspy.ExtraBytesParams("height", "i2", offsets=[0.5], scales=[0.1]))
    rng = np.random.default_rng(point_format)
    dtype = header.point_format.dtype()
    records = rng.integers(0, 256, count * dtype.itemsize, np.uint8).view(dtype).copy()
    if "gps_time" in (dtype.names or ()):
        records["gps_time"] = rng.random(count)
    if point_format >= 9:
        records["classification_flags"] &= 0xCF  # one channel: lazrs garbles several
    with laspy.open(path, "w", header=header) as writer:
        writer.write_points(laspy.PackedPointRecord(records, header.point_format))
        if version == "1.4":
            writer.write_evlrs(VLRList([laspy.VLR("someone", 9, "", bytes(99))]))
    return path.read_bytes()


def _chunked(path: Path, version: str, point_format: int, *, copc: bool) -> bytes:
    """A LAZ file of several chunks: uncompressed LAS with its points and records exchanged."""
    raw = bytearray(_las(path, version, point_format))
    start, num_vlrs, _, length = struct.unpack_from("<IIBH", raw, 96)
    size, points = struct.unpack_from("<H", raw, 94)[0], bytes(raw[start:])
    vlr = lazrs.LazVlr.new_for_compression(point_format, length - _length(point_format), True)
    laszip = bytes(vlr.record_data())
    added = struct.pack("<" + _VLR, 0, b"laszip encoded", 22204, len(laszip), b"") + laszip
    if copc:
        info = struct.pack("<5d2Q2d11Q", 1e6, 6.6e6, 0, 9, 1, 0, 64, *[0.0] * 2, *[0] * 11)
        added = struct.pack("<" + _VLR, 0, b"copc", 1, len(info), b"") + info + added
    head = raw[:size] + added + raw[size:start]
    struct.pack_into("<IIB", head, 96, start + len(added), num_vlrs + 1 + copc, 0x80 | point_format)
    with path.open("w+b") as file:
        file.write(head)
        compressor = lazrs.LasZipCompressor(file, vlr)
        at = 0
        for count in (NUM_POINTS // 2, NUM_POINTS // 3, NUM_POINTS - NUM_POINTS * 5 // 6):
            compressor.compress_many(np.frombuffer(points[at : at + count * length], np.uint8))
            compressor.finish_current_chunk()
            at += count * length
        compressor.done()
        if version == "1.4":
            end = file.seek(0, 2)
            pages = struct.pack("<4iQ2i", 0, 0, 0, 0, len(head) + 8, 50, 15)
            pages += struct.pack("<4iQ2i", 1, 0, 0, 0, end + 60, 64, -1)  # a page that is itself
            key = (b"copc", 1000) if copc else (b"someone", 9)
            file.write(struct.pack("<" + _EVLR, 0, *key, len(pages), b"") + pages)
            file.seek(235)
            file.write(struct.pack("<QI", end, 1))
    return path.read_bytes()


def _length(point_format: int) -> int:
    return int(laspy.PointFormat(point_format).size)


def _lzf(data: bytes) -> bytes:
    """LZF of literals, and of a copy where a byte is repeated."""
    out = b""
    for at in range(0, len(data), 32):
        run = data[at : at + 32]
        out += (
            bytes([0, run[0], 0xE0, len(run) - 10, 0])
            if len(run) == 32 and len(set(run)) == 1
            else bytes([len(run) - 1]) + run
        )
    return out


SEEDS: dict[str, Callable[[Path], Iterator[Seed]]] = {
    "LAS": las_seeds,
    "LAZ": laz_seeds,
    "COPC": copc_seeds,
    "PLY": ply_seeds,
    "PCD": pcd_seeds,
    "KITTI": kitti_seeds,
    "text": text_seeds,
}
