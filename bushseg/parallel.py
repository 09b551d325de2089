"""Work shared out to all cores: threads that take chunks of rows, or item after item.

For functions that release the interpreter's lock: compiled ones, and PyTorch's and NumPy's on large
arrays.
"""

import itertools
import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


_most_cores: int | None = None


def use_cores(most: int) -> None:
    """Have no more threads work at once in this process: others have the other cores."""
    global _most_cores
    _most_cores = most


def num_workers() -> int:
    """How many threads work at once: the cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        cores = len(os.sched_getaffinity(0))
    else:
        cores = os.cpu_count() or 1
    return cores if _most_cores is None else max(1, min(cores, _most_cores))


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


def map_ahead(function: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
    """Call a function on each item, on all cores, while this thread draws the next items.

    Args:
        function: What is done with an item; calls run at once and end in any order.
        items: Drawn by the calling thread, no further ahead than keeps the cores busy.

    Yields:
        The results, in the order of the items.

    Raises:
        Exception: The first that a call raised, in the order of the items; calls not begun by then
            are left out.
    """
    pending: deque[Future[Result]] = deque()
    with ThreadPoolExecutor(num_workers()) as pool:
        try:
            for item in items:
                pending.append(pool.submit(function, item))
                if len(pending) > 2 * num_workers():
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        finally:
            for call in pending:
                call.cancel()
