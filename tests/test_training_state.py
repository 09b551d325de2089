import pytest
import torch

from bushseg.config import NetworkConfig
from bushseg.errors import CheckpointError
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
    state = TrainingState(2, 5, 0.1, [[1, 2], [3, 4]], 0.7, [{"loss": 1.5}])
    assert TrainingState.from_dict(state.as_dict()) == state
    assert state.confusion(2).counts.tolist() == [[1, 2], [3, 4]]
    assert TrainingState().confusion(2).counts.tolist() == [[0, 0], [0, 0]]


@pytest.mark.parametrize("values", [{"epochs": 1}, {"epoch": 1, "age": 2}])
def test_no_training_state(values):
    with pytest.raises(CheckpointError, match="no training state"):
        TrainingState.from_dict(values)


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


def test_moments_of_another_shape():
    network = make_network()
    optimizer = torch.optim.Adam(network.parameters())
    tensors = {"optimizer.stem.linear.weight.exp_avg": torch.ones(3)}
    with pytest.raises(CheckpointError, match=r"stem\.linear\.weight is \(3,\); expected \(8, 2\)"):
        restore_optimizer(network, optimizer, tensors)
