"""Formats that wrap what is to be damaged: E57's pages with their checksums, safetensors' header.

Damage inside would be found by the wrapping before a reader sees it. So the wrapping is taken off,
and put on again around the damage, sometimes wrongly.
"""

import struct
from dataclasses import replace
from typing import Protocol

import numpy as np
from fuzz_seeds import Seed

_PAGE, _CHECKSUM = 1024, 4
_E57_HEADER = struct.Struct("<8sII4Q")


class Container(Protocol):
    """How a format is unwrapped and wrapped."""

    def unpack(self, seed: Seed) -> Seed:
        """The seed without its wrapping; places are those inside."""

    def pack(self, raw: bytes, inner: Seed, rng: np.random.Generator) -> bytes:
        """Wrap damaged bytes; one time in five, lengths are left as they were."""


class Pages:
    """E57: pages of 1,020 bytes and their CRC-32C; the header says how long file and XML are."""

    def unpack(self, seed: Seed) -> Seed:
        """The logical bytes; the numbers of the header, section and packets; the XML is text."""
        raw = b"".join(
            seed.raw[at : at + _PAGE - _CHECKSUM] for at in range(0, len(seed.raw), _PAGE)
        )
        *_, xml, length, _ = _E57_HEADER.unpack_from(raw)
        start = xml // _PAGE * (_PAGE - _CHECKSUM) + xml % _PAGE
        return replace(
            seed, raw=raw[: start + length], fields=e57_fields(raw, start), text_start=start,
            text_end=start + length,
        )  # fmt: skip

    def pack(self, raw: bytes, inner: Seed, rng: np.random.Generator) -> bytes:
        """Pages with right checksums."""
        payload = _PAGE - _CHECKSUM
        num_pages = -(-len(raw) // payload)
        data = bytearray(raw.ljust(num_pages * payload, b"\0"))
        if rng.random() < 0.8 and len(data) >= _E57_HEADER.size:
            struct.pack_into("<Q", data, 16, num_pages * _PAGE)
            if len(raw) != len(inner.raw):
                struct.pack_into("<Q", data, 32, max(0, len(raw) - inner.text_start))
        pages = (bytes(data[at : at + payload]) for at in range(0, len(data), payload))
        return b"".join(page + struct.pack(">I", _crc(page)) for page in pages)


class Safetensors:
    """safetensors: the length of a JSON header, the header, the tensors."""

    def unpack(self, seed: Seed) -> Seed:
        """The header is text."""
        (length,) = struct.unpack_from("<Q", seed.raw)
        return replace(seed, fields=((0, "Q"),), text_start=8, text_end=8 + length)

    def pack(self, raw: bytes, inner: Seed, rng: np.random.Generator) -> bytes:
        """With the length set right, if the header's end can still be told."""
        change = len(raw) - len(inner.raw)
        if change and len(raw) > 8 and rng.random() < 0.8:
            return struct.pack("<Q", max(0, inner.text_end - 8 + change)) + raw[8:]
        return raw


def e57_fields(raw: bytes, end: int) -> tuple[tuple[int, str], ...]:
    """The numbers of an E57 file's header, of its first section's and of that one's packets."""
    fields = [(8, "I"), (12, "I"), *((at, "Q") for at in (16, 24, 32, 40))]
    section = _E57_HEADER.size
    fields += [(section, "B"), *((section + at, "Q") for at in (8, 16, 24))]
    packet = section + 32
    while packet + 6 < end and raw[packet] in (0, 1, 2):
        (length, count) = struct.unpack_from("<HH", raw, packet + 2)
        fields += [(packet, "B"), (packet + 1, "B"), (packet + 2, "H"), (packet + 4, "H")]
        fields += [(packet + 6 + 2 * index, "H") for index in range(min(count, 9))]
        packet += length + 1
    return tuple(fields)


def _table() -> tuple[int, ...]:
    table = []
    for value in range(256):
        for _ in range(8):
            value = value >> 1 ^ (0x82F63B78 if value & 1 else 0)
        table.append(value)
    return tuple(table)


_TABLE = _table()


def _crc(data: bytes) -> int:
    """CRC-32C, as E57 has it."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc = _TABLE[(crc ^ byte) & 255] ^ crc >> 8
    return crc ^ 0xFFFFFFFF


CONTAINERS: dict[str, Container] = {"e57": Pages(), "safetensors": Safetensors()}
