"""The loops behind :func:`bushseg.sampling.decimate`: MRS between layers, cell by cell.

Four rounds. In each, every cell gives up the points of smallest zeta, a quarter of its quota; those
raise their K neighbors by eq. 3 with W = 1, across the cells' borders too, so that the next round
falls elsewhere.
"""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from bushseg.compiled import compiled
from bushseg.parallel import for_chunks, num_workers

_ROUNDS = 4
_FEW = 20_000  # points that a second thread wouldn't finish any sooner
_BATCH = 32  # picks whose neighbors are fetched together: one by one, each would be waited for


def decimate_mrs(
    zeta: NDArray[np.float64],
    cells: NDArray[np.int64],
    decimation: int,
    xyz: NDArray[np.float32],
    neighbors: NDArray[np.int32],
) -> NDArray[np.int32]:
    """Choose survivors; arguments and result as in :func:`bushseg.sampling.decimate`."""
    parts = 4 * num_workers() if len(zeta) > _FEW else 1
    starts, quotas = _quotas(zeta, cells, decimation)
    num_cells = len(quotas)
    current, highest = zeta.copy(), np.zeros(num_cells)
    for last in range(1, _ROUNDS + 1):
        shares = quotas * last // _ROUNDS - quotas * (last - 1) // _ROUNDS
        places = np.concatenate([[0], np.cumsum(shares)])
        picks = np.empty(places[-1], dtype=np.int32)
        pick = partial(_pick, current, highest, starts, places, picks)
        for_chunks(pick, num_cells, -(-num_cells // parts))
        if last < _ROUNDS:
            _raise_neighbors(current, picks, xyz, neighbors)
    return _taken(current, int(quotas.sum()))


@compiled
def _quotas(
    zeta: NDArray[np.float64], cells: NDArray[np.int64], decimation: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Where each cell begins (and the last ends), and how many of its points survive.

    A cell's share is rounded up or down by the zeta of its first point. That zeta decides, too,
    whether the point survives; its square root's later digits are as good as others.
    """
    starts = np.empty(len(cells) + 1, np.int64)
    num_cells = 0
    for i in range(len(cells)):
        if i == 0 or cells[i] != cells[i - 1]:
            starts[num_cells] = i
            num_cells += 1
    starts[num_cells] = len(cells)
    quotas = np.empty(num_cells, np.int64)
    for cell in range(num_cells):
        size = starts[cell + 1] - starts[cell]
        quotas[cell] = int(np.floor(size / decimation + np.sqrt(zeta[starts[cell]]) * 1e3 % 1))
    return starts[: num_cells + 1], quotas


@compiled
def _pick(
    current: NDArray[np.float64],
    highest: NDArray[np.float64],
    starts: NDArray[np.int64],
    places: NDArray[np.int64],
    picks: NDArray[np.int32],
    first: int,
    stop: int,
) -> None:
    """Pick each cell's share of smallest zeta, ascending by index; of equal ones the first.

    Args:
        current: Zeta of each point; infinite once picked.
        highest: The largest zeta each cell has picked so far; updated.
        starts: Where each cell begins.
        places: Where each cell's picks go.
        picks: All picks of this round.
        first: First cell.
        stop: Cell after the last.
    """
    largest = 0
    for cell in range(first, stop):
        largest = max(largest, starts[cell + 1] - starts[cell])
    members = np.empty(largest + 1, np.int32)
    values, ranks = np.empty(largest, np.float64), np.empty(largest, np.int64)
    for cell in range(first, stop):
        begin, end = starts[cell], starts[cell + 1]
        share = places[cell + 1] - places[cell]
        if share == 0:
            continue
        # Only what lies below a limit is looked at, raised until enough does.
        step = 1.5 * (share + 4) / (end - begin)
        limit, count = highest[cell], 0
        while count < share:
            limit, step, count = limit + step, 2 * step, 0
            for i in range(begin, end):
                members[count] = i
                count += current[i] <= limit
        for i in range(count):
            values[i], ranks[i] = current[members[i]], 0
        for j in range(count):
            value = values[j]
            for i in range(count):
                ranks[i] += value < values[i]
        place = places[cell]
        for i in range(count):
            if ranks[i] < share and place < places[cell + 1]:
                picks[place] = members[i]
                place += 1
                highest[cell] = max(highest[cell], values[i])
                current[members[i]] = np.inf


@compiled
def _raise_neighbors(
    current: NDArray[np.float64],
    picks: NDArray[np.int32],
    xyz: NDArray[np.float32],
    neighbors: NDArray[np.int32],
) -> None:
    """Raise the neighbors of every pick by eq. 3."""
    k = neighbors.shape[1]
    farthest = min(k, len(current)) - 1  # what follows repeats
    rows, ratios = np.empty(_BATCH * k, np.uint32), np.empty(_BATCH * k, np.float32)
    reach = np.empty(_BATCH * k, np.float32)
    for first in range(0, len(picks), _BATCH):
        count = min(_BATCH, len(picks) - first)
        size = count * k
        for number in range(count):
            pick = np.uint32(picks[first + number])
            for j in range(k):
                rows[number * k + j] = np.uint32(neighbors[pick, j])
        for start in range(0, size, k):
            center = np.uint32(picks[first + start // k])
            x, y, z = xyz[center, 0], xyz[center, 1], xyz[center, 2]
            for i in range(start, start + k):
                dx, dy, dz = xyz[rows[i], 0] - x, xyz[rows[i], 1] - y, xyz[rows[i], 2] - z
                ratios[i] = dx * dx + dy * dy + dz * dz
        for i in range(size):
            ratios[i] = np.sqrt(ratios[i])
        for start in range(0, size, k):
            d_max = ratios[start + farthest]
            for i in range(start, start + k):
                reach[i] = d_max if d_max > 0 else np.float32(1)
        for i in range(size):
            ratios[i] = np.sqrt(np.float32(1) - ratios[i] / reach[i])
        for i in range(size):
            current[rows[i]] += ratios[i]


@compiled
def _taken(current: NDArray[np.float64], count: int) -> NDArray[np.int32]:
    """The points whose zeta is infinite, ascending, shape (count,), int32."""
    taken = np.empty(count + 1, np.int32)
    found = 0
    for i in range(len(current)):
        taken[found] = i
        found += np.isinf(current[i])
    return taken[:count]
