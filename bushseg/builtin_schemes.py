"""The built-in class schemes, as tables: name, source codes, color, LAS code, `bush` class.

Six schemes, one constant each; :data:`bushseg.labels.SCHEMES` names them. Codes and colors of
published data sets are theirs; which `bush` class each of their classes stands for is our reading:

- `ground` is the surface itself: soil, rock, paving, mud, and turf too short to rise from it.
- A class that mixes kinds the `bush` scheme keeps apart (SemanticKITTI's vegetation, a height band)
  stands for none of them. Its points are unlabelled after translation, which costs training data
  but teaches nothing false.
"""

from collections.abc import Iterable

from bushseg.scheme import BushClass, ClassInfo, ClassScheme

_Row = tuple[str, tuple[int, ...], str, int, BushClass | None]


def _classes(rows: Iterable[_Row]) -> tuple[ClassInfo, ...]:
    return tuple(
        ClassInfo(name=name, codes=codes, color=color, asprs=asprs, bush=bush)
        for name, codes, color, asprs, bush in rows
    )


BUSH = ClassScheme(
    name="bush",
    description="Ours: what a bush stands on, among and against",
    classes=_classes(
        [
            ("ground", (2,), "#a5814f", 2, "ground"),
            ("low_vegetation", (3,), "#b8d97b", 3, "low_vegetation"),
            ("bush", (4,), "#ff7f0e", 4, "bush"),
            ("tree", (5,), "#1f7a33", 5, "tree"),
            ("building", (6,), "#b5403a", 6, "building"),
            ("man_made", (64,), "#7f7f8c", 64, "man_made"),
            ("vehicle_person", (65,), "#3f6fd1", 65, "vehicle_person"),
        ]
    ),
    unlabelled=(1, 0, 7, 18),
    bush_class="bush",
)
"""Seven classes whose source codes are the LAS codes they are written as.

A file labelled under this scheme therefore reads back as itself. The classes are those a bush must
be told from, by what they are and not by how high they stand:

- low_vegetation: grass, herbs and crops; not woody, and too dense or tall to count as ground.
- bush: woody, branching from near the ground, with no trunk to speak of; hedges too.
- tree: trunk and crown, its lowest branches included.
- building, man_made (walls, fences, poles, wires, furniture), vehicle_person: what moves is apart,
  because it is in one scan and gone in the next.
- Unlabelled: never classified (0), unclassified (1) and scanning artifacts (7 and 18, noise): they
  have no shape to learn, and a model that knows them would hide real points.

LAS has no code for bush, nor for man-made things and vehicles at large. Bush takes 4, "medium
vegetation", which every viewer shows as plants; the others take 64 and 65, the first that LAS 1.4
leaves to users. In most national surveys 4 is a band of heights, roughly 0.5-2 m, that holds the
lower parts of trees: such files are to be read under `asprs`, not under this scheme.
"""

ASPRS = ClassScheme(
    name="asprs",
    description="LAS 1.4's standard classes, for airborne surveys",
    classes=_classes(
        [
            ("ground", (2, 8, 20), "#a5814f", 2, "ground"),
            ("low_vegetation", (3,), "#b8d97b", 3, "low_vegetation"),
            ("medium_vegetation", (4,), "#6fbf4b", 4, None),
            ("high_vegetation", (5,), "#1f7a33", 5, "tree"),
            ("building", (6,), "#b5403a", 6, "building"),
            ("water", (9,), "#2f7ed8", 9, None),
            ("rail", (10,), "#4d4d66", 10, "man_made"),
            ("road", (11,), "#8c8c8c", 11, "ground"),
            ("wire_guard", (13,), "#f2d13c", 13, "man_made"),
            ("wire_conductor", (14,), "#f28e2b", 14, "man_made"),
            ("transmission_tower", (15,), "#9467bd", 15, "man_made"),
            ("wire_connector", (16,), "#c49c94", 16, "man_made"),
            ("bridge_deck", (17,), "#d68ad6", 17, "man_made"),
            ("overhead_structure", (19,), "#8c564b", 19, "man_made"),
            ("snow", (21,), "#dfeaf4", 21, None),
        ]
    ),
    unlabelled=(1, 0, 7, 12, 18, 22),
)
"""The point classes of LAS 1.4, less what describes processing and not the thing itself.

Model key points (8, in LAS 1.1-1.3) and ignored ground (20) lie on the ground and are ground.
Unlabelled: 0 and 1; noise (7, 18); overlap (12, a flag in LAS 1.4); temporal exclusion (22). Codes
of 64 and above mean what each producer says and are unknown here. Nothing is bush: classes 3, 4
and 5 are commonly bands of height above ground. High vegetation counts as tree, which it mostly is;
medium vegetation, with the bushes and the lower parts of trees in it, as neither.
"""

