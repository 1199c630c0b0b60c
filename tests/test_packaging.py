"""The built wheel is complete and works from anywhere; a source tree builds the same one."""

from __future__ import annotations

import sys
import tarfile
import zipfile
from pathlib import Path

import pytest
from environments import Environment, build, run
from gripper import write_gripper

ROOT = Path(__file__).resolve().parents[1]
#: Data folders: folder in the repository -> package in the wheel, and the file that marks one.
DATA = {"hands": ("gdg_hands", "hand.yaml"), "objects": ("gdg_objects", "object.yaml")}


@pytest.fixture(scope="session")
def source_archive(copy: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(copy, tmp_path_factory.mktemp("sdist"), "sdist")


@pytest.fixture(scope="session")
def installed(
    wheel: Path, no_network: dict[str, str], tmp_path_factory: pytest.TempPathFactory
) -> Environment:
    """An environment into which the wheel was installed."""
    environment = Environment.create(tmp_path_factory.mktemp("venv") / "venv", no_network)
    environment.run("pip", "install", "--quiet", str(wheel), cwd=wheel.parent)
    return environment


def names_in(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


def test_the_wheel_holds_every_file_of_every_hand_and_object(wheel: Path):
    names = names_in(wheel)
    for folder, (package, marker) in DATA.items():
        manifests = list((ROOT / folder).glob(f"*/{marker}"))
        assert manifests
        for manifest in manifests:
            for path in manifest.parent.rglob("*"):
                if path.is_file() and "__pycache__" not in path.parts:
                    assert f"{package}/{path.relative_to(ROOT / folder).as_posix()}" in names


def test_the_wheel_holds_every_module_and_protocol_and_the_type_marker(wheel: Path):
    names = names_in(wheel)
    for folder, package in (("gdg", "gdg"), ("plugins", "gdg_plugins")):
        for pattern in ("*.py", "*.yaml", "*.html", "*.js", "*.safetensors", "py.typed"):
            for path in (ROOT / folder).rglob(pattern):
                assert f"{package}/{path.relative_to(ROOT / folder).as_posix()}" in names
    assert any(name.endswith("licenses/LICENSE") for name in names)


def test_the_wheel_holds_nothing_else(wheel: Path):
    top = {name.partition("/")[0] for name in names_in(wheel)}
    packages = {"gdg", "gdg_plugins", "gdg_hands", "gdg_objects"}
    assert {name for name in top if not name.endswith(".dist-info")} == packages
    assert not [name for name in names_in(wheel) if "__pycache__" in name or name.endswith(".pyc")]


def test_the_source_archive_builds_the_same_wheel(
    source_archive: Path, wheel: Path, tmp_path_factory: pytest.TempPathFactory
):
    folder = tmp_path_factory.mktemp("unpacked")
    with tarfile.open(source_archive) as archive:
        archive.extractall(folder, filter="data")
    (source,) = folder.iterdir()
    again = build(source, tmp_path_factory.mktemp("again"), "wheel")
    assert names_in(again) == names_in(wheel)


def test_the_installed_wheel_lists_its_plugins_hands_and_objects_from_anywhere(
    installed: Environment,
):
    root = Path("/")
    plugins = installed.run("gdg", "plugins", cwd=root, GDG_STRICT_PLUGINS="1")
    assert "FAILED" not in plugins
    assert "pytorch-kinematics" in plugins
    assert "barrett" in installed.run("gdg", "hands", "list", cwd=root)
    assert "cube_small" in installed.run("gdg", "objects", "list", cwd=root)
    where = installed.run("python", "-c", "import gdg; print(gdg.__file__)", cwd=root)
    assert Path(where.strip()).is_relative_to(installed.folder)


def test_the_installed_wheel_plans_a_grasp_from_anywhere(installed: Environment, tmp_path: Path):
    installed.run(
        "gdg", "grasp", "hand=barrett", "object=cube_small", "n=1", "fitter.steps=5",
        "fitter.particles=2", "simulate=false", f"out={tmp_path / 'out'}", cwd=Path("/"),
    )  # fmt: skip
    assert list((tmp_path / "out").rglob("grasps.json"))


def test_a_new_hand_folder_is_seen_at_once_by_an_editable_install(tmp_path: Path):
    """Editable installs map a package to its folder, which is what is searched here."""
    package = tmp_path / "site" / "acme_hands"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    info = tmp_path / "site" / "acme_hands-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme-hands\nVersion: 1\n")
    (info / "entry_points.txt").write_text("[gdg.hands]\nacme = acme_hands\n")
    code = "from gdg.folders import HANDS; print('two_jaws' in HANDS.all())"
    search = str(tmp_path / "site")
    command = (sys.executable, "-c", code)
    assert run(*command, cwd=tmp_path, PYTHONPATH=search).strip() == "False"
    write_gripper(package)
    assert run(*command, cwd=tmp_path, PYTHONPATH=search).strip() == "True"
