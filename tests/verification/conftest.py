"""Scans whose every field is drawn, and copies of them as predict makes them."""

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

from bushseg import io
from bushseg.labels import SCHEMES

ADDED = {"class_index": "u1", "confidence": "f4", "bush_probability": "f4"}


@dataclass(frozen=True)
class Recipe:
    """A scan to be written."""

    version: str = "1.4"
    point_format: int = 7
    extras: tuple[laspy.ExtraBytesParams, ...] = ()
    evlrs: bool = False
    crs_in_evlr: bool = False
    undescribed: int = 0
    num_points: int = 40
    seed: int = 0


def write_scan(path: Path, recipe: Recipe) -> Path:
    """A file unlike any default, its points within ten metres."""
    is_old = recipe.version == "1.0"  # laspy doesn't write it
    header = laspy.LasHeader(
        version="1.1" if is_old else recipe.version, point_format=recipe.point_format
    )
    header.scales, header.offsets = [0.01, 0.01, 0.02], [1e6, 6.6e6, -100]
    header.file_source_id = 77
    header.global_encoding.value = 0x11 if recipe.point_format >= 6 else 0x01
    header.uuid = UUID(int=12345678901234567890)
    header.system_identifier, header.generating_software = "a scanner", "a program"
    header.creation_date = date(2011, 2, 3)
    header.extra_header_bytes, header.extra_vlr_bytes = b"behind", b"before the points"
    header.vlrs.append(laspy.VLR("someone", 3, "odd", b"\x00\xff payload"))
    crs = WktCoordinateSystemVlr('PROJCRS["a",BASEGEOGCRS["b"]]')
    if not recipe.crs_in_evlr:
        header.vlrs.append(crs)
    header.add_extra_dims(list(recipe.extras))
    if recipe.undescribed:
        header.add_extra_dim(laspy.ExtraBytesParams("gone", f"{recipe.undescribed}u1"))
    rng = np.random.default_rng(recipe.seed)
    dtype = header.point_format.dtype()
    raw = rng.integers(0, 256, recipe.num_points * dtype.itemsize, np.uint8)
    records = raw.view(dtype).copy()
    for name in "XYZ":
        records[name] = rng.integers(-500, 500, recipe.num_points)
    if "gps_time" in dtype.names:
        records["gps_time"] = rng.random(recipe.num_points)
    if "classification_flags" in dtype.names:
        records["classification_flags"] &= 0xCF  # one channel: lazrs garbles several
    evlrs = [laspy.VLR("someone", 9, "long", bytes(range(256)) * 300)] * recipe.evlrs
    if recipe.crs_in_evlr:
        evlrs.append(laspy.VLR(crs.user_id, crs.record_id, "", crs.record_data_bytes()))
    with laspy.open(path, "w", header=header) as writer:
        writer.write_points(laspy.PackedPointRecord(records, header.point_format))
        if evlrs:
            writer.write_evlrs(VLRList(evlrs))
    raw_file = bytearray(path.read_bytes())
    if is_old:
        raw_file[25] = 0
    if recipe.undescribed:
        at = raw_file.index(b"gone".ljust(32, b"\0")) - 4
        raw_file[at + 2] = 31  # a type that doesn't exist: nothing is described
    path.write_bytes(raw_file)
    return path


def label_scan(source: Path, target: Path, seed: int = 5) -> Path:
    """What predict writes, with labels that are drawn."""
    rng, scheme = np.random.default_rng(seed), SCHEMES["bush"]
    suffix = io.suffix_of(target)
    added = {name: np.dtype(kind) for name, kind in ADDED.items()}
    with io.open_scan(source) as reader, io.create(target, suffix, reader, added) as writer:
        for chunk in reader.chunks(17):
            labels = rng.integers(0, 3, len(chunk)).astype(np.int16)
            columns = {
                name: rng.random(len(chunk)).astype(kind) for name, kind in ADDED.items()
            } | {"class_index": labels.astype("u1")}
            as_las = suffix in (".las", ".laz")
            writer.write(
                chunk, columns, scheme.to_asprs(labels, {}) if as_las else scheme.decode(labels)
            )
    return target


@pytest.fixture(scope="session")
def recipe() -> type[Recipe]:
    return Recipe


@pytest.fixture(scope="session")
def write() -> Callable[[Path, Recipe], Path]:
    return write_scan


@pytest.fixture(scope="session")
def label() -> Callable[..., Path]:
    return label_scan
