"""Whether a scan is such as a model was trained on, by what is cheap to tell."""

import numpy as np

from bushseg.checkpoint import ModelCard
from bushseg.features import height_profile
from bushseg.io.units import counts_in_feet
from bushseg.scan import VoxelScan

_DENSITY_MARGIN = 1.5
_HEIGHT_MARGIN = 1.5
_LOW_SHARE_MARGIN = 0.5
_CONFIDENCE_DROP = 0.15
_LEAST_WIDTH = 0.5  # metres
_MANY_POINTS = 1000


def domain_warnings(
    card: ModelCard,
    scan: VoxelScan,
    neighbor_distance: float,
    confidence: float | None = None,
    crs: str | None = None,
) -> list[str]:
    """What about a scan lies outside what a model was trained on.

    Args:
        card: The model's card.
        scan: The scan.
        neighbor_distance: The scan's median distance to the K-th neighbor, metres.
        confidence: Mean confidence of its voxels; None where they haven't been labelled.
        crs: The scan's coordinate reference system as its file states it.

    Returns:
        One line a concern.
    """
    found = (
        _units(scan, crs),
        _density(card, neighbor_distance),
        *_heights(card, scan),
        _confidence(card, confidence),
    )
    return [warning for warning in found if warning is not None]


def _units(scan: VoxelScan, crs: str | None) -> str | None:
    """Coordinates that aren't metres."""
    xyz, scratch = scan.voxels.xyz, scan.voxels.scratch
    spans = [
        (xyz[rows, :2].min(axis=0), xyz[rows, :2].max(axis=0)) for rows in scratch.blocks(len(xyz))
    ]
    low, high = np.min(spans, axis=0)[0], np.max(spans, axis=0)[1]
    width = float((high - low).max())
    if width < _LEAST_WIDTH and scan.num_points >= _MANY_POINTS:
        return (
            f"the scan's {scan.num_points:,} points lie within {width:.3g} m: are its coordinates "
            "degrees? bushseg takes them for metres; reproject the scan first"
        )
    if not counts_in_feet(crs):
        return None
    return (
        "the scan's CRS counts in feet and its coordinates were taken for metres: all is seen 3.3 "
        "times as large; reproject the scan first"
    )


def _density(card: ModelCard, distance: float) -> str | None:
    """Far sparser or denser than the training data."""
    low, high = card.neighbor_distance
    if low / _DENSITY_MARGIN <= distance <= high * _DENSITY_MARGIN:
        return None
    sparser = "sparser" if distance > high else "denser"
    return (
        f"the scan is {sparser} than the model's training data: {card.prepare.num_neighbors} "
        f"neighbors within {distance:.2f} m, in training {low:.2f} to {high:.2f} m; "
        "its labels may mean little"
    )


def _heights(card: ModelCard, scan: VoxelScan) -> list[str | None]:
    """Heights that no training scan had, and a scan without ground to measure them from."""
    if card.heights is None or card.low_share is None:
        return []
    low, high, low_share = height_profile(scan.features["height"], scan.voxels.scratch)
    reach, depth = card.heights[1], card.heights[0]
    tall = deep = bare = None
    if high > _HEIGHT_MARGIN * max(reach, 1.0):
        tall = (
            f"the scan reaches {high:.0f} m above its ground, the model's training data "
            f"{reach:.0f} m; are its coordinates in metres, and z upwards?"
        )
    if low < min(_HEIGHT_MARGIN * depth, depth - 1.0):
        deep = (
            f"1 % of the scan lies more than {-low:.1f} m below what looks like its ground, in "
            f"training {-depth:.1f} m; heights above ground, which the model goes by, may be wrong"
        )
    if low_share < _LOW_SHARE_MARGIN * card.low_share:
        bare = (
            f"only {low_share:.1%} of the scan's voxels lie near the ground, in training at least "
            f"{card.low_share:.1%}; without ground points, heights above it are guesses"
        )
    return [tall, deep, bare]


def _confidence(card: ModelCard, confidence: float | None) -> str | None:
    """A model that is far less sure than it was where it could be judged."""
    if confidence is None or card.confidence is None:
        return None
    if confidence >= card.confidence - _CONFIDENCE_DROP:
        return None
    return (
        f"the model is unsure of this scan: mean confidence {confidence:.0%}, on held-out data "
        f"{card.confidence:.0%}; expect more wrong labels"
    )
