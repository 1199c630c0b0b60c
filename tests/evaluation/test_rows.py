"""Every number of a row against grasps whose verdicts are known."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from gdg.data.grasps import GraspSet, load_grasps
from gdg.evaluation.rows import STAGES
from gdg.evaluation.run import run_cells, run_eval
from gdg.evaluation.spread import pooled
from gdg.metrics import (
    chance_error,
    direction_coverage,
    distinct_grasps,
    joint_diversity,
    mean_interval,
    wilson_interval,
)

GRID = ("object=cube_small,cube_medium", "n=12", "seed=0,1", "planner.told=true")


@pytest.fixture
def row_and_sets(configs):
    """A row of two objects and two seeds, and the sets of grasps behind it, by object."""
    done = run_eval(configs(*GRID))
    results, _ = run_cells(configs(*GRID))
    by_object: dict[str, list[GraspSet]] = {}
    for result in results:
        by_object.setdefault(result.cell.job.object, []).append(result.grasps)
    (row,) = done.rows
    return row, by_object


def test_success_is_pooled_and_by_object(row_and_sets):
    row, by_object = row_and_sets
    passed = {name: sum(len(g.passed) for g in sets) for name, sets in by_object.items()}
    assert (row.success.k, row.success.n) == (sum(passed.values()), 48)
    assert 0 < row.success.k < 48
    assert row.success.interval == wilson_interval(row.success.k, 48)
    shares = [count / 24 for count in passed.values()]
    least = chance_error([one.success for one in row.objects])
    assert row.macro == pytest.approx((np.mean(shares), *mean_interval(shares, least)))
    assert [(one.name, one.success.k, one.success.n) for one in row.objects] == [
        (name, count, 24) for name, count in passed.items()
    ]
    assert (row.seeds, row.n) == (2, "12")


def test_trials_of_shifted_hands_are_averaged(row_and_sets):
    row, by_object = row_and_sets
    verdicts = [v for sets in by_object.values() for g in sets for v in g.verdicts]
    assert row.trials.k == pytest.approx(sum(np.mean(v.shift_successes) for v in verdicts))
    assert row.trials.share < row.success.share
    unstable = sum(len(set(v.shift_successes)) > 1 for v in verdicts)
    assert 0 < unstable < 48
    assert row.stable == pytest.approx(1 - unstable / 48)


def test_first_and_best_grasp_are_per_object_and_seed(row_and_sets):
    row, by_object = row_and_sets
    sets = [g for group in by_object.values() for g in group]
    assert (row.first.k, row.first.n) == (sum(g.verdicts[0].success for g in sets), 4)
    assert (row.any.k, row.any.n) == (sum(bool(g.passed) for g in sets), 4)
    assert row.any.k > row.first.k or row.first.k == 4


def test_diversity_is_by_object_and_pooled(row_and_sets):
    row, by_object = row_and_sets
    single = [joint_diversity(pooled(sets)) for sets in by_object.values()]
    assert row.spread.joints_rad == pytest.approx(np.mean(single))
    joints = torch.cat([g.joints[g.passed] for sets in by_object.values() for g in sets])
    assert row.spread.joints_pooled_rad == pytest.approx(joints.std(0).mean().item(), rel=1e-4)
    assert row.spread.objects == 2
    assert [one.diversity_rad for one in row.objects] == pytest.approx(single)


def test_one_grasp_per_object_has_no_diversity_by_object_but_a_pooled_one(configs):
    words = ("object=cube_small,cube_medium", "n=1", "seed=3,4", "simulator.below=9")
    (row,) = run_eval(configs(*words)).rows
    assert row.spread.joints_rad > 0  # two seeds of each object
    (row,) = run_eval(configs(*words, "seed=3")).rows
    assert math.isnan(row.spread.joints_rad)
    assert row.spread.objects == 0


def test_directions_and_distinct_grasps_are_those_of_the_metrics(row_and_sets, gripper_model):
    row, by_object = row_and_sets
    sets = [pooled(group) for group in by_object.values()]
    assert row.spread.distinct == sum(map(distinct_grasps, sets))
    assert row.spread.coverage == pytest.approx(
        np.mean([direction_coverage(gripper_model, g) for g in sets])
    )


def test_overlap_is_exact_and_of_the_grasps_as_planned(row_and_sets):
    row, by_object = row_and_sets
    depths = np.concatenate(
        [g.metrics["penetration_mm"].numpy() for group in by_object.values() for g in group]
    )
    assert row.penetration_mm == pytest.approx(
        {"median": np.median(depths), "p95": np.quantile(depths, 0.95), "max": depths.max()}
    )
    assert set(row.quality) == {"epsilon", "volume", "epsilon_all", "volume_all"}


def test_time_is_split_and_per_grasp(row_and_sets, configs):
    row, _ = row_and_sets
    assert set(row.seconds) == set(STAGES)
    assert row.seconds["generate"] == pytest.approx(0.25)
    assert row.seconds["fit"] == pytest.approx(0.5)
    assert row.seconds["plan"] > 0
    assert row.seconds["simulate"] > 0
    (row,) = run_eval(configs("object=cube_small", "n=2")).rows
    assert math.isnan(row.seconds["fit"])  # not told


def test_failures_are_counted_by_reason_with_those_not_found(configs):
    words = ("object=cube_small", "n=20", "planner.found=16", "simulator.below=0.6")
    results, _ = run_cells(configs(*words))
    (row,) = run_eval(configs(*words)).rows
    counts = Counter(v.failure for v in results[0].grasps.verdicts if v.failure)
    assert row.failures == {**counts, "not found": 4}
    assert sum(row.failures.values()) + row.success.k == 20
    assert {"moved", "lost-contact"} <= set(row.failures)
    assert row.rejected == {"too far": 2}


def test_trials_that_were_left_out_leave_their_mean_unknown(configs):
    (row,) = run_eval(configs("object=cube_small", "n=3", "simulator.early=true")).rows
    assert math.isnan(row.trials.share)
    assert row.trials.interval == (0.0, 1.0)
    assert math.isnan(row.stable)


def test_hardware_and_engine_are_told(row_and_sets):
    row, _ = row_and_sets
    assert row.engines == ("fake 1.0",)
    (machine,) = row.hardware
    for part in ("cores", "1 thread per process", "no GPU used", f"torch {torch.__version__}"):
        assert part in machine
    assert row.load > 0


def test_refinement_makes_rows_of_its_own(configs):
    rows = run_eval(configs("object=cube_small", "n=1", "refine=false,true")).rows
    assert [row.settings["refine"] for row in rows] == ["False", "True"]


def test_settings_of_the_same_file_name_are_not_pooled(configs, tmp_path: Path):
    from gripper import write_gripper

    hands = [write_gripper(tmp_path / folder) for folder in ("a", "b")]
    manifest = hands[1] / "hand.yaml"
    manifest.write_text(manifest.read_text().replace("title: ", "title: other "))
    rows = run_eval(configs(f"hand={hands[0]},{hands[1]}", "object=cube_small", "n=1")).rows
    assert len(rows) == 2
    assert rows[0].settings != rows[1].settings


def test_a_plan_that_was_measured_keeps_its_metrics_in_the_cell(configs, tmp_path: Path):
    run_cells(configs("object=cube_small", "n=2"))
    (path,) = (tmp_path / "out" / "cells").rglob("grasps.json")
    grasps = load_grasps(path)
    assert {"penetration_mm", "epsilon", "wrench_volume", "palm_z"} <= set(grasps.metrics)
    assert replace(grasps, verdicts=()).contacts is not None
