import json
import pickle
import struct
from collections.abc import Callable

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file

from bushseg.checkpoint import ModelCard, build_network, load_checkpoint, load_model, save_model
from bushseg.config import NetworkConfig, PrepareConfig
from bushseg.errors import CheckpointError, ConfigError
from bushseg.labels import load_scheme
from bushseg.models.batch import Batch
from bushseg.pyramid import Pyramid


@pytest.fixture
def card() -> ModelCard:
    return ModelCard(
        scheme=load_scheme("bush"),
        features=("rgb", "height"),
        optional_features=("rgb",),
        prepare=PrepareConfig(num_levels=1),
        network=NetworkConfig(widths=(8,), head_widths=(4, 4)),
        neighbor_distance=(0.1, 0.3),
        metrics={"val_miou": 0.5, "val_iou/bush": None},
    )


@pytest.fixture
def saved(card, tmp_path):
    """A network of random weights, and the file it was written to."""
    torch.manual_seed(0)
    network = build_network(card).eval()
    path = tmp_path / "best.safetensors"
    save_model(path, card, network)
    return network, path


@pytest.fixture
def forge(saved, card) -> Callable:
    """Write the model again with something wrong."""
    _, path = saved

    def write(change=None, *, tensors=None, metadata=None):
        values = {**json.loads(card.model_dump_json()), **(change or {})}
        given = {"bushseg": json.dumps(values)} if metadata is None else metadata
        save_file(load_file(path) if tensors is None else tensors, path, metadata=given)
        return path

    return write


def batch() -> Batch:
    rng = np.random.default_rng(0)
    xyz = rng.normal(size=(9, 3)).astype(np.float32)
    pyramid = Pyramid(
        (rng.integers(0, 9, (9, 4)).astype(np.int32),),
        (np.array([2, 5], np.int32),),
        (rng.integers(0, 2, 9).astype(np.int32),),
    )
    return Batch.from_numpy(rng.normal(size=(9, 4)).astype(np.float32), xyz, xyz, pyramid, 0.1)


def test_a_round_trip_changes_nothing(saved, card):
    network, path = saved
    model = load_model(str(path))
    assert model.card == card
    assert model.path == path
    assert not model.network.training
    with torch.inference_mode():
        assert torch.equal(model.network(batch()), network(batch()))


def test_state_and_extra_tensors_survive(saved, card, tmp_path):
    path = tmp_path / "last.safetensors"
    extra = {"optimizer.a.exp_avg": torch.arange(3.0)}
    save_model(path, card, saved[0], extra=extra, state={"epoch": 3, "loss_sum": 0.1})
    found, state, tensors = load_checkpoint(path)
    assert found == card
    assert state == {"epoch": 3, "loss_sum": 0.1}
    assert torch.equal(tensors["optimizer.a.exp_avg"], extra["optimizer.a.exp_avg"])
    assert load_model(path).card == card


def test_half_precision_weights_are_widened(saved, forge):
    _, path = saved
    tensors = {n: t.half() if t.is_floating_point() else t for n, t in load_file(path).items()}
    network = load_model(forge(tensors=tensors)).network
    assert {parameter.dtype for parameter in network.parameters()} == {torch.float32}


def test_a_missing_file(tmp_path):
    with pytest.raises(CheckpointError, match="no such file"):
        load_model(tmp_path / "none.safetensors")
    with pytest.raises(CheckpointError, match="no such file"):
        load_model(tmp_path)


@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.999])
def test_a_truncated_file(saved, share):
    _, path = saved
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * share)])
    with pytest.raises(CheckpointError, match="no intact safetensors file"):
        load_model(path)


def test_a_header_that_promises_terabytes(saved):
    _, path = saved
    path.write_bytes(struct.pack("<Q", 2**42) + path.read_bytes()[8:])
    with pytest.raises(CheckpointError, match="no intact safetensors file"):
        load_model(path)


