"""The sites that the bundled models learn from, and those that judge them.

Sensors are drawn anew for each site (`vary`); a folder holds sites of one mixture of places, drawn
by weight, so that there is as much settlement as a kind of sensor meets. Each judging folder has a
settlement and a wild place; their seeds and plants are others: larger shrubs, smaller trees,
sparser leaves, more bare twigs.
"""

from typing import Any

from bushseg.simulation import SimulateConfig
from bushseg.simulation.places.config import PLACE_NAMES

OTHER_PLANTS: dict[str, Any] = {
    "shrub_height": [0.6, 1.7, 4.5],
    "shrub_leaf_density": [0.6, 1.4, 3.5],
    "shrub_leaf_length": [0.03, 0.06, 0.12],
    "shrub_leafless": 0.2,
    "hedge_height": [0.8, 1.8, 3.6],
    "hedge_clipped": 0.4,
    "tree_height": [3.5, 8.0, 20.0],
    "tree_low_crowns": 0.4,
    "tree_leafless": 0.2,
}

SETTLED = {"street": 5.0, "village": 2.0, "garden": 1.0, "yard": 1.0, "road": 1.0}
GREEN = {
    "orchard": 1.0,
    "fields": 1.0,
    "park": 1.5,
    "forest_edge": 1.5,
    "forest": 2.0,
    "heath": 1.0,
    "trail": 1.5,
}
"""How often each place is drawn where people live, and where they don't."""


def _sites(
    seed: int,
    kind: str,
    num_sites: int,
    size: float,
    weights: dict[str, float],
    plants: dict[str, Any] | None = None,
    **sensor: Any,
) -> SimulateConfig:
    """Places drawn by weight, seen by sensors of one kind."""
    return SimulateConfig.from_dict(
        {
            "seed": seed,
            "num_sites": num_sites,
            "size": size,
            "place": "mixed",
            "places": {name: {"weight": weights.get(name, 0.0)} for name in PLACE_NAMES},
            "sensor": {"kind": kind, "vary": True, **sensor},
            "plants": plants or {},
        }
    )


TRAINING: dict[str, dict[str, SimulateConfig]] = {
    "close": {
        "spinning": _sites(1000, "spinning", 15, 80.0, GREEN),
        "spinning_settled": _sites(1050, "spinning", 24, 70.0, SETTLED),
        "vehicle": _sites(1100, "vehicle", 2, 40.0, GREEN),
        "vehicle_settled": _sites(1150, "vehicle", 5, 40.0, SETTLED),
        "mobile": _sites(1200, "mobile", 5, 40.0, GREEN),
        "mobile_settled": _sites(1250, "mobile", 5, 40.0, SETTLED),
        "tripod": _sites(1300, "tripod", 6, 40.0, GREEN),
        "tripod_settled": _sites(1351, "tripod", 6, 40.0, SETTLED),
        "tripod_alone": _sites(1400, "tripod", 3, 40.0, GREEN, stations=1),
        "phase": _sites(1500, "phase", 2, 40.0, {"forest": 1.0}, stations=2),
        "phase_settled": _sites(1550, "phase", 2, 40.0, SETTLED, stations=2),
        "uav": _sites(1600, "uav", 3, 60.0, GREEN),
        "uav_settled": _sites(1650, "uav", 3, 60.0, SETTLED),
        "photogrammetry": _sites(1702, "photogrammetry", 3, 60.0, GREEN),
        "photogrammetry_settled": _sites(1755, "photogrammetry", 2, 60.0, SETTLED),
    },
    "airborne": {
        "airborne": _sites(2000, "airborne", 12, 100.0, GREEN),
        "airborne_settled": _sites(2050, "airborne", 14, 100.0, SETTLED),
        "uav": _sites(2100, "uav", 2, 80.0, GREEN),
        "uav_settled": _sites(2150, "uav", 3, 80.0, SETTLED),
        "photogrammetry": _sites(2201, "photogrammetry", 2, 80.0, GREEN),
        "photogrammetry_settled": _sites(2252, "photogrammetry", 2, 80.0, SETTLED),
    },
}
"""By model, then by folder."""

_ALL = {**SETTLED, **GREEN}

TEST: dict[str, SimulateConfig] = {
    "spinning": _sites(9006, "spinning", 5, 80.0, _ALL, OTHER_PLANTS),
    "vehicle": _sites(9100, "vehicle", 3, 40.0, _ALL, OTHER_PLANTS),
    "mobile": _sites(9216, "mobile", 4, 40.0, _ALL, OTHER_PLANTS),
    "tripod": _sites(9332, "tripod", 4, 40.0, _ALL, OTHER_PLANTS),
    "uav": _sites(9416, "uav", 3, 60.0, _ALL, OTHER_PLANTS),
    "airborne": _sites(9522, "airborne", 5, 100.0, _ALL, OTHER_PLANTS),
    "photogrammetry": _sites(9603, "photogrammetry", 2, 60.0, _ALL, OTHER_PLANTS),
}
"""By folder, seeds chosen so that each draws a street and a wood or park among other places; both
models are judged on those whose density suits them."""
