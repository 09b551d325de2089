"""The extra bytes of a LAS file: which of them labelling may have changed or added."""

import re
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count

import numpy as np

from bushseg.verification.las_container import EXTRA_BYTES, RECORD_BYTES, Container, Record

LABEL_COLUMNS = {"class_index": "u1", "confidence": "f4", "bush_probability": "f4"}
"""What labelling adds: name and type."""

DESCRIPTION = b"Extra bytes".ljust(32, b"\0")
_BYTES = 192  # a descriptor's
_TYPES = ("u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8")
_SCALE, _OFFSET = 0x08, 0x10
_ADDED = re.compile(rf"({'|'.join(LABEL_COLUMNS)})(_\d+)?")
_UNDESCRIBED = b"ExtraBytes"


@dataclass(frozen=True, slots=True)
class Extra:
    """One described stretch of a record's extra bytes.

    Attributes:
        name: As its descriptor has it, with _2, _3, ... where an earlier one is called so.
        type: NumPy's name of its type; "" where it isn't one plain number.
        start: Where it begins in a record.
        size: Its bytes.
        descriptor: Its 192 bytes.
    """

    name: str
    type: str
    start: int
    size: int
    descriptor: bytes


@dataclass(frozen=True, slots=True)
class Extras:
    """All extra bytes of a file.

    Attributes:
        record: The VLR or EVLR that describes them, or None.
        described: In order; empty where the descriptors contradict the record's length.
        num_left: How many bytes at the record's end nothing describes.
        starts: Where the extra bytes begin in a record.
    """

    record: Record | None
    described: tuple[Extra, ...]
    num_left: int
    starts: int


def read_extras(container: Container) -> Extras:
    """Parse the descriptors."""
    record = next((r for r in container.vlrs + container.evlrs if r.key == EXTRA_BYTES), None)
    starts = RECORD_BYTES[container.point_format]
    num_bytes = container.record_bytes - starts
    payload = b"" if record is None else container.payload(record)
    described: list[Extra] = []
    taken: set[str] = set()
    at, end = starts, starts + num_bytes
    for first in range(0, len(payload) - _BYTES + 1, _BYTES):
        descriptor = payload[first : first + _BYTES]
        kind, options = descriptor[2], descriptor[3]
        size, plain = _size(kind, options)
        if size == 0 or at + size > end:
            return Extras(record, (), num_bytes, starts)
        name = descriptor[4:36].split(b"\0")[0].decode("utf-8", "replace")
        name = next(each for each in _candidates(name or "ExtraBytes") if each not in taken)
        taken.add(name)
        is_plain = plain and not _is_scaled(descriptor, options)
        described.append(Extra(name, _TYPES[kind - 1] if is_plain else "", at, size, descriptor))
        at += size
    return Extras(record, tuple(described), end - at, starts)


def label_columns(before: Extras, after: Extras) -> tuple[dict[str, Extra], list[str]]:
    """Find what labelling added, or wrote over as it says it does, in the labelled copy.

    Returns:
        Name to place of each label column, and what contradicts the source, a line each.
    """
    found: dict[str, Extra] = {}
    wrong: list[str] = []
    if len(_bytes(after)) > len(_bytes(before)):
        kept = before.described
        wrong += [
            f"descriptor of {old.name!r} isn't what it was"
            for old, new in zip(kept, after.described, strict=False)
            if old.descriptor != new.descriptor
        ]
        added, num_covered = _behind(before, after)
        if len(after.described) < len(kept) or num_covered != before.num_left or after.num_left:
            return {}, [*wrong, "descriptors don't account for the extra bytes of the source"]
        for extra in added:
            match = _ADDED.fullmatch(extra.name)
            name = match[1] if match else ""
            if name in found or extra.type != LABEL_COLUMNS.get(name) or not _is_bare(extra):
                wrong.append(f"{extra.name!r} is no dimension that labelling adds")
            else:
                found[name] = extra
    own = {extra.name: extra for extra in before.described}
    for name, kind in LABEL_COLUMNS.items():
        for candidate in _candidates(name):
            if name in found or candidate not in own:
                break
            if own[candidate].type == kind:
                found[name] = own[candidate]
    return found, wrong


def _behind(before: Extras, after: Extras) -> tuple[Sequence[Extra], int]:
    """What follows the source's dimensions, and how many of its bare bytes stand-ins describe."""
    rest = after.described[len(before.described) :]
    covered = index = 0
    while index < len(rest) and covered < before.num_left:
        size = rest[index].size
        expected = struct.pack("<2xBB32s156x", 0, size, _UNDESCRIBED)
        if rest[index].descriptor != expected:
            break
        covered += size
        index += 1
    return rest[index:], covered


def _bytes(extras: Extras) -> range:
    return range(sum(extra.size for extra in extras.described) + extras.num_left)


def _is_bare(extra: Extra) -> bool:
    """Whether a descriptor says type and name, and nothing else."""
    kind = _TYPES.index(extra.type) + 1
    return extra.descriptor == struct.pack("<2xBB32s156x", kind, 0, extra.name.encode())


def _size(kind: int, options: int) -> tuple[int, bool]:
    """Bytes of a dimension, 0 if its type is none, and whether it is one number."""
    if kind == 0:
        return options, False
    width, index = divmod(kind - 1, len(_TYPES))
    return (0, False) if width > 2 else (np.dtype(_TYPES[index]).itemsize * (width + 1), width == 0)


def _is_scaled(descriptor: bytes, options: int) -> bool:
    """Whether a scale or an offset is meant: 0 and NaN would wipe every value out."""
    (scale,), (offset,) = (
        struct.unpack_from("<d", descriptor, 112),
        struct.unpack_from("<d", descriptor, 136),
    )
    scale = scale if options & _SCALE else 1.0
    offset = offset if options & _OFFSET else 0.0
    return bool(options & (_SCALE | _OFFSET) and np.isfinite([scale, offset]).all() and scale)


def _candidates(name: str) -> Iterator[str]:
    yield name
    for number in count(2):
        suffix = f"_{number}"
        yield name.encode()[: 32 - len(suffix)].decode("utf-8", "ignore") + suffix
