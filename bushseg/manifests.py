"""What the manifests of a prepared data set must say, checked before anything is made of it."""

from collections.abc import Mapping
from typing import Annotated, Any, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError, model_validator

from bushseg.config import PrepareConfig
from bushseg.errors import CacheError
from bushseg.scheme import ClassScheme

Count = Annotated[int, Field(ge=0, lt=2**62)]
CodeCounts = dict[Annotated[str, Field(pattern=r"^-?[0-9]{1,20}$")], Count]
"""How many points hold each code."""


class _Part(BaseModel):
    """Plain values; what isn't asked for is left alone, for it may be another command's."""

    model_config = ConfigDict(frozen=True, strict=True)


class TileRecord(_Part):
    """A tile; see :class:`bushseg.dataset.TileEntry`."""

    core_size: Annotated[Count, Field(gt=0)]
    class_counts: list[Count]
    neighbor_distance: FiniteFloat
    height_profile: Annotated[list[FiniteFloat], Field(min_length=3, max_length=3)]


class ScanManifest(_Part):
    """What stands beside a scan's tiles."""

    path: str
    num_points: Count
    num_skipped: Count
    unknown_codes: CodeCounts
    invalid_codes: Count
    tiles: list[TileRecord]
    has_labels: bool
    features: list[str]


class PreparedScan(ScanManifest):
    """A scan as the data set lists it: its manifest and its folder."""

    folder: str


class CropsManifest(_Part):
    """What stands beside the crops."""

    tiles: list[Count]
    labelled: list[bool]

    @model_validator(mode="after")
    def _check(self) -> Self:
        if len(self.tiles) != len(self.labelled):
            raise ValueError(f"{len(self.tiles)} crops, {len(self.labelled)} flags")
        return self


class DatasetManifest(BaseModel):
    """The data set's own."""

    model_config = ConfigDict(frozen=True)

    config: PrepareConfig
    scheme: ClassScheme
    scans: list[PreparedScan]
    crops: str
    features: list[str]

    @model_validator(mode="after")
    def _check(self) -> Self:
        for scan in self.scans:
            for tile in scan.tiles:
                if len(tile.class_counts) != self.scheme.num_classes:
                    raise ValueError(
                        f"counts of {len(tile.class_counts)} classes, the scheme has "
                        f"{self.scheme.num_classes}"
                    )
        return self


Manifest = TypeVar("Manifest", bound=BaseModel)


def check_manifest(kind: type[Manifest], values: Mapping[str, Any], source: object) -> Manifest:
    """Check a manifest's values.

    Args:
        kind: Which manifest it is.
        values: What its JSON holds.
        source: Where it stands, for the message.

    Raises:
        CacheError: A value is missing, of another type or out of range.
    """
    try:
        return kind.model_validate(values)
    except (ValidationError, RecursionError) as error:
        reason = str(error).splitlines()[0]
        if isinstance(error, ValidationError):
            first = error.errors(include_url=False)[0]
            reason = f"{'.'.join(map(str, first['loc'])) or 'it'}: {first['msg']}"
        raise CacheError(
            f"{source}: can't be used ({reason}); run `bushseg prepare` again"
        ) from error
