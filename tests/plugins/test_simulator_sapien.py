"""Control tests of the SAPIEN simulator: what must pass passes, what must fail fails."""

from __future__ import annotations

import itertools
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from gdg_plugins.simulator_sapien.options import SapienOptions
from gdg_plugins.simulator_sapien.scene import GraspScene
from gdg_plugins.simulator_sapien.simulator import SapienSimulator
from jaws import Welded, grasp_of, protocol_of, verdict_of
from real_hands import HANDS as REAL_HANDS

from gdg.data.grasps import GraspSet
from gdg.data.verdict import DIRECTIONS, Verdict
from gdg.errors import GdgError
from gdg.hands.hand import Hand, load_hand
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel, find_object, load_object
from gdg.protocols import Protocol, Shifts
from gdg.registry import get_registry
from gdg.rotations import random_rotations
from gdg.simulation.judgement import Push
from gdg.simulation.simulator import _decided, _Facts, _verdict
from gdg.simulation.trial import Start, Trial, _is_over, run_trial
from gdg.testing import check_component

BUNDLED = Path(__file__).resolve().parents[2] / "hands"
PRESETS = ("dro-2024", "gendexgrasp-2022")


def model_of(hand: Hand) -> HandModel:
    record = get_registry().find("hand-model", "pytorch-kinematics")
    return record.load()(record.options(surface_points=200), hand, torch.device("cpu"))


# -- controls ----------------------------------------------------------------------------------


@pytest.mark.parametrize("preset", PRESETS)
def test_firm_grasp_passes(preset: str, gripper_model: HandModel, cube: ObjectModel):
    verdict = verdict_of(gripper_model, cube, grasp_of(cube), protocol_of(preset, shifts=4))
    assert verdict.success
    assert verdict.failure == ""
    assert verdict.shift_successes == (True,) * 5
    assert verdict.contact_kept == (True,) * 6
    assert max(verdict.displacement_m) < 0.001
    assert max(verdict.rotation_rad) < 0.01
    assert verdict.penetration_end_mm < 0.5


@pytest.mark.parametrize("preset", PRESETS)
def test_absent_hand_fails_in_all_six_directions(
    preset: str, gripper_model: HandModel, cube: ObjectModel
):
    protocol = protocol_of(preset, pushes={"order": "reset"}, success={"measured": "per-push"})
    verdict = verdict_of(gripper_model, cube, grasp_of(cube, shift=1.0), protocol)
    assert not verdict.success
    assert verdict.contact_kept == (False,) * 6
    assert verdict.displacement_m == pytest.approx((verdict.free_displacement_m,) * 6, rel=1e-3)
    assert min(verdict.displacement_m) > protocol.success.max_displacement_m


@pytest.mark.parametrize("preset", PRESETS)
def test_jaws_one_centimetre_away_fail(preset: str, gripper_model: HandModel, cube: ObjectModel):
    verdict = verdict_of(gripper_model, cube, grasp_of(cube, gap=0.01), protocol_of(preset))
    assert not verdict.success
    assert verdict.failure == "lost-contact"


@pytest.mark.parametrize("preset", PRESETS)
def test_welded_object_passes(preset: str, gripper_model: HandModel, cube: ObjectModel):
    grasps = grasp_of(cube, squeeze=0.0005)
    (verdict,) = Welded(SapienOptions()).simulate(gripper_model, cube, grasps, protocol_of(preset))
    assert verdict.success
    assert max(verdict.displacement_m) < 1e-6
    assert verdict.free_displacement_m < 1e-6


@pytest.mark.parametrize("preset", PRESETS)
def test_object_ejected_by_initial_penetration_fails(
    preset: str, gripper_model: HandModel, cube: ObjectModel
):
    grasps = grasp_of(cube, gap=0.01, squeeze=None)
    grasps.poses[0, 2, 3] = -0.005  # the palm is 15 mm inside
    verdict = verdict_of(gripper_model, cube, grasps, protocol_of(preset))
    assert not verdict.success
    assert verdict.failure in {"penetrating", "drifted", "moved", "lost-contact"}
    assert verdict.penetration_start_mm == pytest.approx(15.0, abs=1.0)
    assert verdict.drift_m > 0.01


