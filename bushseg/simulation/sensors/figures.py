"""What each sensor can do: about what its maker states.

The OS1's figures and the HDL-32E's angles were checked against published tables; the others are as
commonly given and may be off by a little. Drift, drop-out and what is called ours are guesses.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from bushseg.points import FloatArray

Kind = Literal[
    "tripod", "phase", "mobile", "spinning", "vehicle", "uav", "airborne", "photogrammetry"
]
Lidar = Literal["vlp-16", "hdl-32e", "hdl-64e", "os1-64", "os1-128"]
Echo = Literal["all", "strongest", "last"]
Split = Literal["edges", "all"]
Scaling = Literal["corrected", "raw"]


@dataclass(frozen=True, slots=True)
class Figures:
    """All that sensors differ in; each is a setting of `SensorConfig`, which says what it means.

    What a sensor has no use for stays at its default, such as a tripod's flight height.
    """

    sensor_height: float = 0.0
    angular_step: float = 0.2
    lowest_angle: float = -90.0
    highest_angle: float = 90.0
    turn_spacing: float = 0.5
    tilt: float = 0.0
    sway: float = 0.0
    bob: float = 0.0
    pulse_spacing: float = 0.25
    point_spacing: float = 0.08
    views: int = 5
    matching_window: float = 0.4
    untextured: float = 0.01
    flight_height: float = 500.0
    scan_angle: float = 30.0
    overlap: float = 0.3
    line_jitter: float = 0.3
    exit_diameter: float = 0.01
    divergence: float = 1.0
    sub_rays: int = 5
    split: Split = "edges"
    range_resolution: float = 0.5
    echo: Echo = "strongest"
    max_returns: int = 1
    min_range: float = 0.5
    max_range: float = 120.0
    reach: float = 50.0
    dropout: float = 0.01
    range_noise: float = 0.015
    noise_range: float = 50.0
    angular_noise: float = 0.0
    registration_noise: float = 0.0
    intensity: Scaling = "corrected"
    intensity_noise: float = 0.08
    color_noise: float = 10.0
    visibility: float = 20_000.0


PRESETS: dict[Kind, Figures] = {
    # RIEGL VZ-400i: 100 degrees from -40 to 60, 7 mm at the exit, 0.35 mrad, precision 3 mm, from
    # 0.5 m on, 400 m at 20 % (280 m at 10 %), several targets a pulse. The width of its pulse (3 ns
    # or 0.5 m) is ours.
    "tripod": Figures(
        sensor_height=1.7,
        angular_step=0.33,
        lowest_angle=-40.0,
        highest_angle=60.0,
        exit_diameter=0.007,
        divergence=0.35,
        sub_rays=3,
        range_resolution=0.5,
        echo="all",
        max_returns=4,
        max_range=400.0,
        reach=280.0,
        range_noise=0.003,
        noise_range=100.0,
        registration_noise=0.004,
    ),
    # FARO Focus S 150, compares phases: 300 degrees about a level axis (-60 to 90), 2.1 mm at the
    # exit, 0.3 mrad at 1/e (0.42 at 1/e^2), 0.6 to 150 m at 90 % (50 m at 10 %). What lies in one
    # beam is averaged over much longer than a pulse; its filters drop what is farther apart.
    "phase": Figures(
        sensor_height=1.7,
        angular_step=0.33,
        lowest_angle=-60.0,
        highest_angle=90.0,
        exit_diameter=0.0021,
        divergence=0.42,
        sub_rays=3,
        range_resolution=1.5,
        min_range=0.6,
        max_range=150.0,
        reach=50.0,
        range_noise=0.001,
        noise_range=25.0,
        angular_noise=0.005,
        registration_noise=0.003,
    ),
    # A 16-beam LiDAR on a turning head, carried: the head takes its beams everywhere.
    "mobile": Figures(
        sensor_height=1.9,
        turn_spacing=0.5,
        tilt=45.0,
        sway=3.0,
        bob=0.03,
        sub_rays=3,
        registration_noise=0.03,
    ),
    # One turn of a LiDAR on a robot or car, as the car sees it.
    "spinning": Figures(sensor_height=1.6, sway=0.5, bob=0.01, split="all"),
    # The same, driven along the path and put together.
    "vehicle": Figures(
        sensor_height=1.9, turn_spacing=1.0, sway=0.5, bob=0.01, sub_rays=3, registration_noise=0.04
    ),
    # RIEGL miniVUX-1UAV: 1.6 by 0.5 mrad, precision 10 mm, up to 5 targets, 250 m at 60 % (100 m
    # at 10 %), full circle. The width at the exit and that of its pulse are ours.
    "uav": Figures(
        pulse_spacing=0.12,
        flight_height=50.0,
        scan_angle=40.0,
        overlap=0.5,
        exit_diameter=0.01,
        divergence=0.9,
        sub_rays=7,
        split="all",
        range_resolution=0.5,
        echo="all",
        max_returns=5,
        min_range=3.0,
        max_range=250.0,
        reach=100.0,
        range_noise=0.01,
        noise_range=100.0,
        angular_noise=0.01,
        registration_noise=0.02,
        intensity="raw",
    ),
    # RIEGL VQ-780i: 0.25 mrad, 60 degrees, precision 20 mm. It tells up to 15 targets; 7 is what
    # surveys deliver. The width at the exit and that of its pulse are ours. So are the errors: with
    # 20 mm of noise, level ground would be rougher than it is in delivered, adjusted strips. So is
    # the reach: crews fly as high as the pulse rate lets them, and few leaves give a third echo.
    "airborne": Figures(
        pulse_spacing=0.25,
        flight_height=600.0,
        scan_angle=30.0,
        overlap=0.3,
        exit_diameter=0.02,
        divergence=0.25,
        sub_rays=7,
        split="all",
        range_resolution=0.5,
        echo="all",
        max_returns=7,
        min_range=50.0,
        max_range=4000.0,
        reach=800.0,
        range_noise=0.012,
        noise_range=2000.0,
        angular_noise=0.003,
        registration_noise=0.015,
        intensity="raw",
    ),
    # A drone's camera, and software that matches its pictures: all ours, held against one cloud.
    "photogrammetry": Figures(
        flight_height=80.0,
        scan_angle=25.0,
        range_noise=0.006,
        registration_noise=0.006,
        color_noise=6.0,
    ),
}
"""Figures by kind of sensor."""

LIDAR_OF: dict[Kind, Lidar] = {"mobile": "vlp-16", "spinning": "os1-64", "vehicle": "hdl-32e"}
"""The LiDAR that kinds with beams carry unless told."""

_HDL_64E = np.concatenate([np.linspace(-24.33, -8.83, 32), np.linspace(-8.33, 2.0, 32)])

BEAMS: dict[Lidar, FloatArray] = {
    "vlp-16": np.linspace(-15, 15, 16, dtype=np.float64),
    "hdl-32e": np.linspace(-30.67, 10.67, 32, dtype=np.float64),
    "hdl-64e": _HDL_64E,  # 1/2 degree below, 1/3 above
    "os1-64": np.linspace(-16.6, 16.6, 64, dtype=np.float64),
    "os1-128": np.linspace(-22.5, 22.5, 128, dtype=np.float64),
}
"""Elevations of a LiDAR's beams, degrees, upwards, by its manual."""

