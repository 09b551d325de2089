"""How far simulated scans are from real ones: the simulator's figure of merit, to be driven down.

    python benchmarks/realism.py tls=SITES mls=SITES frame=FRAMES uav=SITES airborne=SITES
        photogrammetry=SITES --real ../shared/data [--above 0.5] [--per-scan]

Scans are compared within a kind of sensor, after sub-sampling at one voxel size: histograms of what
the network sees (inclination of normals, SPF angles, density, height above ground, eigenvalue
features, intensity). The distance is Wasserstein-1, in standard deviations of the real values, mean
over all pairs of a simulated and a real scan. The yardstick is the same distance between two real
scans of the kind. Figure of merit: their ratio, geometric mean over features; at 1, a simulated
scan differs from a real one as much as real ones differ from each other. Where all real scans of a
kind show one place, the two halves of a scan take the place of two scans; they are more alike, so
that the ratio looks worse than it is.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scan_features import Features, scan_features
from scipy.stats import wasserstein_distance
from tables import print_table

from bushseg.io import find_scans

LEAST_YARD = 0.02
"""The yardstick is never shorter than this, in standard deviations: two real scans of one survey
may agree in a feature to a hair, which nothing simulated is to be measured by."""


@dataclass(frozen=True)
class Kind:
    """A kind of sensor.

    Attributes:
        patterns: Its real scans, relative to the data folder.
        voxel_size: At which scans of this kind are compared, metres.
        one_place: Whether all of them show one place, so that they say nothing of how real places
            differ.
    """

    patterns: tuple[str, ...]
    voxel_size: float
    one_place: bool = False


KINDS = {
    "tls": Kind(("forest/TLS_Clip.laz", "forest/LPine1_demo.laz"), 0.1),
    "mls": Kind(("forest/MLS_Clip.laz",), 0.1, one_place=True),
    "frame": Kind(("frames/*.bin",), 0.1, one_place=True),
    "uav": Kind(("forest/pine_plot.laz", "forest/QuePet*.laz"), 0.15),
    "photogrammetry": Kind(("odm/*.laz",), 0.1, one_place=True),
    "airborne": Kind(("ign/ign_770*.laz", "forest/bcts_*.laz"), 0.3),
}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "simulated", nargs="+", help="KIND=SCANS; KIND is one of " + ", ".join(KINDS)
    )
    parser.add_argument("--real", type=Path, required=True, help="folder of the real scans")
    parser.add_argument(
        "--above", type=float, default=-np.inf, help="compare only what is higher above ground, m"
    )
    parser.add_argument("--per-scan", action="store_true", help="a figure for each simulated scan")
    options = parser.parse_args()
    summary = []
    for name, paths in by_kind(options.simulated).items():
        kind = KINDS[name]
        real_paths = [
            path for pattern in kind.patterns for path in sorted(options.real.glob(pattern))
        ]
        real = [scan_features(path, kind.voxel_size, options.above) for path in real_paths]
        scans = find_scans(paths)
        simulated = [scan_features(path, kind.voxel_size, options.above) for path in scans]
        rows = compare(simulated, real, one_place=kind.one_place)
        print_table(
            f"{name}: {len(simulated)} simulated, {len(real)} real, voxels of {kind.voxel_size} m",
            [
                "feature",
                "simulated to real",
                "real to real",
                "ratio",
                "simulated mean",
                "real mean",
            ],
            [[r.name, r.distance, r.yard, r.ratio, r.simulated_mean, r.real_mean] for r in rows],
        )
        summary.append([name, len(simulated), merit(rows)])
        if options.per_scan:
            each = [
                [path.name, merit(compare([one], real, one_place=kind.one_place))]
                for path, one in zip(scans, simulated, strict=True)
            ]
            print_table("", ["simulated scan", "ratio"], sorted(each, key=lambda row: -row[1]))
    print_table(
        "Figure of merit (1: as unlike as two real scans)", ["kind", "scans", "ratio"], summary
    )


def by_kind(arguments: Sequence[str]) -> dict[str, list[Path]]:
    """Sort `KIND=PATH` arguments.

    Raises:
        SystemExit: One names no kind.
    """
    found: dict[str, list[Path]] = {}
    for argument in arguments:
        kind, _, path = argument.partition("=")
        if kind not in KINDS or not path:
            raise SystemExit(f"{argument!r}: expected KIND=SCANS, KIND one of {', '.join(KINDS)}")
        found.setdefault(kind, []).append(Path(path))
    return found


@dataclass(frozen=True)
class FeatureDistance:
    """How far simulated values of a feature are from real ones.

    Attributes:
        name: The feature.
        distance: Mean Wasserstein-1 over pairs of a simulated and a real scan, in standard
            deviations of the real values.
        yard: The same over pairs of real scans.
        simulated_mean: Mean of the simulated values, in the feature's unit.
        real_mean: Likewise.
    """

    name: str
    distance: float
    yard: float
    simulated_mean: float
    real_mean: float

    @property
    def ratio(self) -> float:
        """Distance over yardstick."""
        return self.distance / max(self.yard, LEAST_YARD)


def compare(
    simulated: Sequence[Features], real: Sequence[Features], *, one_place: bool
) -> list[FeatureDistance]:
    """Distances of all features that every scan has.

    Args:
        simulated: Features of simulated scans.
        real: Of real ones.
        one_place: Whether the yardstick is the distance of their halves.
    """
    rows = []
    for name in real[0]:
        if not all(name in scan for scan in (*simulated, *real)):
            continue
        made, own = ([scan[name] for scan in scans] for scans in (simulated, real))
        pooled = np.concatenate(own)
        unit = max(float(pooled.std()), 1e-6)
        pairs = [_halves(one) for one in own] if one_place else list(combinations(own, 2))
        across = [(one, other) for one in made for other in own]
        distance, yard = (
            float(np.mean([wasserstein_distance(*pair) for pair in several])) / unit
            for several in (across, pairs)
        )
        means = float(np.concatenate(made).mean()), float(pooled.mean())
        rows.append(FeatureDistance(name, distance, yard, *means))
    return rows


def _halves(values: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Values of the two halves of a scan, by its Morton order."""
    return values[: len(values) // 2], values[len(values) // 2 :]


def merit(rows: Sequence[FeatureDistance]) -> float:
    """The geometric mean of the ratios."""
    return float(np.exp(np.mean([np.log(max(row.ratio, 1e-6)) for row in rows])))


if __name__ == "__main__":
    main()
