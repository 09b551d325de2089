"""Every setting, with its unit and its reason.

Settings are small frozen models; an unknown name or a value out of range is an error that says
so. `bushseg.toml` holds them by section ([prepare], [network], [train], [predict]); command-line
options override it, and what was resolved is stored beside every result.
"""

import reprlib
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import tomli_w
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    model_validator,
)

from bushseg.errors import ConfigError
from bushseg.memory import parse_size

Sampling = Literal["mrs", "random"]
Precision = Literal["auto", "float32", "bfloat16"]
Attention = Literal["mam", "randla", "eca", "se", "nonlocal", "axial"]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, le=1)]
Width = Annotated[int, Field(ge=1, le=4096)]

FINE_TUNING_RATE = 0.001
"""First learning rate of a network that begins with another's weights: the usual 0.01 would undo
within some steps what it knows."""


class Section(BaseModel):
    """A group of settings: immutable, and strict about names."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    listed_by: ClassVar[str] = "bushseg config"
    """The command that prints all settings."""

    @classmethod
    def from_dict(cls, values: dict[str, Any], source: str = "settings") -> Self:
        """Check plain values.

        Raises:
            ConfigError: A name is unknown or a value is out of range.
        """
        try:
            return cls.model_validate(values)
        except ValidationError as error:
            raise ConfigError(f"{source}: {_first(error, cls.listed_by)}") from error

    def to_toml(self) -> str:
        """Write all settings as TOML; those that are None are left out."""
        return tomli_w.dumps(self.model_dump(mode="json", exclude_none=True))


class PrepareConfig(Section):
    """How scans become cached tensors."""

    voxel_size: Positive = Field(0.1, description="Edge of the sub-sampling grid, metres")
    scheme: str = Field("bush", description="Class scheme: a built-in name or a TOML file")
    label_field: str | None = Field(
        None, description="Attribute that holds the class codes; None takes the format's own"
    )
    num_neighbors: int = Field(16, ge=3, le=64, description="K of every neighborhood")
    num_levels: int = Field(4, ge=1, le=6, description="How often the network decimates")
    decimation: int = Field(4, ge=2, le=16, description="One point in this many survives a level")
    sampling: Sampling = Field("mrs", description="How points are chosen: MRS or plain random")
    tile_points: int = Field(
        120_000, ge=1_000, le=4_000_000, description="A tile's core holds at most so many voxels"
    )
    halo: int = Field(
        48, ge=0, le=512, description="Context around a tile's core, in voxels (rounded up to 16)"
    )
    crop_points: int = Field(12_288, ge=256, le=65_536, description="Voxels in a training crop")
    num_crops: int | None = Field(
        None, ge=1, description="Crops to draw; None draws enough for two passes over the data"
    )
    seed: int = Field(0, ge=0, description="Seed of decimation and crops")


class NetworkConfig(Section):
    """BushNet's switches; with `randla()` only RandLA-Net remains."""

    spo: bool = Field(True, description="Use the position channel of LMFF (Table 3)")
    spf: bool = Field(True, description="Use the SPF channel of LMFF, eq. 4-9 (Table 3)")
    position: Literal["relative", "absolute"] = Field(
        "relative",
        description="relative: p_i - p_k and distance, so that labels don't depend on where a tile "
        "was cut; absolute: p_i and p_k as well, as RandLA-Net has it",
    )
    attention: Attention = Field("mam", description="How a neighborhood is pooled (Table 4)")
    widths: tuple[Width, ...] = Field(
        (32, 128, 256, 512), description="Feature width after each encoder layer; multiples of 4"
    )
    stem_width: Width = Field(8, description="Width after the first fully connected layer")
    head_widths: tuple[Width, Width] = Field((64, 32), description="Widths before the class scores")
    dropout: Share = Field(0.5, description="Drop-out before the class scores")

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.widths or any(width < 4 or width % 4 for width in self.widths):
            raise ValueError(f"widths are {self.widths}; expected multiples of 4")
        return self

    @classmethod
    def randla(cls) -> Self:
        """RandLA-Net: two channels (features, full position encoding) and attentive pooling."""
        return cls(spf=False, attention="randla", position="absolute")


class AugmentConfig(Section):
    """What training varies. Rotation is about z: gravity tells a bush from a wall."""

    rotate: bool = Field(True, description="Rotate about z by any angle")
    scale: float = Field(0.1, ge=0, lt=1, description="Scale by 1 plus or minus this")
    jitter: float = Field(0.1, ge=0, description="Gaussian noise on positions, voxel sizes")
    color_jitter: float = Field(0.1, ge=0, description="Gaussian shift and noise of colors")
    feature_dropout: Share = Field(
        0.2, description="Chance a crop is shown without its colors, or without its intensity"
    )


