"""Settings: strict about names and ranges, layered, and the same after a trip through TOML."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bushseg.config import (
    Config,
    NetworkConfig,
    PrepareConfig,
    TrainConfig,
    first_difference,
)
from bushseg.errors import ConfigError


def write(folder: Path, text: str) -> Path:
    path = folder / "settings.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("section", "values", "words"),
    [
        (PrepareConfig, {"voxel_sise": 0.1}, "voxel_sise is no known setting"),
        (PrepareConfig, {"voxel_size": 0}, "voxel_size is 0"),
        (PrepareConfig, {"voxel_size": float("inf")}, "voxel_size is inf"),
        (PrepareConfig, {"voxel_size": float("nan")}, "voxel_size is nan"),
        (PrepareConfig, {"num_neighbors": 65}, "num_neighbors is 65"),
        (PrepareConfig, {"sampling": "fps"}, "sampling is 'fps'"),
        (TrainConfig, {"decay": 1.5}, "decay is 1.5"),
        (TrainConfig, {"augment": {"scale": 1}}, "augment.scale is 1"),
        (TrainConfig, {"augment": 3}, "augment is 3"),
        (NetworkConfig, {"widths": [32, 30]}, "expected multiples of 4"),
        (NetworkConfig, {"widths": []}, "expected multiples of 4"),
    ],
)
def test_a_bad_setting_is_named_with_its_value(
    section: type[PrepareConfig], values: dict[str, Any], words: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        section.from_dict(values, "here.toml")
    assert words in str(caught.value)
    assert str(caught.value).startswith("here.toml: ")
    assert "\n" not in str(caught.value)


def test_settings_do_not_change() -> None:
    with pytest.raises(ValueError, match="frozen"):
        PrepareConfig().voxel_size = 1.0  # type: ignore[misc]


def test_the_first_difference_is_named_with_both_values() -> None:
    one = Config()
    assert first_difference(one, Config()) is None
    scale = one.train.augment.model_copy(update={"scale": 0.2})
    other = one.train.model_copy(update={"augment": scale, "seed": 1})
    assert first_difference(one.train, other) == "augment.scale was 0.1, is 0.2"
    asprs = one.predict.model_copy(update={"asprs": {"bush": 4}})
    assert first_difference(asprs, one.predict) == "asprs.bush was 4, is None"
    assert first_difference(one.predict, asprs) == "asprs.bush was None, is 4"


def test_randla_is_what_remains_when_the_papers_parts_are_switched_off() -> None:
    config = NetworkConfig.randla()
    assert (config.spf, config.attention, config.position) == (False, "randla", "absolute")


def test_overrides_lie_on_top_of_the_file_and_none_is_not_given(tmp_path: Path) -> None:
    path = write(tmp_path, "[prepare]\nvoxel_size = 0.5\nhalo = 32\n")
    config = Config.load(
        path, {"prepare": {"voxel_size": 0.25, "halo": None}, "train": {"seed": 7}}
    )
    assert (config.prepare.voxel_size, config.prepare.halo, config.train.seed) == (0.25, 32, 7)


def test_the_file_here_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert Config.load() == Config()
    Path("bushseg.toml").write_text("[train]\nepochs = 3\n", encoding="utf-8")
    assert Config.load().train.epochs == 3


@pytest.mark.parametrize("text", ["[prepare\n", "\x00", "prepare = 3\n", "[bogus]\n"])
def test_a_file_that_holds_no_settings_is_refused(tmp_path: Path, text: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(ConfigError, match=r"settings\.toml"):
        Config.load(path, {"prepare": {"seed": 1}})


def test_a_missing_or_binary_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError, match=r"nowhere\.toml: can't be read \(No such file.*`bushseg config`"
    ):
        Config.load(tmp_path / "nowhere.toml")
    (tmp_path / "settings.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="TOML"):
        Config.load(tmp_path / "settings.toml")


@settings(deadline=None)
@given(
    voxel_size=st.floats(1e-6, 1e6),
    num_crops=st.none() | st.integers(1, 10**6),
    spo=st.booleans(),
    scheme=st.text(max_size=20),
    asprs=st.dictionaries(st.text(max_size=5), st.integers(0, 255), max_size=3),
)
def test_toml_round_trip(
    tmp_path_factory: pytest.TempPathFactory,
    voxel_size: float,
    num_crops: int | None,
    spo: bool,
    scheme: str,
    asprs: dict[str, int],
) -> None:
    config = Config.from_dict(
        {
            "prepare": {"voxel_size": voxel_size, "num_crops": num_crops, "scheme": scheme},
            "network": {"spo": spo},
            "predict": {"asprs": asprs},
        }
    )
    path = write(tmp_path_factory.getbasetemp(), config.to_toml())
    assert Config.load(path) == config
