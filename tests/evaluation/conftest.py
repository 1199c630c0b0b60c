"""Grids of components that take no time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from evaluation_fakes import LOG, FakePlugin
from gripper import write_gripper

from gdg.cli.settings import configs_from
from gdg.config import RunConfig
from gdg.pipeline.jobs import DEFAULTS, EvalJob
from gdg.registry import get_registry

WORDS = ("planner=fake", "simulator=fake", "hand_model.surface_points=60", "workers=1")


@pytest.fixture(autouse=True)
def fakes() -> Iterator[None]:
    """Registers the fakes for one test."""
    registry = get_registry()
    before = list(registry.plugins), list(registry._components)
    registry.register(FakePlugin(), "fakes")
    yield
    registry.plugins[:], registry._components[:] = before


@pytest.fixture
def log(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[[], list[str]]:
    """Gives the lines that planner and simulator have logged since the last call.

    Without plans of one grasp, which are the warm-ups of workers.
    """
    path = tmp_path / "log.txt"
    path.touch()
    monkeypatch.setenv(LOG, str(path))

    def lines() -> list[str]:
        found = path.read_text().splitlines()
        path.write_text("")
        return [line for line in found if not (line.startswith("plan") and line.endswith(" 1"))]

    return lines


@pytest.fixture(scope="session")
def hand_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_gripper(tmp_path_factory.mktemp("hands"))


@pytest.fixture
def configs(hand_folder: Path, tmp_path: Path) -> Callable[..., list[RunConfig]]:
    """Configs of an evaluation of the gripper from words."""

    def make(*words: str) -> list[RunConfig]:
        given = (f"hand={hand_folder}", *WORDS, f"out={tmp_path / 'out'}", *words)
        return configs_from(EvalJob, DEFAULTS, (), given)

    return make
