"""The jobs of a scan on Dask's workers."""

import os
import socket
import subprocess
import sys
import time
import warnings
from pathlib import Path

import pytest

from bushseg import cluster
from bushseg.cluster import check_address, connected
from bushseg.cluster_jobs import look
from bushseg.config import PredictConfig
from bushseg.errors import ConfigError, WorkerError
from bushseg.folder_prediction import predict_folder
from bushseg.prediction import predict_file
from bushseg.preparation import prepare

distributed = pytest.importorskip("distributed")

# Dask's event loops run in this process: a warning there must not become an error, which would end
# what keeps its workers alive.
pytestmark = pytest.mark.filterwarnings("default")
SETTINGS = {"tile_points": 1000, "halo": 16}

# A tile kills its worker as long as a file "deadly-NUMBER" says so, two folders above the scan's; a
# scan does if "deadly-NAME" stands beside the folder of outputs, or the data set's.
PRELOAD = """
import os, signal
from pathlib import Path
from bushseg import prepare_jobs, scan_jobs, tile_jobs

label_tile = tile_jobs.label_tile_job
label_scan = scan_jobs.label_scan_job
prepare_scan = prepare_jobs.prepare_scan_job

def attempt(root, name):
    with open(root / f"tries-{name}", "a") as file:
        file.write("x")
    if (root / f"deadly-{name}").exists():
        os.kill(os.getpid(), signal.SIGKILL)

def work(folder, number, **arguments):
    attempt(Path(folder).parents[1], number)
    label_tile(folder=folder, number=number, **arguments)

def work_on_scan(output, **arguments):
    attempt(Path(output).parents[1], Path(output).name)
    label_scan(output=output, **arguments)

def prepare(folder, scan, **arguments):
    attempt(Path(folder).parents[2], Path(scan).name)
    prepare_scan(folder=folder, scan=scan, **arguments)

def dask_setup(worker):
    prepare_jobs.prepare_scan_job = prepare
    tile_jobs.label_tile_job = work
    scan_jobs.label_scan_job = work_on_scan
"""


@pytest.fixture(scope="module")
def local(tmp_path_factory):
    """The address of a cluster of three processes, two of which a tile may kill."""
    import dask

    preload = tmp_path_factory.mktemp("preload") / "deadly.py"
    preload.write_text(PRELOAD)
    python_path = os.pathsep.join(filter(None, sys.path))
    settings = {
        "distributed.worker.preload": [str(preload)],
        "distributed.nanny.environ": {"PYTHONPATH": python_path, "OMP_NUM_THREADS": "1"},
    }
    with warnings.catch_warnings(), dask.config.set(settings):
        warnings.simplefilter("ignore")
        with distributed.LocalCluster(
            n_workers=3,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address=None,
            silence_logs=60,
        ) as running:
            yield running.scheduler_address


@pytest.fixture
def alone(model, scans, tmp_path) -> bytes:
    """What one process writes."""
    predict_file(scans / "south.las", tmp_path / "1.las", model, PredictConfig(**SETTINGS))
    return (tmp_path / "1.las").read_bytes()


class Counted:
    """Progress that is counted."""

    def __init__(self) -> None:
        self.steps: dict[str, list[int]] = {}

    def start(self, stage: str, total: int | None, unit: str) -> None:
        self.steps[stage] = self._open = []

    def advance(self, amount: int) -> None:
        self._open.append(amount)

    def note(self, message: str) -> None:
        raise AssertionError(message)


def test_a_cluster_comes_to_the_same_output(local, alone, model, scans, tmp_path):
    config, progress = PredictConfig(**SETTINGS, scheduler=local), Counted()
    result = predict_file(scans / "south.las", tmp_path / "2.las", model, config, progress=progress)
    assert (tmp_path / "2.las").read_bytes() == alone
    assert len(progress.steps["labelling"]) > 1
    assert sum(progress.steps["labelling"]) == result.num_voxels
    tries = sorted(tmp_path.glob("tries-*"))
    assert len(tries) == len(progress.steps["labelling"])
    assert {path.read_text() for path in tries} == {"x"}
    assert not list(tmp_path.glob(".2.las-*"))


