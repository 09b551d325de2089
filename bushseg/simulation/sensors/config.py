"""How a site is scanned."""

from dataclasses import fields, replace
from typing import Self

from pydantic import Field, model_validator

from bushseg.config import Positive, Section, Share
from bushseg.simulation.sensors.figures import (
    LIDAR_OF,
    LIDARS,
    PRESETS,
    Echo,
    Figures,
    Kind,
    Lidar,
    Scaling,
    Split,
)


class SensorConfig(Section):
    """A sensor's settings; None takes the figure of that kind of sensor (see `figures`)."""

    kind: Kind = Field(
        "tripod",
        description="tripod: terrestrial scanner by pulses, phase: by phases; mobile: carried "
        "along the path; spinning: single frames of a LiDAR on a vehicle, as KITTI .bin and "
        ".label, vehicle: its frames put together; uav, airborne: flight strips; photogrammetry: "
        "what is made of a drone's pictures",
    )
    lidar: Lidar | None = Field(
        None,
        description="Make of a mobile, spinning or vehicle sensor; None: vlp-16, os1-64, hdl-32e",
    )
    stations: int = Field(3, ge=1, le=100, description="Tripod set-ups on a site")
    frames: int = Field(1, ge=1, le=1000, description="Frames of a spinning sensor, on the path")
    vary: bool = Field(
        False,
        description="Draw another sensor of that kind for each site, within what such sensors "
        "differ by (see `variety`); what is given stays",
    )
    color: bool = Field(True, description="Whether points of LAZ files have RGB")
    shadows: bool = Field(True, description="Whether things cast shadows in the colors")

    sensor_height: float | None = Field(
        None, ge=0, le=10, description="Height of a sensor that stands or drives, metres"
    )
    angular_step: float | None = Field(
        None,
        ge=0.005,
        le=10,
        description="Step between a tripod's rays, or a LiDAR's columns, degrees",
    )
    lowest_angle: float | None = Field(
        None, ge=-90, le=90, description="Lowest elevation of a tripod's rays, degrees"
    )
    highest_angle: float | None = Field(
        None, ge=-90, le=90, description="Highest elevation of a tripod's rays, degrees"
    )
    turn_spacing: float | None = Field(
        None, ge=0.02, le=50, description="Path between the turns put together, metres"
    )
    tilt: float | None = Field(
        None, ge=0, le=90, description="Tilt of a carried head, ever elsewhere, degrees"
    )
    sway: float | None = Field(
        None, ge=0, le=30, description="How far a carried sensor pitches and rolls, degrees"
    )
    bob: float | None = Field(
        None, ge=0, le=1, description="How far a carried sensor moves up and sideways, metres"
    )
    pulse_spacing: float | None = Field(
        None,
        ge=0.01,
        le=5,
        description="Step between pulses of one flight strip on level ground, metres",
    )
    point_spacing: float | None = Field(
        None, ge=0.02, le=1, description="Step between the points of photogrammetry, metres"
    )
    views: int | None = Field(
        None, ge=1, le=30, description="Directions that pictures are taken in, the first is down"
    )
    matching_window: float | None = Field(
        None,
        ge=0,
        le=5,
        description="Edge of the patches that are sought in other pictures, on the ground, metres; "
        "of that, 3 to 9 times 0.8 point_spacing counts",
    )
    untextured: Share | None = Field(
        None, description="Share of the ground that is too uniform to be found in other pictures"
    )
    flight_height: float | None = Field(
        None, ge=10, le=5000, description="Height of flight above the site's highest ground, metres"
    )
    scan_angle: float | None = Field(
        None,
        gt=0,
        le=60,
        description="Greatest angle of a flight's rays or views from the nadir, degrees",
    )
    overlap: float | None = Field(
        None, ge=0, le=0.9, description="Share of a flight strip that its neighbor covers as well"
    )
    line_jitter: Share | None = Field(
        None, description="How far scan lines are off their places, as a share of the step"
    )
    exit_diameter: float | None = Field(
        None, ge=0, le=0.5, description="Width of the beam where it leaves, metres"
    )
    divergence: float | None = Field(
        None, ge=0, le=20, description="Growth of the beam's width (at 1/e^2), milliradians"
    )
    sub_rays: int | None = Field(
        None, ge=1, le=31, description="Rays that stand for a beam; 1: a line without width"
    )
    split: Split | None = Field(
        None,
        description="Which beams are cast as several rays: all, or those whose range doesn't lie "
        "in line with those before and after (edges), which is quicker where beams lie far apart",
    )
    range_resolution: float | None = Field(
        None, ge=0, le=10, description="Things nearer to each other become one return, metres"
    )
    echo: Echo | None = Field(None, description="Which returns of a beam are kept")
    max_returns: int | None = Field(None, ge=1, le=15, description="Most returns of a beam")
    min_range: float | None = Field(None, ge=0, description="Nearest return, metres")
    max_range: Positive | None = Field(None, description="Farthest return, metres")
    reach: Positive | None = Field(
        None,
        description="Where a surface of reflectance 0.1, met head-on, is seen every other time, "
        "metres",
    )
    dropout: float | None = Field(
        None, ge=0, lt=1, description="Share of returns that get lost for no reason"
    )
    range_noise: float | None = Field(
        None, ge=0, le=1, description="Standard deviation of near ranges met head-on, metres"
    )
    noise_range: Positive | None = Field(
        None, description="Where that has grown to 1.4 times as much, metres"
    )
    angular_noise: float | None = Field(
        None, ge=0, le=1, description="Standard deviation of a ray's direction, degrees"
    )
    registration_noise: float | None = Field(
        None,
        ge=0,
        le=1,
        description="Standard deviation of where stations, strips or the path are thought to be, "
        "metres along each axis",
    )
    intensity: Scaling | None = Field(
        None, description="corrected: for range; raw: falling with its square"
    )
    intensity_noise: Share | None = Field(
        None, description="Standard deviation of intensities, as a share of the intensity"
    )
    color_noise: float | None = Field(
        None, ge=0, le=255, description="Standard deviation of colors, of 255"
    )
    visibility: Positive | None = Field(
        None, description="Where haze leaves 2 % of a color's contrast, metres"
    )

    @property
    def figures(self) -> Figures:
        """All figures: those given here, then those of the LiDAR, then those of the kind."""
        preset = PRESETS[self.kind]
        if self.beams is not None:
            preset = replace(preset, **LIDARS[self.beams])
        values = ((field.name, getattr(self, field.name)) for field in fields(Figures))
        return replace(preset, **{name: value for name, value in values if value is not None})

    @property
    def beams(self) -> Lidar | None:
        """The LiDAR's make; None for a sensor without fixed beams."""
        default = LIDAR_OF.get(self.kind)
        return default and (self.lidar or default)

    @model_validator(mode="after")
    def _check(self) -> Self:
        figures = self.figures
        if figures.min_range >= figures.max_range:
            raise ValueError(
                f"min_range is {figures.min_range} m and max_range {figures.max_range} m; "
                "expected min_range to be the smaller"
            )
        if figures.lowest_angle >= figures.highest_angle:
            raise ValueError(
                f"lowest_angle is {figures.lowest_angle} and highest_angle "
                f"{figures.highest_angle} degrees; expected lowest_angle to be the smaller"
            )
        flies = self.kind in ("uav", "airborne")
        if flies and figures.max_range < 1.5 * figures.flight_height:
            raise ValueError(
                f"max_range is {figures.max_range} m for a flight_height of "
                f"{figures.flight_height} m; expected at least 1.5 times the height"
            )
        if self.lidar is not None and self.kind not in LIDAR_OF:
            raise ValueError(
                f"lidar is {self.lidar} for a {self.kind} sensor; expected none, or kind to be "
                "mobile, spinning or vehicle"
            )
        return self