def test_verdict_turns_with_the_world(gripper_model: HandModel, tmp_path: Path):
    protocol = protocol_of(
        "dro-2024", friction=0.2, pushes={"order": "reset", "acceleration": 3.0},
        success={"measured": "per-push"},
    )  # fmt: skip
    box = find_object("foam_brick")
    quarter = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    path = tmp_path / "turned.stl"
    box.mesh.copy().apply_transform(quarter).export(path)
    grasps = grasp_of(box)
    turned = replace(grasps, poses=torch.tensor(quarter, dtype=torch.float32) @ grasps.poses)
    before = verdict_of(gripper_model, box, grasps, protocol)
    after = verdict_of(gripper_model, load_object(path, "turned"), turned, protocol)
    # a push along +x becomes one along +y, one along +y becomes one along -x
    image = [DIRECTIONS.index(name) for name in ("+y", "-y", "-x", "+x", "+z", "-z")]
    assert after.success == before.success
    assert [after.displacement_m[i] for i in image] == pytest.approx(
        before.displacement_m, abs=2e-4
    )
    assert after.drift_m == pytest.approx(before.drift_m, abs=2e-4)


# -- figures -----------------------------------------------------------------------------------


@pytest.mark.parametrize("preset", PRESETS)
def test_free_displacement_is_that_of_the_equations_of_motion(
    preset: str, gripper_model: HandModel, cube: ObjectModel
):
    protocol = protocol_of(preset)
    verdict = verdict_of(gripper_model, cube, grasp_of(cube), protocol)
    dt, speed, way = protocol.timestep_ms / 1000, 0.0, 0.0
    for _ in range(protocol.pushes.steps):
        speed = (speed + protocol.pushes.acceleration * dt) * (
            1 - protocol.body.linear_damping * dt
        )
        way += speed * dt
    assert verdict.free_displacement_m == pytest.approx(way, rel=1e-3)
    # half a t² without damping; the steps of the simulation add one per cent
    if preset == "dro-2024":
        assert verdict.free_displacement_m == pytest.approx(0.25, rel=0.02)


def test_starting_penetration_is_the_jaws_depth(gripper_model: HandModel, cube: ObjectModel):
    verdict = verdict_of(gripper_model, cube, grasp_of(cube, gap=-0.003), protocol_of("dro-2024"))
    assert verdict.penetration_start_mm == pytest.approx(3.0, abs=0.1)


def test_grip_force_is_stiffness_times_squeeze(gripper_model: HandModel, cube: ObjectModel):
    protocol = protocol_of("dro-2024")
    force = grip_force(gripper_model, cube, protocol, squeeze=0.002)
    assert force == pytest.approx(protocol.drive.stiffness * 0.002, rel=0.1)


def test_grip_force_is_bounded_by_the_hand_where_asked(gripper_model: HandModel, cube: ObjectModel):
    limit = gripper_model.hand.spec.drives.default.force_limit
    own_gains = protocol_of("dro-2024").model_copy(update={"drive": None})
    assert grip_force(gripper_model, cube, own_gains, squeeze=0.02) == pytest.approx(limit, rel=0.1)
    stiff = protocol_of("dro-2024", drive={"stiffness": 5000.0, "damping": 100.0})
    bounded = grip_force(gripper_model, cube, stiff, squeeze=0.02, force_limits=True)
    assert bounded == pytest.approx(limit, rel=0.1)
    assert grip_force(gripper_model, cube, stiff, squeeze=0.02, force_limits=False) > 2 * limit


def grip_force(
    hand: HandModel, obj: ObjectModel, protocol: Protocol, squeeze: float, **options: object
) -> float:
    """Force of the left jaw on the object after settling, newton."""
    scene = GraspScene(hand.hand, obj, protocol, SapienOptions(**options))
    start = start_of(grasp_of(obj, squeeze=squeeze))
    scene.reset(start.T_object_root, start.joints, start.targets)
    scene.step(200)
    return scene.forces()["left"]


def test_friction_decides_whether_a_weak_grip_holds(gripper_model: HandModel, cube: ObjectModel):
    pushes = {"order": "reset", "acceleration": 50.0}
    success = {"measured": "per-push", "contact": False}
    smooth = protocol_of("dro-2024", friction=0.1, pushes=pushes, success=success)
    rough = protocol_of("dro-2024", friction=3.0, pushes=pushes, success=success)
    assert verdict_of(gripper_model, cube, grasp_of(cube), smooth).failure == "moved"
    assert verdict_of(gripper_model, cube, grasp_of(cube), rough).success


