"""A tiny site with exact labels, prepared once and learnt once, for all tests that need a model."""

import multiprocessing
import os
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
import pytest
from hypothesis import settings

from bushseg.config import Config, NetworkConfig, PrepareConfig, TrainConfig

# Networks this small lose more by threads that wait for each other than they gain.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# A first call may compile for seconds: no test judges how long an example takes.
settings.register_profile("untimed", parent=settings.default, deadline=None)
settings.load_profile("untimed")

# A shell that starts this in the background has Ctrl-C ignored, in all processes to come as well;
# some tests send it.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

EDGE = 8.0
GROUND, BUSH, WALL = 2, 4, 6


@dataclass(frozen=True)
class Scene:
    """Points of a made-up site: ground, round bushes, a wall."""

    xyz: np.ndarray  # (N, 3) metres
    codes: np.ndarray  # (N,) LAS codes
    rgb: np.ndarray  # (N, 3) uint16
    intensity: np.ndarray  # (N,) uint16


def make_scene(seed: int, num_points: int = 4000) -> Scene:
    rng = np.random.default_rng(seed)
    quarter = num_points // 4
    ground = np.column_stack(
        [
            rng.uniform(0, EDGE, (num_points - 2 * quarter, 2)),
            np.zeros(1).repeat(num_points - 2 * quarter),
        ]
    )
    centers = rng.uniform(1, EDGE - 2, (3, 2))
    ball = rng.normal(size=(quarter, 3))
    ball *= 0.7 * rng.random((quarter, 1)) ** (1 / 3) / np.linalg.norm(ball, axis=1, keepdims=True)
    bush = ball + np.column_stack([centers[np.arange(quarter) % 3], np.full(quarter, 0.7)])
    wall = np.column_stack(
        [rng.uniform(0, EDGE, quarter), np.full(quarter, EDGE - 0.5), rng.uniform(0, 2, quarter)]
    )
    xyz = np.concatenate([ground, bush, wall])
    codes = np.repeat([GROUND, BUSH, WALL], [len(ground), len(bush), len(wall)])
    colors = {GROUND: (40_000, 30_000, 20_000), BUSH: (10_000, 45_000, 9_000), WALL: (30_000,) * 3}
    rgb = np.array([colors[code] for code in codes]) + rng.integers(-5000, 5000, (len(xyz), 3))
    intensity = codes * 900 + rng.integers(0, 2000, len(xyz))
    order = rng.permutation(len(xyz))
    return Scene(
        xyz[order],
        codes[order].astype(np.uint8),
        rgb[order].astype(np.uint16),
        intensity[order].astype(np.uint16),
    )


def save_las(path: Path, scene: Scene, point_format: int = 7, *, labelled: bool = True) -> Path:
    version = "1.4" if point_format >= 6 else "1.2"
    las = laspy.LasData(laspy.LasHeader(version=version, point_format=point_format))
    las.header.scales, las.header.offsets = [0.001] * 3, [0.0] * 3
    las.x, las.y, las.z = scene.xyz.T
    las.intensity = scene.intensity
    if labelled:
        las.classification = scene.codes
    if "red" in las.point_format.dimension_names:
        las.red, las.green, las.blue = scene.rgb.T
    las.write(str(path))
    return path


def make_config(**train: object) -> Config:
    """Settings of a network that learns the site in seconds."""
    settings = {"epochs": 2, "batch_size": 2, "steps_per_epoch": 6, "validation": "none"}
    return Config(
        prepare=PrepareConfig(
            voxel_size=0.15,
            num_neighbors=8,
            num_levels=2,
            tile_points=1500,
            halo=16,
            crop_points=512,
            num_crops=16,
        ),
        network=NetworkConfig(widths=(8, 16), head_widths=(8, 8), dropout=0.1),
        train=TrainConfig(**(settings | train)),
    )


@pytest.fixture(scope="session")
def new_scene() -> Callable[..., Scene]:
    return make_scene


@pytest.fixture(scope="session")
def write_las() -> Callable[..., Path]:
    return save_las


@pytest.fixture(scope="session")
def contents() -> Callable[[Path], dict[str, bytes]]:
    """What the files in a folder hold, by their paths in it."""

    def read(folder: Path) -> dict[str, bytes]:
        files = (path for path in folder.rglob("*") if path.is_file())
        return {str(path.relative_to(folder)): path.read_bytes() for path in files}

    return read


@pytest.fixture(scope="session")
def tiny() -> Callable[..., Config]:
    return make_config


