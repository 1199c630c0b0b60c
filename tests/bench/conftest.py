"""Tables of components that take no time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from evaluation_fakes import FakePlugin
from gripper import write_gripper

from gdg.bench.tables import BenchTable, Claim, Method, Published
from gdg.registry import get_registry


@pytest.fixture(autouse=True)
def fakes() -> Iterator[None]:
    """Registers the fakes for one test."""
    registry = get_registry()
    before = list(registry.plugins), list(registry._components)
    registry.register(FakePlugin("other"), "fakes")
    yield
    registry.plugins[:], registry._components[:] = before


@pytest.fixture(autouse=True)
def hands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The gripper, found by its name."""
    write_gripper(tmp_path / "hands")
    monkeypatch.setenv("GDG_HANDS_PATH", str(tmp_path / "hands"))
    monkeypatch.delenv("GDG_TEST_ASSETS", raising=False)


@pytest.fixture
def table() -> BenchTable:
    """Two planners of the gripper, one of them asked for two grasps at most."""
    return BenchTable(
        "small",
        "A small table",
        (
            Method("first", "two_jaws", ("planner=fake",), Published(70.0, 0.2, 16.0)),
            Method("second", "two_jaws", ("planner=other",), Published(50.0), most=2),
        ),
        (
            Claim("the first is not much worse", "success", "first", "second", -9.0),
            Claim("the first is far better", "success", "first", "second", 9.0),
        ),
    )
