"""What answers in half a second imports no heavy library."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

HEAVY = {"torch", "sapien", "trimesh", "lightning", "pyvista", "igl", "scipy", "mujoco", "numba"}
LIGHT = (
    "gdg",
    "gdg.assemble",
    "gdg.components",
    "gdg.config",
    "gdg.errors",
    "gdg.folders",
    "gdg.hands.decisions",
    "gdg.hands.spec",
    "gdg.hookspecs",
    "gdg.objects.spec",
    "gdg.protocols",
    "gdg.registry",
    "gdg.testing",
    "gdg.testing.pytest_plugin",
    "gdg.validation",
    "gdg.yaml_files",
    "gdg.cli",
)


def modules_after(code: str) -> set[str]:
    """Top-level modules that a fresh interpreter holds after running ``code``."""
    report = "; import sys, json; print(json.dumps(sorted({m.split('.')[0] for m in sys.modules})))"
    command = [sys.executable, "-c", code + report]
    finished = subprocess.run(command, capture_output=True, text=True, check=False)
    assert finished.returncode == 0, finished.stderr
    return set(json.loads(finished.stdout.splitlines()[-1]))


def test_light_modules_import_nothing_heavy():
    assert modules_after(f"import {', '.join(LIGHT)}") & HEAVY == set()


def test_listing_plugins_hands_and_objects_imports_nothing_heavy():
    code = (
        "from gdg.registry import get_registry; from gdg.folders import HANDS, OBJECTS; "
        "from gdg.protocols import load_protocol; "
        "assert get_registry().components(); assert not [p for p in get_registry().plugins if "
        "p.failure]; assert HANDS.all(); assert OBJECTS.all(); load_protocol('dro-2024')"
    )
    assert modules_after(code) & HEAVY == set()


def test_composing_a_config_imports_nothing_heavy():
    code = (
        "from gdg.config import JobConfig, compose; from gdg.registry import get_registry; "
        "compose(JobConfig, get_registry(), {'distance': 'aligned', 'fitter': 'adam'}, (), "
        "['fitter.steps=5'])"
    )
    assert modules_after(code) & HEAVY == set()


@pytest.mark.parametrize("arguments", [["--help"], ["plugins"], ["hands", "list"]])
def test_light_commands_import_nothing_heavy(arguments: list[str]):
    code = (
        f"import contextlib, sys; sys.argv[1:] = {arguments!r}; from gdg.cli import main\n"
        "with contextlib.suppress(SystemExit):\n    main()\n"
        "pass"
    )
    assert modules_after(code) & HEAVY == set()
