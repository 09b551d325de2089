"""Training that begins with another model's weights, for other classes and features if need be."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

from bushseg import io
from bushseg.bundled import file_hash
from bushseg.checkpoint import Model, ModelCard
from bushseg.config import Config, NetworkConfig, PrepareConfig
from bushseg.errors import CheckpointError, ConfigError
from bushseg.features import FEATURES
from bushseg.io.kept import KeptReader
from bushseg.model_choice import DEFAULT, candidates, choose, choose_prepared
from bushseg.models.bushnet import BushNet

_MUST_AGREE = ("voxel_size", "num_neighbors", "num_levels", "decimation", "sampling")
"""What a network has learnt to see; with other settings its weights mean little."""

_ADOPTED = (*_MUST_AGREE, "halo", "tile_points", "crop_points")

_STEM, _CLASSES = "stem.linear.weight", ("head.3.weight", "head.3.bias")


@dataclass(frozen=True, slots=True)
class Pretrained:
    """A model to begin with.

    Attributes:
        model: The model.
        name: For people, and in the new model's card: its name and its file's SHA-256.
    """

    model: Model
    name: str


def find_pretrained(name: str, prepare: PrepareConfig) -> Pretrained:
    """The model that a name means, checked against a prepared data set.

    Args:
        name: As for :func:`bushseg.model_choice.candidates`; "default" takes the bundled model of
            the data set's voxel size.
        prepare: How the data set was prepared.

    Raises:
        CheckpointError: There is no such model.
        ConfigError: The data set was prepared otherwise than the model's data.
    """
    chosen = choose_prepared(candidates(name), prepare)
    theirs = chosen.card.prepare
    for setting in _MUST_AGREE:
        ours, wanted = getattr(prepare, setting), getattr(theirs, setting)
        if ours != wanted:
            raise ConfigError(
                f"the data set was prepared with {setting} {ours}, {chosen.name} wants {wanted}; "
                f"prepare again: `bushseg prepare SCANS --for {name}`"
            )
    model = chosen.load()
    digest = file_hash(model.path)[:12] if model.path is not None else "in memory"
    return Pretrained(model, f"{chosen.name} (SHA-256 {digest})")


def settings_for(
    model: str, paths: Sequence[str | Path], config: PrepareConfig
) -> tuple[PrepareConfig, str]:
    """Settings that prepare scans for a model to be trained on.

    Args:
        model: The model's name; "default" takes the bundled model that suits the first scan.
        paths: The scans, or folders of them.
        config: Settings; those that were given stay, the others are the model's where it needs it.

    Returns:
        The settings, and whose they are, for people.

    Raises:
        CheckpointError: There is no such model.
        ConfigError: A setting was given that the model can't be used with.
        ReadError: The first scan can't be read.
    """
    among, reason = candidates(model), ""
    chosen = among[0]
    scans = io.find_scans(paths) if model == DEFAULT else []
    if scans:
        with io.open_scan(scans[0]) as reader:
            chosen, reason = choose(among, KeptReader(reader))
    adopted = {name: getattr(chosen.card.prepare, name) for name in _ADOPTED}
    given = config.model_dump(exclude_unset=True)
    for name in _MUST_AGREE:
        if given.get(name, adopted[name]) != adopted[name]:
            raise ConfigError(
                f"{name} is {given[name]}, {chosen.name} wants {adopted[name]}; "
                "leave the setting out"
            )
    because = f" ({reason})" if reason else ""
    return PrepareConfig(**{**adopted, **given}), f"{chosen.name}{because}"


def with_network_of(config: Config, source: ModelCard) -> Config:
    """The settings with the network that the weights fit.

    Raises:
        ConfigError: Another network was asked for.
    """
    if config.network not in (NetworkConfig(), source.network):
        raise ConfigError(
            "[network] asks for another network than the model to begin with; "
            "leave its settings out"
        )
    return config.model_copy(update={"network": source.network})


def adopt(network: BushNet, card: ModelCard, source: Model) -> list[str]:
    """Give a new network the weights of another, as far as they mean the same.

    All inner layers are taken over. In the first, the columns of features that both know are; those
    of new features begin at zero, so that at first they change nothing. In the last, the rows of
    classes with the same name are; the others begin anew.

    Args:
        network: The new network, of the source's settings; changed.
        card: Its card.
        source: The model to begin with.

    Returns:
        What begins anew, for people.

    Raises:
        CheckpointError: The source's weights don't fit.
    """
    weights = dict(source.network.state_dict())
    fresh = network.state_dict()
    stem = torch.zeros_like(fresh[_STEM])
    ours, theirs = _columns(card.features), _columns(source.card.features)
    for name in card.features:
        if name in theirs:
            stem[:, ours[name]] = weights[_STEM][:, theirs[name]]
    weights[_STEM] = stem
    known = source.card.scheme.names
    for name in _CLASSES:
        rows = fresh[name].clone()
        for index, label in enumerate(card.scheme.names):
            if label in known:
                rows[index] = weights[name][known.index(label)]
        weights[name] = rows
    try:
        network.load_state_dict(weights)
    except RuntimeError as error:
        reason = str(error).splitlines()[-1].strip()
        raise CheckpointError(f"{source.path}: its weights don't fit ({reason})") from error
    features = [name for name in card.features if name not in theirs]
    classes = [name for name in card.scheme.names if name not in known]
    notes = [("features", features), ("classes", classes)]
    return [f"new {what}: {', '.join(names)}" for what, names in notes if names]


def _columns(features: Sequence[str]) -> dict[str, slice]:
    """Which columns of the first layer belong to each feature."""
    columns, start = {}, 0
    for name in features:
        columns[name] = slice(start, start + FEATURES[name])
        start += FEATURES[name]
    return columns
