"""A grid is run cell by cell, never twice, planned once for all its tests, in any process."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from gdg.data.grasps import load_grasps
from gdg.errors import GdgError
from gdg.evaluation.run import run_cells, run_eval
from gdg.evaluation.tables import tree_of
from gdg.pipeline.fingerprint import bundled_weights
from gdg.registry import get_registry

TWO = "object=cube_small,cube_medium"
ONE = "object=cube_small"


def cells_in(folder: Path) -> list[Path]:
    return sorted((folder / "cells").rglob("grasps.json"))


def test_cells_are_reported_and_rows_follow_the_settings(configs, log, tmp_path: Path):
    told: list[tuple[int, int, str]] = []
    done = run_eval(configs(TWO, "n=3", "planner.top=1,2"), lambda *words: told.append(words))
    assert done.folder == tmp_path / "out"
    hand = {"hand": "two_jaws"}
    assert [row.settings for row in done.rows] == [
        {**hand, "planner.top": "1"}, {**hand, "planner.top": "2"},
    ]  # fmt: skip
    assert [count for count, _, _ in told] == [0, 1, 2, 3, 4]
    assert {total for _, total, _ in told} == {4}
    assert "cube" in told[1][2]
    for name in ("summary.json", "summary.md", "summary.csv", "summary.png"):
        assert (done.folder / name).is_file()
    assert not (done.folder / "agreement.json").exists()


def test_grasps_are_planned_once_for_all_protocols_simulators_and_refinements(configs, log):
    grid = configs(
        ONE, "n=4", "protocol=dro-2024,gendexgrasp-2022", "refine=false,true",
        "simulator.below=0.7,0.9",
    )  # fmt: skip
    results, _ = run_cells(grid)
    lines = log()
    assert lines.count("plan two_jaws cube_small 4") == 1
    assert len(lines) == 1 + 8
    poses = [result.grasps.poses for result in results]
    assert len(poses) == 8
    assert all(torch.equal(other, poses[0]) for other in poses)
    # a protocol more tests what is there
    run_cells(configs(ONE, "n=4", "protocol=dro-2024", "simulator.below=0.5"))
    assert log() == ["test cube_small dro-2024 True"]


def test_what_shapes_the_plan_is_planned_anew(configs, log):
    for word in ("seed=0", "seed=1", "n=2", "planner.top=2"):
        run_cells(configs(ONE, "n=3", word))
        assert log()[0].startswith("plan")


def test_a_finished_cell_is_not_run_again(configs, log):
    first = configs(ONE, "n=2")
    before = run_eval(first).rows
    assert log() == ["plan two_jaws cube_small 2", "test cube_small dro-2024 True"]
    run_eval(configs(TWO, "n=2"))
    assert log() == ["plan two_jaws cube_medium 2", "test cube_medium dro-2024 True"]
    again = run_eval(first).rows
    assert [tree_of(row) for row in again] == [tree_of(row) for row in before]
    assert log() == []


def test_engine_workers_and_threads_make_no_other_cell(configs, log):
    for word in ("workers=2", "threads=2", "cell_timeout_s=100"):
        run_cells(configs(ONE, "n=2", word))
    assert len(log()) == 2


def test_two_processes_find_what_one_finds(configs, log, tmp_path: Path):
    grid = (TWO, "n=3", "seed=0,1")
    run_eval(configs(*grid))
    run_eval(configs(*grid, "workers=2", f"out={tmp_path / 'other'}"))
    assert len(log()) == 16
    ours, theirs = cells_in(tmp_path / "out"), cells_in(tmp_path / "other")
    assert [path.parent.name for path in ours] == [path.parent.name for path in theirs]
    for one, other in zip(ours, theirs, strict=True):
        a, b = load_grasps(one), load_grasps(other)
        assert torch.equal(a.poses, b.poses)
        assert a.verdicts == b.verdicts


def test_a_cell_repeats_by_its_config(configs, log, tmp_path: Path):
    from gdg.cli.settings import configs_from
    from gdg.pipeline.jobs import DEFAULTS, EvalJob

    run_cells(configs(ONE, "n=1", "planner.top=3"))
    (path,) = (tmp_path / "out" / "cells").rglob("config.yaml")
    (config,) = configs_from(EvalJob, DEFAULTS, (path,), ())
    log()
    run_cells([config])
    assert log() == []


def test_a_mistake_in_one_cell_leaves_the_others(configs, log, tmp_path: Path):
    with pytest.raises(GdgError, match="Did you mean 'cube_small'"):
        run_eval(configs("object=cube_smal,cube_medium", "n=2"))
    assert log()[0] == "plan two_jaws cube_medium 2"
    assert len(cells_in(tmp_path / "out")) == 1
    assert not (tmp_path / "out" / "summary.json").exists()


@pytest.mark.parametrize("what", ["planner.broken=mistake,''", "simulator.broken=true,false"])
def test_what_a_component_refuses_leaves_the_others(configs, log, tmp_path: Path, what: str):
    with pytest.raises(GdgError, match=r"cube_small: this (planner|simulator) gives up"):
        run_eval(configs(ONE, "n=2", what, "protocol=dro-2024,gendexgrasp-2022"))
    assert len(cells_in(tmp_path / "out")) == 2


def test_a_bug_in_one_cell_is_raised_when_the_others_are_done(configs, log, tmp_path: Path):
    with pytest.raises(ZeroDivisionError):
        run_eval(configs(ONE, "n=2", "planner.broken=bug,''"))
    assert len(cells_in(tmp_path / "out")) == 1


def test_grasps_that_are_not_finite_are_a_mistake_of_their_planner(configs, tmp_path: Path):
    with pytest.raises(GdgError, match="not finite"):
        run_eval(configs(ONE, "n=2", "planner.broken='not finite'"))
    assert not list((tmp_path / "out").rglob("grasps.json"))


def test_an_interrupted_cell_leaves_no_result(configs, tmp_path: Path):
    with pytest.raises(KeyboardInterrupt):
        run_eval(configs(ONE, "n=2", "planner.broken=interrupted"))
    assert not list((tmp_path / "out").rglob("grasps.json"))


def test_a_killed_worker_loses_only_its_cell(configs, log, tmp_path: Path):
    with pytest.raises(GdgError, match=r"two_jaws.*cube_small: .* killed 3 times"):
        run_eval(configs(ONE, "n=2", "planner.broken=killed,''", "seed=0,1", "workers=2"))
    assert len(cells_in(tmp_path / "out")) == 2


def test_empty_plans_are_not_simulated(configs, log):
    (row,) = run_eval(configs(ONE, "n=3", "planner.found=0")).rows
    assert log() == ["plan two_jaws cube_small 3"]
    assert row.failures == {"not found": 3}
    assert row.any.k == row.first.k == 0


def test_bundled_weights_that_change_make_another_cell(
    configs, log, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    package = tmp_path / "weighty"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "planner.py").write_text("from evaluation_fakes import FakePlanner\n")
    monkeypatch.syspath_prepend(tmp_path)
    components = get_registry()._components
    planner = get_registry().find("planner", "fake")
    record = replace(planner, target="weighty.planner:FakePlanner")
    components[components.index(planner)] = record
    weights = package / "fake.safetensors"
    planned = []
    for content in (b"one", b"one", b"more"):
        if not weights.exists() or weights.read_bytes() != content:
            weights.write_bytes(content)
        run_cells(configs(ONE, "n=2"))
        planned.append(len(log()))
    assert planned == [2, 0, 2]
    assert bundled_weights(record, "fake") == [weights]
    assert bundled_weights(record, "") == [weights]
    assert bundled_weights(record, "other") == bundled_weights(planner, "fake") == []


def test_the_summary_is_strict_json(configs, tmp_path: Path):
    run_eval(configs(ONE, "n=1"))

    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    (row,) = json.loads((tmp_path / "out" / "summary.json").read_text(), parse_constant=refuse)
    assert row["success"]["n"] == 1
    assert row["spread"]["joints_rad"] is None
