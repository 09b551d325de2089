import subprocess
import sys

import pytest

import bushseg

HEAVY = ("torch", "open3d", "matplotlib", "scipy", "laspy")


@pytest.mark.parametrize("name", bushseg.__all__)
def test_every_name_is_there(name):
    value = getattr(bushseg, name)
    assert value.__name__ == name
    assert value.__doc__


def test_a_function_is_not_hidden_by_a_module_of_its_name():
    import bushseg.evaluation
    import bushseg.prediction
    import bushseg.preparation
    import bushseg.training

    assert all(callable(getattr(bushseg, name)) for name in bushseg.__all__)


def test_names_are_in_order_and_once():
    assert bushseg.__all__ == sorted(set(bushseg.__all__))


def test_no_other_name():
    with pytest.raises(AttributeError, match="'bushseg' has no attribute 'segment'"):
        _ = bushseg.segment


@pytest.mark.parametrize(
    "code",
    [
        "import bushseg",
        "import bushseg.io, bushseg.config, bushseg.labels",
        "import bushseg_cli.main",
        "import sys; sys.argv = ['bushseg', '--help']\n"
        "from bushseg_cli.main import app; app(standalone_mode=False)",
        "import sys; sys.argv = ['bushseg', 'predict', '--help']\n"
        "from bushseg_cli.main import app; app(standalone_mode=False)",
    ],
)
def test_nothing_heavy_is_loaded_before_it_is_used(code):
    check = f"\nimport sys; print([n for n in {HEAVY!r} if n in sys.modules], file=sys.stderr)"
    result = subprocess.run(
        [sys.executable, "-c", code + check], capture_output=True, text=True, check=True
    )
    assert result.stderr.strip() == "[]"
