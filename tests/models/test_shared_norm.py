"""Rows that processes share are normalized as if one held them all. Threads stand for processes."""

import copy
import threading
from dataclasses import dataclass, field

import pytest
import torch
from torch import nn

from bushseg.models.batch import Batch, Level
from bushseg.models.layers import Dropout
from bushseg.models.shared_norm import normalize
from bushseg.ranks import Ranks

SIZE = 3


@dataclass
class Meeting:
    """Where threads add up."""

    barrier: threading.Barrier = field(default_factory=lambda: threading.Barrier(SIZE, timeout=30))
    given: list[torch.Tensor] = field(default_factory=lambda: [torch.empty(0)] * SIZE)


@dataclass(frozen=True)
class Threads(Ranks):
    """Ranks whose sums are those of threads."""

    meeting: Meeting

    def total(self, tensor: torch.Tensor) -> torch.Tensor:
        self.meeting.given[self.rank] = tensor.detach().clone()
        self.meeting.barrier.wait()
        summed = torch.stack(self.meeting.given).sum(dim=0)
        self.meeting.barrier.wait()
        return summed


@pytest.fixture
def as_ranks(monkeypatch):
    """`as_ranks(function)` calls function(rank) in three threads, each a rank of its own."""
    local = threading.local()

    def call(function):
        meeting, results, errors = Meeting(), [None] * SIZE, []

        def work(rank: int) -> None:
            local.ranks = Threads(rank, SIZE, torch.device("cpu"), meeting)
            try:
                results[rank] = function(rank)
            except Exception as error:
                meeting.barrier.abort()
                errors.append(error)

        threads = [threading.Thread(target=work, args=(rank,)) for rank in range(SIZE)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        if errors:
            raise errors[0]
        return results

    alone = Ranks(0, 1, torch.device("cpu"))
    for module in ("layers", "lmff", "shared_norm"):
        monkeypatch.setattr(
            f"bushseg.models.{module}.current", lambda: getattr(local, "ranks", alone)
        )
    return call


@pytest.mark.parametrize("sizes", [(4, 5, 6), (7, 0, 1), (0, 2, 0)])
def test_normalizing_parts_equals_normalizing_the_whole(as_ranks, sizes):
    torch.manual_seed(0)
    rows = (3 + 2 * torch.randn(sum(sizes), 4, dtype=torch.float64)).requires_grad_()
    into = torch.randn(sum(sizes), 4, dtype=torch.float64)
    norm = nn.BatchNorm1d(4).double()
    nn.init.uniform_(norm.weight, 0.5, 2)
    expected = norm(rows)
    (expected * into).sum().backward()

    parts = [part.detach().requires_grad_() for part in rows.split(sizes)]
    norms = [copy.deepcopy(norm) for _ in sizes]

    def work(rank):
        norms[rank].zero_grad()
        found, mean, variance, count = normalize(parts[rank], norms[rank])
        (found * into.split(sizes)[rank]).sum().backward()
        return found.detach(), mean, variance, count

    found, means, variances, counts = zip(*as_ranks(work), strict=True)
    torch.testing.assert_close(torch.cat(found), expected.detach())
    torch.testing.assert_close(torch.cat([part.grad for part in parts]), rows.grad)
    for mean, variance, count in zip(means, variances, counts, strict=True):
        torch.testing.assert_close(mean, rows.detach().mean(dim=0))
        torch.testing.assert_close(variance, rows.detach().var(dim=0, correction=0))
        assert count == sum(sizes)
    for name, parameter in norm.named_parameters():
        summed = sum(dict(other.named_parameters())[name].grad for other in norms)
        torch.testing.assert_close(summed, parameter.grad)


@pytest.mark.parametrize("owner", [None, 1])
def test_a_single_row_in_all_takes_the_running_statistics(as_ranks, owner):
    norm = nn.BatchNorm1d(2).double()
    norm.running_mean.copy_(torch.tensor([1.0, 2.0]))
    rows = [torch.full((int(rank == owner), 2), 5.0, dtype=torch.float64) for rank in range(SIZE)]
    found = torch.cat([x for x, *_ in as_ranks(lambda rank: normalize(rows[rank], norm))])
    assert found.shape == (int(owner is not None), 2)
    torch.testing.assert_close(
        found, torch.tensor([[4.0, 3.0]]).double()[: len(found)], rtol=1e-4, atol=0
    )


def test_drop_out_drops_what_one_process_would_have_dropped(as_ranks):
    """Threads share one generator, so the numbers are drawn in turn, each from the same seed."""
    x, turn = torch.rand(9, 5) + 1, threading.Lock()
    parts = x.split((4, 0, 5))
    torch.manual_seed(3)
    expected = nn.functional.dropout(x, 0.4)

    def draw(ones, share):
        with turn:
            torch.manual_seed(3)
            return functional(ones, share)

    functional, nn.functional.dropout = nn.functional.dropout, draw
    try:
        found = as_ranks(lambda rank: Dropout(0.4)(parts[rank]))
    finally:
        nn.functional.dropout = functional
    torch.testing.assert_close(torch.cat(found), expected)


def doubled(batch: Batch) -> Batch:
    """The same in double precision, which takes the plain path."""
    levels = tuple(
        Level(lv.xyz.double(), lv.normals.double(), lv.neighbors, lv.decimated, lv.interpolated)
        for lv in batch.levels
    )
    return Batch(batch.features.double(), levels)


@pytest.mark.parametrize(("double", "tolerance"), [(False, 2e-4), (True, 1e-9)])
def test_a_network_learns_from_parts_what_it_learns_from_the_whole(
    as_ranks, batch_of, small, network_of, double, tolerance
):
    """Both ways to compute, one process without a point."""
    network = network_of(small(dropout=0.0)).train()
    clouds = [batch_of(120, seed=1), batch_of(200, seed=2)]
    parts = [clouds[0], Batch.empty(3, 6, 2), clouds[1]]
    whole = Batch.concatenated(clouds)
    if double:
        network, parts, whole = network.double(), list(map(doubled, parts)), doubled(whole)
    torch.manual_seed(0)
    into = torch.randn(320, 5, dtype=whole.features.dtype)
    networks = [copy.deepcopy(network) for _ in parts]
    expected = network(whole)
    (expected * into).mean().backward()

    def work(rank):
        found = networks[rank](parts[rank])
        (found * into.split((120, 0, 200))[rank]).sum().div(into.numel()).backward()
        return found.detach()

    torch.testing.assert_close(
        torch.cat(as_ranks(work)), expected.detach(), rtol=tolerance, atol=tolerance
    )
    scale = max(float(p.grad.abs().max()) for p in network.parameters())
    for name, parameter in network.named_parameters():
        gradients = [dict(other.named_parameters())[name].grad for other in networks]
        summed = sum(gradient for gradient in gradients if gradient is not None)
        torch.testing.assert_close(
            summed,
            parameter.grad,
            rtol=tolerance,
            atol=tolerance * scale,
            msg=name,
        )
    for name, buffer in network.named_buffers():
        for other in networks:
            torch.testing.assert_close(
                dict(other.named_buffers())[name], buffer, rtol=tolerance, atol=tolerance
            )