def test_object_has_the_mass_and_inertia_of_its_shape(gripper_model: HandModel):
    brick = find_object("foam_brick")
    scene = GraspScene(gripper_model.hand, brick, protocol_of("dro-2024"), SapienOptions())
    T = scene.body.cmass_local_pose.to_transformation_matrix()
    inertia = T[:3, :3] @ np.diag(scene.body.inertia) @ T[:3, :3].T
    expected = 500.0 * brick.inertia.numpy()
    assert scene.body.mass == pytest.approx(500.0 * brick.volume, rel=1e-5)
    np.testing.assert_allclose(T[:3, 3], brick.center_of_mass.numpy(), atol=1e-7)
    np.testing.assert_allclose(inertia, expected, atol=1e-4 * expected.max())


# -- judgement ---------------------------------------------------------------------------------


def test_rotation_beyond_the_limit_fails(gripper_model: HandModel, cube: ObjectModel):
    success = {"max_rotation_rad": 1e-9, "measured": "per-push"}
    verdict = verdict_of(
        gripper_model, cube, grasp_of(cube), protocol_of("dro-2024", success=success)
    )
    assert verdict.failure == "rotated"


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


# -- repeatability -----------------------------------------------------------------------------


def start_of(grasps: GraspSet) -> Start:
    targets = grasps.joints if grasps.targets is None else grasps.targets
    return Start(grasps.poses[0].numpy(), grasps.joints[0].numpy(), targets[0].numpy())


@pytest.mark.parametrize("order", ["sequential", "reset"])
def test_reused_scene_repeats_a_fresh_one_exactly(
    order: str, gripper_model: HandModel, cube: ObjectModel
):
    protocol = protocol_of("dro-2024", friction=0.2, pushes={"order": order, "acceleration": 8.0})
    start, other = start_of(grasp_of(cube, shift=0.012)), start_of(grasp_of(cube, gap=-0.004))
    used = GraspScene(gripper_model.hand, cube, protocol, SapienOptions())
    run_trial(used, protocol, other)
    again = run_trial(used, protocol, start)
    fresh = GraspScene(gripper_model.hand, cube, protocol, SapienOptions())
    assert again == run_trial(fresh, protocol, start)
    assert again != run_trial(fresh, protocol, other)


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


def resident_bytes() -> int:
    pages = Path("/proc/self/statm").read_text().split()[1]
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="reads memory from /proc")
def test_a_scene_keeps_no_memory_from_trial_to_trial(gripper_model: HandModel, cube: ObjectModel):
    protocol = protocol_of("dro-2024", pushes={"steps": 1}, start={"settle_steps": 1})
    scene = GraspScene(gripper_model.hand, cube, protocol, SapienOptions())
    start = start_of(grasp_of(cube))
    sizes = []
    for _ in range(3):
        for _ in range(300):
            run_trial(scene, protocol, start)
        sizes.append(resident_bytes())
    assert sizes[-1] - sizes[0] < 2**20


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


# -- the hand's tree ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(path.parent.name for path in BUNDLED.glob("*/hand.yaml")))
def test_links_are_where_the_hand_model_has_them(name: str, cube: ObjectModel):
    assert_same_kinematics(model_of(load_hand(BUNDLED / name)), cube)


@pytest.mark.parametrize("name", REAL_HANDS)
def test_links_of_real_hands_are_where_the_hand_model_has_them(
    name: str, real_hands: Path, cube: ObjectModel
):
    assert_same_kinematics(model_of(load_hand(real_hands / name)), cube)


def test_links_of_a_prismatic_hand_with_mimic_are_where_the_hand_model_has_them(
    gripper_model: HandModel, cube: ObjectModel
):
    assert_same_kinematics(gripper_model, cube)


def assert_same_kinematics(model: HandModel, cube: ObjectModel) -> None:
    scene = GraspScene(model.hand, cube, protocol_of("dro-2024"), SapienOptions())
    generator = torch.Generator().manual_seed(0)
    share = torch.rand(len(model.joint_names), generator=generator)
    joints = model.lower + share * (model.upper - model.lower)
    T_world_root = torch.eye(4)
    T_world_root[:3, :3] = random_rotations(1, generator)[0]
    T_world_root[:3, 3] = torch.tensor([1.0, -2.0, 0.5])
    scene.reset(T_world_root.numpy(), joints.double().numpy(), joints.double().numpy())
    expected = T_world_root @ model.link_poses_in_root(joints[None])[0]
    for steps in (0, 20):
        scene.step(steps)
        placed = scene.hand.link_poses()
        found = np.stack([placed[link] for link in model.link_names])
        np.testing.assert_allclose(
            found, expected.numpy(), atol=1e-4, err_msg=f"after {steps} steps"
        )
