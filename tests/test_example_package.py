"""The example package is built, installed beside gdg's wheel and used by name, as a user would."""

from __future__ import annotations

import json
import shutil
import zipfile
from pathlib import Path

import pytest
from environments import Environment, build

EXAMPLE = Path(__file__).resolve().parents[1] / "docs" / "examples" / "gdg-acme"
ELSEWHERE = Path("/")


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the example, which builds would litter."""
    ignored = shutil.ignore_patterns("build", "dist", "*.egg-info", "__pycache__", ".*")
    folder = tmp_path_factory.mktemp("example") / EXAMPLE.name
    return Path(shutil.copytree(EXAMPLE, folder, ignore=ignored))


@pytest.fixture(scope="module")
def example_wheel(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(source, tmp_path_factory.mktemp("example-wheel"), "wheel")


@pytest.fixture(scope="module")
def installed(
    example_wheel: Path, no_network: dict[str, str], tmp_path_factory: pytest.TempPathFactory
) -> Environment:
    """A fresh environment with the example's wheel, which brought gdg's along."""
    environment = Environment.create(tmp_path_factory.mktemp("venv") / "venv", no_network)
    environment.run("pip", "install", "--quiet", str(example_wheel), cwd=example_wheel.parent)
    return environment


def test_its_wheel_holds_all_of_its_package_and_nothing_else(source: Path, example_wheel: Path):
    with zipfile.ZipFile(example_wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
    root = source / "src"
    expected = {p.relative_to(root).as_posix() for p in (root / "gdg_acme").rglob("*")}
    assert names == {name for name in expected if (root / name).is_file()}


def test_it_depends_on_nothing_but_gdg(installed: Environment):
    code = "from importlib.metadata import requires; print(requires('gdg-acme'))"
    printed = installed.run("python", "-c", code, cwd=ELSEWHERE)
    assert printed.strip() == """['gdg>=0.1', 'pytest>=8.0; extra == "test"']"""


def test_its_hand_is_listed_and_shown(installed: Environment):
    listed = installed.run("gdg", "hands", "list", cwd=ELSEWHERE).splitlines()
    (line,) = [line for line in listed if line.startswith("acme_gripper ")]
    assert "package" in line
    assert "Acme TG-3" in line
    wide = {"COLUMNS": "200"}
    shown = installed.run("gdg", "hands", "show", "acme_gripper", cwd=ELSEWHERE, **wide)
    assert "finger_3_tip" in shown


def test_its_components_are_listed_with_their_options(installed: Environment):
    listed = installed.run("gdg", "plugins", "--options", cwd=ELSEWHERE, GDG_STRICT_PLUGINS="1")
    for text in ("huber ", "evolution ", "(gdg-acme 0.1.0)", "knee = 0.001", "population = 48"):
        assert text in listed


def test_listing_it_imports_nothing_heavy(installed: Environment):
    code = "import sys, gdg_acme; print('torch' in sys.modules, 'trimesh' in sys.modules)"
    assert installed.run("python", "-c", code, cwd=ELSEWHERE).strip() == "False False"


def test_all_three_plan_a_grasp_by_name(installed: Environment, tmp_path: Path):
    installed.run(
        "gdg", "grasp", "hand=acme_gripper", "object=cube_medium", "n=1", "distance=huber",
        "fitter=acme/evolution", "fitter.population=6", "fitter.generations=4", "picture=false",
        "report=false", f"out={tmp_path}", cwd=ELSEWHERE,
    )  # fmt: skip
    made = json.loads((tmp_path / "grasps.json").read_text())
    assert made["hand"] == "acme_gripper"
    assert made["provenance"]["distance"].startswith("huber/")
    assert made["grasps"][0]["verdict"]["protocol"].startswith("dro-2024")
    used = made["provenance"]["components"]["fitter"]
    assert (used["distribution"], used["version"]) == ("gdg-acme", "0.1.0")
    assert "name: acme/evolution" in (tmp_path / "config.yaml").read_text()


def test_its_own_tests_pass_with_shapes_checked(source: Path, installed: Environment):
    printed = installed.run(
        "python", "-m", "pytest", "-q", "-p", "no:cacheprovider",
        "--jaxtyping-packages=gdg_acme,beartype.beartype", "tests", cwd=source,
    )  # fmt: skip
    assert " passed" in printed
