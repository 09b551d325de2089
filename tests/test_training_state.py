import json

import pytest
import torch

from bushseg.config import NetworkConfig, TrainConfig
from bushseg.errors import CheckpointError, ConfigError
from bushseg.models.bushnet import BushNet
from bushseg.training_state import (
    TrainingState,
    generator,
    optimizer_tensors,
    restore_optimizer,
    torch_seed,
)


def make_network() -> BushNet:
    return BushNet(2, 3, NetworkConfig(widths=(4,), head_widths=(4, 4)))


def step(network: BushNet, optimizer: torch.optim.Adam) -> None:
    optimizer.zero_grad()
    sum(parameter.square().sum() for parameter in network.parameters()).backward()
    optimizer.step()


def test_a_round_trip_through_plain_values():
    state = TrainingState(
        settings=TrainConfig(seed=3, augment={"scale": 0.2}),
        epoch=1,
        step=5,
        loss_sum=0.1,
        counts=[[1, 2], [3, 4]],
        best=0.7,
        history=[{"loss": 1.5}],
    )
    assert TrainingState.from_dict(json.loads(json.dumps(state.model_dump()))) == state
    assert state.confusion(2).counts.tolist() == [[1, 2], [3, 4]]
    begun = TrainingState(settings=TrainConfig())
    assert begun.confusion(2).counts.tolist() == [[0, 0], [0, 0]]


def test_training_has_begun_with_its_first_step():
    settings = TrainConfig()
    assert not TrainingState(settings=settings).has_begun
    assert TrainingState(settings=settings, step=1).has_begun
    assert TrainingState(settings=settings, epoch=1, history=[{}]).has_begun


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        ({"age": 2}, "age"),
        ({"settings": None}, "settings"),
        ({"settings": {"seed": -1}}, r"settings\.seed is -1"),
        ({"epoch": "two"}, "epoch is 'two'"),
        ({"epoch": -1}, "epoch is -1"),
        ({"epoch": 1}, "history for each of 1 epochs"),
        ({"loss_sum": [1.0]}, "loss_sum"),
        ({"counts": [[1, "x"], [0, 0]]}, "counts"),
        ({"counts": [[2**70]]}, "counts"),
        ({"history": {"loss": 1}}, "history"),
    ],
)
def test_no_training_state(damage, words):
    with pytest.raises(ConfigError, match=words):
        TrainingState.from_dict(TrainingState(settings=TrainConfig()).model_dump() | damage)


@pytest.mark.parametrize("counts", [[[1]], [[1, 2], [3]], [[1, 2]], [[1, 2, 3]] * 3])
def test_counts_of_other_classes(counts):
    state = TrainingState(settings=TrainConfig(), counts=counts)
    with pytest.raises(CheckpointError, match="2 classes"):
        state.confusion(2)


def test_random_numbers_follow_from_their_names():
    assert generator(1, 2, 3).random() == generator(1, 2, 3).random()
    names = [(0,), (1,), (0, 1), (1, 0), (0, 0, 1), (0, 1, 1)]
    assert len({generator(*name).random() for name in names}) == len(names)
    assert len({torch_seed(*name) for name in names}) == len(names)
    assert all(0 <= torch_seed(*name) < 2**63 for name in names)


def test_the_optimizer_goes_on_as_if_never_stopped():
    torch.manual_seed(0)
    network = make_network()
    optimizer = torch.optim.Adam(network.parameters(), 0.01)
    assert optimizer_tensors(network, optimizer) == {}
    step(network, optimizer)
    tensors = {name: t.clone() for name, t in optimizer_tensors(network, optimizer).items()}
    other = make_network()
    other.load_state_dict(network.state_dict())
    again = torch.optim.Adam(other.parameters(), 0.01)
    restore_optimizer(other, again, tensors)
    for _ in range(3):
        step(network, optimizer)
        step(other, again)
    for one, two in zip(network.parameters(), other.parameters(), strict=True):
        assert torch.equal(one, two)


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("exp_avg", torch.ones(3), r"is \(3,\) torch\.float32; expected \(8, 2\)"),
        ("exp_avg_sq", torch.ones(8, 2, dtype=torch.int64), r"is \(8, 2\) torch\.int64"),
        ("step", torch.ones(8, 2), r"is \(8, 2\) torch\.float32; expected \(\)"),
        ("step", None, "is missing"),
        ("exp_avg", None, "is missing"),
    ],
)
def test_moments_that_are_missing_or_misshapen(key, value, words):
    network = make_network()
    optimizer = torch.optim.Adam(network.parameters())
    step(network, optimizer)
    tensors = optimizer_tensors(network, optimizer)
    name = f"optimizer.stem.linear.weight.{key}"
    tensors = {k: t for k, t in tensors.items() if k != name}
    if value is not None:
        tensors[name] = value
    with pytest.raises(CheckpointError, match=rf"{key} of stem\.linear\.weight {words}"):
        restore_optimizer(network, optimizer, tensors)
