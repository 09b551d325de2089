"""Rows of tensors a few thousand at a time, on all cores.

Without gradients each layer is one function of a row, or of a neighborhood, and chunks small enough
for a core's cache are faster and bound the memory. All chunks of a layer have the same number of
rows: oneDNN compiles a program for each shape that it multiplies and keeps what it compiled, so
shapes that came of a tile's size would take time in each tile and add up over a scan.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import torch
from torch import Tensor

from bushseg.parallel import for_chunks

CHUNK = 2048
"""Points handled at once without gradients: their rows stay in a core's cache."""


@contextmanager
def serial_torch() -> Iterator[None]:
    """Hold PyTorch's own threads to one, for as long as ours are many."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def run_chunks(function: Callable[[int, int], object], num_rows: int, size: int) -> None:
    """:func:`bushseg.parallel.for_chunks` for functions of PyTorch that need no gradients."""

    def call(start: int, stop: int) -> None:
        with torch.inference_mode():  # a thread's own setting
            function(start, stop)

    with serial_torch():
        for_chunks(call, num_rows, size)


def in_chunks(
    function: Callable[..., Tensor], width: int, *rows: Tensor, size: int = CHUNK
) -> Tensor:
    """Apply a function that treats rows independently, `size` rows at a time.

    On a CPU all cores take chunks. The last one reaches back so as to have as many rows as the
    others; fewer rows than `size` are taken in chunks of a power of two. With gradients (and so
    with batch statistics) everything is done at once.

    Args:
        function: Takes the chunks of `rows`, returns one tensor with as many rows.
        width: Columns of what it returns.
        rows: Tensors of the same number of rows.
        size: Rows in a chunk.

    Returns:
        The function's result for all rows, (N, width).
    """
    first, num_rows = rows[0], len(rows[0])
    if torch.is_grad_enabled() or not num_rows:
        return function(*rows)
    size = min(size, 1 << (num_rows.bit_length() - 1))
    dtype = next((tensor.dtype for tensor in rows if tensor.is_floating_point()), torch.float32)
    out = torch.empty(num_rows, width, dtype=dtype, device=first.device)

    def call(start: int, stop: int) -> None:
        out[start:stop] = function(*(tensor[stop - size : stop] for tensor in rows))[start - stop :]

    if first.device.type == "cpu":
        run_chunks(call, num_rows, size)
    else:
        for start in range(0, num_rows, size):
            call(start, min(start + size, num_rows))
    return out
