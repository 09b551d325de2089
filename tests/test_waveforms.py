"""Waveforms beside a scan come to lie beside its output."""

from pathlib import Path

import laspy
import pytest

import bushseg
from bushseg.errors import WriteError
from bushseg.prediction import predict_file
from bushseg.waveforms import plan_waveforms

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning:laspy")

WAVES = bytes(range(256)) * 20


@pytest.fixture
def scan(new_scene, tmp_path) -> Path:
    """Point format 4, whose points' waveforms are in another file."""
    scene = new_scene(1, 600)
    las = laspy.LasData(laspy.LasHeader(version="1.3", point_format=4))
    las.header.scales = [0.001] * 3
    las.x, las.y, las.z = scene.xyz.T
    path = tmp_path / "scans" / "scan.las"
    path.parent.mkdir()
    las.write(str(path))
    raw = bytearray(path.read_bytes())
    raw[6] = raw[6] & ~0x02 | 0x04
    path.write_bytes(raw)
    path.with_suffix(".wdp").write_bytes(WAVES)
    return path


@pytest.mark.parametrize("name", ["out.las", "out.laz"])
def test_they_are_copied(scan, height_model, tmp_path, name):
    result = predict_file(scan, tmp_path / name, height_model)
    assert (tmp_path / "out.wdp").read_bytes() == WAVES
    assert not any("waveforms" in warning for warning in result.warnings)
    assert bushseg.verify(scan, tmp_path / name).equal
    assert not list(tmp_path.glob(".*"))


def test_another_format_and_no_waveforms_need_none(scan, height_model, scans, tmp_path):
    predict_file(scan, tmp_path / "out.ply", height_model)
    predict_file(scans / "south.las", tmp_path / "out.las", height_model)
    assert not (tmp_path / "out.wdp").exists()


def test_if_they_are_missing_it_says_so(scan, height_model, tmp_path):
    scan.with_suffix(".wdp").unlink()
    result = predict_file(scan, tmp_path / "out.las", height_model)
    (warning,) = (warning for warning in result.warnings if "waveforms" in warning)
    assert "scan.wdp, which isn't beside it" in warning
    assert not (tmp_path / "out.wdp").exists()


def test_another_file_in_their_place_needs_overwrite(scan, height_model, tmp_path):
    (tmp_path / "out.wdp").write_bytes(b"precious")
    with pytest.raises(WriteError, match=r"out\.wdp: exists already"):
        predict_file(scan, tmp_path / "out.las", height_model)
    assert (tmp_path / "out.wdp").read_bytes() == b"precious"
    assert not (tmp_path / "out.las").exists()
    predict_file(scan, tmp_path / "out.las", height_model, overwrite=True)
    assert (tmp_path / "out.wdp").read_bytes() == WAVES


def test_a_copy_that_a_stopped_run_left_is_kept(scan, height_model, tmp_path):
    (tmp_path / "out.wdp").write_bytes(WAVES)
    before = (tmp_path / "out.wdp").stat()
    predict_file(scan, tmp_path / "out.las", height_model)
    assert (tmp_path / "out.wdp").stat().st_mtime_ns == before.st_mtime_ns


def test_an_output_of_the_same_name_beside_the_scan_shares_them(scan, height_model):
    predict_file(scan, scan.with_suffix(".laz"), height_model)
    assert scan.with_suffix(".wdp").read_bytes() == WAVES
    assert sorted(path.name for path in scan.parent.iterdir()) == [
        "scan.las",
        "scan.laz",
        "scan.wdp",
    ]


def test_they_come_before_the_output_and_an_error_names_them(
    scan, height_model, tmp_path, monkeypatch
):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("shutil.copyfile", full)
    with pytest.raises(WriteError, match=r"out\.wdp: can't copy .*No space left"):
        predict_file(scan, tmp_path / "out.las", height_model)
    assert not (tmp_path / "out.las").exists()
    assert not (tmp_path / "out.wdp").exists()


def test_nothing_is_planned_for_a_scan_with_none(scans, tmp_path):
    with bushseg.open_scan(scans / "south.las") as reader:
        plan = plan_waveforms(reader.info, tmp_path / "out.las", overwrite=False)
    assert plan.source is None
    assert plan.num_bytes == 0
    plan.write()
    assert not list(tmp_path.iterdir())
