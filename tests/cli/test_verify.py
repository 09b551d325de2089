"""`bushseg verify` and `bushseg predict --verify`."""

import json
from pathlib import Path

import pytest


@pytest.fixture
def labeled(bushseg, scans, run):
    """A scan, its labelled copy, and what `predict --verify` said."""
    source = scans / "north.las"
    return source, bushseg("predict", source, "-o", "out.las", "-m", run, "--verify")


def test_predict_verifies_what_it_wrote(labeled):
    source, outcome = labeled
    assert outcome.status == 0
    assert f"out.las: equal to {source}; 4,000 points" in outcome.out
    assert "  ok       point records      4,000 of 36 bytes, in order\n" in outcome.out
    assert "class_index added, confidence added" in outcome.out


def test_verify_says_what_differs(bushseg, labeled):
    source, _ = labeled
    assert bushseg("verify", source, "out.las", "--scheme", "bush").status == 0
    raw = bytearray(Path("out.las").read_bytes())
    raw[4] = 9
    Path("out.las").write_bytes(raw)
    outcome = bushseg("verify", source, "out.las")
    assert outcome.status == 1
    assert f"out.las: DIFFERS from {source}" in outcome.out
    assert "           file source id 9, was 0\n" in outcome.out
    found = json.loads(bushseg("verify", source, "out.las", "--json").out)
    assert not found["equal"]
    assert found["checks"][0]["differences"] == ["file source id 9, was 0"]


def test_predict_has_the_proof_in_its_json(bushseg, scans, run):
    arguments = ("predict", scans / "south.las", "-o", "out.laz", "-m", run, "--verify", "--json")
    found = json.loads(bushseg(*arguments).out)
    assert found["verified"]["equal"]
    assert found["num_points"] == found["verified"]["num_points"]
