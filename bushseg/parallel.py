"""Rows worked on by all cores: threads that take chunks of rows until none is left.

For functions that release the interpreter's lock: compiled ones, and PyTorch's and NumPy's on large
arrays.
"""

import itertools
import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor


def num_workers() -> int:
    """How many threads work at once: the cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def for_chunks(function: Callable[[int, int], object], num_rows: int, size: int) -> None:
    """Call `function(start, stop)` for chunks that cover all rows once, on all cores.

    Args:
        function: Works on rows start to stop and writes its result where no other chunk's goes.
        num_rows: How many rows there are.
        size: Rows in a chunk: enough that calling is cheap beside the work, few enough that what
            it touches stays in a core's cache.

    Raises:
        Exception: The first that a call raised; chunks not begun by then are left out.
    """
    num_chunks = -(-num_rows // size)
    workers = min(num_workers(), num_chunks)
    if workers <= 1:
        for start in range(0, num_rows, size):
            function(start, min(start + size, num_rows))
        return
    numbers, stop = itertools.count(), threading.Event()

    def work() -> None:
        while (number := next(numbers)) < num_chunks and not stop.is_set():
            try:
                function(number * size, min(number * size + size, num_rows))
            except BaseException:
                stop.set()
                raise

    with ThreadPoolExecutor(workers) as pool:
        try:
            for future in [pool.submit(work) for _ in range(workers)]:
                future.result()
        finally:
            stop.set()  # Ctrl-C reaches this thread only: the others must not finish the rows first
