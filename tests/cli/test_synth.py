"""``gdg synth`` on the command line: what it prints, what ``-c`` repeats, how mistakes end."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from command_line import refused
from gripper import write_gripper

from gdg.cli.synth_display import clock, pair_line, progress_line
from gdg.pipeline.counts import ShardCounts
from gdg.pipeline.synth import PairResult, Progress

QUICK = (
    "planner.steps=1", "planner.batch=4", "planner.max_batches=1", "planner.contacts=2",
    "planner.max_force_closure=1000", "planner.max_distance_m=1000",
    "planner.max_penetration_m=1000", "planner.max_self_m=1000", "hand_model.surface_points=60",
    "max_penetration_mm=0", "workers=1", "shard=2", "n=1", "give_up_after=1",
)  # fmt: skip


@pytest.fixture(autouse=True)
def nothing_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every grasp overlaps by 2 mm, so that nothing is simulated."""

    class Overlap:
        def __init__(self, hand, obj, grasps):
            self.object_mm = 2.0 + 0.0 * grasps.poses[:, 0, 0]
            self.self_mm = 0.0 * self.object_mm

    monkeypatch.setattr("gdg.quality.exact_overlap", Overlap, raising=False)


def test_every_pair_gets_its_line_and_the_run_can_be_repeated(run, tmp_path: Path):
    hand = write_gripper(tmp_path / "a, b")
    outcome = run("synth", f'hand="{hand}"', "object=cube_small,apple", *QUICK, "out=made")
    assert outcome.code == 0, outcome.err
    for name in ("cube_small", "apple"):
        assert f"two_jaws · {name}: 0 grasps (0 new: 4 candidates" in outcome.err
    assert "no grasp passed after 1 shard, 4 candidates; mostly 'penetration'" in outcome.err
    assert outcome.out.startswith("0 grasps of 2 pairs, 0 of them new, in ")
    again = run("synth", "-c", "made/config.yaml")
    assert again.code == 0, again.err
    for name in ("cube_small", "apple"):
        assert f"two_jaws · {name}: 0 grasps: no grasp passed" in again.err
    # the user's words win
    other = run("synth", "-c", "made/config.yaml", "object=lemon")
    assert "of 1 pairs" in other.out


def test_a_disk_without_room_is_told_in_one_line(run, monkeypatch, tmp_path: Path):
    def full(descriptor: int) -> None:
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(os, "fsync", full)
    hand = write_gripper(tmp_path)
    outcome = run("synth", f"hand={hand}", "object=cube_small", *QUICK)
    refused(outcome, "runs/synth: cannot be written: the disk is full", "run the same command")


def test_an_unknown_engine_is_told(run):
    refused(run("synth", "hand=allegro", "object=mug", "engine=slurm"), "engine", "'slurm'")


def test_help_explains_the_options_of_scale(run):
    out = run("synth", "--help").out
    for word in ("engine", "workers", "ray_address", "retry", "shard_timeout_s", "give_up_after"):
        assert f"\n    {word} " in out


def test_rates_and_times_are_told():
    made = ShardCounts(400, 100, 80, 20, {"penetration": 300}, {"moved": 60}, {"plan": 3.0})
    progress = Progress(pairs=4, ended=1, grasps=50, missing=350, made=made, seconds=10.0)
    assert progress_line(progress) == (
        "2.00/s, 25 % of the tested passed, pair 1 of 4, 0:00:10 gone, 0:02:55 to go"
    )
    nothing_yet = Progress(4, 0, 0, 400, ShardCounts(), 1.0)
    assert progress_line(nothing_yet).endswith("? to go")
    assert pair_line(PairResult("allegro", "mug", 100, made, 2, "")) == (
        "allegro · mug: 100 grasps (20 new: 400 candidates, 100 planned, 80 tested, 25 % passed, "
        "3 s)"
    )
    assert clock(3661.4) == "1:01:01"