def test_a_tile_that_kills_its_worker_is_named_after_two_tries(
    local, alone, model, scans, tmp_path
):
    (tmp_path / "deadly-1").touch()
    config = PredictConfig(**SETTINGS, scheduler=local)
    path, output = model.path, tmp_path / "2.las"
    with pytest.raises(WorkerError) as caught:
        predict_file(scans / "south.las", output, path, config)
    assert str(caught.value).startswith("tile 1 (x ")
    assert "its worker was lost twice (its Dask worker was lost)" in str(caught.value)
    assert (tmp_path / "tries-1").read_text() == "xx"
    assert not output.exists()
    kept = list(tmp_path.glob(".2.las-*.bushseg/*/tile_*.safetensors"))
    assert f"; {len(kept)} of {len(kept) + 1} tiles are done and kept" in str(caught.value)
    (tmp_path / "deadly-1").unlink()
    # Whoever goes on takes up what the cluster has done.
    predict_file(scans / "south.las", output, path, PredictConfig(**SETTINGS))
    assert output.read_bytes() == alone
    assert (tmp_path / "tries-1").read_text() == "xx"


def test_whole_scans_on_a_cluster(local, run, scans, tmp_path):
    (tmp_path / "deadly-north.las").touch()
    alone = predict_folder(scans, tmp_path / "alone", run, verify=True)
    config = PredictConfig(scheduler=local)
    result = predict_folder(scans, tmp_path / "out", run, config, verify=True)
    by_name = {scan.input.name: scan for scan in result.scans}
    assert by_name["north.las"].error == (
        f"{scans / 'north.las'}: its worker was lost twice (its Dask worker was lost); make memory "
        "free, then start the same command again"
    )
    tries = {path.name: path.read_text() for path in tmp_path.glob("tries-*")}
    assert tries == {"tries-middle.las": "x", "tries-north.las": "xx", "tries-south.las": "x"}
    for number, name in ((0, "middle.las"), (2, "south.las")):
        assert by_name[name].result.class_counts == alone.scans[number].result.class_counts
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "alone" / name).read_bytes()
    (tmp_path / "deadly-north.las").unlink()
    # One scan is left, fewer than there are workers: they label its tiles.
    result = predict_folder(scans, tmp_path / "out", run, config)
    assert (result.count("done"), result.count("skipped")) == (1, 2)
    name = "north.las"
    assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "alone" / name).read_bytes()
    assert (tmp_path / "tries-north.las").read_text() == "xx"
    assert sorted(path.name for path in (tmp_path / "out").glob(".*")) == [".bushseg.json"]


def test_scans_are_prepared_on_a_cluster(local, tiny, scans, tmp_path, contents):
    (tmp_path / "deadly-north.las").touch()
    config, folder = tiny().prepare, tmp_path / "out"
    with pytest.raises(WorkerError) as caught:
        prepare([scans], folder, config, scheduler=local)
    assert str(caught.value) == (
        f"{scans / 'north.las'}: its worker was lost twice (its Dask worker was lost); 2 of 3 "
        "scans are done and kept: make memory free, then start the same command again"
    )
    (tmp_path / "deadly-north.las").unlink()
    assert prepare([scans], folder, config, scheduler=local).num_redone == 1
    tries = {path.name: path.read_text() for path in tmp_path.glob("tries-*")}
    assert tries == {"tries-middle.las": "x", "tries-north.las": "xxx", "tries-south.las": "x"}
    alone = prepare([scans], tmp_path / "alone", config).folder
    assert contents(folder) == contents(alone)


def test_a_folder_that_the_workers_do_not_see(local, tmp_path):
    # Workers are shown another path than the one that was written.
    with connected(local) as scheduler:
        run = scheduler._client.run
        scheduler._client.run = lambda function, path, *rest, **options: run(
            function, "/no/such" + path, *rest, **options
        )
        with pytest.raises(WorkerError, match=r"doesn't see /no/such.* name a --scratch folder"):
            scheduler.check(tmp_path)
    assert not list(tmp_path.glob("check-*"))


def test_what_a_worker_looks_for(tmp_path):
    note = tmp_path / "note"
    note.write_text("this")
    assert look(str(note), "this", cluster.FORMAT_VERSION) is None
    assert "sees another folder" in str(look(str(note), "that", cluster.FORMAT_VERSION))
    assert "another version of bushseg" in str(look(str(note), "this", -1))
    assert [path.name for path in tmp_path.iterdir()] == ["note"]


@pytest.mark.parametrize(
    "address", ["tcp://127.0.0.1:8786", "tcp://localhost:1", "tcp://[::1]:9", "tls://cluster:8786"]
)
def test_addresses_that_may_be_used(address):
    check_address(address, insecure=False)


