"""How much sensors of one kind differ: what a network should be indifferent to."""

from typing import Any

import numpy as np

from bushseg.simulation.sensors.config import SensorConfig
from bushseg.simulation.sensors.figures import PRESETS, Kind

SPANS: dict[Kind, dict[str, tuple[float, float]]] = {
    "tripod": {
        "sensor_height": (1.2, 2.2),
        "divergence": (0.2, 0.5),
        "range_noise": (0.002, 0.006),
        "registration_noise": (0.001, 0.01),
        "dropout": (0.003, 0.05),
    },
    "phase": {
        "sensor_height": (1.2, 2.2),
        "reach": (30.0, 120.0),
        "range_noise": (0.0005, 0.004),
        "registration_noise": (0.001, 0.01),
        "dropout": (0.003, 0.1),
    },
    "mobile": {
        "sensor_height": (1.2, 2.2),
        "turn_spacing": (0.4, 0.8),
        "tilt": (25.0, 70.0),
        "sway": (1.0, 6.0),
        "registration_noise": (0.01, 0.05),
        "dropout": (0.003, 0.1),
    },
    "spinning": {
        "sensor_height": (0.6, 2.2),
        "sway": (0.2, 3.0),
        "dropout": (0.003, 0.2),
    },
    "vehicle": {
        "sensor_height": (1.5, 2.4),
        "turn_spacing": (0.8, 2.0),
        "registration_noise": (0.01, 0.06),
        "dropout": (0.003, 0.1),
    },
    "uav": {
        "flight_height": (30.0, 80.0),
        "pulse_spacing": (0.08, 0.2),
        "scan_angle": (30.0, 45.0),
        "overlap": (0.3, 0.7),
        "divergence": (0.3, 1.6),
        "range_noise": (0.005, 0.02),
        "registration_noise": (0.01, 0.05),
    },
    "airborne": {
        "flight_height": (300.0, 1500.0),
        "pulse_spacing": (0.18, 0.7),  # 30 to 2 pulses a square metre and strip
        "scan_angle": (15.0, 30.0),
        "overlap": (0.1, 0.6),
        "divergence": (0.25, 0.5),
        "reach": (660.0, 1500.0),  # at the preset's flight height, and in proportion to it
        "range_noise": (0.006, 0.025),
        "registration_noise": (0.005, 0.04),
    },
    "photogrammetry": {
        "flight_height": (40.0, 120.0),
        "point_spacing": (0.05, 0.12),
        "scan_angle": (12.0, 35.0),
        "matching_window": (0.25, 0.6),
        "untextured": (0.001, 0.04),
        "range_noise": (0.003, 0.015),
        "registration_noise": (0.003, 0.015),
        "dropout": (0.003, 0.1),
    },
}
"""Least and greatest value of each figure that is drawn."""

CHOICES: dict[Kind, dict[str, tuple[str, ...]]] = {
    "tripod": {"intensity": ("corrected", "raw")},
    "phase": {},
    "mobile": {"lidar": ("vlp-16", "hdl-32e"), "echo": ("strongest", "last")},
    "spinning": {
        "lidar": ("vlp-16", "hdl-32e", "hdl-64e", "os1-64", "os1-64", "os1-128"),
        "echo": ("strongest", "last"),
        "intensity": ("corrected", "raw"),
    },
    "vehicle": {"lidar": ("vlp-16", "hdl-32e", "hdl-64e", "os1-64"), "echo": ("strongest", "last")},
    "uav": {"intensity": ("corrected", "raw")},
    "airborne": {"intensity": ("corrected", "raw")},
    "photogrammetry": {},
}
"""What else is drawn, one as likely as another."""


def varied(rng: np.random.Generator, config: SensorConfig) -> SensorConfig:
    """Draw a sensor of that kind; what `config` gives stays.

    Figures are drawn evenly by their logarithm. A setting that is given changes no other draw, but
    for the flight height: who flies higher sends fewer and brighter pulses, and so sees farther.
    """
    drawn: dict[str, Any] = {}
    for name, (low, high) in SPANS[config.kind].items():
        drawn[name] = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    for name, options in CHOICES[config.kind].items():
        drawn[name] = options[rng.integers(len(options))]
    if config.kind == "airborne":
        height = config.flight_height or drawn["flight_height"]
        drawn["reach"] *= height / PRESETS["airborne"].flight_height
    free = {name: value for name, value in drawn.items() if getattr(config, name) is None}
    return SensorConfig.model_validate({**config.model_dump(), **free})
