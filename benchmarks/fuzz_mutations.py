"""Ways to damage a seed: lies in single numbers, other words, flips, cuts, splices, repeats.

Everything is drawn from the generator that is passed, so a case is its number and nothing else.
"""

import math
import re
import struct
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from fuzz_containers import CONTAINERS
from fuzz_seeds import Seed

_FLOATS = (0.0, -0.0, 1.0, -1.0, math.nan, math.inf, -math.inf, 1e300, -1e300, 5e-324, 1e-320, 1e9)
_WORDS = (
    *("", "0", "1", "-1", "2", "3", "8", "29", "31", "255", "256", "65535", "65536", "2147483647"),
    *("2147483648", "4294967295", "4294967296", "9223372036854775807", "9223372036854775808"),
    *("18446744073709551615", "1e18", "1e308", "1e999", "-1e999", "1e-320", "nan", "NaN", "inf"),
    *(
        "-Infinity",
        "0x10",
        "1_000",
        "1.5",
        "٣",
        "x",
        "X",
        "y",
        "label",
        "_",
        "char",
        "uchar",
        "int",
    ),
    *("float", "double", "list", "uint", "vertex", "ascii", "binary", "true", "null", "[]", "{}"),
    *('""', '"../../etc"', '"/etc/passwd"', '"a\\u0000b"', "F64", "BF16", "F4", "U8", "[0,0]"),
    *("\x00", "\r", "\n", "\ufeff", "\u2028", "#", "//", '"', ",", ";", "a" * 300, "9" * 400),
    *("9" * 5000, "[" * 5000, '{"a":' * 5000, "-", "+", ".", "e", "1e", "--1", "%", "%00", "&#0;"),
)
_WORD = re.compile(rb'[^\s<>="/,;:\[\]{}\\]+')


def mutate(rng: np.random.Generator, seeds: Sequence[Seed]) -> tuple[Seed, bytes]:
    """Damage one of some seeds of one format.

    Returns:
        The seed, and the damaged bytes.
    """
    seed = seeds[rng.integers(len(seeds))]
    container = CONTAINERS.get(seed.container)
    if container is None or rng.random() < 0.1:
        return seed, _damage(rng, seed.raw, seed if container is None else None, seeds)
    inner = container.unpack(seed)
    return seed, container.pack(_damage(rng, inner.raw, inner, seeds), inner, rng)


def _damage(
    rng: np.random.Generator, raw: bytes, seed: Seed | None, seeds: Sequence[Seed]
) -> bytes:
    """Apply one to three mutations; those that know the seed's layout come first and most often."""
    data = bytearray(raw)
    text = (0, 0) if seed is None else (seed.text_start, seed.text_end)
    for _ in range(rng.choice([1, 2, 3], p=[0.6, 0.3, 0.1])):
        if seed is not None and len(data) == len(raw) and rng.random() < 0.75:
            has_text = text[1] > text[0]
            if has_text and (not seed.fields or rng.random() < 0.5):
                _change_text(rng, data, *text)
                continue
            if seed.fields:
                _change_number(rng, data, *seed.fields[rng.integers(len(seed.fields))])
                continue
        data = _change_bytes(rng, data, seeds)
    return bytes(data)


def _change_number(rng: np.random.Generator, data: bytearray, at: int, code: str) -> None:
    """Put another number in a field: an extreme, a neighbor of the true one, any bits."""
    size = struct.calcsize("<" + code)
    if at + size > len(data):
        return
    if rng.random() < 0.25:
        data[at : at + size] = rng.bytes(size)
        return
    (value,) = struct.unpack_from("<" + code, data, at)
    if code in "df":
        choices = (*_FLOATS, value * -1, value * 1.5, math.nextafter(value, math.inf))
        with np.errstate(over="ignore"):
            value = choices[rng.integers(len(choices))]
        value = max(-3e38, min(3e38, value)) if code == "f" and math.isfinite(value) else value
    else:
        bits = 8 * size
        power = 1 << int(rng.integers(bits))
        choices = (0, 1, -1, 1 << (bits - 1), (1 << (bits - 1)) - 1, power, power - 1, len(data))
        choices = (
            *choices,
            value + 1,
            value - 1,
            value * 2,
            value // 2,
            len(data) - 1,
            len(data) - 8,
        )
        code, value = code.upper(), choices[rng.integers(len(choices))] % (1 << bits)
    struct.pack_into("<" + code, data, at, value)


def _change_text(rng: np.random.Generator, data: bytearray, start: int, end: int) -> None:
    """Exchange a word, or drop, repeat or swap lines."""
    what = rng.random()
    text = bytes(data[start:end])
    if what < 0.75:
        places = _words(text)
        if not places:
            return
        low, high = places[rng.integers(len(places))]
        if what < 0.1:  # a word of the text's own
            other = places[rng.integers(len(places))]
            word = text[other[0] : other[1]]
        elif what < 0.25 and text[low:high].isdigit():
            word = str(int(text[low:high][:40]) + int(rng.integers(-2, 3))).encode()
        else:
            word = _WORDS[rng.integers(len(_WORDS))].encode("utf-8")
        if rng.random() < 0.1:
            low = high  # beside, not instead
        data[start + low : start + high] = word
        return
    separator = b"\n" if text.count(b"\n") > 3 else b","
    lines = text.split(separator)
    one, two = rng.integers(len(lines), size=2)
    if what < 0.83:
        del lines[one]
    elif what < 0.91:
        lines.insert(one, lines[two])
    else:
        lines[one], lines[two] = lines[two], lines[one]
    data[start:end] = separator.join(lines)


@lru_cache(maxsize=256)
def _words(text: bytes) -> list[tuple[int, int]]:
    return [match.span() for match in _WORD.finditer(text)]


def _change_bytes(rng: np.random.Generator, data: bytearray, seeds: Sequence[Seed]) -> bytearray:
    """Damage that knows nothing of the format."""
    size = len(data)
    if size < 2:
        return bytearray(rng.bytes(9))
    what = rng.integers(8)
    low, high = sorted(rng.integers(0, size, 2).tolist())
    if what == 0:
        for _ in range(rng.integers(1, 9)):
            data[rng.integers(size)] ^= 1 << int(rng.integers(8))
    elif what == 1:
        for _ in range(rng.integers(1, 5)):
            data[rng.integers(size)] = int(rng.integers(256))
    elif what == 2:
        del data[low:]
    elif what == 3:
        del data[low : min(high, low + int(rng.integers(1, 65)))]
    elif what == 4:
        data[low:low] = data[low:high]
    elif what == 5:
        data[low:high] = bytes([rng.choice([0, 255, 32, 48, 10])]) * (high - low)
    elif what == 6:
        data[low:low] = rng.bytes(int(rng.integers(1, 65)))
    else:
        other = seeds[rng.integers(len(seeds))].raw
        data[low:] = other[min(low, len(other)) :]
    return data
