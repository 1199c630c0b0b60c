"""A grid is run cell by cell, never twice, and summed up by the metrics of gdg."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
import torch

from gdg.data.grasps import load_grasps
from gdg.errors import GdgError
from gdg.metrics import joint_diversity, wilson_interval
from gdg.pipeline.evaluate import COLUMNS, cells, markdown, run_eval
from gdg.pipeline.jobs import EvalJob


def test_a_grid_is_summed_up(configs, calls, tmp_path: Path):
    grid = configs(
        EvalJob, "object=cube_small,cube_medium", "n=3", "planner.steps=1,2", f"out={tmp_path}"
    )
    reported: list[tuple[int, int, str]] = []
    rows, folder = run_eval(grid, lambda *words: reported.append(words))
    assert folder == tmp_path
    assert [row.settings for row in rows] == [
        {"hand": "two_jaws", "planner.steps": steps} for steps in ("1", "2")
    ]
    for row in rows:
        assert (row.objects, row.n, row.successes) == (2, 6, 4)
        assert row.interval == wilson_interval(4, 6)
        assert row.failures == {"drifted": 2}
        assert row.stable == pytest.approx(4 / 6)
        assert row.penetration_mm == 1.5
        assert row.protocol == "dro-2024-v1"
        assert row.diversity_rad > 0
        assert row.seconds["plan"] > 0
    assert [done for done, _, _ in reported] == [0, 1, 2, 3, 4]
    assert {total for _, total, _ in reported} == {4}
    assert "cube_small" in reported[1][2]


def test_diversity_is_over_the_passing_grasps_of_all_objects(configs, calls, tmp_path: Path):
    grid = configs(EvalJob, "object=cube_small,cube_medium", "n=3", f"out={tmp_path}")
    (row,), _ = run_eval(grid)
    sets = [load_grasps(path) for path in sorted(tmp_path.rglob("grasps.json"))]
    joints = torch.cat([grasps.joints[grasps.passed] for grasps in sets])
    assert row.diversity_rad == pytest.approx(joints.std(0).mean().item(), rel=1e-4)
    (alone,), _ = run_eval(configs(EvalJob, "object=cube_small", "n=3", f"out={tmp_path}"))
    (cube,) = [grasps for grasps in sets if grasps.object_name == "cube_small"]
    assert alone.diversity_rad == pytest.approx(joint_diversity(cube))


def test_seeds_are_pooled(configs, calls, tmp_path: Path):
    (row,), _ = run_eval(
        configs(EvalJob, "object=cube_small", "n=2", "seed=0,1,2", f"out={tmp_path}")
    )
    assert (row.n, row.objects) == (6, 1)


def test_a_finished_cell_is_not_run_again(configs, calls, tmp_path: Path):
    first = configs(EvalJob, "object=cube_small", "n=2", f"out={tmp_path}")
    before, _ = run_eval(first)
    wider = configs(EvalJob, "object=cube_small,cube_medium", "n=2", f"out={tmp_path}")
    run_eval(wider)
    assert calls.planned == [("cube_small", 2), ("cube_medium", 2)]
    assert run_eval(first)[0] == before
    assert len(calls.planned) == 2
    # any other setting is another cell
    run_eval(configs(EvalJob, "object=cube_small", "n=2", "seed=1", f"out={tmp_path}"))
    assert len(calls.planned) == 3


def test_the_number_of_workers_does_not_make_another_cell(configs, calls, tmp_path: Path):
    for workers in (1, 2):
        run_eval(
            configs(EvalJob, "object=cube_small", "n=1", f"workers={workers}", f"out={tmp_path}")
        )
    assert len(calls.planned) == 1


def test_a_mistake_in_one_cell_leaves_the_others(configs, calls, tmp_path: Path):
    grid = configs(EvalJob, "object=cube_smal,cube_medium", "n=2", f"out={tmp_path}")
    with pytest.raises(GdgError, match="Did you mean 'cube_small'"):
        run_eval(grid)
    assert calls.planned == [("cube_medium", 2)]
    assert len(list(tmp_path.rglob("grasps.json"))) == 1
    assert not (tmp_path / "summary.json").exists()
    # mended, only what is missing runs
    run_eval(configs(EvalJob, "object=cube_small,cube_medium", "n=2", f"out={tmp_path}"))
    assert calls.planned == [("cube_medium", 2), ("cube_small", 2)]


def test_an_interrupted_cell_leaves_no_result(
    configs, calls, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    from gdg_plugins.simulator_sapien.simulator import SapienSimulator

    def interrupted(*args, **kwargs):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(SapienSimulator, "simulate", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run_eval(configs(EvalJob, "object=cube_small", "n=2", f"out={tmp_path}"))
    assert not list(tmp_path.rglob("grasps.json"))
    (row,), _ = run_eval(configs(EvalJob, "object=cube_small", "n=2", f"out={tmp_path}"))
    assert row.n == 2


def test_grasps_that_were_not_found_count_as_failures(configs, calls, tmp_path: Path):
    grid = configs(EvalJob, "object=cube_small", "planner.max_distance_m=1e-9", f"out={tmp_path}")
    (row,), _ = run_eval(grid)
    assert (row.n, row.successes, row.failures) == (8, 0, {"not found": 8})
    assert math.isnan(row.diversity_rad)


def test_the_summary_is_strict_json(configs, calls, tmp_path: Path):
    # one passing grasp has no diversity
    rows, _ = run_eval(configs(EvalJob, "object=cube_small", "n=1", f"out={tmp_path}"))
    assert math.isnan(rows[0].diversity_rad)

    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    tree = json.loads((tmp_path / "summary.json").read_text(), parse_constant=refuse)
    assert tree[0]["n"] == 1
    assert tree[0]["diversity_rad"] is None
    text = (tmp_path / "summary.md").read_text()
    assert text == markdown(rows)
    assert len({line.count("|") for line in text.splitlines()}) == 1
    assert len(cells(rows[0])) == len(rows[0].settings) + len(COLUMNS)


def test_settings_of_the_same_file_name_are_not_pooled(configs, calls, tmp_path: Path):
    from gripper import write_gripper

    hands = [write_gripper(tmp_path / folder) for folder in ("a", "b")]
    manifest = hands[1] / "hand.yaml"
    manifest.write_text(manifest.read_text().replace("title: ", "title: other "))
    grid = configs(
        EvalJob,
        f"hand={hands[0]},{hands[1]}",
        "object=cube_small",
        "n=1",
        f"out={tmp_path / 'out'}",
    )
    rows, _ = run_eval(grid)
    assert len(rows) == 2
    assert rows[0].settings != rows[1].settings
