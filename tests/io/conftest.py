"""Small scans, spelled out byte by byte, that several tests read, damage or copy."""

import struct

import numpy as np
import pytest

XYZ = [(1.0, 2.0, 3.0), (-4.5, 5.25, 0.125)]


def _ply(encoding: str, order: str) -> bytes:
    header = (
        f"ply\nformat {encoding} 1.0\ncomment two points\nelement vertex 2\n"
        "property float x\nproperty float y\nproperty double z\nproperty uchar red\n"
        "property short scalar_Classification\nelement face 1\n"
        "property list uchar int vertex_indices\nend_header\n"
    ).encode()
    rows = [(*XYZ[0], 255, -1), (*XYZ[1], 7, 300)]
    if encoding == "ascii":
        return header + "".join(" ".join(map(str, row)) + "\n" for row in rows).encode() + b"1 0\n"
    body = b"".join(struct.pack(order + "ffdBh", *row) for row in rows)
    return header + body + struct.pack(order + "Bi", 1, 0)


def _pcd(encoding: str) -> bytes:
    header = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z ring _ label\n"
        "SIZE 4 4 8 2 1 4\nTYPE F F F U U I\nCOUNT 1 1 1 1 3 1\nWIDTH 1\nHEIGHT 2\n"
        f"VIEWPOINT 10 20 30 1 0 0 0\nPOINTS 2\nDATA {encoding}\n"
    ).encode()
    rows = [(*XYZ[0], 65535, 0, 0, 0, -1), (*XYZ[1], 3, 0, 0, 0, 9)]
    if encoding == "ascii":
        return header + "".join(" ".join(map(str, row)) + "\n" for row in rows).encode()
    if encoding == "binary":
        return header + b"".join(struct.pack("<ffdHBBBi", *row) for row in rows)
    by_field = b"".join(
        struct.pack("<" + kind, *(row[column] for row in rows))
        for column, kind in enumerate(["ff", "ff", "dd", "HH"])
    )
    by_field += bytes(6) + struct.pack("<ii", -1, 9)
    literals = b"".join(
        bytes([len(run) - 1]) + run
        for run in (by_field[at : at + 32] for at in range(0, len(by_field), 32))
    )
    return header + struct.pack("<II", len(literals), len(by_field)) + literals


@pytest.fixture(scope="session")
def samples() -> dict[str, bytes]:
    """File name to content; each holds the points `XYZ` and some attributes."""
    bin_rows = b"".join(struct.pack("<4f", *row, 0.5) for row in XYZ)
    return {
        "ascii.ply": _ply("ascii", "="),
        "little.ply": _ply("binary_little_endian", "<"),
        "big.ply": _ply("binary_big_endian", ">"),
        "ascii.pcd": _pcd("ascii"),
        "binary.pcd": _pcd("binary"),
        "compressed.pcd": _pcd("binary_compressed"),
        "frame.bin": bin_rows,
        "semantic3d.txt": b"1 2 3 -1800 10 20 30\n-4.5 5.25 0.125 7 1 2 3\n",
        "named.csv": b"X,Y,Z,class\n1,2,3,2\n-4.5,5.25,0.125,-1\n",
    }


@pytest.fixture(scope="session")
def xyz() -> np.ndarray:
    return np.array(XYZ)
