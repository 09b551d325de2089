"""What one LAS point record holds: its fields, their places and their names.

A record is read as one numpy structured array whose bytes are exactly the file's. Names are those
of laspy, whose tables of the standard fields are used. Extra bytes follow the standard fields, in
the order of their descriptors (LAS 1.4 R15, table 24).
"""

import struct
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np
from laspy.point.dims import ALL_POINT_FORMATS_DTYPE, get_sub_fields_dict
from numpy.typing import NDArray

from bushseg.errors import WriteError
from bushseg.parallel import for_chunks
from bushseg.points import AttributeArray, FloatArray

EXTRA_BYTES_RECORD = ("LASF_Spec", 4)
UNDESCRIBED = "ExtraBytes"
NAME_BYTES = 32
_DESCRIPTOR = struct.Struct("<2xBB32s4x72s3d3d32s")
DESCRIPTOR_BYTES = _DESCRIPTOR.size
_SCALE_BIT, _OFFSET_BIT = 0x08, 0x10
_MAX_PAYLOAD = 65535
# Data type 1 to 10; 11 to 20 are pairs of them and 21 to 30 triples, deprecated but met.
_TYPES = ("u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8")
# What LAS has no type for, and the smallest that holds it.
_WIDENED = {"b1": "u1", "f2": "f4"}
_CHUNK = 65_536  # records a thread takes at a time

Records = NDArray[np.void]


@dataclass(frozen=True, slots=True, eq=False)
class ExtraDimension:
    """One described stretch of extra bytes.

    Attributes:
        name: Unique within its layout: a name met before gets the suffix _2, _3, ...
        dtype: As stored; a multi-valued dimension has a sub-array dtype.
        descriptor: Its 192 bytes in the extra bytes VLR.
        scale: Factor and offset of each value, shape (2, M), float64; None if it isn't scaled.
    """

    name: str
    dtype: np.dtype[Any]
    descriptor: bytes
    scale: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PointLayout:
    """The fields of a point record.

    Attributes:
        point_format: 0 to 10.
        extras: The described extra bytes, in order.
        num_undescribed: Trailing extra bytes that no descriptor covers.
    """

    point_format: int
    extras: tuple[ExtraDimension, ...] = ()
    num_undescribed: int = 0

    @property
    def dtype(self) -> np.dtype[Any]:
        """The record as a packed structured dtype, little endian."""
        fields: list[Any] = list(ALL_POINT_FORMATS_DTYPE[self.point_format].descr)
        fields += [(extra.name, extra.dtype) for extra in self.extras]
        if self.num_undescribed:
            fields.append((self._undescribed_name(), np.dtype(("u1", (self.num_undescribed,)))))
        return np.dtype(fields)

    def attribute_dtypes(self) -> dict[str, np.dtype[Any]]:
        """Name and dtype of each attribute that :meth:`attributes` gives."""
        empty = np.empty(0, self.dtype)
        return {
            name: column.dtype if column.ndim == 1 else np.dtype((column.dtype, column.shape[1:]))
            for name, column in self.attributes(empty).items()
        }

    def attributes(self, records: Records) -> dict[str, AttributeArray]:
        """Every field but X, Y and Z, bit fields taken apart and scaled dimensions scaled.

        Args:
            records: Point records of :attr:`dtype`, shape (N,).

        Returns:
            Name to a column of its own, shape (N,) or (N, M). A no-data value stays what it is.
        """
        parts: dict[str, list[tuple[str, int]]] = {}
        for name, (packed, field) in get_sub_fields_dict(self.point_format).items():
            parts.setdefault(packed, []).append((name, field.mask))
        scales = {extra.name: extra.scale for extra in self.extras}
        columns: dict[str, AttributeArray] = {}
        for field_name in self.dtype.names or ():
            if field_name in ("X", "Y", "Z"):
                continue
            column = np.ascontiguousarray(records[field_name])
            scale = scales.get(field_name)
            if field_name in parts:
                for name, mask in parts[field_name]:
                    columns[name] = (column & mask) >> (mask & -mask).bit_length() - 1
            elif scale is not None:
                factor, offset = scale if column.ndim == 2 else scale[:, 0]
                columns[field_name] = column * factor + offset
            else:
                columns[field_name] = column
        return columns

    def described(self) -> tuple[bytes, ...]:
        """One descriptor after another for all extra bytes, the undescribed ones included.

        Descriptors are positional, so whoever adds a dimension has to account for every byte
        before it: type 0 stands for as many bytes as its options say.
        """
        descriptors = [extra.descriptor for extra in self.extras]
        for start in range(0, self.num_undescribed, 255):
            num_bytes = min(255, self.num_undescribed - start)
            descriptors.append(_pack_descriptor(UNDESCRIBED, 0, num_bytes))
        return tuple(descriptors)

    def with_added(
        self, name: str, dtype: np.dtype[Any], reserved: Collection[str] = ()
    ) -> tuple["PointLayout", str]:
        """Make room for a column, or find the room it already has.

        An extra dimension of this name and dtype that isn't scaled is reused: labelling a labelled
        file again replaces what was there. Otherwise a name that is taken gets the suffix _2, _3...

        Args:
            name: The column's name, cut to 32 bytes.
            dtype: Its dtype, one value a point.
            reserved: Dimensions that may not be reused.

        Returns:
            The layout and the name the column has in it.

        Raises:
            WriteError: LAS has no type for this column.
        """
        stored = las_dtype(name, dtype)
        base = shorten(name)
        taken = self._names()
        own = {extra.name: extra for extra in self.extras}
        for candidate in _candidates(base):
            extra = own.get(candidate)
            if extra is not None and extra.scale is None and extra.dtype == stored:
                if candidate in reserved:
                    continue
                return self, candidate
            if candidate not in taken:
                break
        descriptor = _pack_descriptor(candidate, _TYPES.index(stored.str[1:]) + 1, 0)
        extra = ExtraDimension(candidate, stored, descriptor)
        extras = self.extras + self._undescribed_as_extras() + (extra,)
        layout = PointLayout(self.point_format, extras)
        if DESCRIPTOR_BYTES * len(extras) > _MAX_PAYLOAD or layout.dtype.itemsize > 0xFFFF:
            raise WriteError(f"no room for {name!r} in a LAS point record; choose .ply instead")
        return layout, candidate

    def _undescribed_as_extras(self) -> tuple[ExtraDimension, ...]:
        if not self.num_undescribed:
            return ()
        names = _candidates(self._undescribed_name())
        return tuple(
            ExtraDimension(next(names), np.dtype(("u1", (descriptor[3],))), descriptor)
            for descriptor in self.described()[len(self.extras) :]
        )

    def _undescribed_name(self) -> str:
        taken = _standard_names(self.point_format) | {extra.name for extra in self.extras}
        return _unique(UNDESCRIBED, taken)

    def _names(self) -> set[str]:
        return _standard_names(self.point_format) | set(self.dtype.names or ())


