"""The class schemes bushseg knows, and reading a user's own from TOML.

The types, and how codes become labels, are in :mod:`bushseg.scheme`; they are given again here so
that one import serves.

A user's scheme is a TOML file:

    name = "orchard"
    unlabelled = [0]
    bush_class = "hedge"

    [[classes]]
    name = "soil"
    codes = [1, 2]       # source codes; the first is the one written
    color = "#a0782d"    # optional
    asprs = 2            # optional: the LAS class it is written as
    bush = "ground"      # optional: the class of the `bush` scheme that holds these points

    [[classes]]
    name = "hedge"
    codes = [7]
    bush = "bush"
"""

import tomllib
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray
from pydantic import ValidationError

from bushseg.builtin_schemes import ASPRS, BUSH, RELLIS, RELLIS11, SEMANTIC3D, SEMANTICKITTI
from bushseg.codes import UNLABELLED, Encoded
from bushseg.errors import SchemeError
from bushseg.scheme import ASPRS_UNCLASSIFIED, UNLABELLED_INDEX, ClassInfo, ClassScheme

__all__ = [
    "ASPRS_UNCLASSIFIED",
    "SCHEMES",
    "UNLABELLED",
    "UNLABELLED_INDEX",
    "ClassInfo",
    "ClassScheme",
    "Encoded",
    "describe_legacy_loss",
    "dump_scheme",
    "fit_legacy",
    "load_scheme",
    "parse_scheme",
]

SCHEMES: dict[str, ClassScheme] = {
    "bush": BUSH,
    "asprs": ASPRS,
    "semantic3d": SEMANTIC3D,
    "rellis": RELLIS,
    "rellis11": RELLIS11,
    "semantickitti": SEMANTICKITTI,
}

_LEGACY_MAX_CODE = 31
_MAX_FILE_BYTES = 1_000_000


def load_scheme(name_or_path: str | Path) -> ClassScheme:
    """Give the built-in scheme of that name, or read a user's from a TOML file.

    Args:
        name_or_path: One of :data:`SCHEMES`, or the path of a `.toml` file.

    Raises:
        SchemeError: There is no such scheme or file, or the file is malformed.
    """
    name = str(name_or_path)
    if name in SCHEMES:
        return SCHEMES[name]
    path = Path(name_or_path)
    if path.suffix.lower() != ".toml":
        close = get_close_matches(name, SCHEMES, n=1)
        hint = f" (did you mean {close[0]}?)" if close else ""
        raise SchemeError(
            f"unknown class scheme {name!r}{hint}; expected {', '.join(SCHEMES)} "
            "or the path of a .toml file"
        )
    try:
        with path.open("rb") as file:
            content = file.read(_MAX_FILE_BYTES + 1)
    except OSError as error:
        raise SchemeError(f"{path}: can't be read ({error.strerror or error})") from error
    if len(content) > _MAX_FILE_BYTES:
        raise SchemeError(f"{path}: larger than 1 MB; expected a class scheme in TOML")
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise SchemeError(f"{path}: isn't UTF-8 text; expected a class scheme in TOML") from error
    return parse_scheme(text, source=str(path))


def parse_scheme(text: str, source: str = "class scheme") -> ClassScheme:
    """Read a scheme from TOML text.

    Args:
        text: What :func:`dump_scheme` gives, or a user's file.
        source: Where the text is from, for messages.

    Raises:
        SchemeError: The text isn't TOML, or a field is missing, unknown or wrong.
    """
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise SchemeError(f"{source}: isn't valid TOML: {error}") from error
    try:
        return ClassScheme.model_validate(table)
    except ValidationError as error:
        raise SchemeError(f"{source}: {_describe(error, table)}") from error


def dump_scheme(scheme: ClassScheme) -> str:
    """Write a scheme as TOML text that :func:`parse_scheme` reads back as its equal."""
    return tomli_w.dumps(scheme.model_dump(mode="json", exclude_none=True))


def fit_legacy(codes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Fit LAS classification codes into point formats 0-5, which have five bits for them.

    Codes above 31 become 1, unclassified. Their lower five bits, which is what would be stored,
    name other classes: 64 (man-made) would turn into 0 and 69 into 5, high vegetation.

    Args:
        codes: Shape (N,), uint8.

    Returns:
        Codes of 0 .. 31, shape (N,), uint8.
    """
    return np.where(codes > _LEGACY_MAX_CODE, np.uint8(ASPRS_UNCLASSIFIED), codes)


def describe_legacy_loss(
    scheme: ClassScheme, counts: NDArray[np.int64], mapping: Mapping[str, int] | None = None
) -> str | None:
    """Say which classes :func:`fit_legacy` turns into unclassified points.

    Args:
        scheme: The classes.
        counts: Points of each class, shape (C,), int64.
        mapping: As :meth:`bushseg.scheme.ClassScheme.to_asprs` takes it.

    Returns:
        One line, or None where no point loses its code.
    """
    codes = scheme.to_asprs(np.arange(scheme.num_classes), mapping)
    lost = np.flatnonzero((fit_legacy(codes) != codes) & (counts > 0))
    if not len(lost):
        return None
    named = ", ".join(f"{scheme.names[label]} ({codes[label]})" for label in lost)
    return (
        f"LAS point formats 0 to 5 have no class codes above {_LEGACY_MAX_CODE}: {named} stand as "
        f"{ASPRS_UNCLASSIFIED}, unclassified; class_index tells them apart, and --asprs CLASS=CODE "
        "gives them codes that fit"
    )


def _describe(error: ValidationError, table: dict[str, Any]) -> str:
    """Put the first thing wrong with a scheme into one line: field, value, what was expected."""
    first = error.errors()[0]
    field = _field_name(first["loc"], table)
    if first["type"] == "missing":
        return f"{field} is missing; add it"
    if first["type"] == "extra_forbidden":
        return f"{field} is no field of a class scheme; remove it or correct its spelling"
    if first["type"] == "value_error":
        return str(first["ctx"]["error"])
    value = repr(first["input"])
    shown = value if len(value) <= 60 else f"{value[:57]}..."
    return f"{field} is {shown}; {first['msg'][0].lower()}{first['msg'][1:]}"


def _field_name(location: tuple[int | str, ...], table: dict[str, Any]) -> str:
    """Name a field as a reader of the file would: `codes of class 2 ('hedge')`."""
    match location:
        case ("classes", int(position), *inner):
            info = table["classes"][position]
            name = f" ({info['name']!r})" if isinstance(info, dict) and "name" in info else ""
            field = f"{inner[0]} of " if inner else ""
            return f"{field}class {position + 1}{name}"
        case (field, *_):
            return str(field)
    return "the scheme"
