"""What the wheel is built from: every package, and every file that isn't Python, is named."""

import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"][
    "setuptools"
]


def test_every_package_is_in_the_wheel():
    """One that isn't listed works in a checkout and is missing from the wheel."""
    found = {
        ".".join(path.parent.relative_to(ROOT).parts)
        for path in (ROOT / "bushseg").rglob("__init__.py")
    }
    assert set(SETTINGS["packages"]) == found | {"bushseg_cli"}
    assert all((ROOT / folder).is_dir() for folder in SETTINGS["package-dir"].values())


def test_every_data_file_is_in_the_wheel():
    named = {
        path
        for package, patterns in SETTINGS["package-data"].items()
        for pattern in patterns
        for path in (ROOT / package.replace(".", "/")).glob(pattern)
    }
    there = {
        path
        for path in (ROOT / "bushseg").rglob("*")
        if path.is_file() and path.suffix != ".py" and "__pycache__" not in path.parts
    }
    assert there == named
    assert ROOT / "bushseg" / "bundled" / "index.toml" in named
