"""What a simulated site holds and how it is scanned."""

from pydantic import Field

from bushseg.config import Section
from bushseg.simulation.sensors import SensorConfig


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

    sensor: SensorConfig = Field(SensorConfig(), description="How it is scanned")
