"""Where the time went, stage by stage."""

import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

Item = TypeVar("Item")


class Stages:
    """Counts seconds towards named stages.

    A stage may be entered any number of times. What is timed inside another stage counts towards
    the inner one alone, so that the stages add up to the time that passed in them.

    Attributes:
        seconds: Seconds by stage, in the order in which they were first entered.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._open: list[str] = []
        self._counted_until = 0.0

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """Count the time inside towards a stage."""
        self._count()
        self.seconds.setdefault(stage, 0.0)
        self._open.append(stage)
        try:
            yield
        finally:
            self._count()
            self._open.pop()

    def each(self, stage: str, items: Iterable[Item]) -> Iterator[Item]:
        """Count the time that it takes to come by each item towards a stage."""
        iterator = iter(items)
        while True:
            with self.timed(stage):
                try:
                    item = next(iterator)
                except StopIteration:
                    return
            yield item

    def _count(self) -> None:
        """Count what passed since the last time towards the innermost stage."""
        now = time.perf_counter()
        if self._open:
            self.seconds[self._open[-1]] += now - self._counted_until
        self._counted_until = now