@pytest.mark.parametrize(
    "address", ["tcp://cluster:8786", "tcp://10.0.0.1:8786", "tcp://0.0.0.0:1"]
)
def test_another_machine_wants_tls(address):
    with pytest.raises(ConfigError, match=r"another machine without tls.*--insecure-scheduler"):
        check_address(address, insecure=False)
    check_address(address, insecure=True)


@pytest.mark.parametrize(
    "address",
    ["", "127.0.0.1:8786", "tcp://", "tcp://host", "http://host:1", "tcp://host:x", "tcp://h:1/x"],
)
def test_what_is_no_address(address):
    with pytest.raises(ConfigError, match=r"expected an address such as tcp://127\.0\.0\.1:8786"):
        check_address(address, insecure=True)


def free_port() -> int:
    with socket.socket() as opened:
        opened.bind(("127.0.0.1", 0))
        return opened.getsockname()[1]


def test_nobody_answers(monkeypatch):
    monkeypatch.setattr(cluster, "_CONNECT", 0.5)
    port = free_port()
    with (
        pytest.raises(WorkerError, match=f"^tcp://127.0.0.1:{port}: no Dask scheduler can be"),
        connected(f"tcp://127.0.0.1:{port}"),
    ):
        pass


def test_tls_without_certificates():
    with (
        pytest.raises(WorkerError, match="Dask's settings name no certificates"),
        connected(f"tls://127.0.0.1:{free_port()}"),
    ):
        pass


def test_the_extra_is_missing(monkeypatch):
    monkeypatch.setattr(cluster, "find_spec", lambda _: None)
    with (
        pytest.raises(WorkerError, match=r"pip install 'bushseg\[cluster\]'"),
        connected("tcp://127.0.0.1:1"),
    ):
        pass


@pytest.fixture
def started(tmp_path):
    """`dask scheduler` and `dask worker` as processes; gives the address and the worker."""
    port = free_port()
    address = f"tcp://127.0.0.1:{port}"
    path = os.pathsep.join(filter(None, sys.path))
    env = os.environ | {"PYTHONPATH": path, "OMP_NUM_THREADS": "1"}
    dask = [sys.executable, "-m", "dask"]
    here = ["--host", "127.0.0.1", "--no-dashboard"]
    commands = [
        [*dask, "scheduler", *here, "--port", str(port)],
        [*dask, "worker", address, *here, "--nthreads", "1", "--no-nanny"],
    ]
    processes = []
    with (tmp_path / "dask.log").open("w") as log:
        for command in commands:
            processes.append(
                subprocess.Popen(command, env=env, stdout=log, stderr=log, cwd=tmp_path)
            )
        yield address, processes[1]
        for process in reversed(processes):
            process.kill()
            process.wait()


def test_dask_started_as_processes(started, alone, model, scans, tmp_path):
    address, worker = started
    deadline = time.monotonic() + 60
    while not (answers := _answers(address)) and time.monotonic() < deadline:
        time.sleep(0.2)
    assert answers, (tmp_path / "dask.log").read_text()
    config = PredictConfig(**SETTINGS, scheduler=address)
    predict_file(scans / "south.las", tmp_path / "2.las", model, config)
    assert (tmp_path / "2.las").read_bytes() == alone
    assert worker.poll() is None


def _answers(address: str) -> bool:
    host, port = address.removeprefix("tcp://").split(":")
    with socket.socket() as opened:
        return opened.connect_ex((host, int(port))) == 0


def test_a_cluster_that_loses_all_its_workers(started, model, scans, tmp_path, monkeypatch):
    address, worker = started
    monkeypatch.setattr(cluster, "_PATIENCE", 30.0)
    monkeypatch.setattr(cluster, "_LOOK", 0.5)
    check = cluster.Cluster.check

    def lose_worker(self: cluster.Cluster, folder: Path) -> None:
        check(self, folder)
        worker.kill()
        worker.wait()
        monkeypatch.setattr(cluster, "_PATIENCE", 2.0)

    monkeypatch.setattr(cluster.Cluster, "check", lose_worker)
    config = PredictConfig(**SETTINGS, scheduler=address)
    with pytest.raises(WorkerError, match="has had no workers for 2 s; what is done is kept"):
        predict_file(scans / "south.las", tmp_path / "2.las", model, config)
    assert not (tmp_path / "2.las").exists()
