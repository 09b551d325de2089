"""The sites that the bundled models learn from, and those that judge them.

Sensors are drawn anew for each site (`vary`), places by weight (`mixed`). The judging sites have
other seeds and other plants: larger shrubs, smaller trees, sparser leaves, more bare twigs.
"""

from typing import Any

from bushseg.simulation import SimulateConfig

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


def _sites(
    seed: int, kind: str, num_sites: int, size: float, plants: dict[str, Any], **sensor: Any
) -> SimulateConfig:
    """Mixed places, seen by sensors of one kind."""
    return SimulateConfig.from_dict(
        {
            "seed": seed,
            "num_sites": num_sites,
            "size": size,
            "place": "mixed",
            "sensor": {"kind": kind, "vary": True, **sensor},
            "plants": plants,
        }
    )


TRAINING: dict[str, dict[str, SimulateConfig]] = {
    "close": {
        "spinning": _sites(1000, "spinning", 32, 80.0, {}),
        "vehicle": _sites(1100, "vehicle", 6, 40.0, {}),
        "mobile": _sites(1200, "mobile", 10, 40.0, {}),
        "tripod": _sites(1300, "tripod", 10, 40.0, {}),
        "tripod_alone": _sites(1400, "tripod", 5, 40.0, {}, stations=1),
        "phase": _sites(1500, "phase", 4, 40.0, {}, stations=2),
        "uav": _sites(1600, "uav", 6, 60.0, {}),
    },
    "airborne": {
        "airborne": _sites(2000, "airborne", 26, 100.0, {}),
        "uav": _sites(2100, "uav", 5, 80.0, {}),
    },
}
"""By model, then by folder."""

TEST: dict[str, SimulateConfig] = {
    "spinning": _sites(9000, "spinning", 4, 80.0, OTHER_PLANTS),
    "vehicle": _sites(9100, "vehicle", 2, 40.0, OTHER_PLANTS),
    "mobile": _sites(9200, "mobile", 3, 40.0, OTHER_PLANTS),
    "tripod": _sites(9300, "tripod", 3, 40.0, OTHER_PLANTS),
    "uav": _sites(9400, "uav", 2, 60.0, OTHER_PLANTS),
    "airborne": _sites(9500, "airborne", 4, 100.0, OTHER_PLANTS),
}
"""By folder; both models are judged on those whose density suits them."""