LIDARS: dict[Lidar, dict[str, Any]] = {
    # Velodyne VLP-16: 10 turns a second, 3.0 by 1.2 mrad, 12.7 by 9.5 mm, 100 m, 3 cm.
    "vlp-16": {
        "angular_step": 0.2,
        "divergence": 2.1,
        "exit_diameter": 0.011,
        "max_range": 100.0,
        "reach": 40.0,
        "range_noise": 0.02,
    },
    # Velodyne HDL-32E: 10 turns a second, 2.8 mrad, 100 m, 2 cm.
    "hdl-32e": {
        "angular_step": 0.16,
        "divergence": 2.8,
        "exit_diameter": 0.01,
        "max_range": 100.0,
        "reach": 40.0,
        "range_noise": 0.015,
    },
    # Velodyne HDL-64E: 10 turns a second, 2 mrad, 0.9 to 120 m, 50 m at 10 %, less than 2 cm.
    "hdl-64e": {
        "angular_step": 0.18,
        "divergence": 2.0,
        "exit_diameter": 0.01,
        "min_range": 0.9,
        "max_range": 120.0,
        "reach": 50.0,
        "range_noise": 0.012,
    },
    # Ouster OS1, 64 beams: 2048 columns, 0.13 degrees at half height (3.9 mrad at 1/e^2), 10 mm,
    # 0.8 to 120 m, 40 m at 10 %, 1.5 cm where the signal is strong and 3 cm where it is fair.
    "os1-64": {
        "angular_step": 360 / 2048,
        "divergence": 3.9,
        "exit_diameter": 0.01,
        "min_range": 0.8,
        "max_range": 120.0,
        "reach": 40.0,
        "range_noise": 0.015,
        "noise_range": 30.0,
        "angular_noise": 0.01,
    },
    # Ouster OS1, 128 beams: as before, with 0.18 degrees at half height (5.3 mrad at 1/e^2).
    "os1-128": {
        "angular_step": 360 / 2048,
        "divergence": 5.3,
        "exit_diameter": 0.01,
        "min_range": 0.8,
        "max_range": 120.0,
        "reach": 40.0,
        "range_noise": 0.015,
        "noise_range": 30.0,
        "angular_noise": 0.01,
    },
}
"""Figures that follow from the LiDAR rather than from what carries it."""
