from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from bushseg.points import PointCloud

Modules = Callable[[str], ModuleType]


def test_scores(benchmark_module: Modules) -> None:
    objects = benchmark_module("objects")

    def verdict(kind: str, bush: int, tree: int, ground: int = 0) -> object:
        counts = np.array([ground, 0, bush, tree, 0, 0, 0])
        return objects.Verdict("a", kind, 2.0, counts)

    scores = objects.score_objects(
        [
            verdict("Bush", 6, 2),
            verdict("Hedgerow", 1, 0, ground=3),
            verdict("Tree", 2, 8),
            verdict("WoodyEdge", 50, 50),
        ]
    )
    assert scores.bush_iou == pytest.approx(7 / (12 + 2))
    assert scores.tree_iou == pytest.approx(8 / (10 + 2))
    assert (scores.bushes_right, scores.trees_right) == (0.5, 1.0)


def test_made_up_ground_lies_under_the_object(benchmark_module: Modules) -> None:
    objects, judging = benchmark_module("objects"), benchmark_module("judging")
    xyz = np.array([[200_000.0, 100_000, 70], [200_001, 100_001, 73]])
    cloud = PointCloud(xyz, {"intensity": np.array([10, 20], np.uint16)})
    scan = judging.Scan(Path("a.las"), cloud, np.array([15, 15]), None, None)
    grounded = objects.set_on_ground(scan)
    assert (grounded.cloud.xyz[:2] == xyz).all()
    assert grounded.codes[:2].tolist() == [15, 15]
    ground = grounded.cloud.xyz[2:]
    assert np.abs(ground[:, 2] - 70).max() < 0.3
    assert len(ground) == pytest.approx((13 / 0.25) ** 2, rel=0.1)
    assert set(grounded.cloud.attributes["intensity"].tolist()) == {10, 20}
