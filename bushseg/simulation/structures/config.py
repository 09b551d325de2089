"""What people built and drive: every distribution, to be edited for one's own region."""

from typing import Literal

from pydantic import Field

from bushseg.config import Section, Share
from bushseg.simulation.plants.distributions import Spread, Weights

VehicleKind = Literal["hatchback", "saloon", "estate", "suv", "minivan", "pickup", "van", "tractor"]


class StructuresConfig(Section):
    """Settings of vehicles and what lines a street; defaults are meant for Europe."""

    vehicle_kinds: Weights[VehicleKind] = Field(
        {
            "hatchback": 0.3,
            "saloon": 0.12,
            "estate": 0.2,
            "suv": 0.16,
            "minivan": 0.1,
            "pickup": 0.03,
            "van": 0.09,
        },
        description="Vehicles on streets and drives (weights; a kind left out is never seen)",
    )
    vehicle_scale: Spread = Field(
        (0.9, 1.0, 1.08),
        description="Factor on vehicles' lengths (5 %, 50 % and 95 % quantile)",
    )
    parking_gap: Spread = Field(
        (0.4, 0.8, 2.0),
        description="Gap between parked cars, metres (5 %, 50 % and 95 % quantile)",
    )
    front_garden: Spread = Field(
        (1.2, 3.5, 8.0),
        description="From the pavement to the houses of a street, metres "
        "(5 %, 50 % and 95 % quantile)",
    )
    front_hedge_height: Spread = Field(
        (0.5, 1.1, 2.2),
        description="Height of hedges along streets, metres (5 %, 50 % and 95 % quantile)",
    )
    front_walls: Share = Field(
        0.3, description="Share of front gardens behind a wall or fence, planted or not"
    )
    terraced: Share = Field(0.35, description="Share of streets whose houses stand wall to wall")
    street_trunk: Spread = Field(
        (1.8, 2.6, 4.0),
        description="Bare trunk of street trees, metres (5 %, 50 % and 95 % quantile)",
    )
