"""Settings as TOML for people: every setting, what it means, its unit."""

import json
from collections.abc import Mapping
from typing import Any

from bushseg.config import Section


def described(settings: Section) -> str:
    """Write settings as TOML with comments.

    What is None is written as a comment, for TOML has no such value. A kind of table is explained
    where it stands first.
    """
    return "\n\n".join(_tables(settings, "", set())) + "\n"


def _tables(settings: Section, name: str, explained: set[type[Section]]) -> list[str]:
    """The lines of `settings` themselves and then those of the tables in them."""
    new = type(settings) not in explained
    explained.add(type(settings))
    lines, below = ([f"[{name}]"] if name else []), []
    for key, field in type(settings).model_fields.items():
        value = getattr(settings, key)
        if isinstance(value, Section):
            below += _tables(value, f"{name}.{key}" if name else key, explained)
            continue
        if new:
            lines.append(f"# {field.description}")
        lines.append(f"# {key} =" if value is None else f"{key} = {_plain(value)}")
    return ["\n".join(lines), *below] if len(lines) > bool(name) else below


def _plain(value: Any) -> str:
    """A value as TOML writes it, on one line."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_plain(part)}" for key, part in value.items()) + " }"
    return json.dumps(value)
