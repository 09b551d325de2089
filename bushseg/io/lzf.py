"""LZF decompression, which PCD's binary_compressed bodies need.

The format, after the description in Marc Lehmann's LibLZF: a control byte below 32 announces
control + 1 literal bytes; any other copies bytes already put out, its upper three bits giving the
length (7: a further byte is added), its lower five and the next byte the distance back.
"""

MAX_RATIO = 88
"""Three bytes of input make at most 264 of output."""


def decompress(data: bytes, size: int) -> bytearray:
    """Decompress `data`.

    Args:
        data: The compressed bytes.
        size: How many bytes come out.

    Raises:
        ValueError: The data is damaged, or makes more or fewer bytes than `size`.
    """
    out = bytearray()
    position = 0
    end = len(data)
    try:
        while position < end:
            control = data[position]
            position += 1
            if control < 32:
                stop = position + control + 1
                out += data[position:stop]
                position = stop
                continue
            length = control >> 5
            if length == 7:
                length += data[position]
                position += 1
            length += 2
            start = len(out) - ((control & 31) << 8) - data[position] - 1
            position += 1
            if start < 0 or len(out) > size:
                raise ValueError("LZF data is damaged")
            piece = out[start : start + length]
            if len(piece) < length:
                # The copy overlaps its own output: what is there repeats.
                piece = (piece * (length // len(piece) + 1))[:length]
            out += piece
    except IndexError as error:
        raise ValueError("LZF data ends early") from error
    if len(out) != size or position != end:
        raise ValueError(f"LZF data makes {len(out)} bytes instead of {size}")
    return out
