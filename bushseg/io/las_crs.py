"""The coordinate reference system of a LAS file, as text for people and other programs."""

import struct
from typing import BinaryIO

from bushseg.io.las_header import LasHeader

WKT_RECORD = ("LASF_Projection", 2112)
_GEO_KEYS = ("LASF_Projection", 34735)
_GEO_DOUBLES = ("LASF_Projection", 34736)
_GEO_ASCII = ("LASF_Projection", 34737)
_MAX_BYTES = 1 << 20  # An EVLR may be of any size; no CRS comes near this.

# The GeoTIFF keys met in LAS files (OGC 19-008r4, annex A).
_KEY_NAMES = {
    1024: "GTModelType",
    1025: "GTRasterType",
    1026: "GTCitation",
    2048: "GeodeticCRS",
    2049: "GeodeticCitation",
    2050: "GeodeticDatum",
    2052: "GeogLinearUnits",
    2054: "GeogAngularUnits",
    2056: "Ellipsoid",
    3072: "ProjectedCRS",
    3073: "ProjectedCitation",
    3074: "Projection",
    3076: "ProjLinearUnits",
    4096: "VerticalCRS",
    4097: "VerticalCitation",
    4099: "VerticalUnits",
}


def read_crs(header: LasHeader, file: BinaryIO) -> str | None:
    """The CRS as WKT where there is one, else the GeoTIFF keys in words, else None.

    Args:
        header: The header, whose VLRs and EVLRs are searched.
        file: The file it came from.
    """
    payloads: dict[tuple[str, int], bytes] = {}
    for record in header.vlrs + header.evlrs:
        if record.user_id == "LASF_Projection" and 0 < record.length <= _MAX_BYTES:
            payloads.setdefault(record.key, record.payload(file))
    wkt = payloads.get(WKT_RECORD, b"").decode("utf-8", "replace").strip("\0 \n")
    if wkt:
        return wkt
    if _GEO_KEYS not in payloads:
        return None
    return _keys_in_words(
        payloads[_GEO_KEYS], payloads.get(_GEO_DOUBLES, b""), payloads.get(_GEO_ASCII, b"")
    )


def _keys_in_words(keys: bytes, doubles: bytes, text: bytes) -> str | None:
    """One "name=value" a key; keys that point outside their parameters are left out."""
    shorts = struct.unpack(f"<{len(keys) // 2}H", keys[: len(keys) // 2 * 2])
    # Four numbers open the directory, the last of which counts the keys; each key is four again.
    count = shorts[3] if len(shorts) >= 4 else 0
    words = []
    for start in range(4, min(4 + 4 * count, len(shorts) - 3), 4):
        key, place, length, value = shorts[start : start + 4]
        name = _KEY_NAMES.get(key, f"key {key}")
        if place == 0:
            words.append(f"{name}={value}")
        elif place == _GEO_DOUBLES[1] and 8 * value + 8 <= len(doubles):
            words.append(f"{name}={struct.unpack_from('<d', doubles, 8 * value)[0]:g}")
        elif place == _GEO_ASCII[1] and value < len(text):
            part = text[value : value + length].decode("latin-1").strip("|\0 ")
            words.append(f"{name}={part!r}")
    return f"GeoTIFF keys: {', '.join(words)}" if words else None