def parse_layout(point_format: int, num_extra_bytes: int, payload: bytes) -> PointLayout:
    """Read the descriptors of the extra bytes.

    Descriptors that contradict the record's length, or name a type that doesn't exist, can't tell
    where anything is: all extra bytes then count as undescribed.

    Args:
        point_format: 0 to 10.
        num_extra_bytes: How many bytes follow the standard fields in each record.
        payload: The extra bytes VLR's content; empty if there is none.
    """
    extras: list[ExtraDimension] = []
    taken = _standard_names(point_format)
    left = num_extra_bytes
    for start in range(0, len(payload) - DESCRIPTOR_BYTES + 1, DESCRIPTOR_BYTES):
        extra = _parse_descriptor(payload[start : start + DESCRIPTOR_BYTES], taken)
        if extra is None or extra.dtype.itemsize > left:
            return PointLayout(point_format, (), num_extra_bytes)
        extras.append(extra)
        taken.add(extra.name)
        left -= extra.dtype.itemsize
    return PointLayout(point_format, tuple(extras), left)


def las_dtype(name: str, dtype: np.dtype[Any]) -> np.dtype[Any]:
    """The little-endian LAS type that holds every value of `dtype`.

    Raises:
        WriteError: There is none.
    """
    code = dtype.str[1:]
    code = _WIDENED.get(code, code)
    if code not in _TYPES:
        raise WriteError(f"LAS can't hold {name!r}, which is {dtype}; choose .ply instead")
    return np.dtype(f"<{code}")


def shorten(name: str, room: int = NAME_BYTES) -> str:
    """Cut a name to `room` bytes of UTF-8, between characters."""
    return name.encode()[:room].decode("utf-8", "ignore")


def scale_coordinates(
    records: Records, scales: Sequence[float] | FloatArray, offsets: Sequence[float] | FloatArray
) -> FloatArray:
    """X, Y and Z in the file's unit, shape (N, 3), float64."""
    xyz = np.empty((len(records), 3))

    def scale(start: int, stop: int) -> None:
        for axis, name in enumerate("XYZ"):
            np.multiply(records[name][start:stop], scales[axis], out=xyz[start:stop, axis])
            xyz[start:stop, axis] += offsets[axis]

    for_chunks(scale, len(records), _CHUNK)
    return xyz


def _parse_descriptor(raw: bytes, taken: set[str]) -> ExtraDimension | None:
    kind, options, name_bytes, _, *numbers, _ = _DESCRIPTOR.unpack(raw)
    name = name_bytes.split(b"\0")[0].decode("utf-8", "replace")
    name = _unique(name or UNDESCRIBED, taken)
    if kind == 0:
        return ExtraDimension(name, np.dtype(("u1", (options,))), raw) if options else None
    if kind > 3 * len(_TYPES):
        return None
    width, code = (kind - 1) // len(_TYPES) + 1, _TYPES[(kind - 1) % len(_TYPES)]
    dtype = np.dtype(f"<{code}") if width == 1 else np.dtype((f"<{code}", (width,)))
    factors = np.array(numbers[:width] if options & _SCALE_BIT else [1.0] * width)
    shifts = np.array(numbers[3 : 3 + width] if options & _OFFSET_BIT else [0.0] * width)
    scaled = options & (_SCALE_BIT | _OFFSET_BIT)
    # A scale of 0 or NaN would wipe every value out: such a descriptor doesn't mean it.
    if not scaled or not np.isfinite([factors, shifts]).all() or not factors.all():
        return ExtraDimension(name, dtype, raw)
    return ExtraDimension(name, dtype, raw, np.stack([factors, shifts]))


def _pack_descriptor(name: str, kind: int, options: int) -> bytes:
    return _DESCRIPTOR.pack(kind, options, name.encode(), b"", *[0.0] * 6, b"")


def _standard_names(point_format: int) -> set[str]:
    fields = set(ALL_POINT_FORMATS_DTYPE[point_format].names or ())
    return fields | set(get_sub_fields_dict(point_format)) | {"x", "y", "z"}


def _candidates(base: str) -> Iterator[str]:
    """`base`, base_2, base_3, ... each within the length a name may have."""
    yield base
    for number in count(2):
        suffix = f"_{number}"
        yield shorten(base, NAME_BYTES - len(suffix)) + suffix


def _unique(base: str, taken: set[str]) -> str:
    return next(name for name in _candidates(base) if name not in taken)
