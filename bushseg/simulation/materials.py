"""What surfaces are made of: how bright the laser finds them, and their color."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Material:
    """A surface's looks.

    Attributes:
        reflectance: Share of the laser's light that returns at normal incidence, near infrared.
        color: Red, green and blue in daylight, 0 to 255.
    """

    reflectance: float
    color: tuple[int, int, int]


SOIL = Material(0.30, (112, 100, 66))
LAWN = Material(0.42, (104, 124, 60))
GRAVEL = Material(0.36, (158, 150, 138))
GRASS = Material(0.55, (136, 156, 74))
DRY_GRASS = Material(0.50, (186, 168, 112))
BARK = Material(0.35, (92, 74, 58))
PLASTER = Material(0.75, (228, 220, 202))
TILES = Material(0.40, (158, 76, 56))
GLASS = Material(0.08, (70, 84, 98))
PANE = Material(0.004, (70, 84, 98))
"""A window that mirrors light away: seen from near or by strong lasers only."""

WOOD = Material(0.50, (140, 102, 66))
STONE = Material(0.45, (150, 146, 138))
METAL = Material(0.60, (120, 124, 128))
BRICK = Material(0.38, (142, 92, 74))
CONCRETE = Material(0.42, (164, 162, 156))
STRAW = Material(0.62, (196, 176, 112))
ASPHALT = Material(0.14, (84, 84, 86))
SAND = Material(0.45, (186, 170, 134))
LITTER = Material(0.40, (118, 92, 62))
MEADOW = Material(0.46, (122, 132, 66))
WATER = Material(0.01, (74, 80, 78))
"""Near infrared is swallowed, and what is mirrored goes elsewhere."""

RUBBER = Material(0.06, (36, 36, 38))
SKIN = Material(0.45, (206, 164, 138))

BROADLEAF = (
    Material(0.52, (70, 112, 42)),
    Material(0.50, (88, 122, 48)),
    Material(0.56, (108, 132, 60)),
    Material(0.48, (58, 98, 50)),
)
SHRUB_LEAF = (
    Material(0.50, (60, 100, 44)),
    Material(0.54, (98, 128, 52)),
    Material(0.46, (74, 104, 72)),
    Material(0.50, (122, 116, 58)),
    Material(0.44, (104, 62, 54)),
)
HEDGE_LEAF = (
    Material(0.48, (52, 92, 40)),
    Material(0.52, (84, 116, 50)),
    Material(0.42, (44, 72, 48)),
    Material(0.46, (110, 96, 60)),
)
HERB_LEAF = (
    Material(0.52, (72, 118, 46)),
    Material(0.56, (100, 134, 58)),
    Material(0.50, (118, 126, 66)),
)
NEEDLES = (
    Material(0.38, (46, 80, 52)),
    Material(0.42, (58, 90, 66)),
    Material(0.40, (70, 96, 78)),
)
DEAD_LEAF = (Material(0.48, (142, 104, 66)), Material(0.52, (166, 128, 82)))
TREE_BARK = (
    BARK,
    Material(0.42, (122, 108, 92)),
    Material(0.32, (104, 78, 60)),
    Material(0.55, (190, 184, 172)),
)
SHRUB_BARK = (
    Material(0.36, (98, 82, 64)),
    Material(0.42, (124, 100, 78)),
    Material(0.34, (92, 56, 48)),
)
DEAD_WOOD = (Material(0.45, (138, 126, 112)), Material(0.38, (108, 92, 76)))
PAINT = (
    Material(0.55, (168, 36, 36)),
    Material(0.70, (222, 222, 224)),
    Material(0.30, (44, 62, 104)),
    Material(0.25, (52, 54, 56)),
    Material(0.45, (52, 92, 58)),
)
CLOTH = (
    Material(0.50, (196, 124, 40)),
    Material(0.35, (58, 70, 112)),
    Material(0.55, (150, 150, 150)),
)
