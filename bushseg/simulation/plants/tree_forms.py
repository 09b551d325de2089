"""What kinds of trees there are: the shapes of their crowns."""

from dataclasses import dataclass

from bushseg.simulation.plants.config import TreeForm


@dataclass(frozen=True, slots=True)
class Form:
    """How a tree is built.

    Attributes:
        heights: Least and greatest height, metres; a height drawn is brought within.
        width: Least and greatest crown diameter over the tree's height.
        base: Least and greatest height of the crown's base over the tree's.
        profile: Crown radius over the greatest at evenly spaced heights, from the base up.
        slopes: Slope of the lowest and of the highest boughs against the horizontal, degrees.
        boughs: Number of boughs of a tree of 10 m.
        trunk: How high the trunk goes as one, over the tree's height.
        filling: How full the crown is inside: 2 as full as at the rim, 1 rather hollow.
        droop: How much twigs rise; below 0 they hang.
        twig: Least and greatest length of twigs of a tree of 10 m, metres.
        clumping: Leaves keep to this last share of the twigs' and branches' lengths.
        density: Factor on the leaf area density.
        needles: Whether it is a conifer: needles, whorls, green in winter.
        stems: Least and greatest number of stems from the ground.
    """

    heights: tuple[float, float]
    width: tuple[float, float]
    base: tuple[float, float]
    profile: tuple[float, ...]
    slopes: tuple[float, float]
    boughs: int = 34
    trunk: float = 0.8
    filling: float = 1.4
    droop: float = 0.2
    twig: tuple[float, float] = (0.25, 0.8)
    clumping: float = 0.9
    density: float = 1.0
    needles: bool = False
    stems: tuple[int, int] = (1, 1)


FORMS: dict[TreeForm, Form] = {
    "round": Form(
        (3, 30), (0.45, 0.75), (0.12, 0.4), (0.45, 0.8, 0.97, 1.0, 0.92, 0.7, 0.3), (5, 60)
    ),
    "wide": Form(
        (5, 28), (0.75, 1.15), (0.15, 0.35), (0.5, 0.9, 1.0, 0.95, 0.75, 0.3), (0, 45), trunk=0.65
    ),
    "columnar": Form(
        (4, 28), (0.22, 0.4), (0.08, 0.4), (0.55, 0.85, 1.0, 1.0, 0.85, 0.5, 0.15), (30, 70)
    ),
    "poplar": Form(
        (9, 30), (0.12, 0.2), (0.05, 0.15), (0.5, 0.9, 1.0, 1.0, 0.9, 0.6, 0.1), (60, 80), 44, 0.93
    ),
    "cone": Form(
        (3, 30),
        (0.25, 0.45),
        (0.02, 0.45),
        (1.0, 0.87, 0.72, 0.57, 0.42, 0.26, 0.05),
        (-18, 20),
        70,
        trunk=0.99,
        filling=1.0,
        droop=-0.3,
        twig=(0.2, 0.5),
        density=1.6,
        needles=True,
    ),
    "pine": Form(
        (5, 30),
        (0.25, 0.5),
        (0.5, 0.75),
        (0.5, 0.85, 1.0, 0.95, 0.75, 0.3),
        (-5, 40),
        26,
        trunk=0.92,
        twig=(0.2, 0.45),
        clumping=0.5,
        needles=True,
    ),
    "willow": Form(
        (5, 18),
        (0.7, 1.1),
        (0.15, 0.3),
        (0.75, 1.0, 1.0, 0.9, 0.7, 0.3),
        (20, 60),
        trunk=0.6,
        droop=-3.5,
        twig=(1.2, 3.2),
        density=0.7,
    ),
    "fruit": Form(
        (2.2, 7),
        (0.7, 1.15),
        (0.2, 0.4),
        (0.6, 0.95, 1.0, 0.9, 0.6, 0.2),
        (15, 60),
        trunk=0.5,
        twig=(0.3, 0.9),
    ),
    "multi_stemmed": Form(
        (6, 16),
        (0.45, 0.8),
        (0.1, 0.35),
        (0.35, 0.7, 0.95, 1.0, 0.85, 0.4),
        (15, 60),
        trunk=0.85,
        stems=(2, 5),
    ),
}
"""Forms by name."""
