"""What a simulated site holds and how it is scanned."""

from pathlib import Path
from typing import Any, ClassVar, Literal, Self

from pydantic import Field

from bushseg.config import Section, read_toml
from bushseg.simulation.places.config import PlaceName, PlacesConfig
from bushseg.simulation.plants.config import PlantsConfig
from bushseg.simulation.sensors.config import SensorConfig
from bushseg.simulation.structures.config import StructuresConfig
from bushseg.simulation.terrain import TerrainConfig


class SimulateConfig(Section):
    """Settings of :func:`bushseg.simulation.simulate`; defaults give about 500 k points."""

    listed_by: ClassVar[str] = "bushseg simulate --show-config"

    num_sites: int = Field(1, ge=1, le=10_000, description="Sites to make, each another")
    seed: int = Field(0, ge=0, description="Seed; the same seed gives the same points")
    size: float = Field(40.0, ge=20, le=500, description="Edge of the square site, metres")
    place: Literal[PlaceName, "mixed"] = Field(
        "garden", description="What the sites are; mixed draws a place for each, by weight"
    )
    sensor: SensorConfig = SensorConfig()
    terrain: TerrainConfig = TerrainConfig()
    plants: PlantsConfig = PlantsConfig()
    structures: StructuresConfig = StructuresConfig()
    places: PlacesConfig = PlacesConfig()

    @classmethod
    def load(cls, path: str | Path | None = None, overrides: dict[str, Any] | None = None) -> Self:
        """Read a TOML file, if one is given, and lay overrides on top.

        Args:
            path: The file; what it doesn't set keeps its default.
            overrides: Settings by name; one that holds a table, such as `sensor`, is laid over
                the file's table.

        Raises:
            ConfigError: The file is missing, no TOML, or holds an unknown or bad setting.
        """
        values = {} if path is None else read_toml(Path(path))
        for name, given in (overrides or {}).items():
            below = values.get(name)
            if isinstance(given, dict) and isinstance(below, dict):
                values[name] = {**below, **given}
            elif given != {}:
                values[name] = given
        return cls.from_dict(values, "settings" if path is None else str(path))
