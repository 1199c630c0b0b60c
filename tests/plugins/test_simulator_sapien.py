"""How verdicts are judged, and decided early, in PhysX; ``test_simulators`` has the controls."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
import torch
from gdg_plugins.simulator_sapien.options import SapienOptions
from gdg_plugins.simulator_sapien.simulator import SapienSimulator
from jaws import grasp_of, protocol_of, verdict_of

from gdg.data.grasps import GraspSet
from gdg.data.verdict import Verdict
from gdg.errors import GdgError
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.protocols import Shifts
from gdg.simulation.judgement import Push
from gdg.simulation.simulator import _decided, _Facts, _verdict
from gdg.simulation.trial import Trial, _is_over
from gdg.testing import check_component

PRESETS = ("dro-2024", "gendexgrasp-2022")


def test_starting_penetration_is_the_jaws_depth(gripper_model: HandModel, cube: ObjectModel):
    verdict = verdict_of(gripper_model, cube, grasp_of(cube, gap=-0.003), protocol_of("dro-2024"))
    assert verdict.penetration_start_mm == pytest.approx(3.0, abs=0.1)


# -- judgement ---------------------------------------------------------------------------------


def test_overlap_that_remains_fails(gripper_model: HandModel, cube: ObjectModel):
    start = {"settle_steps": 1, "max_penetration_m": 0.002, "max_depenetration_velocity": 0.001}
    verdict = verdict_of(
        gripper_model,
        cube,
        grasp_of(cube, gap=-0.01, squeeze=None),
        protocol_of("dro-2024", start=start),
    )
    assert verdict.failure == "penetrating"
    assert verdict.penetration_end_mm > 2.0


def test_without_targets_the_verdict_says_unrefined(gripper_model: HandModel, cube: ObjectModel):
    protocol = protocol_of("dro-2024")
    grasps = grasp_of(cube, gap=-0.0005, squeeze=None)
    verdict = verdict_of(gripper_model, cube, grasps, protocol)
    assert not verdict.refined
    assert verdict_of(gripper_model, cube, grasp_of(cube), protocol).refined
    assert verdict.protocol == "dro-2024-v1"
    assert verdict.engine.startswith("sapien 3")
    assert verdict.seconds > 0


def test_other_joints_are_refused(gripper_model: HandModel, cube: ObjectModel):
    grasps = replace(grasp_of(cube), joint_names=("open",))
    with pytest.raises(GdgError, match="close"):
        verdict_of(gripper_model, cube, grasps, protocol_of("dro-2024"))


def test_progress_counts_grasps_and_none_is_no_work(gripper_model: HandModel, cube: ObjectModel):
    calls: list[tuple[int, int]] = []
    grasps = grasp_of(cube).select([0, 0, 0])
    simulator = SapienSimulator(SapienOptions())
    protocol = protocol_of("gendexgrasp-2022")
    simulator.simulate(gripper_model, cube, grasps, protocol, lambda *call: calls.append(call))
    assert calls == [(1, 3), (2, 3), (3, 3)]
    assert simulator.simulate(gripper_model, cube, grasps.select([]), protocol) == ()


# -- early decisions ---------------------------------------------------------------------------


def mixed_grasps(obj: ObjectModel) -> GraspSet:
    """Sixteen grasps, some firm, some weak, by a corner, turned, overlapping, or not there."""
    generator = np.random.default_rng(0)
    sets = [grasp_of(obj, shift=1.0), grasp_of(obj, gap=0.01, squeeze=0.0)]
    sets[1].poses[0, 2, 3] = -0.005  # the palm throws the object out
    for _ in range(14):
        gap, squeeze = generator.uniform(-0.003, 0.001), generator.uniform(0.0003, 0.002)
        grasp = grasp_of(obj, gap, squeeze, shift=generator.uniform(0.0, 0.026))
        turn = np.eye(4)
        angle = generator.uniform(-0.3, 0.3)
        turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        sets.append(replace(grasp, poses=torch.tensor(turn, dtype=torch.float32) @ grasp.poses))
    targets = [grasp.targets for grasp in sets if grasp.targets is not None]
    return replace(
        sets[0],
        poses=torch.cat([grasp.poses for grasp in sets]),
        joints=torch.cat([grasp.joints for grasp in sets]),
        targets=torch.cat(targets),
    )


def assert_same_judgement(decisive: Verdict, full: Verdict) -> None:
    assert (decisive.success, decisive.failure) == (full.success, full.failure)
    ran = len(decisive.shift_successes)
    assert decisive.shift_successes == full.shift_successes[:ran]
    assert decisive.trials == full.trials == len(full.shift_successes)
    measured = [value for value in decisive.displacement_m if not np.isnan(value)]
    assert measured == list(full.displacement_m[: len(measured)])
    assert len(measured) == 6 or not decisive.success


#: Sections of the success criterion under which what ends a trial early differs.
CRITERIA = {
    "in-total": {"measured": "total"},
    "per-push": {"measured": "per-push"},
    "per-push-without-contact": {"measured": "per-push", "contact": False},
    "rotation": {"measured": "per-push", "max_rotation_rad": 0.1},
}


@pytest.mark.parametrize(
    ("criterion", "order"),
    [*((name, "sequential") for name in CRITERIA), ("per-push", "reset")],
)
@pytest.mark.parametrize("preset", PRESETS)
def test_decisive_trials_judge_as_all_trials_do(
    preset: str, criterion: str, order: str, gripper_model: HandModel, cube: ObjectModel
):
    acceleration = {"dro-2024": 3.0, "gendexgrasp-2022": 0.9}[preset]
    protocol = protocol_of(
        preset, friction=0.2, success=CRITERIA[criterion],
        pushes={"order": order, "acceleration": acceleration},
    )  # fmt: skip
    # shifts so wide that trials of one grasp differ
    protocol = protocol.model_copy(update={"shifts": Shifts(count=4, distance_m=0.004)})
    grasps = mixed_grasps(cube)
    full, decisive = (
        SapienSimulator(SapienOptions(trials=trials)).simulate(
            gripper_model, cube, grasps, protocol
        )
        for trials in ("all", "decisive")
    )
    for early, late in zip(decisive, full, strict=True):
        assert_same_judgement(early, late)
    assert {verdict.success for verdict in full} == {True, False}
    assert any(len(set(verdict.shift_successes)) == 2 for verdict in full)
    assert all(verdict.stable is not None for verdict in full)


#: What of a protocol is made harder, so that trials of one grasp differ.
HARDER = {
    "gdg-realistic-1": {"friction": 0.15, "pushes": {"steps": 60}, "lift": {"steps": 80}},
    "graspqp-2025": {"friction": 0.1, "start": {"settle_steps": 40}, "body": {"mass_kg": 0.1}},
    "multigrippergrasp-2024": {"friction": 0.1, "pushes": {"steps": 100, "directions": ["+x"]}},
}


@pytest.mark.parametrize("preset", HARDER)
def test_decisive_trials_judge_lifts_shares_and_directions_as_all_trials_do(
    preset: str, gripper_model: HandModel, cube: ObjectModel
):
    protocol = protocol_of(preset, **HARDER[preset])
    protocol = protocol.model_copy(update={"shifts": Shifts(count=4, distance_m=0.004)})
    grasps = mixed_grasps(cube)
    full, decisive = (
        SapienSimulator(SapienOptions(trials=trials)).simulate(
            gripper_model, cube, grasps, protocol
        )
        for trials in ("all", "decisive")
    )
    for early, late in zip(decisive, full, strict=True):
        assert (early.success, early.failure) == (late.success, late.failure)
        ran = len(early.shift_successes)
        assert early.shift_successes == late.shift_successes[:ran]
        assert early.trials == late.trials == len(late.shift_successes) == 5
    assert {verdict.success for verdict in full} == {True, False}
    if preset == "gdg-realistic-1":
        assert "penetrating" in {verdict.failure for verdict in full}


def test_decisive_stops_at_three_of_five_and_leaves_stability_open(
    gripper_model: HandModel, cube: ObjectModel
):
    protocol = protocol_of("dro-2024", shifts=4)
    verdict = verdict_of(gripper_model, cube, grasp_of(cube), protocol, trials="decisive")
    assert verdict.shift_successes == (True,) * 3
    assert (verdict.success, verdict.trials, verdict.stable) == (True, 5, None)
    absent = verdict_of(gripper_model, cube, grasp_of(cube, shift=1.0), protocol, trials="decisive")
    assert absent.shift_successes == (False,) * 3
    assert (absent.success, absent.failure, absent.stable) == (False, "lost-contact", None)


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_a_majority_is_more_than_half_of_the_trials_asked_for(count: int):
    total = 1 + count
    for outcomes in itertools.product([True, False], repeat=total):
        trials = [trial_that(passed) for passed in outcomes]
        ran = next(n for n in range(1, total + 1) if _decided(trials[:n], total))
        protocol = protocol_of("dro-2024", shifts=count)
        facts = _Facts(protocol, 0.1, True, "an engine", ())
        early, late = (_verdict(some, facts, 0.0, 0.0) for some in (trials[:ran], trials))
        assert early.success == late.success == (2 * sum(outcomes) > total)
        assert early.failure == late.failure


def trial_that(passed: bool) -> Trial:
    nothing = (0.0,) * 6
    return Trial("" if passed else "moved", nothing, nothing, 0.0, (True,) * 6, 0.0, False)


def test_decisive_trials_pass_the_conformance_kit():
    assert check_component("simulator", "sapien", trials="decisive") == []


#: Far beyond any preset's limit in displacement, metres.
FAR_M = 0.5


def test_a_trial_is_over_only_where_its_failure_is_certain():
    per_push = protocol_of("dro-2024", success={"measured": "per-push"})
    still, moved, lost = Push(0.0, 0.0, True), Push(FAR_M, 0.0, True), Push(FAR_M, 0.0, False)
    assert not _is_over(per_push, [still, moved, lost], "end")
    assert not _is_over(per_push, [still], "failed")
    # a later push may still lose contact, which is what a trial fails by in the first place
    assert not _is_over(per_push, [moved], "named")
    assert _is_over(per_push, [moved], "failed")
    assert _is_over(per_push, [moved, lost], "named")


def test_without_a_contact_criterion_the_first_displacement_ends_a_trial():
    success = {"measured": "per-push", "contact": False}
    assert _is_over(protocol_of("dro-2024", success=success), [Push(FAR_M, 0.0, False)], "named")


def test_displacement_in_total_is_judged_after_the_last_push_alone():
    total = protocol_of("dro-2024")
    moved = Push(FAR_M, 0.0, True)
    assert not _is_over(total, [moved] * 5, "failed")
    assert _is_over(total, [moved] * 6, "failed")
    assert _is_over(total, [Push(0.0, 0.0, False)], "named")
