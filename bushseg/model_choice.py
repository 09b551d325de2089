"""Which model labels a scan: the one named, the newest run's, or the bundled one that suits it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bushseg.bundled import BundledModel, bundled_models, bundled_path
from bushseg.checkpoint import Model, ModelCard, load_model, read_card
from bushseg.config import PrepareConfig
from bushseg.density import Density, measure_density, sample_points
from bushseg.errors import CheckpointError
from bushseg.io.kept import KeptReader
from bushseg.runs import BEST, RUNS, find_model

DEFAULT = "default"
"""Names whichever bundled model suits the data."""

_MARGIN = 1.5  # this much sparser than its training data a scan may be and still suit a model
_SPREAD = 3.0  # far over near, from which on a sensor is taken to have stood in the scene
_FILLED = 0.75  # voxel sizes times root K to the K-th neighbor, up to which a surface is filled


@dataclass(frozen=True, slots=True)
class Candidate:
    """A model that may be used, known by its card.

    Attributes:
        name: For people: 'bundled "close"', or the file's path.
        card: What it is.
        source: The model itself, or its file.
    """

    name: str
    card: ModelCard
    source: Model | Path

    def load(self) -> Model:
        """The model.

        Raises:
            CheckpointError: Its file is damaged.
        """
        return self.source if isinstance(self.source, Model) else load_model(self.source)


Choice = Model | str | Path | tuple[Candidate, ...] | None
"""What a user may say of the model to use, and what was found of it."""


def candidates(model: Choice = None) -> list[Candidate]:
    """The models that may be used; where there are several, the data decide.

    Args:
        model: A model; a bundled model's name, or "default" for whichever of them suits; a model
            file, a run's folder or its name in `runs/`. None takes the newest run's best model if
            there is one, else as "default". Candidates that were found before stay what they are.

    Raises:
        CheckpointError: There is no such model, or a file is damaged.
    """
    if isinstance(model, tuple):
        return list(model)
    if isinstance(model, Model):
        return [Candidate(str(model.path or "in memory"), model.card, model)]
    bundled = bundled_models()
    if model is None and any(RUNS.glob(f"*/{BEST}")):
        return [_from_file(find_model())]
    if model is None or str(model) == DEFAULT:
        if not bundled:
            raise CheckpointError(
                f"no model: none is bundled with this build, and {RUNS.absolute()} holds no "
                "finished epoch of a run; train one with `bushseg train`, or name one with --model"
            )
        chosen = bundled
    else:
        chosen = tuple(entry for entry in bundled if entry.name == str(model))
        if not chosen:
            return [_from_file(_find(model, [entry.name for entry in bundled]))]
    paths = [(entry, bundled_path(entry)) for entry in chosen]
    return [Candidate(_title(entry), read_card(path), path) for entry, path in paths]


def choose(among: Sequence[Candidate], kept: KeptReader) -> tuple[Candidate, str]:
    """The candidate that suits a scan's density, and why.

    Args:
        among: The candidates, finest voxels first, at least one.
        kept: The scan; what is read of it stays with it.

    Returns:
        The candidate, and the reason for people; empty where there was no choice.
    """
    if len(among) == 1:
        return among[0], ""
    xyz = sample_points(kept)
    if not len(xyz):
        return among[0], "the scan has no points to judge by"
    densities = [
        measure_density(xyz, it.card.prepare.voxel_size, it.card.prepare.num_neighbors)
        for it in among
    ]
    best = _best([it.card for it in among], densities)
    card, density = among[best].card, densities[best]
    size = card.prepare.voxel_size
    low, high = card.neighbor_distance
    reason = (
        f"voxels of {size:g} m, since at that size {card.prepare.num_neighbors} neighbors lie "
        f"within {density.median:.2f} m (across the scan {density.near:.2f} to "
        f"{density.far:.2f} m; in its training data {low:.2f} to {high:.2f} m)"
    )
    return among[best], reason


def suited_better(chosen: Candidate, kept: KeptReader) -> str | None:
    """A warning, if a bundled model was named and another one suits the scan's density."""
    entries = bundled_models()
    if len(entries) < 2 or chosen.name not in map(_title, entries):
        return None
    best, reason = choose(candidates(DEFAULT), kept)
    if best.name == chosen.name:
        return None
    return f"{best.name} suits the scan better than {chosen.name}: {reason}"


def choose_prepared(among: Sequence[Candidate], prepare: PrepareConfig) -> Candidate:
    """The candidate of a prepared data set's voxel size; the nearest, where none has it."""
    return min(among, key=lambda it: abs(math.log(it.card.prepare.voxel_size / prepare.voxel_size)))


def _best(cards: Sequence[ModelCard], densities: Sequence[Density]) -> int:
    """Which model suits a scan of these densities at the models' voxel sizes.

    At large voxels every dense scan looks alike, so the finest model is taken whose training data
    were not much denser and whose voxels the scan fills where it is dense, or is uneven, as only
    scans from within the scene are. `benchmarks/density.py` shows by how much real scans differ. If
    that is so for none, the nearest training data decide.
    """
    misfits = []
    for number, (card, density) in enumerate(zip(cards, densities, strict=True)):
        low, high = card.neighbor_distance
        reach = max(density.median, 1e-9)
        misfits.append(max(0.0, math.log(low / reach), math.log(reach / high)))
        filled = _FILLED * card.prepare.voxel_size * math.sqrt(card.prepare.num_neighbors)
        is_near = density.near <= filled or density.spread >= _SPREAD
        if is_near and density.median <= _MARGIN * high:
            return number
    return min(range(len(cards)), key=misfits.__getitem__)


def _title(entry: BundledModel) -> str:
    return f'bundled "{entry.name}"'


def _from_file(path: Path) -> Candidate:
    return Candidate(str(path), read_card(path), path)


def _find(model: str | Path, known: Sequence[str]) -> Path:
    """A model's file by its path, its run's folder, or its run's name in `runs/`."""
    path = Path(model)
    if not path.exists() and (RUNS / path).is_dir():
        path = RUNS / path
    if not path.exists():
        names = f"; bundled are {', '.join(known)}" if known else ""
        raise CheckpointError(
            f"{model}: no such model, file or run{names}; `bushseg models` lists what there is"
        )
    return find_model(path)


@dataclass(frozen=True, slots=True)
class Available:
    """A model that is there to be used.

    Attributes:
        name: What `--model` takes.
        path: Its file.
        num_bytes: The file's size.
        purpose: What it is for; empty for a run's.
        card: What it is.
        is_default: Whether it is used, or chosen from, where none is named.
    """

    name: str
    path: Path
    num_bytes: int
    purpose: str
    card: ModelCard
    is_default: bool


def available() -> list[Available]:
    """The bundled models, finest first, and the best of each run in `runs/`, newest first.

    Raises:
        CheckpointError: A model's file is damaged.
    """
    runs = sorted(RUNS.glob(f"*/{BEST}"), key=lambda path: path.stat().st_mtime, reverse=True)
    listed = [(entry.name, bundled_path(entry), entry.purpose) for entry in bundled_models()]
    listed += [(str(path.parent), path, "") for path in runs]
    newest = runs[0] if runs else None
    return [
        Available(
            name=name,
            path=path,
            num_bytes=path.stat().st_size,
            purpose=purpose,
            card=read_card(path),
            is_default=path == newest if newest else True,
        )
        for name, path, purpose in listed
    ]
