"""A process of its own that decompresses LAZ points to standard output.

    python decompress.py FILE POINT_OFFSET BYTES VLR_OFFSET VLR_LENGTH

lazrs sizes buffers by numbers from the file, and an absurd one aborts the process: this one.
"""

import os
import struct
import sys

import lazrs

_BLOCK_RECORDS = 100_000
_CHUNK_SIZE_AT = 12
_UNCHUNKED = 1
_ONE_CHUNK, _VARIABLE = 0xFFFFFFFE, 0xFFFFFFFF


def main() -> None:
    """Write every point's bytes, in order."""
    path, *numbers = sys.argv[1:]
    offset, num_bytes, vlr_at, vlr_length = map(int, numbers)
    with open(path, "rb") as file:  # noqa: PTH123 - pathlib is slow to import
        file.seek(vlr_at)
        vlr = bytearray(file.read(vlr_length))
        (compressor,), (chunk_size,) = (
            struct.unpack_from("<H", vlr),
            struct.unpack_from("<I", vlr, _CHUNK_SIZE_AT),
        )
        # lazrs knows neither LASzip's first layout nor a chunk size of 0, which COPC may have.
        if compressor == _UNCHUNKED or chunk_size == 0:
            size = _ONE_CHUNK if compressor == _UNCHUNKED else _VARIABLE
            struct.pack_into("<I", vlr, _CHUNK_SIZE_AT, size)
        record = lazrs.LazVlr(bytes(vlr)).item_size()
        kind = lazrs.LasZipDecompressor if compressor == _UNCHUNKED else lazrs.ParLasZipDecompressor
        file.seek(offset)
        decompressor = kind(file, bytes(vlr))
        while num_bytes:
            block = bytearray(min(num_bytes, _BLOCK_RECORDS * record))
            decompressor.decompress_many(block)
            num_bytes -= len(block)
            view = memoryview(block)
            while view:
                view = view[os.write(1, view) :]


if __name__ == "__main__":
    main()
