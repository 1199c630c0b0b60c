"""pyproject.toml declares exactly what the code imports; constraints.txt pins it."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
#: Declared, and never imported by name: who needs it.
INDIRECT = {"fast-simplification": "trimesh, to thin meshes before they are cut"}
#: Import names whose distributions do not list them in their metadata.
UNLISTED = {"manifold3d": "manifold3d"}
OWN = {"gdg", "gdg_plugins", "gdg_hands", "gdg_objects"}


def canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


#: What loads a part of gdg by itself, so that it is there whenever that part is.
HOSTS = {"pytest": "gdg.testing.pytest_plugin"}


def section(name: str) -> set[str]:
    """Names in one list of requirements of pyproject.toml (tomllib needs Python 3.11)."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    match = re.search(rf"^{name} = \[\n?(.*?)\]$", text, re.MULTILINE | re.DOTALL)
    assert match is not None
    return {canonical(found) for found in re.findall(r'"([A-Za-z0-9._-]+)', match[1])}


def imports_of(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            yield node.module


def third_party(*folders: str) -> dict[str, Path]:
    """Top-level import name -> a file that imports it."""
    found: dict[str, Path] = {}
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*.py")):
            for name in imports_of(path):
                found.setdefault(name.partition(".")[0], path)
    return {n: p for n, p in found.items() if n not in sys.stdlib_module_names and n not in OWN}


@pytest.fixture(scope="module")
def distributions() -> dict[str, set[str]]:
    listed = metadata.packages_distributions()
    found = {name: {canonical(dist) for dist in dists} for name, dists in listed.items()}
    return {**found, **{name: {dist} for name, dist in UNLISTED.items()}}


def optional() -> set[str]:
    """Names in the extras that users may install."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    extras = text.partition("[project.optional-dependencies]")[2].partition("\n[")[0]
    extras = re.sub(r"\ndev = \[.*?\n\]", "", extras, flags=re.DOTALL)
    return {canonical(name) for name in re.findall(r'"([A-Za-z0-9._-]+)[^"]*"', extras)}


def test_everything_that_is_imported_is_declared(distributions: dict[str, set[str]]):
    declared = section("dependencies") | optional()
    undeclared = {
        name: str(path.relative_to(ROOT))
        for name, path in third_party("gdg", "plugins").items()
        if name not in HOSTS and not distributions.get(name, {canonical(name)}) & declared
    }
    assert undeclared == {}


def test_everything_that_is_declared_is_imported(distributions: dict[str, set[str]]):
    used = set().union(
        *(distributions.get(name, {canonical(name)}) for name in third_party("gdg", "plugins"))
    )
    assert section("dependencies") - used == set(INDIRECT)


def test_tests_and_tools_import_only_what_is_declared(distributions: dict[str, set[str]]):
    declared = section("dependencies") | optional() | section("dev") | {"packaging"}
    local = {path.stem for path in (ROOT / "tests").glob("*.py")}
    local |= {path.parent.name for path in (ROOT / "tests").glob("*/__init__.py")}
    local |= {path.stem for path in (ROOT / "tools").glob("*.py")}
    undeclared = {
        name: str(path.relative_to(ROOT))
        for name, path in third_party("tests", "tools").items()
        if name not in local and not distributions.get(name, {canonical(name)}) & declared
    }
    assert undeclared == {}


def test_dependencies_are_listed_in_alphabetical_order():
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    for block in re.findall(
        r"^(?:dependencies|dev) = \[\n(.*?)^\]$", text, re.MULTILINE | re.DOTALL
    ):
        names = [canonical(name) for name in re.findall(r'"([A-Za-z0-9._-]+)', block)]
        assert names == sorted(names)


def test_every_dependency_is_pinned_without_local_label():
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pins = [line for line in lines if not line.startswith("#")]
    assert all(re.fullmatch(r"[a-z0-9-]+==[A-Za-z0-9.!]+", pin) for pin in pins)
    pinned = {pin.partition("==")[0] for pin in pins}
    assert (section("dependencies") | optional()) - pinned == set()
