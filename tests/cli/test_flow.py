"""From scans to scores by commands alone, on the tiny site."""

import json
from pathlib import Path

import laspy
import pytest


def test_from_scans_to_scores(bushseg, scans, settings):
    made = bushseg("prepare", scans, "-c", settings)
    assert made.status == 0
    assert "3 scans (0 kept from before)" in made.out
    assert "3 scans (3 kept from before)" in bushseg("prepare", scans, "-c", settings).out

    trained = bushseg("train", "-c", settings, "--epochs", 2, "--validation", "scan:south")
    assert trained.status == 0
    (run,) = Path("runs").iterdir()
    assert str(run) in trained.out
    assert "best on the held-out split" in trained.out
    assert trained.err.count("\n") == 2  # a line an epoch, no bars where nobody watches

    labeled = bushseg("predict", scans / "south.las", "-o", "labeled.las")
    assert labeled.status == 0
    assert "4,000 points" in labeled.out
    assert str(run / "best.safetensors") in labeled.out
    assert len(laspy.read("labeled.las")) == 4000

    judged = bushseg("evaluate", "labeled.las", scans / "south.las", "-o", "report")
    assert judged.status == 0
    assert "mIoU" in judged.out
    assert {path.name for path in Path("report").iterdir()} == {
        "metrics.json",
        "per_class.csv",
        "confusion.csv",
        "confusion.png",
    }


def test_prepare_within_too_little_memory(bushseg, scans, settings):
    refused = bushseg("prepare", scans, "-c", settings, "--max-memory", "300MB")
    assert refused.status == 1
    assert "takes at least 0.5" in refused.err
    assert "is no size" in bushseg("prepare", scans, "-c", settings, "--max-memory", "lots").err


def test_prepare_in_processes_has_no_profile(bushseg, scans, settings):
    refused = bushseg("prepare", scans, "-c", settings, "--workers", 2, "--profile")
    assert refused.status == 2
    assert "--profile goes with one process" in refused.err
    assert not Path("prepared").exists()
    refused = bushseg("prepare", scans, "-c", settings, "--scheduler", "tcp://192.0.2.1:8786")
    assert refused.status == 1
    assert "or --insecure-scheduler" in refused.err


def test_json_of_prepare_and_train(bushseg, scans, settings):
    made = json.loads(bushseg("prepare", scans, "-o", "data", "-c", settings, "--json").out)
    assert (made["folder"], made["num_scans"], made["num_redone"]) == ("data", 3, 3)
    assert 0 < sum(made["stages"].values()) < made["seconds"]
    profile = bushseg("prepare", scans, "-o", "data", "-c", settings, "--seed", 1, "--profile").out
    for stage in ("read", "neighbors", "draw crops", "write", "other"):
        assert f"  {stage} " in profile
    assert made["features"] == ["rgb", "intensity", "height"]
    trained = bushseg(
        "train", "data", "-o", "run", "-c", settings, "--epochs", 1, "--seed", 3, "--json"
    )
    result = json.loads(trained.out)
    assert trained.err == ""
    assert (result["folder"], result["epochs"], result["interrupted"]) == ("run", 1, False)
    assert result["history"][0]["loss"] > 0
    assert "seed = 3" in Path("run/config.toml").read_text()
    again = ("train", "data", "-o", "run", "--overwrite", "-c", settings, "--epochs", 1)
    profile = bushseg(*again, "--precision", "bfloat16", "--profile").out
    for stage in ("wait for batches", "forward", "backward", "update", "metrics and checkpoints"):
        assert f"  {stage} " in profile


