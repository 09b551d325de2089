"""A scan that is read twice, the second time from memory where it is small."""

from collections.abc import Iterator

from bushseg.io.base import CHUNK_POINTS, ScanReader
from bushseg.points import PointCloud

KEPT_BYTES = 1 << 28
"""What a scan's chunks may take in memory; a larger scan is read again."""


class KeptReader(ScanReader):
    """Keeps what another reader gives, up to a limit.

    Attributes:
        source: The reader itself.
        held: The chunks kept so far.

    Args:
        reader: The scan. It stays open; whoever opened it closes it.
        limit: Bytes that may be kept; of a scan beyond it nothing is. None takes `KEPT_BYTES`.
    """

    def __init__(self, reader: ScanReader, limit: int | None = None) -> None:
        self.info = reader.info
        self.held: list[PointCloud] = []
        self.source = reader
        self._limit = KEPT_BYTES if limit is None else limit
        self._is_whole = False
        self._begun: tuple[list[PointCloud], Iterator[PointCloud]] | None = None

    def head(self, num_points: int) -> list[PointCloud]:
        """Read the first chunks ahead; the next pass begins with them and goes on from there.

        Args:
            num_points: How many points they hold at least, unless the scan has fewer.

        Raises:
            ReadError: As the reader's own.
        """
        rest = self.source.chunks()
        chunks: list[PointCloud] = []
        while sum(map(len, chunks)) < num_points and (chunk := next(rest, None)) is not None:
            chunks.append(chunk)
        self._begun = chunks.copy(), rest
        return chunks

    def forget_head(self) -> None:
        """Let go of what was read ahead: the next pass may come late."""
        self._begun = None

    def chunks(self, size: int = CHUNK_POINTS) -> Iterator[PointCloud]:
        """Yield all points in the file's order; kept ones in the chunks of the first time.

        Raises:
            ReadError: As the reader's own.
        """
        if self._is_whole:
            yield from self.held
            return
        self.held = []
        keeps, num_points, num_bytes = True, 0, 0
        for chunk in self._resumed(size):
            num_points, num_bytes = num_points + len(chunk), num_bytes + _num_bytes(chunk)
            # By what its points took so far, the whole scan would be too large: none of it is kept.
            if num_bytes * max(1.0, self.info.num_points / max(num_points, 1)) > self._limit:
                keeps, self.held = False, []
            if keeps:
                self.held.append(chunk)
            yield chunk
        self._is_whole = keeps

    def _resumed(self, size: int) -> Iterator[PointCloud]:
        """All chunks from the source, those read ahead first."""
        begun, self._begun = self._begun, None
        if begun is None:
            yield from self.source.chunks(size)
            return
        ahead, rest = begun
        while ahead:
            yield ahead.pop(0)
        yield from rest


def _num_bytes(chunk: PointCloud) -> int:
    """Bytes that a chunk's arrays take."""
    arrays = [chunk.xyz, *chunk.attributes.values()]
    if chunk.record is not None:
        arrays.append(chunk.record)
    return sum(array.nbytes for array in arrays)
