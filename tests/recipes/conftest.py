"""Recipes are scripts beside the library, as the benchmarks are that they use."""

import importlib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="session")
def recipe_module() -> Iterator[Callable[[str], ModuleType]]:
    """Import a recipe's module by its name."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT / "benchmarks")
        patch.syspath_prepend(ROOT / "recipes")
        yield importlib.import_module
