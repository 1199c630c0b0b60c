"""Overlaps that can be predicted, and those of real hands against other ways to find them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from conftest import build_model
from gripper import MANIFEST, URDF
from measured_grasps import around_the_cube, closed_on, grasp_set

from gdg.geometry.overlap import body_of, penetration_depth
from gdg.hands.hand import load_hand
from gdg.hands.self_collision import LinkBodies
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel, find_object
from gdg.penetration import penetration_depth as sampled_depth
from gdg.quality.overlap import Bodies, exact_overlap, object_bodies


def test_jaws_lie_in_a_cube_as_deep_as_they_are_pressed(
    gripper_model: HandModel, cube: ObjectModel
):
    grasps = around_the_cube(gripper_model, cube, [0.5, 0.01, -0.01, -1.0, -4.0])
    overlap = exact_overlap(gripper_model, cube, grasps)
    expected = torch.tensor([0.0, 0.0, 0.01, 1.0, 4.0])
    torch.testing.assert_close(overlap.object_mm, expected, rtol=0, atol=1e-4)
    assert not overlap.self_mm.any()


def test_jaws_that_pass_through_each_other_are_noticed(gripper_model: HandModel, cube: ObjectModel):
    poses = torch.eye(4).repeat(3, 1, 1)
    poses[:, 0, 3] = 1.0
    joints = torch.tensor([[0.049], [0.0505], [0.052]])
    overlap = exact_overlap(gripper_model, cube, grasp_set(gripper_model, cube, poses, joints))
    torch.testing.assert_close(overlap.self_mm, torch.tensor([0.0, 1.0, 4.0]), rtol=0, atol=1e-3)
    assert not overlap.object_mm.any()


def test_self_contacts_that_the_manifest_allows_do_not_count(tmp_path, cube: ObjectModel):
    (tmp_path / "two_jaws.urdf").write_text(URDF)
    (tmp_path / "hand.yaml").write_text(MANIFEST + "allowed_self_contacts:\n  - [left, right]\n")
    hand = build_model(load_hand(tmp_path))
    crossed = grasp_set(hand, cube, torch.eye(4)[None], torch.tensor([[0.055]]))
    assert exact_overlap(hand, cube, crossed).self_mm.item() == 0.0


def test_parts_that_overlap_when_open_touch_by_construction(tmp_path, cube: ObjectModel):
    # jaws so thick that they lie in each other from the start
    urdf = URDF.replace('xyz="0 0.005 0.035"', 'xyz="0 -0.01 0.035"')
    (tmp_path / "two_jaws.urdf").write_text(urdf.replace("0.03 0.01 0.06", "0.03 0.12 0.06"))
    (tmp_path / "hand.yaml").write_text(MANIFEST)
    hand = build_model(load_hand(tmp_path))
    closed = grasp_set(hand, cube, torch.eye(4)[None], torch.tensor([[0.03]]))
    assert exact_overlap(hand, cube, closed).self_mm.item() == 0.0


def test_a_grasp_that_is_not_finite_spoils_no_other(gripper_model: HandModel, cube: ObjectModel):
    grasps = around_the_cube(gripper_model, cube, [-1.0, -2.0, -3.0])
    joints = grasps.joints.clone()
    joints[1] = torch.nan
    overlap = exact_overlap(gripper_model, cube, replace(grasps, joints=joints))
    assert overlap.object_mm.isnan().tolist() == [False, True, False]
    assert overlap.self_mm.isnan().tolist() == [False, True, False]
    assert overlap.object_mm[2].item() == pytest.approx(3.0, abs=1e-3)
    assert len(exact_overlap(gripper_model, cube, grasps.select([])).object_mm) == 0


@pytest.mark.parametrize("name", ["allegro", "shadowhand", "barrett"])
def test_depths_of_real_hands_are_those_of_all_pairs(name: str):
    obj = find_object("rubber_duck")
    hand, grasps = closed_on(name, obj, 3)
    overlap = exact_overlap(hand, obj, grasps)
    still = [body_of(part) for part in obj.convex_parts]
    Ts = hand.link_poses(hand.q_of(grasps)).double().numpy()
    for T, depth in zip(Ts, overlap.object_mm.tolist()):
        deepest = 0.0
        for part in hand.hand.parts:
            if part.kind == "sphere":
                continue
            placed = body_of(part.mesh).placed(T[hand.link_names.index(part.link)])
            for other in still:
                deepest = max(deepest, penetration_depth(placed, other, ignored=deepest))
        assert depth == pytest.approx(1000 * deepest, abs=1e-3)


@pytest.mark.parametrize("name", ["allegro", "shadowhand", "barrett"])
def test_samples_see_no_deeper_than_the_exact_overlap(name: str):
    obj = find_object("cube_medium")
    hand, grasps = closed_on(name, obj, 8)
    exact = exact_overlap(hand, obj, grasps).object_mm
    sampled = 1000 * sampled_depth(hand, obj, hand.q_of(grasps))
    assert (exact > sampled - 0.1).all()
    assert exact.max() > 0.1


def test_self_overlaps_of_a_real_hand_are_those_of_all_pairs_of_links(cube: ObjectModel):
    hand, _ = closed_on("shadowhand", cube, 1)
    generator = torch.Generator().manual_seed(0)
    share = torch.rand(6, len(hand.joint_names), generator=generator)
    joints = hand.lower + share * (hand.upper - hand.lower)
    grasps = grasp_set(hand, cube, torch.eye(4).repeat(6, 1, 1), joints)
    overlap = exact_overlap(hand, cube, grasps).self_mm
    for T, depth in zip(hand.link_poses_in_root(joints).double().numpy(), overlap.tolist()):
        pairs = LinkBodies(hand.hand).overlaps(T, hand.hand.may_collide(), 0.0)
        assert depth == pytest.approx(1000 * max(pairs.values(), default=0.0), abs=1e-3)
    assert overlap.max() > 1.0


def test_crossing_fingers_are_noticed_where_they_cross_in_the_middle_posture(cube: ObjectModel):
    hand, _ = closed_on("shadowhand", cube, 1)
    middle = ((hand.lower + hand.upper) / 2)[None]
    grasps = grasp_set(hand, cube, torch.eye(4)[None], middle)
    assert exact_overlap(hand, cube, grasps).self_mm.item() > 5.0


def test_bodies_near_each_other_are_found_in_any_pose(cube: ObjectModel):
    moved, still = Bodies(object_bodies(cube)), Bodies(object_bodies(cube))
    T = np.eye(4)[None]
    for shift, depth in ((0.0, 0.04), (0.03, 0.01), (0.0399, 0.0001), (0.041, 0.0)):
        T[0, 0, 3] = shift
        moved.place(T)
        assert moved.depth_in(still) == pytest.approx(depth, abs=1e-7)
        assert still.depth_in(moved) == pytest.approx(depth, abs=1e-7)
        assert moved.depth_in(still, np.zeros((1, 1), bool)) == 0.0