def test_a_pickle_is_not_unpickled(tmp_path):
    class Trap:
        def __reduce__(self):
            return (pytest.fail, ("unpickled",))

    path = tmp_path / "model.safetensors"
    path.write_bytes(pickle.dumps(Trap()))
    with pytest.raises(CheckpointError, match="no intact safetensors file"):
        load_model(path)
    torch.save({"a": torch.ones(2)}, path)
    with pytest.raises(CheckpointError, match="no intact safetensors file"):
        load_model(path)


def test_another_program_s_tensors(tmp_path):
    path = tmp_path / "other.safetensors"
    save_file({"weight": torch.ones(2)}, path)
    with pytest.raises(CheckpointError, match="no model of bushseg's"):
        load_model(path)


def test_a_missing_tensor(saved, forge):
    tensors = load_file(saved[1])
    del tensors["network.bottleneck.linear.weight"]
    with pytest.raises(CheckpointError, match=r"don't fit.*bottleneck\.linear\.weight"):
        load_model(forge(tensors=tensors))


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_weights_that_are_no_numbers(saved, forge, value):
    _, path = saved
    tensors = load_file(path)
    next(tensor for tensor in tensors.values() if tensor.is_floating_point()).view(-1)[0] = value
    forge(tensors=tensors)
    with pytest.raises(CheckpointError, match="NaN or infinite"):
        load_model(path)


def test_a_tensor_of_another_shape(saved, forge):
    tensors = load_file(saved[1])
    tensors["network.bottleneck.linear.weight"] = torch.ones(8, 9)
    with pytest.raises(CheckpointError, match="don't fit"):
        load_model(forge(tensors=tensors))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"version": 99}, "version 99; expected 1"),
        ({"features": []}, "wants features"),
        ({"features": ["rgb", "smell"]}, "smell"),
        ({"color": "blue"}, "color is no known setting"),
        ({"neighbor_distance": "far"}, "neighbor_distance"),
        ({"network": {"widths": [2**40]}}, "widths"),
        ({"network": {"widths": [8], "stem_width": 2**40}}, "stem_width"),
        ({"network": {"widths": [8], "head_widths": [2**40, 8]}}, "head_widths"),
        ({"network": {"widths": [4] * 100_000}}, "100000 layers, the data 1 levels"),
        ({"network": {"widths": [4096]}}, "don't fit"),
    ],
)
def test_a_card_that_lies(forge, change, reason):
    path = forge(change)
    with pytest.raises(CheckpointError, match=reason):
        load_model(path)


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "7", "null", "[" * 100_000, "1" * 5000, '{"version": 1}']
)
def test_a_card_that_is_none(forge, text):
    path = forge(metadata={"bushseg": text})
    with pytest.raises(CheckpointError) as error:
        load_model(path)
    assert "\n" not in str(error.value)


def test_absurd_settings_allocate_nothing(forge, monkeypatch):
    """The widest network the settings allow would take gigabytes; it is only ever made on meta."""

    def refuse(tensor, *args, **kwargs):
        assert tensor.is_meta or tensor.numel() < 1000
        return tensor

    monkeypatch.setattr(torch.nn.init, "kaiming_uniform_", refuse)
    widths = [4096] * 6
    change = {"network": {"widths": widths}, "prepare": {"num_levels": len(widths)}}
    with pytest.raises(CheckpointError, match="don't fit"):
        load_model(forge(change))


def test_levels_and_layers_must_agree(card):
    with pytest.raises(ConfigError, match="1 layers, the data 4 levels"):
        ModelCard.from_dict({**card.model_dump(), "prepare": PrepareConfig().model_dump()})


def test_nothing_but_tensors_and_text_is_stored(saved):
    with safe_open(saved[1], framework="pt") as file:
        assert set(file.metadata()) == {"bushseg", "state"}
        assert all(name.startswith("network.") for name in file.keys())  # noqa: SIM118
