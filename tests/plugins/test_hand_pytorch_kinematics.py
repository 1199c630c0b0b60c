"""Kinematics agree with another library, with finite differences and with what can be predicted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import yourdfpy
from conftest import build_model

from gdg.folders import HANDS
from gdg.hands.hand import Hand, load_hand
from gdg.kinds.hand_model import HandModel
from gdg.penetration import self_penetration
from gdg.rotations import ROOT_DIM, q_from_pose, random_rotations

REAL = ("ezgripper", "barrett", "robotiq_3finger", "allegro", "shadowhand")
BUNDLED = tuple(name for name, found in HANDS.all().items() if found.tier == "bundled")
IDENTITY_ROOT = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0)


def random_joints(model: HandModel, count: int, seed: int = 0) -> torch.Tensor:
    share = torch.rand(count, len(model.joint_names), generator=torch.Generator().manual_seed(seed))
    return model.lower + share * (model.upper - model.lower)


def random_q(model: HandModel, count: int, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    poses = torch.eye(4).repeat(count, 1, 1)
    poses[:, :3, :3] = random_rotations(count, generator)
    poses[:, :3, 3] = 0.2 * torch.randn(count, 3, generator=generator)
    return q_from_pose(poses, random_joints(model, count, seed))


def assert_same_as_yourdfpy(hand: Hand) -> None:
    model = build_model(hand)
    theirs = yourdfpy.URDF.load(str(hand.urdf.path), load_meshes=False)
    joints = random_joints(model, 20)
    ours = model.link_poses_in_root(joints).numpy()
    for row, values in enumerate(joints.tolist()):
        # mimic and passive joints explicitly: yourdfpy knows no chains of mimics
        matrix, offset = hand.coupling
        moving = matrix @ np.array(values) + offset
        named = dict(zip((joint.name for joint in hand.moving_joints), moving, strict=True))
        theirs.update_cfg([named[name] for name in theirs.actuated_joint_names])
        for index, link in enumerate(hand.link_names):
            T_root_link = theirs.get_transform(link, hand.urdf.root)
            np.testing.assert_allclose(ours[row, index], T_root_link, atol=1e-5)


@pytest.mark.parametrize("name", REAL)
def test_real_hands_move_as_in_yourdfpy(real_hands: Path, name: str):
    assert_same_as_yourdfpy(load_hand(real_hands / name))


@pytest.mark.parametrize("name", BUNDLED)
def test_bundled_hands_move_as_in_yourdfpy(name: str):
    assert_same_as_yourdfpy(load_hand(HANDS.find(name).path))


def test_the_gripper_closes_as_predicted(gripper_model: HandModel):
    q = torch.tensor([[0.1, 0.2, 0.3, *IDENTITY_ROOT[3:], 0.02]])
    poses = dict(zip(gripper_model.link_names, gripper_model.link_poses(q)[0, :, :3, 3].tolist()))
    assert poses["base"] == pytest.approx([0.1, 0.2, 0.3], abs=1e-6)
    assert poses["left"] == pytest.approx([0.1, 0.2 + 0.03, 0.3], abs=1e-6)
    assert poses["right"] == pytest.approx([0.1, 0.2 - 0.03, 0.3], abs=1e-6)


def test_the_root_pose_moves_the_whole_hand_rigidly(gripper_model: HandModel):
    q = random_q(gripper_model, 5)
    still = q.clone()
    still[:, :ROOT_DIM] = torch.tensor(IDENTITY_ROOT)
    rotation = torch.stack((q[:, 3:6], q[:, 6:9], torch.linalg.cross(q[:, 3:6], q[:, 6:9])), 1)
    expected = gripper_model.surface_points(still) @ rotation.mT + q[:, None, :3]
    torch.testing.assert_close(gripper_model.surface_points(q), expected, atol=1e-5, rtol=0)


@pytest.mark.parametrize("name", BUNDLED)
def test_a_batch_of_one_equals_its_row_in_the_batch(name: str):
    model = build_model(load_hand(HANDS.find(name).path))
    q = random_q(model, 4)
    batch = model.link_poses(q)
    for row in range(4):
        torch.testing.assert_close(
            model.link_poses(q[row : row + 1])[0], batch[row], atol=1e-6, rtol=0
        )


def test_an_empty_batch_stays_empty(gripper_model: HandModel):
    q = torch.zeros(0, ROOT_DIM + 1)
    poses = gripper_model.link_poses(q)
    assert poses.shape == (0, 4, 4, 4)
    assert gripper_model.surface_points(q).shape == (0, 200, 3)
    assert self_penetration(gripper_model, poses).shape == (0,)
    assert gripper_model.limit_violation(q).shape == (0,)
    assert gripper_model.palm(q)[0].shape == (0, 3)


@pytest.mark.parametrize("name", BUNDLED)
def test_gradients_of_link_poses_equal_finite_differences(name: str):
    model = build_model(load_hand(HANDS.find(name).path))
    weights = torch.randn(len(model.link_names), 4, 4, generator=torch.Generator().manual_seed(1))
    joints = random_joints(model, 1)

    def value(q: torch.Tensor) -> torch.Tensor:
        return (model.link_poses_in_root(q) * weights).sum((1, 2, 3))

    probe = joints.clone().requires_grad_(True)
    (gradient,) = torch.autograd.grad(value(probe).sum(), probe)
    step = 2e-2
    steps = step * torch.eye(joints.shape[1])
    # the fourth-order stencil allows steps that float32 can tell apart
    far, near = (value(joints + k * steps) - value(joints - k * steps) for k in (2, 1))
    torch.testing.assert_close(gradient[0], (8 * near - far) / (12 * step), atol=2e-3, rtol=2e-3)


def test_surface_gradients_reach_every_actuated_joint():
    model = build_model(load_hand(HANDS.find("allegro").path))
    q = random_q(model, 2).requires_grad_(True)
    model.surface_points(q).square().sum().backward()
    assert q.grad is not None
    assert (q.grad[:, ROOT_DIM:] != 0).all()


def test_normals_turn_but_never_shift(gripper_model: HandModel):
    q = random_q(gripper_model, 3)
    surface = gripper_model.surface
    poses = gripper_model.link_poses(q)
    turned = gripper_model.turn(poses, surface.normals, surface.link_index)
    torch.testing.assert_close(turned.norm(dim=-1), torch.ones(3, 200), atol=1e-5, rtol=0)
    tips = gripper_model.place(poses, surface.points + surface.normals, surface.link_index)
    feet = gripper_model.place(poses, surface.points, surface.link_index)
    torch.testing.assert_close(turned, tips - feet, atol=1e-5, rtol=0)


def test_points_may_differ_within_the_batch(gripper_model: HandModel):
    poses = gripper_model.link_poses(random_q(gripper_model, 3))
    generator = torch.Generator().manual_seed(0)
    points = torch.randn(3, 7, 3, generator=generator)
    index = torch.randint(0, 4, (3, 7), generator=generator)
    together = gripper_model.place(poses, points, index)
    for row in range(3):
        alone = gripper_model.place(poses[row : row + 1], points[row], index[row])
        torch.testing.assert_close(together[row], alone[0])


def test_the_palm_is_where_the_manifest_says(gripper_model: HandModel):
    center, normal = gripper_model.palm(torch.tensor([[*IDENTITY_ROOT, 0.0]]))
    torch.testing.assert_close(center, torch.zeros(1, 3))
    torch.testing.assert_close(normal, torch.tensor([[0.0, 0.0, 1.0]]))


def test_joint_limits_cost_nothing_inside_and_their_excess_outside(gripper_model: HandModel):
    q = torch.tensor([[*IDENTITY_ROOT, value] for value in (0.0, 0.05, 0.06, -0.02)])
    expected = torch.tensor([0.0, 0.0, 0.01, 0.02])
    torch.testing.assert_close(gripper_model.limit_violation(q), expected, atol=1e-5, rtol=0)
    clamped = gripper_model.clamp(q)[:, ROOT_DIM:]
    torch.testing.assert_close(clamped[:, 0], torch.tensor([0.0, 0.05, 0.05, 0.0]))


def test_the_gradient_of_the_limit_penalty_is_finite_inside(gripper_model: HandModel):
    q = torch.tensor([[*IDENTITY_ROOT, 0.02]], requires_grad=True)
    gripper_model.limit_violation(q).sum().backward()
    assert q.grad is not None
    assert q.grad.isfinite().all()


def test_jaws_that_run_into_each_other_overlap_and_open_ones_do_not(gripper_model: HandModel):
    first, second = (gripper_model.spheres.reach > 0).nonzero().T
    index = gripper_model.spheres.link_index
    links = {tuple(pair) for pair in torch.stack((index[first], index[second]), 1).tolist()}
    assert links == {(2, 3)}
    q = torch.tensor([[*IDENTITY_ROOT, value] for value in (0.0, 0.025, 0.055)])
    overlap = self_penetration(gripper_model, gripper_model.link_poses(q))
    assert overlap[:2].max() < 1e-5
    assert overlap[2] > 1e-3


@pytest.mark.parametrize("name", BUNDLED)
def test_the_open_posture_is_free_of_self_collision(name: str):
    model = build_model(load_hand(HANDS.find(name).path))
    assert self_penetration(model, model.link_poses_in_root(model.open_posture[None])).max() < 1e-5


def test_fingers_that_cross_are_seen():
    # in the middle of all ranges the ShadowHand's little finger lies across the ring finger
    model = build_model(load_hand(HANDS.find("shadowhand").path))
    middle = (model.lower + model.upper)[None] / 2
    assert self_penetration(model, model.link_poses_in_root(middle)).max() > 0.005


def test_region_normals_point_where_the_surface_does(gripper_model: HandModel):
    normals = dict(
        zip(gripper_model.regions.link_index.tolist(), gripper_model.regions.normals.tolist())
    )
    assert normals[2] == pytest.approx([0, -1, 0])
    assert normals[3] == pytest.approx([0, 1, 0])


@pytest.mark.parametrize("name", REAL)
def test_region_normals_of_real_hands_agree_with_the_surface_nearby(real_hands: Path, name: str):
    model = build_model(load_hand(real_hands / name), points=3000)
    regions, surface = model.regions, model.surface
    agree = []
    for corners, normal, link in zip(regions.corners, regions.normals, regions.link_index):
        own = surface.link_index == link
        gap = (surface.points[own] - corners.mean(0)).norm(dim=-1)
        nearest = surface.normals[own][gap.argsort()[:5]]
        agree.append(float((nearest @ normal).mean()))
    assert np.mean(np.array(agree) > 0.0) > 0.95


def test_a_hand_without_regions_has_none(gripper: Hand):
    spec = gripper.spec.model_copy(update={"contact_regions": {}})
    regions = build_model(replace(gripper, spec=spec)).regions
    assert regions.corners.shape == (0, 4, 3)
    assert regions.link_index.dtype == torch.long
