"""A disk that is full while something is written: one line names the file, nothing is half done."""

import contextlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from bushseg import preparation, tiled_scan
from bushseg.config import PredictConfig
from bushseg.errors import WriteError
from bushseg.folder_prediction import predict_folder
from bushseg.prediction import predict_file
from bushseg.preparation import prepare

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such limits")

Limit = Callable[[int], contextlib.AbstractContextManager[None]]


@pytest.fixture
def files_of_at_most() -> Limit:
    """A file that may not grow further looks to us like a disk that is full."""
    import resource

    @contextlib.contextmanager
    def limit(size: int) -> Iterator[None]:
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)

    return limit


def said(error: pytest.ExceptionInfo[WriteError], path: Path) -> None:
    assert str(error.value).startswith(f"{path}: ")
    assert "File too large" in str(error.value)
    assert "partial" not in str(error.value)


@pytest.mark.parametrize("name", ["o.las", "o.laz", "o.ply", "o.pcd", "o.csv", "o.label"])
def test_while_the_output_is_written(model, scans, tmp_path, files_of_at_most, name):
    output = tmp_path / name
    output.write_text("old")
    with files_of_at_most(9_000), pytest.raises(WriteError) as error:
        predict_file(scans / "south.las", output, model, overwrite=True)
    said(error, output)
    assert output.read_text() == "old"
    assert list(tmp_path.iterdir()) == [output]


def test_while_tiles_are_kept(model, scans, tmp_path, files_of_at_most):
    output = tmp_path / "out.las"
    config = PredictConfig(tile_points=1000, halo=8)
    with files_of_at_most(3_000), pytest.raises(WriteError, match="same command again") as error:
        predict_file(scans / "south.las", output, model, config)
    assert "File too large" in str(error.value)
    assert not output.exists()
    predict_file(scans / "south.las", output, model, config)
    assert list(tmp_path.iterdir()) == [output]


def test_while_voxels_go_to_disk(model, scans, tmp_path, files_of_at_most, monkeypatch):
    read_voxels = tiled_scan.read_voxels

    def spill(*given, **more):
        return read_voxels(*given, **(more | {"max_voxels": 500}))

    monkeypatch.setattr(tiled_scan, "read_voxels", spill)
    with files_of_at_most(3_000), pytest.raises(WriteError, match=r"no room|can't") as error:
        predict_file(scans / "south.las", tmp_path / "out.las", model)
    assert "File too large" in str(error.value)
    assert not (tmp_path / "out.las").exists()
    predict_file(scans / "south.las", tmp_path / "out.las", model)
    assert [path.name for path in tmp_path.iterdir()] == ["out.las"]


def test_of_a_folder_the_first_scan_is_named(model, scans, tmp_path, files_of_at_most):
    with files_of_at_most(9_000):
        result = predict_folder(scans, tmp_path / "out", model)
    assert [scan.status for scan in result.scans] == ["failed"] * 3
    assert result.scans[0].error.startswith(f"{tmp_path / 'out' / 'middle.las'}: ")
    assert predict_folder(scans, tmp_path / "out", model).complete


@pytest.mark.parametrize("size", [3_000, 20_000])
def test_while_voxels_to_prepare_go_to_disk(
    scans, tiny, tmp_path, files_of_at_most, size, monkeypatch
):
    monkeypatch.setattr(preparation, "MAX_VOXELS", 300)
    output = tmp_path / "prepared"
    with files_of_at_most(size), pytest.raises(WriteError, match="work on another disk") as error:
        prepare([scans], output, tiny().prepare)
    assert "File too large" in str(error.value)
    prepare([scans], output, tiny().prepare)
    assert not list(output.rglob(".*"))
    assert (output / "dataset.json").exists()


@pytest.mark.parametrize("size", [2_000, 30_000, 100_000])
def test_while_a_data_set_is_prepared(scans, tiny, tmp_path, files_of_at_most, size):
    output = tmp_path / "prepared"
    with files_of_at_most(size), pytest.raises(WriteError, match="same command again") as error:
        prepare([scans], output, tiny().prepare)
    assert "File too large" in str(error.value)
    prepare([scans], output, tiny().prepare)
    assert not list(output.rglob(".*"))
    assert (output / "dataset.json").exists()
