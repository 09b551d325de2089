"""What a labeler says of a scan, and how good it is: shared by networks and their alternatives.

A labeler is anything with a name that gives points the probabilities of the `bush` scheme's seven
classes. It is shown a scan as a user would show it: points and their attributes, no labels.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from stations import find_stations

import bushseg
from bushseg.errors import DataError
from bushseg.features import source_columns
from bushseg.grid import VoxelGrid
from bushseg.ground import height_above_ground
from bushseg.io.kept import KeptReader
from bushseg.io.memory import MemoryReader
from bushseg.labels import SCHEMES
from bushseg.model_choice import Candidate, candidates, choose
from bushseg.points import PointCloud

BUSH = SCHEMES["bush"]
NAMES = BUSH.names
BUSH_LABEL = NAMES.index("bush")
DENSITY_CUBE = 0.5
"""Edge of the cubes in which points are counted for the local density, metres."""


@dataclass(frozen=True)
class Scan:
    """A labelled scan.

    Attributes:
        path: Its file.
        cloud: Its points; the attributes don't hold the labels.
        codes: The source codes of the labels, (N,) int64; -1 where a point is none (no return).
        sensor: Where the sensor stood, (3,) float64, if the file says so; frames do.
        stations: All places the sensor stood at, (S, 3) float64, if known.
    """

    path: Path
    cloud: PointCloud
    codes: NDArray[np.int64]
    sensor: NDArray[np.float64] | None
    stations: NDArray[np.float64] | None


class Labeler(Protocol):
    """Something that labels scans."""

    name: str

    def label(self, scan: Scan) -> NDArray[np.float32]:
        """Probability of each class of the `bush` scheme, (N, 7); zeros where there is no label."""


class Network:
    """A trained model as a labeler.

    Args:
        source: A model, a run's folder, a bundled model's name, or "default": of the bundled models
            the one that suits each scan, as `bushseg predict` takes it.
    """

    def __init__(self, source: str | Path) -> None:
        self.name = str(source)
        # Loaded once, however many scans are labelled.
        self.known = [
            Candidate(found.name, found.card, found.load()) for found in candidates(source)
        ]
        for found in self.known:
            if found.card.scheme.names != NAMES:
                raise DataError(
                    f"{found.name}: tells {', '.join(found.card.scheme.names)} apart; expected the "
                    "classes of scheme 'bush'"
                )

    def label(self, scan: Scan) -> NDArray[np.float32]:
        """As :class:`Labeler`."""
        reader = KeptReader(MemoryReader(scan.cloud, scan.sensor))
        model = choose(self.known, reader)[0].load()
        _, probabilities = bushseg.predict(scan.cloud, model, sensor=scan.sensor)
        return probabilities


class Without:
    """A labeler that is kept from seeing colors or intensity.

    Args:
        labeler: Who labels.
        names: What it isn't shown: "rgb", "intensity".
    """

    def __init__(self, labeler: Labeler, names: Sequence[str]) -> None:
        if unknown := set(names) - {"rgb", "intensity"}:
            raise DataError(f"can't leave out {', '.join(unknown)}; choose rgb or intensity")
        self.labeler, self.names = labeler, names
        self.name = f"{labeler.name} without {' and '.join(names)}"

    def label(self, scan: Scan) -> NDArray[np.float32]:
        """As :class:`Labeler`."""
        columns = source_columns(scan.cloud.attributes)
        hidden = {
            theirs
            for ours, theirs in columns.items()
            if ("intensity" if ours == "intensity" else "rgb") in self.names
        }
        kept = {
            name: column for name, column in scan.cloud.attributes.items() if name not in hidden
        }
        return self.labeler.label(replace(scan, cloud=PointCloud(scan.cloud.xyz, kept)))


def read_scan(path: Path) -> Scan:
    """Read a scan with its labels; no-returns have none."""
    with bushseg.open_scan(path) as reader:
        cloud, info = reader.read(), reader.info
    if info.label_attribute is None:
        raise DataError(f"{path}: has no labels; expected a labelled scan")
    attributes = dict(cloud.attributes)
    codes = attributes.pop(info.label_attribute).astype(np.int64)
    if info.no_returns_at_origin:
        codes[(cloud.xyz == 0).all(axis=1)] = -1
    stations = None if info.sensor_position is None else info.sensor_position[None]
    if stations is None and {"gps_time", "point_source_id"} <= attributes.keys():
        stations = find_stations(
            cloud.xyz, attributes["gps_time"], attributes["point_source_id"].astype(np.int64)
        )
    return Scan(path, PointCloud(cloud.xyz, attributes), codes, info.sensor_position, stations)


@dataclass(frozen=True)
class Judged:
    """Points of one or more scans as a labeler saw them, and what is known of them.

    Attributes:
        codes: Source codes of the true labels, (N,) int64.
        predictions: Class indices of the `bush` scheme, (N,) int16; -1 for none.
        probabilities: (N, 7) float32.
        columns: What scores are split by, name to (N,) float32: "height" above the local ground
            (m), "density" (points in the cube of 0.5 m), "range" to the nearest station (m; NaN
            where none is known).
    """

    codes: NDArray[np.int64]
    predictions: NDArray[np.int16]
    probabilities: NDArray[np.float32]
    columns: Mapping[str, NDArray[np.float32]] = field(default_factory=dict)

    @classmethod
    def of(cls, labeler: Labeler, scan: Scan) -> "Judged":
        """Have a scan labelled."""
        return cls.from_probabilities(labeler.label(scan), scan)

    @classmethod
    def from_probabilities(cls, probabilities: NDArray[np.float32], scan: Scan) -> "Judged":
        """Keep the points of a scan that are points."""
        real = (scan.codes >= 0) & np.isfinite(scan.cloud.xyz).all(axis=1)
        found = probabilities[real]
        predictions = found.argmax(axis=1).astype(np.int16)
        predictions[found.sum(axis=1) == 0] = -1
        return cls(scan.codes[real], predictions, found, _columns(scan, real))

    @classmethod
    def joined(cls, parts: Iterable["Judged"]) -> "Judged":
        """The points of several scans."""
        parts = list(parts)
        return cls(
            np.concatenate([part.codes for part in parts]),
            np.concatenate([part.predictions for part in parts]),
            np.concatenate([part.probabilities for part in parts]),
            {
                name: np.concatenate([part.columns[name] for part in parts])
                for name in parts[0].columns
            },
        )

    def thinned(self, size: int) -> "Judged":
        """At most `size` of the points, drawn at random but always the same."""
        if len(self.codes) <= size:
            return self
        return self.where(np.random.default_rng(0).choice(len(self.codes), size, replace=False))

    def where(self, chosen: NDArray[Any]) -> "Judged":
        """Some of the points, by a mask or indices."""
        columns = {name: values[chosen] for name, values in self.columns.items()}
        return Judged(
            self.codes[chosen], self.predictions[chosen], self.probabilities[chosen], columns
        )


def _columns(scan: Scan, real: NDArray[np.bool_]) -> dict[str, NDArray[np.float32]]:
    """Height, density and range of the points that are points."""
    xyz = scan.cloud.xyz[real]
    keys = VoxelGrid.around(xyz[0], DENSITY_CUBE).keys(xyz)
    _, cube, counts = np.unique(keys, return_inverse=True, return_counts=True)
    ranges = np.full(len(xyz), np.nan, np.float32)
    if scan.stations is not None:
        nearest = np.full(len(xyz), np.inf)
        for station in scan.stations:
            nearest = np.minimum(nearest, np.linalg.norm(xyz - station, axis=1))
        ranges = nearest.astype(np.float32)
    return {
        "height": height_above_ground(xyz - xyz[0]),
        "density": counts[cube].astype(np.float32),
        "range": ranges,
    }
