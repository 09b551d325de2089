import json

import pytest

from bushseg.errors import CacheError
from bushseg.manifests import CropsManifest, ScanManifest, check_manifest

TILE = {
    "core_size": 7,
    "class_counts": [3, 0],
    "neighbor_distance": 0.2,
    "height_profile": [0, 1.5, 1],
}
SCAN = {
    "path": "a.las",
    "num_points": 9,
    "num_skipped": 0,
    "unknown_codes": {"65": 2},
    "invalid_codes": 0,
    "tiles": [TILE],
    "has_labels": True,
    "features": ["height"],
}


def test_a_scan_s_manifest_is_taken_with_what_else_stands_in_it():
    manifest = check_manifest(ScanManifest, {**SCAN, "version": 3, "oriented_to": "up"}, "a.json")
    assert manifest.tiles[0].class_counts == [3, 0]


@pytest.mark.parametrize(
    ("change", "place"),
    [
        ({"tiles": [{**TILE, "core_size": 0}]}, "tiles.0.core_size"),
        ({"tiles": [{**TILE, "core_size": "7"}]}, "tiles.0.core_size"),
        ({"tiles": [{**TILE, "core_size": True}]}, "tiles.0.core_size"),
        ({"tiles": [{**TILE, "core_size": 2**70}]}, "tiles.0.core_size"),
        ({"tiles": [{**TILE, "class_counts": [1, -1]}]}, "tiles.0.class_counts.1"),
        ({"tiles": [{**TILE, "height_profile": [0, 1]}]}, "tiles.0.height_profile"),
        ({"tiles": {}}, "tiles"),
        ({"unknown_codes": {"x": 1}}, "unknown_codes.x"),
        ({"features": None}, "features"),
    ],
)
def test_a_value_that_can_t_be_is_named(change, place):
    with pytest.raises(CacheError, match=rf"a\.json: can't be used \({place}.*prepare` again"):
        check_manifest(ScanManifest, {**SCAN, **change}, "a.json")


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_json_s_numbers_that_are_none(number):
    tile = json.loads(json.dumps(TILE).replace("0.2", number))
    with pytest.raises(CacheError, match="neighbor_distance"):
        check_manifest(ScanManifest, {**SCAN, "tiles": [tile]}, "a.json")


def test_crops_have_a_flag_each():
    with pytest.raises(CacheError, match="2 crops, 1 flags"):
        check_manifest(CropsManifest, {"tiles": [0, 0], "labelled": [True]}, "a.json")
