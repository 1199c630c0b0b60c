"""Imports in name only."""

from __future__ import annotations

import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import pytest

from gdg.late_imports import import_without

PAINTS, PAINTER = "gdg_test_paints", "gdg_test_painter"


@pytest.fixture
def painter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """File of a library; beside it lies a package with the modules ``brush`` and ``canvas``."""
    package = tmp_path / PAINTS
    package.mkdir()
    (package / "__init__.py").write_text("size = 7\n")
    (package / "brush.py").write_text("width = 3\n")
    (package / "canvas.py").write_text("height = 5\n")
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path / f"{PAINTER}.py"
    for name in imported(PAINTS) + imported(PAINTER):
        del sys.modules[name]


def imported(package: str) -> list[str]:
    return [name for name in sys.modules if name.startswith(package)]


@pytest.mark.parametrize("line", [f"from {PAINTS} import brush", f"import {PAINTS}.brush as brush"])
def test_a_module_is_imported_when_something_of_it_is_used(painter: Path, line: str):
    painter.write_text(line)
    library = import_without(PAINTER, PAINTS, "brush")
    assert imported(PAINTS) == []
    assert library.brush.width == 3
    assert sys.modules[f"{PAINTS}.brush"].width == 3
    with pytest.raises(AttributeError, match="colour"):
        _ = library.brush.colour


@pytest.mark.parametrize(
    ("line", "found"),
    [
        (f"from {PAINTS} import brush; value = brush.width", 3),
        (f"from {PAINTS}.canvas import height as value", 5),
        (f"from {PAINTS} import size as value", 7),
    ],
)
def test_a_library_that_cannot_do_without_gets_it(painter: Path, line: str, found: int):
    painter.write_text(line)
    assert import_without(PAINTER, PAINTS, "brush").value == found


def test_what_is_imported_already_stays(painter: Path):
    painter.write_text(f"from {PAINTS} import brush")
    before = __import__(f"{PAINTS}.brush").brush
    assert import_without(PAINTER, PAINTS, "brush").brush is before


def test_an_error_of_the_library_comes_out_and_leaves_nothing_behind(painter: Path):
    painter.write_text("1 / 0")
    with pytest.raises(ZeroDivisionError):
        import_without(PAINTER, PAINTS, "brush")
    assert imported(PAINTS) + imported(PAINTER) == []


def test_a_hand_needs_no_plotting_library():
    code = """
        import sys
        import gdg_plugins.hand_pytorch_kinematics.model
        import pytorch_kinematics.ik as ik
        assert not [name for name in sys.modules if name.startswith("matplotlib")]
        assert ik.plt.figure and "matplotlib.pyplot" in sys.modules
    """
    subprocess.run([sys.executable, "-c", textwrap.dedent(code)], check=True)
