"""What a worker does beside planning and testing: it warms up, and measures nothing twice."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from evaluation_fakes import LOG, FakePlanner

import gdg.evaluation.tasks
import gdg.quality
from gdg.config import RunConfig
from gdg.data.grasps import GraspSet
from gdg.evaluation.tasks import Task, forget_pairs, run_task
from gdg.pipeline.fingerprint import plan_fingerprint

ONE = "object=cube_small"


@pytest.fixture(autouse=True)
def nothing_loaded():
    forget_pairs()
    yield
    forget_pairs()


def planned(config: RunConfig) -> GraspSet:
    key = plan_fingerprint(config, config.job.n)
    return run_task(Task(key, key, config))


@pytest.fixture
def plans(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], list[str]]:
    """Gives the plans so far; those that end in 1 are warm-ups."""
    log = tmp_path / "log.txt"
    monkeypatch.setenv(LOG, str(log))
    return lambda: log.read_text().splitlines()


def warm_ups(plans: list[str]) -> list[str]:
    return [line for line in plans if line.endswith(" 1")]


@pytest.fixture
def built(monkeypatch: pytest.MonkeyPatch) -> list[FakePlanner]:
    """The planners that were built, which is where others read their weights."""
    found, plain = [], FakePlanner.__init__

    def counted(self, *given, **used):
        plain(self, *given, **used)
        found.append(self)

    monkeypatch.setattr(FakePlanner, "__init__", counted)
    return found


def test_each_of_many_settings_is_warmed_up_once_before_its_seconds_count(
    configs, plans: Callable[[], list[str]], built: list[FakePlanner]
):
    grid = configs("object=cube_small,cube_medium", "n=3", "planner.top=1,2,3,4,5")
    for config in sorted(grid, key=lambda config: config.job.object):  # as an agenda does
        planned(config)
    assert len(plans()) == 10 + 5
    assert warm_ups(plans()) == ["plan two_jaws cube_medium 1"] * 5
    assert plans()[0].endswith(" 1")
    assert len(built) == 5


def test_settings_that_were_let_go_of_stay_warm(
    configs, plans: Callable[[], list[str]], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(gdg.evaluation.tasks, "COMPONENTS_KEPT", 1)
    for _ in range(2):
        for config in configs(ONE, "n=3", "planner.top=1,2"):
            planned(config)
    assert len(warm_ups(plans())) == 2


def test_what_only_the_test_uses_builds_and_warms_no_planner_again(
    configs, plans: Callable[[], list[str]], built: list[FakePlanner]
):
    for config in configs(ONE, "n=3", "seed=0,1", "simulator.below=0.5,0.9"):
        planned(config)
    assert len(plans()) == 4 + 1
    assert len(built) == 1


def test_each_test_has_its_own_simulator(configs):
    below = {}
    for config in configs(ONE, "n=40", "simulator.below=0.5,0.9"):
        grasps = planned(config)
        key = plan_fingerprint(config, 40)
        tested = run_task(Task("cell", key, config, grasps))
        below[config.components["simulator"].options.below] = len(tested.passed)
    assert 0 < below[0.5] < below[0.9]


def test_a_warm_up_leaves_the_grasps_as_they_are(configs):
    (config,) = configs(ONE, "n=2")
    cold, warm = planned(config), planned(config)
    assert torch.equal(cold.poses, warm.poses)
    assert torch.equal(cold.joints, warm.joints)
