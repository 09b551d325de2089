import json
import tomllib

from bushseg.config import Config
from bushseg.labels import SCHEMES, parse_scheme


def test_labels_lists_the_schemes(bushseg):
    lines = bushseg("labels").out.splitlines()
    assert [line.split()[0] for line in lines] == list(SCHEMES)
    assert set(json.loads(bushseg("labels", "--json").out)) == set(SCHEMES)


def test_labels_of_one_scheme(bushseg):
    outcome = bushseg("labels", "bush")
    assert all(name in outcome.out for name in SCHEMES["bush"].names)
    assert json.loads(bushseg("labels", "bush", "--json").out)["name"] == "bush"


def test_labels_as_toml_can_be_read_back(bushseg):
    assert parse_scheme(bushseg("labels", "rellis", "--toml").out) == SCHEMES["rellis"]


def test_models(bushseg, run):
    outcome = bushseg("models", "--model", run)
    assert outcome.status == 0
    assert "rgb, intensity, height" in outcome.out
    described = json.loads(bushseg("models", "--model", run, "--json").out)
    assert set(described) == {"path", "card", "parameters"}
    parameters = described["parameters"]
    assert parameters.pop("total") == sum(parameters.values())


def test_config_prints_all_settings(bushseg):
    text = bushseg("config").out
    assert Config.from_dict(tomllib.loads(text)) == Config()


def test_config_writes_and_takes_a_file(bushseg, tmp_path):
    assert bushseg("config", "-o", "bushseg.toml").status == 0
    path = tmp_path / "bushseg.toml"
    path.write_text(path.read_text().replace("epochs = 100", "epochs = 7"))
    assert "epochs = 7" in bushseg("config").out
    refused = bushseg("config", "-o", "bushseg.toml")
    assert refused.status == 1
    assert "exists already" in refused.err


def test_a_misspelt_setting(bushseg, tmp_path):
    (tmp_path / "bushseg.toml").write_text("[train]\nepoch = 3\n")
    outcome = bushseg("config")
    assert outcome.status == 1
    assert "train.epoch is no known setting" in outcome.err
