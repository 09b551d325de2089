from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

Modules = Callable[[str], ModuleType]


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("vle/SA1_Bush_130.las", True),
        ("vle/SA2_Bush_1915.las", False),
        ("ign/ign_77050_627755.laz", False),
        ("ign/origin_dsmMarker.laz", True),
        ("ign/KM_1.laz", False),
        ("frames/seq00_000000.bin", False),
        ("odm/brighton_small.laz", False),
        ("forest/TLS_Clip.laz", False),
    ],
)
def test_who_may_train(benchmark_module: Modules, path: str, expected: bool) -> None:
    assert benchmark_module("real_scans").may_train(Path("data", path)) is expected


def test_sources_and_training_scans_share_no_file(
    benchmark_module: Modules, tmp_path: Path
) -> None:
    real_scans = benchmark_module("real_scans")
    for name in ("ign/ign_77050_1.laz", "ign/origin_x.laz", "vle/SA1_Tree_1.las", "vle/SA2_a.las"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    train = real_scans.training_scans(tmp_path)
    assert [path.name for path in train] == ["origin_x.laz", "SA1_Tree_1.las"]
    judge = real_scans.SOURCES["ign"].scans(tmp_path)
    assert [path.name for path in judge] == ["ign_77050_1.laz"]


def test_kitti_groups(benchmark_module: Modules) -> None:
    groups = benchmark_module("real_scans").SOURCES["frames"].groups
    assert {groups[code] for code in (70, 71)} == {"vegetation"}
    assert {groups[code] for code in (40, 44, 48, 49, 60, 72)} == {"ground"}
    assert groups[50] == "building"
    assert groups[10] == groups[252] == "vehicle_person"
    assert 0 not in groups
