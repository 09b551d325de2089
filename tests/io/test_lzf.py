from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bushseg.io.lzf import MAX_RATIO, decompress


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"", b""),
        (b"\x02abc", b"abc"),
        # Length 1 + 2, distance 2 + 1: the three bytes again.
        (b"\x02abc\x20\x02", b"abcabc"),
        # Distance 1 with length 7: the copy feeds on itself.
        (b"\x00a\xa0\x00", b"a" * 8),
        (b"\x01ab\xa0\x01", b"ab" + b"abababa"),
        # Length 7 takes a further byte: 7 + 255 + 2.
        (b"\x00a\xe0\xff\x00", b"a" * 265),
    ],
)
def test_exact(data: bytes, expected: bytes) -> None:
    assert decompress(data, len(expected)) == expected
    assert len(expected) <= max(1, len(data)) * MAX_RATIO


def test_far_reference() -> None:
    far = bytes(range(256)) * 2
    literals = b"".join(b"\x1f" + far[at : at + 32] for at in range(0, 512, 32))
    # Distance (1 << 8) + 255 + 1 = 512.
    assert decompress(literals + b"\x21\xff", 515) == far + far[:3]


@pytest.mark.parametrize("data", [b"\x05abc", b"\x20\x00", b"\x00a\x20", b"\x00a\xe0", b"\x00a"])
def test_refuses_damage(data: bytes) -> None:
    with pytest.raises(ValueError, match="LZF"):
        decompress(data, 5)


@given(st.binary(max_size=200), st.integers(0, 1000))
def test_any_bytes_give_the_right_length_or_an_error(data: bytes, size: int) -> None:
    with suppress(ValueError):
        assert len(decompress(data, size)) == size
