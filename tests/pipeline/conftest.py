"""Quick jobs: the gripper, a planner that takes every candidate, a simulator that only answers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from gdg_plugins.simulator_sapien.simulator import SapienSimulator
from grasp_samples import make_verdict
from gripper import write_gripper

from gdg.cli.settings import configs_from
from gdg.config import JobConfig, RunConfig
from gdg.data.verdict import Verdict
from gdg.pipeline.jobs import DEFAULTS
from gdg.pipeline.pair import Pair

#: One MALA step, and thresholds that everything meets.
QUICK = (
    "planner=dfc", "planner.steps=1", "planner.batch=4", "planner.max_batches=1",
    "planner.contacts=2", "planner.max_force_closure=1000", "planner.max_distance_m=1000",
    "planner.max_penetration_m=1000", "planner.max_self_m=1000", "hand_model.surface_points=60",
)  # fmt: skip


def verdict(success: bool, protocol: str = "dro-2024-v1") -> Verdict:
    return make_verdict(
        success,
        shift_successes=(success, success, True),
        protocol=protocol,
        engine="answers 1.0",
    )


@dataclass
class Calls:
    """What was planned and simulated: (object, count) each."""

    planned: list[tuple[str, int]] = field(default_factory=list)
    simulated: list[tuple[str, int]] = field(default_factory=list)


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> Calls:
    """Counts plans, and lets every even grasp pass in place of simulating it."""
    seen, original = Calls(), Pair.plan

    def plan(self, count, generator, progress=None, **more):
        seen.planned.append((self.obj.name, count))
        return original(self, count, generator, progress, **more)

    def simulate(self, hand, obj, grasps, protocol, progress=None):
        seen.simulated.append((obj.name, len(grasps)))
        return tuple(verdict(i % 2 == 0, protocol.label) for i in range(len(grasps)))

    monkeypatch.setattr(Pair, "plan", plan)
    monkeypatch.setattr(SapienSimulator, "simulate", simulate)
    return seen


@pytest.fixture(scope="session")
def hand_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_gripper(tmp_path_factory.mktemp("hands"))


@pytest.fixture
def quick() -> tuple[str, ...]:
    """Words that make planning quick, whatever becomes of the grasps."""
    return QUICK


@pytest.fixture
def configs(hand_folder: Path) -> Callable[..., list[RunConfig]]:
    """Configs of a job for the gripper from words; ``files`` as of ``-c``."""

    def make(job: type[JobConfig], *words: str, files: tuple[Path, ...] = ()) -> list[RunConfig]:
        given = words if files else (f"hand={hand_folder}", *QUICK, *words)
        return configs_from(job, DEFAULTS, files, given)

    return make
