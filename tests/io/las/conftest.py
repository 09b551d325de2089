"""Small LAS files made by laspy, and their bytes taken apart without bushseg."""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from uuid import UUID

import laspy
import numpy as np
import pytest
from laspy.vlrs.known import WktCoordinateSystemVlr
from laspy.vlrs.vlrlist import VLRList

VERSIONS = {"1.0": 2, "1.1": 2, "1.2": 4, "1.3": 6, "1.4": 11}  # to how many point formats
WKT = 'PROJCRS["a",BASEGEOGCRS["b"]]'
NUM_POINTS = 100


@dataclass
class Parts:
    """A LAS file as bytes: nothing here knows what bushseg thinks of them."""

    raw: bytes

    def get(self, layout: str, at: int) -> tuple:
        return struct.unpack_from("<" + layout, self.raw, at)

    @property
    def num_points(self) -> int:
        (minor,) = self.get("B", 25)
        return self.get("Q", 247)[0] if minor == 4 else self.get("I", 107)[0]

    @property
    def records(self) -> np.ndarray:
        """Raw records of uncompressed points, shape (N, record length), uint8."""
        (start,), (length,) = self.get("I", 96), self.get("H", 105)
        body = self.raw[start : start + self.num_points * length]
        return np.frombuffer(body, np.uint8).reshape(self.num_points, length)

    @property
    def vlrs(self) -> list[tuple[bytes, bytes]]:
        """Head and payload of each VLR."""
        (position,), (count,) = self.get("H", 94), self.get("I", 100)
        return self._walk(position, count, "H", 54)

    @property
    def evlrs(self) -> list[tuple[bytes, bytes]]:
        position, count = self.get("QI", 235)
        return self._walk(position, count, "Q", 60)

    def _walk(self, position: int, count: int, length: str, size: int) -> list[tuple[bytes, bytes]]:
        found = []
        for _ in range(count):
            (payload,) = self.get(length, position + 20)
            end = position + size + payload
            assert end <= len(self.raw)
            found.append((self.raw[position : position + size], self.raw[position + size : end]))
            position = end
        return found


def random_records(dtype: np.dtype, count: int) -> np.ndarray:
    """Every bit of every field drawn, but for times, which laspy compares."""
    rng = np.random.default_rng(7)
    records = rng.integers(0, 256, count * dtype.itemsize, np.uint8).view(dtype).copy()
    if "gps_time" in dtype.names:
        records["gps_time"] = rng.random(count)
    if "x_t" in dtype.names and "classification_flags" in dtype.names:
        records["classification_flags"] &= 0xCF  # one channel: lazrs garbles several
    return records


def write_las(
    path: Path,
    version: str = "1.4",
    point_format: int = 7,
    extras: tuple[laspy.ExtraBytesParams, ...] = (),
    evlrs: bool = False,
    count: int = NUM_POINTS,
) -> Path:
    """Write a file whose identity, VLRs and gaps are all unlike any default."""
    header = laspy.LasHeader(
        version="1.1" if version == "1.0" else version, point_format=point_format
    )
    header.scales, header.offsets = [0.01, 0.02, 0.003], [1e6, 6.6e6, -100]
    header.file_source_id = 77
    header.global_encoding.value = 0x11 if point_format >= 6 else 0x01
    header.uuid = UUID(int=12345678901234567890)
    header.system_identifier, header.generating_software = "a scanner", "a program"
    header.creation_date = date(2011, 2, 3)
    header.extra_header_bytes, header.extra_vlr_bytes = b"behind the header", b"before the points"
    header.vlrs.append(laspy.VLR("someone", 3, "odd \xe9", b"\x00\xff payload"))
    header.vlrs.append(WktCoordinateSystemVlr(WKT))
    header.add_extra_dims(list(extras))
    with laspy.open(path, "w", header=header, encoding_errors="ignore") as writer:
        records = random_records(header.point_format.dtype(), count)
        writer.write_points(laspy.PackedPointRecord(records, header.point_format))
        if evlrs:
            long = laspy.VLR("someone", 9, "long", bytes(range(256)) * 300)
            writer.write_evlrs(VLRList([long, laspy.VLR("else", 1, "", b"short")]))
    if version == "1.0":
        patch(path, 25, "B", 0)
    return path


def patch(path: Path, at: int, layout: str, *values: float) -> None:
    raw = bytearray(path.read_bytes())
    struct.pack_into("<" + layout, raw, at, *values)
    path.write_bytes(raw)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if {"version", "point_format"} <= set(metafunc.fixturenames):
        pairs = [(version, n) for version, count in VERSIONS.items() for n in range(count)]
        metafunc.parametrize(("version", "point_format"), pairs)


@pytest.fixture
def make_las(tmp_path: Path) -> Callable[..., Path]:
    """Write a small LAS or LAZ file: `make_las("a.laz", version="1.4", point_format=6)`."""
    return lambda name, **options: write_las(tmp_path / name, **options)


@pytest.fixture
def parts() -> Callable[[Path], Parts]:
    return lambda path: Parts(path.read_bytes())


@pytest.fixture
def patch_file() -> Callable[..., None]:
    return patch


@pytest.fixture(scope="session")
def small_files(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, int], bytes]:
    """Name and point format to the bytes of a valid file with EVLRs."""
    folder = tmp_path_factory.mktemp("small")
    return {
        (name, number): write_las(
            folder / name, point_format=number, evlrs=True, count=40
        ).read_bytes()
        for name in ("a.las", "a.laz")
        for number in (3, 7)
    }


@pytest.fixture(scope="session")
def scans() -> Path:
    """The folder of real scans."""
    folder = Path(__file__).parents[4] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"no real scans in {folder}")
    return folder