class TrainConfig(Section):
    """How the network learns. Optimizer and schedule are the paper's (section 4)."""

    epochs: int = Field(100, ge=1, description="Epochs to train")
    batch_size: int = Field(
        4, ge=1, description="Crops in a step, shared out where several processes train together"
    )
    learning_rate: Positive = Field(0.01, description="Adam's first learning rate")
    decay: Annotated[float, Field(gt=0, le=1)] = Field(
        0.95, description="Learning rate is multiplied by this each epoch"
    )
    steps_per_epoch: int | None = Field(
        None, ge=1, description="Steps in an epoch; None: one pass over the training crops"
    )
    class_weights: Literal["sqrt", "inverse", "none"] = Field(
        "sqrt", description="Weight of a class in the loss, by its share f: f^-1/2, 1/f or 1"
    )
    pretrained: str | None = Field(
        None,
        description="Begin with the weights of this model: a name, default, a file or a run",
    )
    validation: str = Field(
        "auto",
        description="What is held out: auto, scan:NAME[,NAME...], tile (by area) or none",
    )
    validation_share: Share = Field(0.2, description="Share held out by validation=auto or tile")
    fresh_crops: bool = Field(False, description="Draw new crops each epoch, not the cached ones")
    precision: Precision = Field(
        "float32",
        description="How a CPU multiplies matrices; bfloat16, and auto where the processor has "
        "units for it, is faster and rounds the factors",
    )
    checkpoint_minutes: float = Field(
        5.0, ge=0, description="Save within an epoch as often: what is lost at most if it is killed"
    )
    rank_timeout: Positive = Field(
        300.0, description="Give up when another process of a training doesn't answer, seconds"
    )
    augment: AugmentConfig = AugmentConfig()
    seed: int = Field(0, ge=0, description="Seed of weights, batches and augmentation")

    @model_validator(mode="before")
    @classmethod
    def _go_gently(cls, values: Any) -> Any:
        """A network that knows something is trained at a lower rate unless told otherwise."""
        if isinstance(values, dict) and values.get("pretrained") is not None:
            return {"learning_rate": FINE_TUNING_RATE, **values}
        return values


def _bytes(size: Any) -> Any:
    """A size as people write it, in bytes."""
    try:
        return parse_size(size) if isinstance(size, str) else size
    except ConfigError as error:
        raise ValueError(str(error)) from None


class PredictConfig(Section):
    """How a scan is labelled."""

    tile_points: int = Field(
        500_000, ge=1_000, le=20_000_000, description="A tile's core holds at most so many voxels"
    )
    halo: int | None = Field(
        None, ge=0, le=512, description="Context around a tile, voxels; None: as the model's data"
    )
    precision: Precision = Field(
        "auto",
        description="How a CPU multiplies matrices; auto: in bfloat16 where the processor has "
        "units for it (about one label in a thousand differs), else in float32",
    )
    max_memory: Annotated[int, BeforeValidator(_bytes)] | None = Field(
        None,
        description='Memory to keep within, such as "2GB"; decides the size of tiles and how many '
        "voxels are held before they go to disk. None: tiles of tile_points",
    )
    workers: int = Field(
        1,
        ge=1,
        le=1024,
        description="Processes that label tiles or a folder's scans, each on its cores' share",
    )
    scheduler: str | None = Field(
        None, description="Dask scheduler whose workers do so: tcp://... or tls://..."
    )
    insecure_scheduler: bool = Field(
        False, description="Use a scheduler of another machine without tls"
    )
    scratch: Path | None = Field(
        None, description="Folder for what memory can't hold; None: a hidden one beside the output"
    )
    keep_classification: bool = Field(
        False, description="Leave LAS classification alone; write the added dimensions only"
    )
    asprs: dict[str, int] = Field(
        default_factory=dict, description="LAS code by class name, where the scheme's is unwanted"
    )


class Config(Section):
    """All sections, as `bushseg.toml` holds them."""

    prepare: PrepareConfig = PrepareConfig()
    network: NetworkConfig = NetworkConfig()
    train: TrainConfig = TrainConfig()
    predict: PredictConfig = PredictConfig()

    @classmethod
    def load(cls, path: str | Path | None = None, overrides: dict[str, Any] | None = None) -> Self:
        """Read a TOML file and lay overrides on top.

        Args:
            path: The file; None takes `bushseg.toml` here if there is one, else the defaults.
            overrides: Section to settings; a value of None counts as not given.

        Raises:
            ConfigError: The file is missing, no TOML, or holds an unknown or bad setting.
        """
        values: dict[str, Any] = {}
        file = Path(path) if path is not None else Path("bushseg.toml")
        if path is not None or file.exists():
            values = read_toml(file)
        for section, settings in (overrides or {}).items():
            given = {name: value for name, value in settings.items() if value is not None}
            below = values.get(section, {})
            # What is no table is left for the check to name.
            values[section] = {**below, **given} if isinstance(below, dict) else below
        return cls.from_dict(values, str(file) if values else "settings")


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file.

    Raises:
        ConfigError: It is missing or no TOML.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(
            f"{path}: can't be read ({error.strerror or error}); expected settings, such as "
            "`bushseg config` prints"
        ) from error
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ConfigError(f"{path}: can't be read as TOML ({error})") from error


def first_difference(before: Section, now: Section) -> str | None:
    """Name the first setting in which two groups of settings differ.

    Returns:
        For people: "augment.scale was 0.1, is 0.2"; None where the groups are equal.
    """
    old, new = dict(_flat(before.model_dump())), dict(_flat(now.model_dump()))
    for name in old | new:
        if old.get(name) != new.get(name):
            return f"{name} was {reprlib.repr(old.get(name))}, is {reprlib.repr(new.get(name))}"
    return None


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Settings by dotted name."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def _first(error: ValidationError, listed_by: str) -> str:
    """The first complaint of a validation, as one line."""
    detail = error.errors(include_url=False)[0]
    name = ".".join(str(part) for part in detail["loc"]) or "settings"
    if detail["type"] == "extra_forbidden":
        return f"{name} is no known setting; `{listed_by}` lists them"
    if detail["type"] == "missing":
        return f"{name} is missing"
    return f"{name} is {detail['input']!r}: {detail['msg']}"
