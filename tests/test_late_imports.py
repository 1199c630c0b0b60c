"""Imports in name only."""

from __future__ import annotations

import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import pytest

from gdg.late_imports import late


@pytest.fixture
def paints(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Name of a package with the modules ``brush`` and ``canvas``."""
    package = tmp_path / "gdg_test_paints"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "brush.py").write_text("width = 3\n")
    (package / "canvas.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    yield package.name
    for name in [name for name in sys.modules if name.startswith(package.name)]:
        del sys.modules[name]


@pytest.mark.parametrize(
    "importing", ["from gdg_test_paints import brush", "import gdg_test_paints.brush as brush"]
)
def test_a_module_is_imported_when_something_of_it_is_used(paints: str, importing: str):
    names: dict = {}
    with late(paints, "brush"):
        exec(importing, names)
    assert not [name for name in sys.modules if name.startswith(paints)]
    assert names["brush"].width == 3
    assert sys.modules[f"{paints}.brush"].width == 3
    with pytest.raises(AttributeError, match="colour"):
        _ = names["brush"].colour


def test_what_is_imported_already_stays(paints: str):
    before = __import__(f"{paints}.brush").brush
    with late(paints, "brush"):
        assert __import__(f"{paints}.brush").brush is before
    assert sys.modules[f"{paints}.brush"] is before


def test_an_error_meanwhile_leaves_nothing_behind(paints: str):
    with pytest.raises(ZeroDivisionError), late(paints, "brush"):
        _ = 1 / 0
    assert paints not in sys.modules


def test_a_hand_needs_no_plotting_library():
    code = """
        import sys
        import gdg_plugins.hand_pytorch_kinematics.model
        import pytorch_kinematics.ik as ik
        assert not [name for name in sys.modules if name.startswith("matplotlib")]
        assert ik.plt.figure and "matplotlib.pyplot" in sys.modules
    """
    subprocess.run([sys.executable, "-c", textwrap.dedent(code)], check=True)
