"""A run folder holds whole, readable files, whatever ends the run."""

from __future__ import annotations

import errno
import json
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
import yaml
from gdg_plugins.simulator_sapien.simulator import SapienSimulator

from gdg.data.grasps import load_grasps
from gdg.errors import GdgError
from gdg.pipeline.grasp import Stages, run_grasp
from gdg.pipeline.jobs import GraspJob

PLAIN = ("object=cube_small", "n=3", "picture=false", "report=false")


@pytest.fixture
def config(configs, tmp_path: Path) -> Callable:
    """The one config of some words, with ``out`` in the temporary folder."""
    return lambda *words, **more: configs(
        GraspJob, *PLAIN, f"out={tmp_path / 'run'}", *words, **more
    )[0]


def test_a_run_leaves_complete_files(config, calls, tmp_path: Path, hand_folder: Path):
    run = run_grasp(config())
    assert run.folder == tmp_path / "run"
    assert sorted(path.name for path in run.folder.iterdir()) == ["config.yaml", "grasps.json"]
    stored = load_grasps(run.folder / "grasps.json")
    assert len(stored) == len(run.grasps) == 3
    assert [v.success for v in stored.verdicts] == [True, False, True]
    assert stored.targets is not None
    torch.testing.assert_close(stored.joints, run.grasps.joints, rtol=0, atol=1e-6)
    about = stored.provenance
    assert about["object_path"] == "cube_small"
    assert about["split"] in ("train", "test")
    assert len(about["hand_hash"]) == len(about["object_hash"]) > 10
    assert about["components"]["planner"]["name"] == "dfc"
    assert about["seconds"].keys() >= {"plan", "simulate"}
    assert about["rejected"]["penetration"] == 0


def test_the_config_that_is_left_gives_the_same_grasps(config, calls, configs, tmp_path: Path):
    first = run_grasp(config("seed=7"))
    stored = yaml.safe_load((first.folder / "config.yaml").read_text())
    assert stored["seed"] == 7
    assert stored["planner"]["name"] == "dfc"
    (again,) = configs(GraspJob, f"out={tmp_path / 'again'}", files=(first.folder / "config.yaml",))
    second = run_grasp(again)
    assert torch.equal(first.grasps.joints, second.grasps.joints)
    assert torch.equal(first.grasps.poses, second.grasps.poses)
    other = run_grasp(config("seed=8"))
    assert not torch.equal(first.grasps.poses, other.grasps.poses)


def test_without_simulation_there_are_no_verdicts(config, calls):
    run = run_grasp(config("simulate=false"))
    assert load_grasps(run.folder / "grasps.json").verdicts == ()
    assert calls.simulated == []


def test_no_grasp_found_is_an_empty_list_with_reasons(config, calls):
    run = run_grasp(config("planner.max_distance_m=1e-9", "picture=true", "report=true"))
    stored = load_grasps(run.folder / "grasps.json")
    assert len(stored) == 0
    assert sum(stored.provenance["rejected"].values()) == 4
    assert calls.simulated == []


def test_every_stage_is_announced(config, calls):
    names: list[str] = []

    class Recorder(Stages):
        def stage(self, name: str):
            names.append(name)
            return super().stage(name)

    run_grasp(config(), Recorder())
    assert names == ["planning", "simulating"]


def test_an_interrupt_while_simulating_keeps_the_planned_grasps(
    config, calls, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    def interrupted(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr(SapienSimulator, "simulate", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_grasp(config())
    stored = load_grasps(tmp_path / "run" / "grasps.json")
    assert len(stored) == 3
    assert stored.verdicts == ()


def test_a_full_disk_leaves_the_old_file(
    config, calls, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    run_grasp(config())
    before = (tmp_path / "run" / "grasps.json").read_text()
    original = Path.write_text

    def full(self: Path, text: str, *args, **kwargs):
        if "grasps.json" in self.name:
            original(self, text[:100], *args, **kwargs)
            raise OSError(errno.ENOSPC, "No space left on device", str(self))
        return original(self, text, *args, **kwargs)

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(OSError, match="No space left"):
        run_grasp(config("seed=1"))
    assert (tmp_path / "run" / "grasps.json").read_text() == before
    assert json.loads(before)["grasps"]
    assert not list((tmp_path / "run").glob(".*"))


def test_a_bad_protocol_is_told_before_any_work(config, calls):
    with pytest.raises(GdgError, match="Did you mean 'dro-2024'"):
        run_grasp(config("protocol=dro-2025"))
    assert calls.planned == []


def test_the_run_folder_is_named_after_hand_object_and_seed(
    configs, calls, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    monkeypatch.chdir(tmp_path)
    (config,) = configs(GraspJob, *PLAIN, "seed=5", "n=1", "simulate=false")
    assert run_grasp(config).folder == Path("runs/grasp/two_jaws-cube_small-seed5")