@pytest.fixture(scope="session")
def scans(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of three labelled scans: north, middle, south."""
    folder = tmp_path_factory.mktemp("scans")
    for seed, name in enumerate(("north", "middle", "south")):
        save_las(folder / f"{name}.las", make_scene(seed))
    return folder


@pytest.fixture(scope="session")
def prepared(scans: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The scans as a data set; not to be written to."""
    from bushseg.preparation import prepare

    folder = tmp_path_factory.mktemp("data") / "prepared"
    prepare([scans], folder, make_config().prepare)
    return folder


@pytest.fixture(scope="session")
def run(prepared: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of six epochs; not to be written to."""
    from bushseg.training import train

    folder = tmp_path_factory.mktemp("runs") / "tiny"
    train(prepared, folder, make_config(epochs=6, steps_per_epoch=8, validation="scan:south"))
    return folder


@pytest.fixture(scope="session")
def model(run: Path):
    from bushseg.checkpoint import load_model

    return load_model(run / "best.safetensors")


@pytest.fixture(scope="session")
def height_model():
    """Untrained; any scan has the one feature it needs."""
    import torch

    from bushseg.checkpoint import Model, ModelCard, build_network
    from bushseg.labels import load_scheme

    card = ModelCard(
        scheme=load_scheme("bush"),
        features=("height",),
        prepare=PrepareConfig(voxel_size=0.15, num_neighbors=8, num_levels=2, halo=16),
        network=NetworkConfig(widths=(8, 16), head_widths=(8, 8)),
        neighbor_distance=(0.1, 1.0),
    )
    with torch.random.fork_rng():
        torch.manual_seed(3)
        return Model(card, build_network(card).eval())


@pytest.fixture(scope="session")
def stand_ins(model, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of bundled models: the tiny one, and its weights passed off as one for the air."""
    import tomli_w

    from bushseg.bundled import INDEX, BundledModel, file_hash
    from bushseg.checkpoint import save_model

    folder = tmp_path_factory.mktemp("bundled")
    entries = []
    for name, voxel_size, distances in (("close", 0.15, (0.2, 0.7)), ("airborne", 0.6, (0.8, 3.0))):
        prepare = model.card.prepare.model_copy(update={"voxel_size": voxel_size})
        changes = {"prepare": prepare, "neighbor_distance": distances}
        path = folder / f"{name}.safetensors"
        save_model(path, model.card.model_copy(update=changes), model.network)
        entry = BundledModel(
            name=name,
            file=path.name,
            sha256=file_hash(path),
            license="MIT",
            voxel_size=voxel_size,
            purpose=f"tests of {name} range",
        )
        entries.append(entry.model_dump(mode="json"))
    (folder / INDEX).write_text(tomli_w.dumps({"models": entries}))
    return folder


@pytest.fixture
def bundle(stand_ins: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """bushseg as if the stand-ins were what it ships with."""
    monkeypatch.setattr("bushseg.bundled.FOLDER", stand_ins)
    return stand_ins


@pytest.fixture
def start_ranks() -> Iterator[Callable[..., list[subprocess.Popen[str]]]]:
    """Start a command once for each rank, with the variables torchrun would set."""
    started: list[subprocess.Popen[str]] = []

    def start(command: list[object], size: int) -> list[subprocess.Popen[str]]:
        with socket.socket() as opened:
            opened.bind(("127.0.0.1", 0))
            port = opened.getsockname()[1]
        shared = {"WORLD_SIZE": size, "LOCAL_WORLD_SIZE": size, "MASTER_PORT": port}
        for rank in range(size):
            variables = shared | {"RANK": rank, "LOCAL_RANK": rank, "CUDA_VISIBLE_DEVICES": ""}
            started.append(
                subprocess.Popen(
                    list(map(str, command)),
                    env=os.environ | {name: str(value) for name, value in variables.items()},
                    stdout=subprocess.PIPE,
                    stderr=subprocess.PIPE,
                    text=True,
                )
            )
        return started[-size:]

    yield start
    for process in started:
        process.kill()
        process.communicate()


_COMMAND = """
import os, sys
os.setsid()
handle = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
os.dup2(handle, 1), os.dup2(handle, 2)
if file_size is not None:  # a file that may not grow further looks to us like a full disk
    import resource
    resource.setrlimit(resource.RLIMIT_FSIZE, (file_size, file_size))
exec(before)
sys.argv = ["bushseg", *arguments]
from bushseg_cli.main import main
main()
"""


class Command:
    """`bushseg ARGUMENTS` in a process that has imported nearly everything already.

    Attributes:
        said: What it says goes into this file.
    """

    def __init__(
        self, said: Path, arguments: list[object], before: str, file_size: int | None
    ) -> None:
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(["bushseg.training", "bushseg.prediction"])
        names = {
            "said": str(said),
            "arguments": list(map(str, arguments)),
            "before": before,
            "file_size": file_size,
        }
        self.said = said
        self._process = context.Process(target=exec, args=(_COMMAND, names))
        self._process.start()

    def is_running(self) -> bool:
        return self._process.exitcode is None

    def wait_for(self, folder: Path, pattern: str) -> None:
        """Until a file is there, or the command has ended."""
        while self.is_running() and not any(folder.glob(pattern)):
            time.sleep(0.005)

    def send(self, number: signal.Signals) -> None:
        """A signal to the process and all that it has started, as a terminal sends it."""
        assert self._process.pid is not None
        os.killpg(self._process.pid, number)

    def kill(self) -> None:
        self._process.kill()

    def wait(self) -> int:
        """Its exit status."""
        self._process.join(120)
        status = self._process.exitcode
        if status is None:
            self.kill()
            raise AssertionError(f"it doesn't end; it said {self.said.read_text()!r}")
        return status


@pytest.fixture
def start_command(tmp_path: Path) -> Iterator[Callable[..., Command]]:
    """Start `bushseg ARGUMENTS`; `before` is Python to be run there first."""
    started: list[Command] = []

    def start(*arguments: object, before: str = "", file_size: int | None = None) -> Command:
        said = tmp_path / f".said-{len(started)}"
        started.append(Command(said, list(arguments), before, file_size))
        return started[-1]

    yield start
    for command in started:
        command.kill()