def test_json_of_predict_and_evaluate(bushseg, scans, run):
    labeled = bushseg("predict", scans / "south.las", "-o", "out.laz", "-m", run, "--json")
    result = json.loads(labeled.out)
    assert labeled.err == ""
    assert result["num_points"] == 4000
    assert sum(result["class_counts"].values()) == 4000
    assert {"stages", "points_per_second", "peak_memory", "warnings", "model"} <= set(result)
    judged = json.loads(bushseg("evaluate", "out.laz", scans / "south.las", "--json").out)
    assert judged["scheme"] == "bush"
    assert judged["num_points"] == 4000
    assert set(judged["classes"]["bush"]) >= {"iou", "precision", "recall", "f1", "support"}


def test_predict_takes_its_options(bushseg, scans, run):
    south = scans / "south.las"
    common = ("predict", south, "-o", "out.las", "-m", run)
    assert bushseg(*common, "--asprs", "bush=4", "--asprs", "ground=40").status == 0
    assert set(laspy.read("out.las").classification) <= {40, 3, 4, 5, 6, 64, 65}
    assert "exists already" in bushseg(*common).err
    assert bushseg(*common, "--overwrite", "--keep-classification").status == 0
    before, after = laspy.read(south), laspy.read("out.las")
    assert (before.classification == after.classification).all()
    profile = bushseg(*common, "--overwrite", "--profile").out
    for stage in ("read", "sub-sample", "neighbors", "normals", "network", "look up", "write"):
        assert f"  {stage} " in profile
    assert bushseg(*common, "--overwrite", "--precision", "float16").status == 1
    exact = (*common, "--overwrite", "--precision", "float32")
    tiled = bushseg(*exact, "--tile-points", 1000, "--halo", 16, "--json")
    assert json.loads(tiled.out)["passes"] > 1


def test_predict_warns_on_standard_error(bushseg, run, new_scene):
    rows = "\n".join(f"{x:.2f} {y:.2f} {z:.2f}" for x, y, z in 9 * new_scene(0, 300).xyz)
    Path("bare.xyz").write_text(rows + "\n")
    outcome = bushseg("predict", "bare.xyz", "-o", "out.ply", "-m", run)
    assert outcome.status == 0
    lines = outcome.err.splitlines()
    assert len(lines) >= 2
    assert all(line.startswith("warning: ") for line in lines)
    assert "warning" not in outcome.out


def test_info(bushseg, scans):
    outcome = bushseg("info", scans)
    assert outcome.status == 0
    assert outcome.out.count("4,000 points") == 3
    reports = json.loads(bushseg("info", scans, "--json").out)
    assert [Path(report["path"]).stem for report in reports] == ["middle", "north", "south"]
    assert reports[0]["classes"] == {"2": 2000, "4": 1000, "6": 1000}
    assert {"format", "bounds", "density", "features", "faults", "error"} <= set(reports[0])


def test_info_goes_on_after_a_broken_scan(bushseg, scans, tmp_path):
    (tmp_path / "broken.las").write_bytes(b"LASF" + bytes(50))
    outcome = bushseg("info", "broken.las", scans / "south.las")
    assert outcome.status == 1
    assert "4,000 points" in outcome.out
    assert "Traceback" not in outcome.out + outcome.err


def test_simulate(bushseg):
    made = bushseg("simulate", "-o", "sites", "--size", 20, "--sensor", "spinning", "--json")
    assert made.status == 0
    assert json.loads(made.out) == {"scans": ["sites/site_000.bin"]}
    assert Path("sites/site_000.label").exists()


def test_quiet(bushseg, scans, settings):
    bushseg("prepare", scans, "-c", settings, "-q")
    outcome = bushseg("train", "-c", settings, "--epochs", 1, "-q")
    assert outcome.status == 0
    assert outcome.err == ""


@pytest.mark.parametrize("option", ["--spf", "--no-spf"])
def test_switches_reach_the_network(bushseg, prepared, settings, option):
    outcome = bushseg("train", prepared, "-o", "run", "-c", settings, "--epochs", 1, option)
    assert outcome.status == 0
    described = json.loads(bushseg("models", "-m", "run", "--json").out)
    assert described["card"]["network"]["spf"] == (option == "--spf")
