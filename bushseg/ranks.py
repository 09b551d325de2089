"""Several processes that train one network: which of them this is, and what they add up.

torchrun starts them and says in the environment who is who (RANK, WORLD_SIZE, LOCAL_RANK,
LOCAL_WORLD_SIZE, MASTER_ADDR, MASTER_PORT). Without it a process is alone: nothing is opened and
every sum is what it was given. Only tensors travel; nothing is unpickled.
"""

import hashlib
import os
import re
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from datetime import timedelta
from functools import cache

import torch
import torch.distributed as dist
from torch import Tensor

from bushseg.errors import ConfigError, RankError

_LOOPBACK = ("127.0.0.1", "localhost", "::1")


@dataclass(frozen=True, slots=True)
class Ranks:
    """The processes that train together, seen from one of them.

    Attributes:
        rank: Which one this is, from 0.
        size: How many there are.
        device: What this one computes on.
    """

    rank: int
    size: int
    device: torch.device

    @property
    def is_first(self) -> bool:
        """Whether this is the one that writes and reports."""
        return self.rank == 0

    def share(self, count: int) -> range:
        """Which of `count` things are this process's: every process has a run of them, in order."""
        return range(count * self.rank // self.size, count * (self.rank + 1) // self.size)

    def total(self, tensor: Tensor) -> Tensor:
        """The sum of all processes' tensors of one shape and dtype; the same bits in each.

        Raises:
            RankError: Another process has ended or does not answer.
        """
        if self.size == 1:
            return tensor
        summed = tensor.detach().to(self.device, copy=True).contiguous()
        with _answered():
            dist.all_reduce(summed)
        return summed.to(tensor.device)

    def from_first(self, tensor: Tensor) -> None:
        """Overwrite a tensor with the first process's.

        Raises:
            RankError: As :meth:`total`.
        """
        if self.size > 1:
            sent = tensor.detach().to(self.device).contiguous()
            with _answered():
                dist.broadcast(sent, 0)
            tensor.detach().copy_(sent)

    def wait(self) -> None:
        """Wait until all processes have come here.

        Raises:
            RankError: As :meth:`total`.
        """
        self.total(torch.zeros(()))

    def rows_of_all(self, rows: Tensor) -> Tensor:
        """All processes' rows, (N, ...) of any N each, one process's after another's.

        Raises:
            RankError: As :meth:`total`.
        """
        if self.size == 1:
            return rows
        counts = torch.zeros(self.size, dtype=torch.int64)
        counts[self.rank] = len(rows)
        counts = self.total(counts)
        first = int(counts[: self.rank].sum())
        whole = rows.new_zeros(int(counts.sum()), *rows.shape[1:])
        whole[first : first + len(rows)] = rows
        return self.total(whole)

    def check_same(self, text: str) -> None:
        """Make sure that all processes were given the same.

        Raises:
            ConfigError: They weren't.
            RankError: As :meth:`total`.
        """
        digest = hashlib.sha256(text.encode()).digest()
        mine = torch.tensor(list(digest), dtype=torch.int64)
        first = mine.clone()
        self.from_first(first)
        differ = torch.tensor(int(not torch.equal(first, mine)))
        if int(self.total(differ)):
            raise ConfigError(
                "the processes of this training have other settings, data or checkpoints than the "
                "first; give all the same, in folders that they share"
            )


_current: Ranks | None = None


def current() -> Ranks:
    """The processes that train together now: inside :func:`joined` all, else this one."""
    return _current or _alone()


@cache
def _alone() -> Ranks:
    return Ranks(0, 1, torch.device("cuda" if torch.cuda.is_available() else "cpu"))


@contextmanager
def joined(timeout: float) -> Iterator[Ranks]:
    """Join the processes that torchrun started, for as long as the block takes.

    gloo connects them on CPUs, nccl on GPUs. Where MASTER_ADDR is this machine, nothing listens but
    on the loopback address.

    Args:
        timeout: Seconds to wait for an answer of the others, at the start and at every sum.

    Raises:
        ConfigError: The environment contradicts itself or the machine.
        RankError: The others are not there in time.
    """
    global _current
    size = _number("WORLD_SIZE", 1)
    if size == 1:
        yield current()
        return
    rank, local = _number("RANK"), _number("LOCAL_RANK", 0)
    beside = _number("LOCAL_WORLD_SIZE", 1)
    if not (0 <= rank < size and 0 <= local < beside <= size):
        raise ConfigError(
            f"RANK {rank}, LOCAL_RANK {local}, LOCAL_WORLD_SIZE {beside} and WORLD_SIZE {size} "
            "contradict each other; start the processes by torchrun"
        )
    device = _device(local, beside)
    with _cores(local, beside) if device.type == "cpu" else nullcontext():
        _connect(rank, size, device, timeout)
        _current = Ranks(rank, size, device)
        try:
            yield _current
        finally:
            _current = None
            dist.destroy_process_group()


def _connect(rank: int, size: int, device: torch.device, timeout: float) -> None:
    """Open the connections between the processes."""
    host, port = os.environ.get("MASTER_ADDR", _LOOPBACK[0]), _number("MASTER_PORT")
    if host in _LOOPBACK:
        # gloo would take the address that the machine's name stands for.
        os.environ.setdefault("GLOO_SOCKET_IFNAME", "lo0" if sys.platform == "darwin" else "lo")
    os.environ.setdefault("TORCH_NCCL_BLOCKING_WAIT", "1")  # an error to catch, not an abort
    wait = timedelta(seconds=timeout)
    # torchrun keeps the store itself; started by hand, the first process does.
    keeps = rank == 0 and os.environ.get("TORCHELASTIC_USE_AGENT_STORE") != "True"
    with _answered():
        listening = _listen(host, port) if keeps else None
        store = dist.TCPStore(  # type: ignore[attr-defined]
            host, port, size, keeps, wait, wait_for_workers=False, master_listen_fd=listening
        )
        dist.init_process_group(
            "nccl" if device.type == "cuda" else "gloo",
            store=dist.PrefixStore("bushseg", store),  # type: ignore[attr-defined]
            rank=rank,
            world_size=size,
            timeout=wait,
        )


def _listen(host: str, port: int) -> int:
    """A socket that listens on that address alone: the store's own would listen on all."""
    family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
    opened = socket.socket(family, socket.SOCK_STREAM)
    opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    opened.bind((host, port))
    opened.listen()
    return opened.detach()


def _device(local: int, beside: int) -> torch.device:
    """A GPU of its own for each process of this machine, or the CPU for all."""
    if not torch.cuda.is_available():
        return torch.device("cpu")
    if beside > torch.cuda.device_count():
        raise ConfigError(
            f"{beside} processes were started on a machine with {torch.cuda.device_count()} GPUs; "
            "start one for each, or hide the GPUs by CUDA_VISIBLE_DEVICES="
        )
    torch.cuda.set_device(local)
    return torch.device("cuda", local)


@contextmanager
def _cores(local: int, beside: int) -> Iterator[None]:
    """Share out the cores to the processes of this machine; else each would use them all."""
    if not hasattr(os, "sched_setaffinity") or beside == 1:
        yield
        return
    before, threads = os.sched_getaffinity(0), torch.get_num_threads()
    cores = sorted(before)
    mine = cores[len(cores) * local // beside : len(cores) * (local + 1) // beside]
    os.sched_setaffinity(0, mine or [cores[local % len(cores)]])
    torch.set_num_threads(max(1, min(threads, len(mine))))
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)
        torch.set_num_threads(threads)


@contextmanager
def _answered() -> Iterator[None]:
    """Say in one line that the others don't answer."""
    try:
        yield
    except (RuntimeError, OSError) as error:
        # gloo says where in its source, what, and what that usually means: the middle is enough.
        said = re.sub(r"^\[\S*\] *", "", str(error)) or type(error).__name__
        reason = re.split(r"\. |\n", said)[0][:150]
        raise RankError(
            f"process {os.environ.get('RANK', '0')} of {os.environ.get('WORLD_SIZE', '1')}: "
            f"another process of this training has ended or doesn't answer ({reason}); see what it "
            "said, then go on by --resume"
        ) from error


def _number(name: str, default: int | None = None) -> int:
    """A number in the environment."""
    text = os.environ.get(name, "" if default is None else str(default))
    if not text.isdecimal():
        raise ConfigError(f"{name} is {text!r} in the environment; expected a number, by torchrun")
    return int(text)
