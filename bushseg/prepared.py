"""What stands in a prepared data set's folders, and what they are called.

    prepared/
      dataset.json              settings, scans, classes, features
      scans/NAME-KEY/           manifest.json, tile_0000.safetensors ...
      crops-KEY/                manifest.json, crop_00000.safetensors ...

A folder's KEY is the hash of all its content follows from: the settings, the file's identity,
the format version. A folder is complete when its manifest stands, which is written last.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bushseg.cache import fingerprint, identity
from bushseg.config import PrepareConfig
from bushseg.io import label_sidecar
from bushseg.scheme import ClassScheme

DATASET = "dataset.json"
MANIFEST = "manifest.json"
SCANS = "scans"
SCRATCH = ".scratch"
"""A folder beside what is being written, with what memory can't hold meanwhile."""

# Tiles follow from every other setting; of the scheme its content counts, not its name.
CROP_SETTINGS = {"crop_points", "num_crops"}


def tile_name(number: int) -> str:
    """File name of a scan's tile."""
    return f"tile_{number:04d}.safetensors"


def lock_name(place: str) -> str:
    """Lock, beside a scan's folder of that name, of whoever writes tiles into it."""
    return f".{place}.lock"


def crop_name(number: int) -> str:
    """File name of a data set's crop."""
    return f"crop_{number:05d}.safetensors"


def scan_key(path: Path, config: PrepareConfig, scheme: ClassScheme) -> str:
    """Hash of all that a scan's tiles follow from."""
    settings = config.model_dump(mode="json", exclude=CROP_SETTINGS | {"scheme"})
    sidecar = label_sidecar(path)
    files = [identity(file) for file in (path, sidecar) if file is not None]
    return fingerprint(
        {"settings": settings, "scheme": scheme.model_dump(mode="json"), "files": files}
    )


def crops_key(manifests: Sequence[dict[str, Any]], config: PrepareConfig) -> str:
    """Hash of all that a data set's crops follow from."""
    return fingerprint(
        {
            "scans": [manifest["folder"] for manifest in manifests],
            **config.model_dump(mode="json", include=CROP_SETTINGS),
        }
    )
