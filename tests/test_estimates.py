"""What labelling will take."""

from bushseg.estimates import START_SECONDS, TILE_POINTS, estimate
from bushseg.memory import PROGRAM
from bushseg.subsample import MAX_VOXELS


def test_memory_stops_growing_where_the_disk_takes_over() -> None:
    small, medium, large, huge = (
        estimate("close", 0.1, 3 * size, size) for size in (1_000, MAX_VOXELS, 10**8, 10**9)
    )
    assert PROGRAM < small.memory < medium.memory == large.memory == huge.memory
    assert small.scratch == medium.scratch == 0 < large.scratch
    assert huge.scratch == 10 * large.scratch
    assert START_SECONDS < small.seconds < medium.seconds
    assert huge.seconds - START_SECONDS == 10 * (large.seconds - START_SECONDS)
    assert medium.num_voxels > TILE_POINTS
