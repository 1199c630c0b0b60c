"""A trial settles, pushes and lifts as its protocol says, and names what it fails by."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jaws import protocol_of
from point_world import PointWorld

from gdg.data.table import Table
from gdg.errors import GdgError
from gdg.protocols import SIX, Protocol
from gdg.scenes.place import check_protocol
from gdg.simulation.lift import direction_vector
from gdg.simulation.trial import TrialStart, Until, free_displacement, run_trial

START = TrialStart(np.eye(4), np.zeros(1), np.zeros(1))
REALISTIC = protocol_of("gdg-realistic-1", timestep_ms=10.0)
TABLETOP = protocol_of("tabletop-lift", timestep_ms=10.0)
TABLE = Table((0.0, 0.0, 1.0), -0.02)


def way(direction: str) -> tuple[int, ...]:
    return tuple(int(value) for value in direction_vector(direction))  # pyright: ignore


def failure_of(world: PointWorld, protocol: Protocol, until: Until = "end") -> str:
    return run_trial(world, protocol, START, until).failure


def test_a_grip_that_holds_passes_pushes_and_lift():
    trial = run_trial(PointWorld(), REALISTIC, START)
    assert trial.failure == ""
    assert trial.displacement == (0.0,) * 6
    assert (trial.lifted.displacement, trial.lifted.held) == (0.0, True)


def test_weight_that_only_the_lift_brings_drops_the_object():
    # holds pushes of 2.5 m/s², not 9.81 and what the rise adds
    world = PointWorld(default_grip=5.0)
    trial = run_trial(world, REALISTIC, START)
    assert trial.failure == "dropped"
    assert trial.contact_kept == (True,) * 6
    assert not trial.lifted.held
    assert trial.lifted.displacement > 1.0


def test_a_grip_that_just_holds_the_weight_lets_go_in_the_rise():
    assert failure_of(PointWorld(default_grip=9.81), REALISTIC) == "dropped"
    held = protocol_of("gdg-realistic-1", lift={"height_m": 0.0})
    assert failure_of(PointWorld(default_grip=9.81), held) == ""


def test_a_failed_push_names_the_failure_and_saves_the_lift():
    world = PointWorld(grip={way("+y"): 1.0})
    full = run_trial(world, REALISTIC, START)
    assert full.failure == "lost-contact"
    assert full.contact_kept == (True, True, False, True, True, True)
    assert full.lifted.held
    early = run_trial(PointWorld(grip={way("+y"): 1.0}), REALISTIC, START, "named")
    assert early.failure == "lost-contact"
    assert np.isnan(early.lifted.displacement)
    assert np.isnan(early.displacement[3:]).all()


def test_drift_is_judged_before_anything_is_pushed():
    trial = run_trial(PointWorld(drift=0.03), REALISTIC, START, "named")
    assert (trial.failure, trial.drift) == ("drifted", 0.03)
    assert np.isnan(trial.displacement).all()


def test_a_failure_before_the_trial_is_its_name():
    trial = run_trial(PointWorld(drift=0.03), REALISTIC, START, "end", failure="penetrating")
    assert trial.failure == "penetrating"
    assert trial.displacement == (0.0,) * 6


@pytest.mark.parametrize(("degrees", "failure"), [(14.0, ""), (16.0, "rotated"), (350.0, "")])
def test_an_object_that_a_push_turns_too_far_is_rotated(degrees: float, failure: str):
    world = PointWorld(turn={way("+x"): math.radians(degrees)})
    trial = run_trial(world, REALISTIC, START)
    assert trial.failure == failure
    turned = min(degrees, 360 - degrees)
    assert trial.rotation == pytest.approx((math.radians(turned), 0, 0, 0, 0, 0), abs=1e-9)


@pytest.mark.parametrize(("degrees", "failure"), [(14.0, ""), (16.0, "tilted")])
def test_an_object_that_the_lift_turns_too_far_is_tilted(degrees: float, failure: str):
    protocol = protocol_of("gdg-realistic-1", pushes={"directions": ["+x"]}, timestep_ms=10.0)
    trial = run_trial(PointWorld(turn={way("-z"): math.radians(degrees)}), protocol, START)
    assert trial.failure == failure
    assert trial.lifted.rotation == pytest.approx(math.radians(degrees))
    assert trial.rotation[0] == 0.0


def test_what_moves_too_far_and_turns_is_dropped():
    world = PointWorld(default_grip=5.0, turn={way("-z"): 1.0})
    protocol = protocol_of("gdg-realistic-1", pushes={"directions": ["+x"]}, timestep_ms=10.0)
    assert failure_of(world, protocol) == "dropped"


def test_only_the_directions_of_the_protocol_are_pushed():
    pushes = {"directions": ["+z", "-x"], "order": "reset"}
    protocol = protocol_of("dro-2024", pushes=pushes, success={"measured": "per-push"})
    trial = run_trial(PointWorld(grip={way("+y"): 0.0}), protocol, START)
    assert trial.failure == ""
    assert [not np.isnan(value) for value in trial.displacement] == [0, 1, 0, 0, 1, 0]
    assert trial.contact_kept == (False, True, False, False, True, False)


def test_a_rest_without_force_comes_before_judgement():
    log = PointWorld()
    protocol = protocol_of("graspqp-2025")
    run_trial(log, protocol, START)
    pushes = [line for line in log.log if line.startswith("step")][1:]
    assert pushes == ["step 60", "step 30"] * 6


@pytest.mark.parametrize(("loose", "passes"), [(0, True), (3, True), (4, False), (6, False)])
def test_a_grasp_passes_if_the_share_of_its_pushes_does(loose: int, passes: bool):
    grip = {way(direction): 1.0 for direction in SIX[:loose]}
    assert (failure_of(PointWorld(grip=grip), protocol_of("graspqp-2025")) == "") == passes


@given(
    loose=st.lists(st.booleans(), min_size=6, max_size=6),
    share=st.sampled_from([0.3, 0.5, 0.9, 1.0]),
    contact=st.booleans(),
    until=st.sampled_from(["named", "failed"]),
)
def test_trials_that_stop_early_judge_as_full_ones(
    loose: list[bool], share: float, contact: bool, until: Until
):
    grip = {way(d): 1.0 for d, gone in zip(SIX, loose, strict=True) if gone}
    success = {"measured": "per-push", "contact": contact, "share": share}
    protocol = protocol_of("gdg-realistic-1", success=success, timestep_ms=10.0)
    full = failure_of(PointWorld(grip=grip), protocol)
    early = failure_of(PointWorld(grip=grip), protocol, until)
    assert bool(full) == bool(early)
    assert until == "failed" or full == early


def test_the_object_on_a_table_feels_its_weight_while_the_hand_closes():
    world = PointWorld(grip={(0, 0, -1): 12.0})
    trial = run_trial(world, TABLETOP, START, table=TABLE)
    assert trial.failure == ""
    assert world.lowered == pytest.approx(0.1)
    # weight acts from the first step on
    assert run_trial(PointWorld(default_grip=9.0), TABLETOP, START, table=TABLE).drift > 0.1


def test_an_object_that_still_lies_on_the_table_was_not_lifted():
    world = PointWorld(on_the_table=True)
    assert run_trial(world, TABLETOP, START, table=TABLE).failure == "dropped"


def test_free_displacement_without_pushes_is_that_of_the_lift():
    fall = free_displacement(PointWorld(), REALISTIC.model_copy(update={"pushes": None}))
    seconds = REALISTIC.lift.steps * 0.01
    # in the hand's frame the object falls and the hand rises by 10 cm
    assert fall == pytest.approx(9.81 / 2 * seconds**2 + 0.1, rel=0.01)


def test_a_table_without_its_protocol_is_refused_and_the_other_way_round():
    with pytest.raises(GdgError, match="scene=tabletop"):
        check_protocol(TABLETOP, on_table=False)
    with pytest.raises(GdgError, match="protocol=tabletop-lift"):
        check_protocol(REALISTIC, on_table=True)
    check_protocol(TABLETOP, on_table=True)
    check_protocol(REALISTIC, on_table=False)
