"""What a worker does beside planning and testing: it warms up, and measures nothing twice."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from evaluation_fakes import LOG, FakePlanner

import gdg.quality
from gdg.config import RunConfig
from gdg.data.grasps import GraspSet
from gdg.evaluation.tasks import Task, forget_pairs, run_task
from gdg.pipeline.fingerprint import plan_fingerprint
from gdg.quality import METRICS, measure

ONE = "object=cube_small"


@pytest.fixture(autouse=True)
def nothing_loaded():
    forget_pairs()
    yield
    forget_pairs()


def planned(config: RunConfig) -> GraspSet:
    key = plan_fingerprint(config, config.job.n)
    return run_task(Task(key, key, config))


def test_components_are_warmed_up_once_for_a_hand_before_seconds_count(
    configs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    log = tmp_path / "log.txt"
    monkeypatch.setenv(LOG, str(log))
    for config in configs("object=cube_small,cube_medium", "n=3", "seed=0,1", "planner.top=1,2"):
        planned(config)
    lines = log.read_text().splitlines()
    assert len(lines) == 8 + 2
    assert [line for line in lines if line.endswith(" 1")] == ["plan two_jaws cube_small 1"] * 2
    assert lines[0].endswith(" 1")


def test_a_warm_up_leaves_the_grasps_as_they_are(configs):
    (config,) = configs(ONE, "n=2")
    cold, warm = planned(config), planned(config)
    assert torch.equal(cold.poses, warm.poses)
    assert torch.equal(cold.joints, warm.joints)


@pytest.mark.parametrize(("measures", "calls"), [(True, 0), (False, 1)])
def test_what_the_planner_has_measured_is_not_measured_again(
    configs, monkeypatch: pytest.MonkeyPatch, measures: bool, calls: int
):
    seen, plain = [], FakePlanner.plan

    def counted(*given):
        seen.append(given)
        return measure(*given)

    def measured_plan(self, hand, obj, count, *rest):
        grasps = measure(hand, obj, plain(self, hand, obj, count, *rest))
        return replace(grasps, metrics={**grasps.metrics, "epsilon": torch.full((count,), 0.5)})

    monkeypatch.setattr(gdg.quality, "measure", counted)
    if measures:
        monkeypatch.setattr(FakePlanner, "plan", measured_plan)
    (config,) = configs(ONE, "n=2")
    grasps = planned(config)
    assert len(seen) == calls
    assert set(METRICS) <= set(grasps.metrics)
    assert ((grasps.metrics["epsilon"] == 0.5).all().item()) == measures
    assert grasps.contacts is not None
