"""What a simulated site holds and how it is scanned."""

from typing import Literal, Self

from pydantic import Field, model_validator

from bushseg.config import Positive, Section, Share


class SimulateConfig(Section):
    """Settings of :func:`bushseg.simulation.simulate`; defaults give about 500 k points."""

    num_sites: int = Field(1, ge=1, le=1000, description="Sites to make, each another")
    seed: int = Field(0, ge=0, description="Seed; the same seed gives the same points")

    size: float = Field(40.0, ge=20, le=500, description="Edge of the square site, metres")
    slope: float = Field(3.0, ge=0, le=30, description="Steepest general slope, degrees")
    relief: float = Field(
        0.15, ge=0, le=10, description="Standard deviation of heights about that slope, metres"
    )
    num_bushes: int = Field(50, ge=0, le=5000, description="Bushes, a length of hedge being one")
    num_trees: int = Field(9, ge=0, le=1000, description="Trees")
    grass_density: float = Field(60.0, ge=0, le=1000, description="Grass blades per square metre")
    building: bool = Field(True, description="Whether a house stands on the site")
    boundary: bool = Field(True, description="Whether a fence and a wall run along the edges")
    num_poles: int = Field(3, ge=0, le=100, description="Lamp posts")
    num_vehicles: int = Field(1, ge=0, le=100, description="Parked cars")
    num_people: int = Field(2, ge=0, le=100, description="People standing about")

    sensor: Literal["tripod", "airborne", "spinning"] = Field(
        "tripod",
        description="tripod: terrestrial scanner; airborne: flight lines; "
        "spinning: one frame of a 64-beam LiDAR, as KITTI .bin and .label",
    )
    stations: int = Field(
        3, ge=1, le=100, description="Tripod set-ups or flight lines; a spinning sensor has one"
    )
    angular_step: float = Field(
        0.36, ge=0.005, le=10, description="Step between a tripod's rays, degrees"
    )
    pulse_spacing: float = Field(
        0.1, ge=0.01, le=5, description="Step between airborne pulses on level ground, metres"
    )
    flight_height: float = Field(
        60.0, ge=30, le=1000, description="Height of the flight lines above the site, metres"
    )
    scan_angle: float = Field(
        20.0, gt=0, le=45, description="Greatest angle of airborne rays from the nadir, degrees"
    )
    min_range: float = Field(0.4, ge=0, description="Nearest return, metres")
    max_range: Positive = Field(120.0, description="Farthest return, metres")
    range_noise: float = Field(
        0.004, ge=0, le=1, description="Standard deviation of ranges, metres"
    )
    intensity_noise: Share = Field(
        0.08, description="Standard deviation of intensities, as a share of the intensity"
    )
    dropout: float = Field(0.01, ge=0, lt=1, description="Share of returns that get lost")
    color: bool = Field(True, description="Whether points have RGB")
    color_noise: float = Field(
        10.0, ge=0, le=255, description="Standard deviation of colors, of 255"
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.min_range >= self.max_range:
            raise ValueError(
                f"min_range is {self.min_range} m and max_range {self.max_range} m; "
                "expected min_range to be the smaller"
            )
        if self.sensor == "airborne" and self.max_range < 1.5 * self.flight_height:
            raise ValueError(
                f"max_range is {self.max_range} m for a flight_height of {self.flight_height} m; "
                "expected at least 1.5 times the height"
            )
        return self
