"""Several processes as one: each runs a small program."""

import itertools
import sys
import textwrap
from pathlib import Path

import pytest
import torch

from bushseg.errors import ConfigError
from bushseg.ranks import Ranks, current, joined


@pytest.fixture
def run(start_ranks):
    """Run a program once for each rank: status, output and error output of each."""

    def call(program: str, size: int) -> list[tuple[int, str, str]]:
        started = start_ranks([sys.executable, "-c", textwrap.dedent(program)], size)
        said = [process.communicate(timeout=120) for process in started]
        return [(p.returncode, *texts) for p, texts in zip(started, said, strict=True)]

    return call


def test_alone_nothing_is_opened_and_sums_are_what_was_given(monkeypatch):
    monkeypatch.delenv("WORLD_SIZE", raising=False)
    with joined(1) as ranks:
        assert ranks is current()
        assert (ranks.rank, ranks.size, ranks.is_first) == (0, 1, True)
        assert not torch.distributed.is_initialized()
        given = torch.arange(3.0)
        assert ranks.total(given) is given
        assert ranks.rows_of_all(given) is given
        assert list(ranks.share(3)) == [0, 1, 2]
        ranks.check_same("anything")


@pytest.mark.parametrize(("count", "size"), [(0, 2), (1, 3), (5, 2), (4, 4), (7, 3)])
def test_shares_are_disjoint_in_order_and_of_like_size(count, size):
    device = torch.device("cpu")
    shares = [list(Ranks(rank, size, device).share(count)) for rank in range(size)]
    assert list(itertools.chain(*shares)) == list(range(count))
    assert max(map(len, shares)) - min(map(len, shares)) <= 1


@pytest.mark.parametrize(
    ("variables", "words"),
    [
        ({"WORLD_SIZE": "two"}, "WORLD_SIZE is 'two'"),
        ({"WORLD_SIZE": "2"}, "RANK is ''"),
        ({"WORLD_SIZE": "2", "RANK": "2", "LOCAL_WORLD_SIZE": "2"}, "contradict each other"),
    ],
)
def test_an_environment_that_contradicts_itself(monkeypatch, variables, words):
    for name in ("RANK", "LOCAL_RANK", "LOCAL_WORLD_SIZE"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(ConfigError, match=words), joined(1):
        pass


def test_sums_rows_and_agreement_of_three(run):
    program = """
        import torch
        from bushseg.errors import ConfigError
        from bushseg.ranks import current, joined
        with joined(60) as ranks:
            given = torch.tensor([ranks.rank, 1])
            assert ranks.total(given).tolist() == [3, 3]
            assert given.tolist() == [ranks.rank, 1]
            rows = torch.full((ranks.rank, 2), float(ranks.rank))
            assert ranks.rows_of_all(rows).tolist() == [[1, 1], [2, 2], [2, 2]]
            mine = torch.tensor([float(ranks.rank)])
            ranks.from_first(mine)
            assert mine.tolist() == [0]
            ranks.check_same("the same")
            try:
                ranks.check_same("mine" if ranks.rank == 2 else "ours")
            except ConfigError:
                print("refused", end="")
        assert current().size == 1
    """
    assert run(program, 3) == [(0, "refused", "")] * 3


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="Linux lists its sockets there")
def test_nothing_listens_but_on_the_loopback_address(run):
    program = """
        import os
        from contextlib import suppress
        from pathlib import Path
        from bushseg.ranks import joined

        def heard():
            mine = set()
            for handle in os.listdir("/proc/self/fd"):
                with suppress(OSError):
                    mine.add(os.readlink(f"/proc/self/fd/{handle}"))
            for table in ("tcp", "tcp6"):
                for line in Path("/proc/net", table).read_text().splitlines()[1:]:
                    _, local, _, state, *_, = fields = line.split()
                    if state == "0A" and f"socket:[{fields[9]}]" in mine:
                        yield local.split(":")[0]

        with joined(60) as ranks:
            ranks.wait()
            print(set(heard()), end="")
            ranks.wait()
    """
    assert run(program, 2) == [(0, "{'0100007F'}", "")] * 2


@pytest.mark.parametrize("how", ["os.kill(os.getpid(), 9)", "time.sleep(8)"])
def test_a_process_that_ends_or_hangs_is_one_line_to_the_others(run, how):
    program = f"""
        import os, time, torch
        from bushseg.errors import RankError
        from bushseg.ranks import joined
        try:
            with joined(4) as ranks:
                ranks.wait()
                if ranks.rank == 1:
                    {how}
                ranks.total(torch.ones(3))
        except RankError as error:
            print(error)
    """
    (status, out, err), _ = run(program, 2)
    assert (status, err) == (0, "")
    assert out.startswith("process 0 of 2: another process of this training has ended or doesn't")
    assert out.count("\n") == 1
    assert out.endswith("go on by --resume\n")


def test_processes_that_never_come_are_given_up(run):
    program = """
        import os
        from bushseg.errors import RankError
        from bushseg.ranks import joined
        os.environ["WORLD_SIZE"] = "2"
        try:
            with joined(1):
                print("joined")
        except RankError as error:
            print(error)
    """
    ((status, out, _),) = run(program, 1)  # PyTorch has something to say of it too
    assert status == 0
    assert out.count("\n") == 1
    assert "process 0 of 2: another process" in out
