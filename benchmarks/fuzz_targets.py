"""What is done with a damaged file, and what may come of it: a refusal in a line, or the truth."""

import math
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from bushseg import io
from bushseg.errors import BushsegError, ReadError
from bushseg.io import laz, laz_worker
from bushseg.io.laz_body import lazrs_errors
from bushseg.io.laz_process import LazProcess

CHUNK = 7
"""Points a chunk: less than a seed's, so that what goes wrong between chunks shows."""
LONGEST_MESSAGE = 1000


class WrongResultError(Exception):
    """A file was taken, and what was read contradicts itself."""


def run(target: Callable[[Path], None], path: Path) -> str:
    """Do it.

    Returns:
        "read" or "refused".

    Raises:
        WrongResultError: What was read contradicts itself, or a refusal isn't one line.
        BaseException: Whatever else the reader let out.
    """
    try:
        target(path)
    except BushsegError as error:
        if len(str(error).splitlines()) != 1 or len(str(error)) > LONGEST_MESSAGE:
            raise WrongResultError(f"a message of {len(str(error))} characters") from error
        return "refused"
    return "read"


def read_scan(path: Path) -> None:
    """Read a scan in small chunks, or in large ones, which LAZ has to stream: the bytes decide."""
    with io.open_scan(path) as scan:
        info = scan.info
        expect(info.num_points > 0, "no points")
        small = zlib.crc32(path.read_bytes()) % 2
        size, laz._MAX_CHUNK_BYTES = (CHUNK, 1 << 28) if small else (io.base.CHUNK_POINTS, 1)
        num_points = 0
        for chunk in scan.chunks(size):
            num_points += len(chunk)
            expect(0 < len(chunk) <= size, f"a chunk of {len(chunk)} points")
            expect(chunk.xyz.dtype == np.float64, f"coordinates as {chunk.xyz.dtype}")
            expect(chunk.xyz.shape == (len(chunk), 3), f"coordinates of {chunk.xyz.shape}")
            expect(set(chunk.attributes) == set(info.attributes), "other attributes")
            for name, column in chunk.attributes.items():
                dtype = np.dtype((column.dtype, column.shape[1:]))
                expect(len(column) == len(chunk), f"{name} has {len(column)} values")
                expect(dtype == info.attributes[name], f"{name} is {dtype}")
        expect(num_points == info.num_points, f"{num_points} of {info.num_points} points")


def read_model(path: Path) -> None:
    """Read a model and what a run would go on from."""
    from bushseg.checkpoint import load_checkpoint, load_model, read_card
    from bushseg.training_state import TrainingState

    card = read_card(path)
    _, state, _ = load_checkpoint(path)
    if state:
        TrainingState.from_dict(state, "training state")
    model = load_model(path)
    expect(model.card == card, "another card")
    for name, tensor in model.network.state_dict().items():
        expect(bool(tensor.isfinite().all()), f"{name} isn't finite")


def read_dataset(path: Path) -> None:
    """Read a prepared data set as training does."""
    from bushseg.dataset import Dataset

    dataset = Dataset(path)
    for number in range(len(dataset.tiles)):
        tile = dataset.tile(number)
        expect(len(tile.xyz) == len(tile.labels) == len(tile.keys), "columns of other lengths")
        expect(len(dataset.class_counts([number])) == dataset.scheme.num_classes, "class counts")
        expect(math.isfinite(dataset.tiles[number].neighbor_distance), "a distance")
    for number in range(len(dataset.crop_tiles)):
        sample = dataset.cached_sample(number)
        expect(len(sample.labels) == len(sample.pyramid.neighbors[0]), "indices of other points")
        expect(int(sample.labels.max()) < dataset.scheme.num_classes, "labels of no class")


def bring_lazrs_in() -> None:
    """Run lazrs in this process, as bushseg doesn't: a hundred times as many cases a second."""

    def run_here(self: LazProcess, request: dict[str, Any], most: int) -> Iterator[Any]:
        path = self._path
        with lazrs_errors(lambda reason: ReadError(path, reason, "undamaged data")):
            try:
                for block in laz_worker.answer({"path": str(path), **request}):
                    expect(0 < len(block) <= most, f"an answer of {len(block)} bytes")
                    yield np.frombuffer(block, np.uint8)
            except laz_worker.RefusalError as error:
                raise ReadError(path, *error.args) from error

    LazProcess.run = run_here  # type: ignore[method-assign]


def expect(condition: bool, otherwise: str) -> None:
    """Raise where something isn't as it must be."""
    if not condition:
        raise WrongResultError(otherwise)
