"""Which sites a model is judged by while it learns."""

import numpy as np
import pytest

from bushseg.errors import DataError
from bushseg.simulation.scene import CLASS_CODES

ALL = list(CLASS_CODES.values())


def write_frames(folder, frames):
    folder.mkdir()
    for number, codes in enumerate(frames):
        labels = np.repeat(np.array(codes, np.uint32), 300)
        points = np.random.default_rng(number).random((len(labels), 4), np.float32) + 1
        points.tofile(folder / f"site_{number:03d}.bin")
        labels.tofile(folder / f"site_{number:03d}.label")
    return folder


def test_the_sites_that_hold_most_classes_are_held_out(recipe_module, tmp_path):
    first = write_frames(tmp_path / "a", [ALL[:2], ALL[:5], ALL[:4], ALL[:3]])
    second = write_frames(tmp_path / "b", [ALL[3:], ALL[3:], [2], [2]])
    small = write_frames(tmp_path / "c", [ALL, ALL])
    held_out = recipe_module("make_model").richest_sites([first, second, small])
    assert held_out == [first / "site_001.bin", second / "site_001.bin"]


def test_a_class_that_nothing_held_out_holds_is_an_error(recipe_module, tmp_path):
    folder = write_frames(tmp_path / "a", [ALL[:-1]] * 4)
    with pytest.raises(DataError, match="no held-out site holds vehicle or person"):
        recipe_module("make_model").richest_sites([folder])
