"""The models that come with bushseg: what there is, and files that are what they were.

`index.toml` lists them, a safetensors file each beside it, and MODEL_CARD.md says how they were
made, how good they are and what they are not for. A build without models has an empty list.
"""

import hashlib
import tomllib
from pathlib import Path
from typing import Annotated

from pydantic import Field

from bushseg.config import Positive, Section
from bushseg.errors import CheckpointError, ConfigError

FOLDER = Path(__file__).parent
INDEX = "index.toml"
MAX_BYTES = 8_000_000
"""What all models together may weigh."""


class BundledModel(Section):
    """One entry of the index."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9-]*$")] = Field(description="What to call it")
    file: Annotated[str, Field(pattern=r"^[\w.-]+\.safetensors$")] = Field(description="Its file")
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")] = Field(description="The file's hash")
    license: str = Field(description="Under which its weights may be used, as an SPDX identifier")
    voxel_size: Positive = Field(description="Edge of the voxels it sees, metres")
    purpose: str = Field(description="Which scans it is for, in a line")


class _Index(Section):
    """What `index.toml` holds."""

    models: tuple[BundledModel, ...] = ()


def bundled_models() -> tuple[BundledModel, ...]:
    """The models there are, finest voxels first.

    Raises:
        CheckpointError: The installation is damaged.
    """
    path = FOLDER / INDEX
    try:
        index = _Index.from_dict(tomllib.loads(path.read_text(encoding="utf-8")), str(path))
    except (OSError, ValueError, ConfigError) as error:
        raise CheckpointError(f"{path}: can't be used ({error}); install bushseg again") from error
    return tuple(sorted(index.models, key=lambda model: model.voxel_size))


def bundled_path(model: BundledModel) -> Path:
    """A bundled model's file, checked to be the very one the index means.

    Raises:
        CheckpointError: It is missing or another file.
    """
    path = FOLDER / model.file
    try:
        found = file_hash(path)
    except OSError as error:
        reason = error.strerror or error
        raise CheckpointError(f"{path}: can't be read ({reason}); install bushseg again") from error
    if found != model.sha256:
        raise CheckpointError(
            f"{path}: has SHA-256 {found[:12]}..., expected {model.sha256[:12]}...; it was "
            "changed or damaged: install bushseg again, or name another model with --model"
        )
    return path


def file_hash(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
