"""Voxels of a scan that memory can't hold: sorted runs in files, merged in the end.

Sub-sampling fills a table; when it is full its rows are sorted by key and written down as a run,
and the table begins anew. A voxel whose points come in far apart parts of the file has a row in
several runs. Merging takes all rows of one range of keys at a time, as many as the table held.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bushseg.scratch import Scratch
from bushseg.voxel_sums import Sums

_SAMPLE = 1024  # rows of a run from one sampled key to the next


class Runs:
    """Runs in a scratch folder.

    Args:
        scratch: Makes the arrays.
    """

    def __init__(self, scratch: Scratch) -> None:
        self._scratch = scratch
        self._runs: list[Sums] = []

    def __len__(self) -> int:
        return len(self._runs)

    @property
    def num_rows(self) -> int:
        """Rows of all runs."""
        return sum(len(run.keys) for run in self._runs)

    def write(self, sums: Sums, size: int) -> None:
        """Write the first `size` rows of a table down as a run: one file, column after column."""
        order = np.argsort(sums.keys[:size])
        num_bytes = [size * column[:1].nbytes for column in sums.columns]
        file = self._scratch.empty(f"run{len(self._runs)}", (sum(num_bytes),), np.uint8)
        # All but the last column have items of eight bytes, so each begins at a multiple of its.
        columns = []
        for column, part in zip(
            sums.columns, np.split(file, np.cumsum(num_bytes)[:-1]), strict=True
        ):
            target = part.view(column.dtype).reshape(size, *column.shape[1:])
            np.take(column, order, axis=0, out=target)
            columns.append(target)
            self._scratch.release()
        self._runs.append(Sums(np.empty(0, np.int32), *columns))

    def count_keys(self, max_rows: int) -> int:
        """How many voxels there are; `max_rows` as in :meth:`ranges`."""
        count = 0
        for slices in self._slices(max_rows):
            count += len(np.unique(self._rows("keys", slices)))
        return count

    def ranges(self, max_rows: int) -> Iterator[Sums]:
        """Yield the rows of all runs, range by range of keys, ascending.

        Args:
            max_rows: Rows to hold at a time; more where there are more than a thousand runs.

        Yields:
            The rows of one range; those of one run after the other, each ascending by key.
        """
        for slices in self._slices(max_rows):
            columns = [self._rows(name, slices) for name in Sums._fields[1:]]
            yield Sums(np.empty(0, np.int32), *columns)

    def remove(self) -> None:
        """Delete the runs' files."""
        self._runs = []
        self._scratch.remove()

    def _rows(self, name: str, slices: Sequence[slice]) -> NDArray[Any]:
        """One column of some rows of each run, set end to end."""
        parts = zip(self._runs, slices, strict=True)
        column = np.concatenate([getattr(run, name)[rows] for run, rows in parts])
        self._scratch.release()
        return column

    def _slices(self, max_rows: int) -> Iterator[list[slice]]:
        """For each range of keys the rows of each run."""
        parts = []
        for run in self._runs:
            parts.append(run.keys[::_SAMPLE].copy())
            self._scratch.release()
        samples = np.sort(np.concatenate(parts))
        # From one bound to the next lie so many sampled steps, and of each run a part of one more.
        step = max(1, max_rows // _SAMPLE - len(self._runs))
        bounds = np.unique(samples[step::step])
        places = []
        for run in self._runs:  # a search reads few keys, but the pages around them with each
            places.append(_places(run.keys, bounds))
            self._scratch.release()
        for part in range(len(bounds) + 1):
            yield [slice(place[part], place[part + 1]) for place in places]


def _places(keys: NDArray[np.int64], bounds: NDArray[np.int64]) -> NDArray[np.intp]:
    """Where the ranges between bounds begin and end among sorted keys."""
    return np.concatenate([[0], np.searchsorted(keys, bounds), [len(keys)]])
