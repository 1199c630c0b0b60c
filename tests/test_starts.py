"""Drive targets press inward by what was asked, and penetrating hands open just so far."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from conftest import build_model
from grasp_samples import make_verdict
from gripper import OPEN_M

from gdg.components import NoOptions
from gdg.data.grasps import GraspSet
from gdg.hands.hand import find_hand
from gdg.initial_poses import around_sphere
from gdg.kinds.hand_model import HandModel
from gdg.kinds.simulator import Simulator
from gdg.objects.model import ObjectModel
from gdg.penetration import penetration_depth
from gdg.protocols import Protocol, Refinement, load_protocol
from gdg.rotations import ROOT_DIM
from gdg.starts import BACK_OUT_STEPS, backed_out, contact_aware_targets, prepare, simulated

#: Joint value at which both jaws touch the bundled cube of 40 mm.
TOUCHING_M = OPEN_M - 0.02
GRADIENT = Refinement(step="gradient", size=0.004)
SIGN = Refinement(step="sign", size=0.004)


def grasps_of(*close: float, x: float = 0.0) -> GraspSet:
    poses = torch.eye(4).repeat(len(close), 1, 1)
    poses[:, 0, 3], poses[:, 2, 3] = x, -0.035
    joints = torch.tensor(close).reshape(-1, 1)
    return GraspSet("two_jaws", "cube_small", ("close",), "base", poses, joints)


def protocol(refinement: Refinement = GRADIENT, mode: str = "as-fitted") -> Protocol:
    preset = load_protocol("dro-2024")
    start = preset.start.model_copy(update={"mode": mode, "clearance_m": 0.0005})
    return preset.model_copy(update={"refinement": refinement, "start": start})


@pytest.mark.parametrize("refinement", [GRADIENT, SIGN])
@pytest.mark.parametrize("gap_m", [0.0, 0.003, -0.003])
def test_jaws_at_a_surface_get_targets_further_in(
    gripper_model: HandModel, cube: ObjectModel, refinement: Refinement, gap_m: float
):
    q = gripper_model.q_of(grasps_of(TOUCHING_M - gap_m))
    targets = contact_aware_targets(gripper_model, cube, q, refinement)
    assert (targets - q[:, ROOT_DIM:]).item() == pytest.approx(refinement.size, rel=1e-4)


def test_jaws_out_of_reach_stay(gripper_model: HandModel, cube: ObjectModel):
    # 6 mm from the cube, beyond the reach of 5 mm; then far away
    for x, close in ((0.0, TOUCHING_M - 0.006), (1.0, TOUCHING_M)):
        q = gripper_model.q_of(grasps_of(close, x=x))
        for refinement in (GRADIENT, SIGN):
            targets = contact_aware_targets(gripper_model, cube, q, refinement)
            assert torch.equal(targets, q[:, ROOT_DIM:])


def test_targets_are_per_grasp(gripper_model: HandModel, cube: ObjectModel):
    q = gripper_model.q_of(grasps_of(TOUCHING_M, 0.0, TOUCHING_M - 0.002))
    moved = contact_aware_targets(gripper_model, cube, q, GRADIENT) - q[:, ROOT_DIM:]
    torch.testing.assert_close(moved[:, 0], torch.tensor([0.004, 0.0, 0.004]))


@pytest.fixture(scope="module")
def closing() -> tuple[HandModel, ObjectModel, torch.Tensor]:
    """An Allegro hand whose fingers touch the cube in several postures."""
    from gdg.objects.model import find_object

    hand, cube = build_model(find_hand("allegro"), 400), find_object("cube_medium")
    q = around_sphere(hand, cube, 8, torch.Generator().manual_seed(0), factor=0.9)
    return hand, cube, q


def test_sign_moves_every_joint_by_all_or_nothing(closing):
    hand, cube, q = closing
    moved = (
        contact_aware_targets(hand, cube, q, Refinement(step="sign", size=0.5)) - q[:, ROOT_DIM:]
    )
    sizes = moved.abs()
    assert (((sizes - 0.5).abs() < 1e-5) | (sizes == 0)).all()
    assert 0 < (sizes > 0).sum() < sizes.numel()


def test_gradient_moves_the_joint_that_moves_most_by_size(closing):
    hand, cube, q = closing
    targets = contact_aware_targets(hand, cube, q, Refinement(step="gradient", size=0.2))
    largest = (targets - q[:, ROOT_DIM:]).abs().amax(-1)
    touching = largest > 0
    assert touching.any()
    torch.testing.assert_close(largest[touching], torch.full((int(touching.sum()),), 0.2))


def test_joints_that_do_not_close_are_left_alone(closing):
    hand, cube, q = closing
    free = contact_aware_targets(hand, cube, q, GRADIENT) != q[:, ROOT_DIM:]
    joint = int(free.sum(0).argmax())
    assert free[:, joint].any()
    stiff = build_model(hand.hand, 400)
    stiff.closed_posture = stiff.closed_posture.clone()
    stiff.closed_posture[joint] = stiff.open_posture[joint]
    targets = contact_aware_targets(stiff, cube, q, GRADIENT)
    assert torch.equal(targets[:, joint], q[:, ROOT_DIM + joint])


def test_targets_bring_the_contacts_nearer(closing):
    hand, cube, q = closing
    targets = contact_aware_targets(hand, cube, q, Refinement(step="gradient", size=0.01))

    def inside(joints: torch.Tensor) -> torch.Tensor:
        points = hand.surface_points(torch.cat((q[:, :ROOT_DIM], joints), dim=-1))
        near = cube.sdf.distance(hand.surface_points(q)).abs() < GRADIENT.reach_m
        return torch.where(near, cube.sdf.distance(points), 0.0).sum(-1)

    touching = (targets != q[:, ROOT_DIM:]).any(-1)
    assert (inside(targets) < inside(q[:, ROOT_DIM:]))[touching].all()


# -- backing out -------------------------------------------------------------------------------


@pytest.mark.parametrize("depth_m", [0.002, 0.008])
def test_a_penetrating_gripper_opens_just_so_far(
    gripper_model: HandModel, cube: ObjectModel, depth_m: float
):
    q = gripper_model.q_of(grasps_of(TOUCHING_M + depth_m))
    joints = backed_out(gripper_model, cube, q, clearance_m=0.0005)
    left = penetration_depth(gripper_model, cube, torch.cat((q[:, :ROOT_DIM], joints), -1)).item()
    step = (TOUCHING_M + depth_m) / BACK_OUT_STEPS
    assert left <= 0.0005
    assert TOUCHING_M + 0.0005 - step - 2e-4 <= joints.item() <= TOUCHING_M + 0.0005 + 2e-4


def test_a_grasp_that_is_clear_does_not_move(gripper_model: HandModel, cube: ObjectModel):
    q = gripper_model.q_of(grasps_of(TOUCHING_M - 0.001, TOUCHING_M + 0.01))
    joints = backed_out(gripper_model, cube, q, clearance_m=0.0005)
    assert joints[0].item() == q[0, -1].item()
    assert joints[1].item() < q[1, -1].item()


def test_a_palm_inside_the_object_starts_in_the_open_posture(
    gripper_model: HandModel, cube: ObjectModel
):
    q = gripper_model.q_of(grasps_of(TOUCHING_M))
    q[:, 2] = 0.0
    joints = backed_out(gripper_model, cube, q, clearance_m=0.0005)
    torch.testing.assert_close(joints[0], gripper_model.open_posture)


# -- prepare -----------------------------------------------------------------------------------


def test_without_refinement_there_are_no_targets(gripper_model: HandModel, cube: ObjectModel):
    grasps = grasps_of(TOUCHING_M)
    assert prepare(gripper_model, cube, grasps, protocol(), refine=False).targets is None
    assert prepare(gripper_model, cube, grasps, protocol(Refinement())).targets is None
    refined = prepare(gripper_model, cube, grasps, protocol())
    assert refined.targets is not None
    assert torch.equal(refined.joints, grasps.joints)


def test_backed_out_hands_close_to_where_they_were_fitted(
    gripper_model: HandModel, cube: ObjectModel
):
    grasps = grasps_of(TOUCHING_M + 0.004)
    for refine in (False, True):
        ready = prepare(gripper_model, cube, grasps, protocol(mode="backed-out"), refine)
        assert ready.joints.item() < TOUCHING_M + 0.001
        aimed = grasps.joints + (0.004 if refine else 0.0)
        assert ready.targets is not None
        torch.testing.assert_close(ready.targets, aimed)
        assert torch.equal(ready.poses, grasps.poses)


def test_no_grasps_need_no_preparation(gripper_model: HandModel, cube: ObjectModel):
    none = replace(grasps_of(TOUCHING_M).select([]), provenance={"rejected": {"x": 1}})
    assert prepare(gripper_model, cube, none, protocol()) is none


class Accepting(Simulator):
    """Lets everything pass, and takes all that has targets for refined, as simulators do."""

    def simulate(self, hand, obj, grasps, protocol, progress=None):
        return (make_verdict(refined=grasps.targets is not None),) * len(grasps)


@pytest.mark.parametrize("mode", ["as-fitted", "backed-out"])
@pytest.mark.parametrize("step", ["none", "gradient"])
@pytest.mark.parametrize("refine", [True, False])
def test_verdicts_are_refined_where_the_refinement_closed_the_hand_and_nowhere_else(
    gripper_model: HandModel, cube: ObjectModel, mode: str, step: str, refine: bool
):
    planned = grasps_of(TOUCHING_M + 0.003, TOUCHING_M)
    test = protocol(GRADIENT.model_copy(update={"step": step}), mode)
    found = simulated(Accepting(NoOptions()), gripper_model, cube, planned, test, refine)
    assert {v.refined for v in found.verdicts} == {refine and step == "gradient"}
    assert torch.equal(found.joints, planned.joints)
    assert (found.targets is None) == (mode == "as-fitted" and not (refine and step == "gradient"))