SEMANTIC3D = ClassScheme(
    name="semantic3d",
    description="Semantic3D's 8 classes: terrestrial scans of towns and villages",
    classes=_classes(
        [
            ("man_made_terrain", (1,), "#9a9a9a", 2, "ground"),
            ("natural_terrain", (2,), "#a5814f", 2, "ground"),
            ("high_vegetation", (3,), "#1f7a33", 5, "tree"),
            ("low_vegetation", (4,), "#ff7f0e", 4, "bush"),
            ("building", (5,), "#b5403a", 6, "building"),
            ("hardscape", (6,), "#7f7f8c", 64, "man_made"),
            ("scanning_artifact", (7,), "#e377c2", 7, None),
            ("car", (8,), "#3f6fd1", 65, "vehicle_person"),
        ]
    ),
    bush_class="low_vegetation",
)
"""Its low vegetation is flowers and bushes below 2 m: what the paper's Table 1 calls Bush."""

_RELLIS_ROWS: tuple[_Row, ...] = (
    ("grass", (3,), "#006600", 3, "low_vegetation"),
    ("tree", (4,), "#00ff00", 5, "tree"),
    ("pole", (5,), "#009999", 64, "man_made"),
    ("water", (6,), "#0080ff", 9, None),
    ("vehicle", (8,), "#ffff00", 65, "vehicle_person"),
    ("log", (15,), "#660000", 1, None),
    ("person", (17,), "#cc9966", 65, "vehicle_person"),
    ("fence", (18,), "#6600cc", 64, "man_made"),
    ("bush", (19,), "#ff99cc", 4, "bush"),
    ("concrete", (23,), "#aaaaaa", 2, "ground"),
    ("barrier", (27,), "#2979ff", 64, "man_made"),
    ("puddle", (31,), "#86ffef", 2, "ground"),
    ("mud", (33,), "#634222", 2, "ground"),
    ("rubble", (34,), "#6e168a", 64, "man_made"),
)
_RELLIS_UNLABELLED = (0, 1, 7, 9, 10, 12)
_NOT_IN_THE_PAPER = {"pole", "water", "fence"}

RELLIS = ClassScheme(
    name="rellis",
    description="RELLIS-3D's 14 classes with points worth counting: off-road frames",
    classes=_classes(_RELLIS_ROWS),
    unlabelled=_RELLIS_UNLABELLED,
    bush_class="bush",
)
"""Dirt, sky, object, asphalt and building have next to no points: unlabelled, as void is.

A log lies on the ground like nothing else in `bush`, so it stands for none of its classes.
"""

RELLIS11 = ClassScheme(
    name="rellis11",
    description="The 11 of RELLIS-3D's classes that BushNet's Table 2 reports",
    classes=_classes(row for row in _RELLIS_ROWS if row[0] not in _NOT_IN_THE_PAPER),
    unlabelled=(
        *_RELLIS_UNLABELLED,
        *(code for row in _RELLIS_ROWS if row[0] in _NOT_IN_THE_PAPER for code in row[1]),
    ),
    bush_class="bush",
)
"""As `rellis`; the paper leaves out pole, water and fence for having too few points."""

SEMANTICKITTI = ClassScheme(
    name="semantickitti",
    description="SemanticKITTI's 19 single-scan classes: frames from the road",
    classes=_classes(
        [
            ("car", (10, 252), "#6496f5", 65, "vehicle_person"),
            ("bicycle", (11,), "#64e6f5", 65, "vehicle_person"),
            ("motorcycle", (15,), "#1e3c96", 65, "vehicle_person"),
            ("truck", (18, 258), "#501eb4", 65, "vehicle_person"),
            ("other_vehicle", (20, 13, 16, 256, 257, 259), "#0000ff", 65, "vehicle_person"),
            ("person", (30, 254), "#ff1e1e", 65, "vehicle_person"),
            ("bicyclist", (31, 253), "#ff28c8", 65, "vehicle_person"),
            ("motorcyclist", (32, 255), "#961e5a", 65, "vehicle_person"),
            ("road", (40, 60), "#ff00ff", 11, "ground"),
            ("parking", (44,), "#ff96ff", 11, "ground"),
            ("sidewalk", (48,), "#4b004b", 2, "ground"),
            ("other_ground", (49,), "#af004b", 2, "ground"),
            ("building", (50,), "#ffc800", 6, "building"),
            ("fence", (51,), "#ff7832", 64, "man_made"),
            ("vegetation", (70,), "#00af00", 5, None),
            ("trunk", (71,), "#873c00", 5, "tree"),
            ("terrain", (72,), "#96f050", 2, "ground"),
            ("pole", (80,), "#fff096", 64, "man_made"),
            ("traffic_sign", (81,), "#ff0000", 64, "man_made"),
        ]
    ),
    unlabelled=(0, 1, 52, 99),
)
"""What moves is folded into what stands (252-259), buses and trains into other_vehicle, lane
markings into road; outliers, other structures and other objects are unlabelled: the benchmark's
own reading for single scans.
"""
