"""Models on disk: one safetensors file that can be used with nothing else.

Its metadata hold the classes, the features, the grid, the network's settings and what the model was
trained on. Nothing is unpickled; a network is only built once its settings and tensors agree.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import torch
from pydantic import Field, model_validator
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from bushseg.config import NetworkConfig, Positive, PrepareConfig, Section, Share
from bushseg.errors import CheckpointError, ConfigError, WriteError
from bushseg.features import FEATURES
from bushseg.files import atomic_path
from bushseg.models.bushnet import BushNet
from bushseg.scheme import ClassScheme

MODEL_VERSION = 1
_CARD = "bushseg"
_WEIGHTS = "network."


class ModelCard(Section):
    """What a model is and what it expects."""

    version: int = Field(MODEL_VERSION, description="Version of this format")
    scheme: ClassScheme = Field(description="The classes it tells apart")
    features: tuple[str, ...] = Field(description="Input features, in order")
    optional_features: tuple[str, ...] = Field(
        (), description="Those it learnt to do without (feature drop-out)"
    )
    prepare: PrepareConfig = Field(description="How its data were prepared")
    network: NetworkConfig = Field(description="The network's settings")
    neighbor_distance: tuple[float, float] = Field(
        description="Least and greatest median distance to the K-th neighbor in its data, metres"
    )
    metrics: dict[str, float | None] = Field(
        default_factory=dict, description="On the held-out split, at the epoch it was saved"
    )
    temperature: Positive = Field(
        1.0, description="Logits are divided by it, so that confidence means something"
    )
    confidence: Share | None = Field(
        None, description="Mean confidence on the held-out split; None where nothing was held out"
    )
    heights: tuple[float, float] | None = Field(
        None,
        description="Heights above ground in its data, metres: least 1 % and greatest 99 % "
        "quantile of a tile",
    )
    low_share: Share | None = Field(
        None, description="Least share of a scan's voxels that lie near the ground, in its data"
    )
    pretrained: str | None = Field(
        None, description="The model whose weights it began with, by name and SHA-256"
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        check_levels(self.prepare, self.network)
        return self


@dataclass(frozen=True, slots=True)
class Model:
    """A network and its card.

    Attributes:
        card: What it is.
        network: The network, in evaluation mode.
        path: Where it was read from; None for one just trained.
    """

    card: ModelCard
    network: BushNet
    path: Path | None = None


def check_levels(prepare: PrepareConfig, network: NetworkConfig) -> None:
    """Refuse a network that has other levels than the data it is to be fed.

    Raises:
        ConfigError: It says how many each has.
    """
    if len(network.widths) != prepare.num_levels:
        raise ConfigError(
            f"network.widths has {len(network.widths)} layers, the data {prepare.num_levels} "
            "levels; give as many widths, or prepare again with another num_levels"
        )


def build_network(card: ModelCard) -> BushNet:
    """A network of random weights that fits a card."""
    num_features = sum(FEATURES[name] for name in card.features)
    return BushNet(num_features, card.scheme.num_classes, card.network)


def save_model(
    path: Path,
    card: ModelCard,
    network: BushNet,
    *,
    extra: Mapping[str, Tensor] | None = None,
    state: Mapping[str, Any] | None = None,
) -> None:
    """Write a model, whole or not at all.

    Args:
        path: The file.
        card: Its card.
        network: Its weights.
        extra: Further tensors, for training to go on from.
        state: Further plain values, likewise.

    Raises:
        WriteError: The disk is full or the folder can't be written to; what stood there stands.
    """
    tensors = {_WEIGHTS + name: tensor for name, tensor in network.state_dict().items()}
    tensors |= dict(extra or {})
    tensors = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    metadata = {_CARD: card.model_dump_json(), "state": json.dumps(state or {})}
    try:
        with atomic_path(path) as partial:
            save_file(tensors, partial, metadata=metadata)
    except (OSError, SafetensorError) as error:
        raise WriteError(
            f"{path}: can't be saved ({error}), what was saved before still stands; make room on "
            "the disk, then go on"
        ) from error


def load_model(path: str | Path) -> Model:
    """Read a model.

    Raises:
        CheckpointError: The file is missing, no model, damaged, or of another version.
    """
    path = Path(path)
    card, _, tensors = load_checkpoint(path)
    try:
        # Built without memory first: settings that ask for absurd widths fail before they are met.
        with torch.device("meta"):
            network = build_network(card)
        network.load_state_dict(network_weights(tensors), assign=True)
    except RuntimeError as error:
        reason = str(error).splitlines()[-1].strip()
        raise CheckpointError(f"{path}: its weights don't fit its settings ({reason})") from error
    for name, tensor in network.state_dict().items():
        if not tensor.isfinite().all():
            raise CheckpointError(
                f"{path}: its weights hold NaN or infinite numbers ({name}); its training failed, "
                "take an earlier model"
            )
    return Model(card, network.float().eval(), path)


def network_weights(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The network's share of a file's tensors, by the names its `load_state_dict` takes."""
    return {
        name.removeprefix(_WEIGHTS): tensor
        for name, tensor in tensors.items()
        if name.startswith(_WEIGHTS)
    }


def load_checkpoint(path: Path) -> tuple[ModelCard, dict[str, Any], dict[str, Tensor]]:
    """Read a file that :func:`save_model` wrote.

    Returns:
        The card, the plain training state (empty in a finished model), and all tensors.

    Raises:
        CheckpointError: As :func:`load_model`.
    """
    metadata, tensors = _read(path, with_tensors=True)
    return *_parse(path, metadata), tensors


def read_card(path: str | Path) -> ModelCard:
    """Read what a model is, and none of its weights.

    Raises:
        CheckpointError: As :func:`load_model`.
    """
    metadata, _ = _read(Path(path), with_tensors=False)
    return _parse(Path(path), metadata)[0]


def _read(path: Path, *, with_tensors: bool) -> tuple[dict[str, str], dict[str, Tensor]]:
    """A file's metadata, and its tensors if they are wanted."""
    if not path.is_file():
        raise CheckpointError(f"{path}: no such file; `bushseg models` lists the models there are")
    try:
        with safe_open(path, framework="pt") as file:
            names = file.keys() if with_tensors else ()
            return file.metadata() or {}, {name: file.get_tensor(name) for name in names}
    except (OSError, SafetensorError, ValueError) as error:
        raise CheckpointError(f"{path}: is no intact safetensors file ({error})") from error


def _parse(path: Path, metadata: Mapping[str, str]) -> tuple[ModelCard, dict[str, Any]]:
    """The card and the plain training state in a file's metadata."""
    if _CARD not in metadata:
        raise CheckpointError(f"{path}: holds tensors but no model of bushseg's")
    try:
        values = json.loads(metadata[_CARD])
        if values.get("version") != MODEL_VERSION:
            raise CheckpointError(
                f"{path}: is a model of version {values.get('version')}; expected {MODEL_VERSION}"
            )
        card = ModelCard.from_dict(values, "model card")
        state = json.loads(metadata.get("state", "{}"))
    except (ValueError, RecursionError, AttributeError, ConfigError) as error:
        # Among them numbers of thousands of digits, and depth without end.
        raise CheckpointError(f"{path}: its model card can't be read ({error})") from error
    unknown = [name for name in card.features if name not in FEATURES]
    if unknown or not card.features:
        raise CheckpointError(f"{path}: wants features {unknown}; known are {', '.join(FEATURES)}")
    return card, state
