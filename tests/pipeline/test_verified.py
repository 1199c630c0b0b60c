"""Proposing until enough grasps pass the test."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import pytest
import torch
from training_samples import some_grasps

import gdg
from gdg.components import Options
from gdg.config import compose
from gdg.data.grasps import GraspSet, load_grasps
from gdg.errors import GdgError
from gdg.pipeline.grasp import run_grasp
from gdg.pipeline.jobs import DEFAULTS, GraspJob
from gdg.pipeline.verified import BATCH, Batch, for_verdicts, verified_grasps
from gdg.registry import get_registry
from gdg.report.table import summary_line

PLAIN = ("object=cube_small", "picture=false", "report=false", "verified=true")


@pytest.fixture
def config(configs, tmp_path: Path) -> Callable:
    """The one config of some words, with ``out`` in the temporary folder."""
    return lambda *words: configs(GraspJob, *PLAIN, f"out={tmp_path / 'run'}", *words)[0]


def test_it_goes_on_until_n_have_passed_and_gives_these_alone(config, calls, tmp_path: Path):
    run = run_grasp(config("n=5", "workers=1"))  # of a batch of four two pass
    assert [count for _, count in calls.planned] == [BATCH] * 3
    stored = load_grasps(tmp_path / "run" / "grasps.json")
    assert len(stored) == len(run.grasps) == 5
    assert all(verdict.success for verdict in stored.verdicts)
    told = stored.provenance["yield"]
    assert (told["proposed"], told["tested"], told["passed"]) == (12, 12, 6)
    assert sum(told["failed"].values()) == 6
    assert "6/12 proposed grasps passed" in summary_line(run.grasps)


def test_python_code_gets_them_too(hand_folder: Path, quick: tuple[str, ...], calls):
    hand = str(hand_folder)
    grasps = gdg.grasp(hand, "cube_small", 3, settings=quick, verified=True, workers=1)
    assert [verdict.success for verdict in grasps.verdicts] == [True] * 3
    with pytest.raises(GdgError, match="needs the simulation"):
        gdg.grasp(hand, "cube_small", 3, settings=quick, verified=True, simulate=False)


def test_what_passed_before_an_interruption_is_kept(config, calls, tmp_path: Path):
    def stop(grasps: GraspSet) -> None:
        grasps.save(tmp_path / "grasps.json")
        if len(grasps) >= 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        verified_grasps(config("n=9", "workers=1"), stop)
    assert len(load_grasps(tmp_path / "grasps.json")) == 4


def test_it_gives_up_and_says_what_the_proposals_failed_by(config):
    run = run_grasp(config("n=3", "most_proposed=1", "protocol=gdg-realistic-1"))
    told = run.grasps.provenance["yield"]
    assert told["proposed"] == BATCH
    assert told["passed"] == len(run.grasps) < 3
    assert sum(told["failed"].values()) == told["tested"] - told["passed"] > 0


def test_what_components_set_for_verified_grasps_is_set_unless_told_otherwise(config):
    class Counted(Options):
        for_verified = MappingProxyType({"trials": 3, "rounds": 1})
        trials: int = 5
        rounds: int = 2

    choice = config().components["simulator"]
    record = replace(choice.record, options=Counted)

    def of(options: Options) -> Options:
        changed = choice.model_copy(update={"options": options, "record": record})
        given = config()
        components = {**given.components, "simulator": changed}
        given = given.model_copy(update={"components": components})
        return for_verdicts(given).components["simulator"].options

    assert of(Counted()) == Counted(trials=3, rounds=1)
    assert of(Counted(trials=5)) == Counted(trials=5, rounds=1)


def test_trials_that_cannot_change_the_verdict_are_left_out_unless_asked_for(config):
    assert for_verdicts(config()).components["simulator"].options.trials == "decisive"
    told = for_verdicts(config("simulator.trials=all"))
    assert told.components["simulator"].options.trials == "all"


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("planner", {"maps": 1.0}),
        ("simulator", {"trials": "decisive"}),
    ],
)
def test_the_usual_components_propose_more_in_the_same_time(key: str, values: dict[str, object]):
    (usual,) = compose(GraspJob, get_registry(), DEFAULTS, (), ["hand=barrett", "object=apple"])
    before, after = (
        one.components[key].options.model_dump() for one in (usual, for_verdicts(usual))
    )
    assert {name: after[name] for name in values} == values
    assert {name for name in after if after[name] != before[name]} == set(values)


def test_workers_change_nothing_but_the_time(config):
    alone = verified_grasps(config("n=8", "most_proposed=1", "workers=1"))
    shared = verified_grasps(config("n=8", "most_proposed=1", "workers=2"))
    assert shared.provenance["yield"] == alone.provenance["yield"]
    assert shared.provenance["yield"]["proposed"] == 8
    torch.testing.assert_close(shared.poses, alone.poses, rtol=0, atol=0)


def test_batches_differ_and_the_first_has_the_seed_of_the_run(config):
    seeds = [Batch(number, config("seed=3")).seed for number in range(5)]
    assert seeds[0] == 3
    assert len(set(seeds)) == 5


def test_there_is_nothing_to_verify_without_a_test(config):
    with pytest.raises(GdgError, match="needs the simulation"):
        config("simulate=false")


def test_sets_are_joined_as_far_as_they_agree():
    one, other = some_grasps("barrett", "lemon", 3), some_grasps("barrett", "lemon", 2)
    joined = GraspSet.joined([one, one.select([]), other])
    assert len(joined) == 5
    torch.testing.assert_close(joined.select([3, 4]).joints, other.joints)
    assert joined.verdicts == one.verdicts + other.verdicts
    assert set(joined.energies) == set(one.energies)
    assert len(GraspSet.joined([one.select([])])) == 0
