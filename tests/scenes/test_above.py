"""Hands stay above the table: in what is measured, where they start, close, open and squeeze."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from conftest import build_model
from hypothesis import given, settings
from hypothesis import strategies as st
from table_samples import BELOW_CUBE, REACH_M, gripper_looking, put
from torch import Tensor

from gdg.closure import close_until_touch
from gdg.data.grasps import GraspSet
from gdg.data.table import Table
from gdg.hands.hand import find_hand
from gdg.initial_poses import above_surface, around_sphere
from gdg.kinds.hand_model import HandModel
from gdg.objects.batch import ObjectBatch
from gdg.objects.model import ObjectModel, find_object
from gdg.penetration import penetration
from gdg.penetration.table import (
    _planes,
    eager_table_penetration,
    hand_height,
    link_heights,
    raised,
    table_penetration,
)
from gdg.quality import exact_overlap
from gdg.rotations import ROOT_DIM, q_from_pose, random_rotations, root_pose
from gdg.scenes.above import approach_height, targets_above
from gdg.scenes.keep import IN_TABLE, ON_THE_WAY, keep_above
from gdg.scenes.place import on_table
from gdg.scenes.reach import FINGER_RADIUS_M, reachable
from gdg.starts import backed_out

DOWN, UP = (0.0, 0.0, -1.0), (0.0, 0.0, 1.0)
FLOOR = Table((0.0, 0.0, 1.0), 0.0)


@pytest.fixture(scope="module")
def allegro() -> HandModel:
    return build_model(find_hand("allegro"))


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def random_hands(hand: HandModel, count: int, seed: int = 0) -> Tensor:
    g = seeded(seed)
    pose = torch.eye(4).repeat(count, 1, 1)
    pose[:, :3, :3] = random_rotations(count, g)
    pose[:, :3, 3] = 0.05 * torch.randn(count, 3, generator=g)
    share = torch.rand(count, len(hand.joint_names), generator=g)
    return q_from_pose(pose, hand.lower + share * (hand.upper - hand.lower))


def as_grasps(hand: HandModel, q: Tensor) -> GraspSet:
    return GraspSet(
        hand.hand.name, "cube_small", hand.joint_names, hand.hand.spec.root_link, root_pose(q),
        q[:, ROOT_DIM:], energies={"total": torch.arange(len(q)).float()},
    )  # fmt: skip


def jaws_above_each_other(close: float) -> Tensor:
    """The gripper looking along x with the cube between its jaws, which move up and down."""
    T = torch.eye(4)[None]
    T[0, :3, :3] = torch.tensor([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    T[0, 0, 3] = -REACH_M
    return q_from_pose(T, torch.tensor([[close]]))


# -- heights and penetration ---------------------------------------------------------------------


def test_heights_are_those_of_the_lowest_corners(allegro: HandModel):
    q = random_hands(allegro, 3)
    Ts = allegro.link_poses(q).numpy()
    heights = link_heights(allegro, BELOW_CUBE, torch.from_numpy(Ts))
    for link, name in enumerate(allegro.link_names):
        for part in allegro.hand.parts_of(name):
            corners = part.mesh.vertices @ Ts[:, link, :3, :3].transpose(0, 2, 1)
            z = corners[..., 2] + Ts[:, link, None, 2, 3]
            assert (heights[:, link].numpy() <= z.min(-1) - BELOW_CUBE.offset + 1e-6).all()
    lowest = heights.amin(-1).numpy()
    surface = allegro.surface_points(q)[..., 2].amin(-1).numpy() - BELOW_CUBE.offset
    assert (lowest <= surface + 1e-6).all()
    assert (surface - lowest < 0.01).all()


@given(st.integers(0, 10_000))
@settings(max_examples=15)
def test_heights_and_penetration_turn_with_the_world(gripper_model, seed: int):
    q, g = random_hands(gripper_model, 2, seed), seeded(seed)
    R, t = random_rotations(1, g)[0], 0.1 * torch.randn(3, generator=g)
    table = Table((0.0, 0.0, 1.0), 0.01)
    up = R @ torch.tensor([0.0, 0.0, 1.0])
    turned = Table(tuple(up.double().tolist()), float(0.01 + up @ t))
    T = torch.eye(4)
    T[:3, :3], T[:3, 3] = R, t
    moved = q_from_pose(T @ root_pose(q), q[:, ROOT_DIM:])
    torch.testing.assert_close(
        hand_height(gripper_model, turned, moved), hand_height(gripper_model, table, q),
        rtol=0, atol=2e-6,
    )  # fmt: skip
    before = table_penetration(gripper_model, [table], gripper_model.link_poses(q))
    after = table_penetration(gripper_model, [turned], gripper_model.link_poses(moved))
    torch.testing.assert_close(after, before, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize(("stride", "margin_m"), [(1, 0.0), (3, 0.002)])
def test_the_compiled_pass_equals_the_reference(allegro: HandModel, stride: int, margin_m: float):
    tables = [Table((0.0, 0.6, 0.8), 0.01), None, BELOW_CUBE]
    Ts = allegro.link_poses(random_hands(allegro, 9)).detach()
    grads, results = [], []
    for way in ("compiled", "eager"):
        poses = Ts.clone().requires_grad_(True)
        if way == "compiled":
            found = table_penetration(allegro, tables, poses, stride, margin_m)
        else:
            planes = _planes(tables, poses)
            found = eager_table_penetration(allegro, *planes, poses, stride, margin_m)
        (grad,) = torch.autograd.grad((found[0] * torch.arange(1.0, 10.0)).sum(), poses)
        results.append((found[0].detach(), found[1]))
        grads.append(grad[..., :3, :])
    assert results[0][0].max() > 0.1
    assert (results[0][0][3:6] == 0).all()
    torch.testing.assert_close(results[0], results[1], rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(grads[0], grads[1], rtol=1e-4, atol=1e-4)


def test_penetration_counts_the_table_beside_the_object(allegro: HandModel, cube: ObjectModel):
    Ts = allegro.link_poses(random_hands(allegro, 4))
    alone, placed = penetration(allegro, cube, Ts), penetration(allegro, put(cube), Ts)
    summed, depth = table_penetration(allegro, [BELOW_CUBE], Ts)
    torch.testing.assert_close(placed.summed, alone.summed + summed)
    torch.testing.assert_close(placed.depth, torch.maximum(alone.depth, depth))
    both = penetration(allegro, ObjectBatch([cube, put(cube)]), Ts.repeat(2, 1, 1, 1))
    torch.testing.assert_close(both.summed, torch.cat((alone.summed, placed.summed)))


def test_exact_overlap_is_the_depth_below_the_table(allegro: HandModel, cube: ObjectModel):
    q = random_hands(allegro, 4)
    q = raised(allegro, BELOW_CUBE, q)
    for depth in (0.004, -0.004):
        low = q - hand_height(allegro, BELOW_CUBE, q)[:, None] * torch.eye(q.shape[1])[2]
        low = low - depth * torch.eye(q.shape[1])[2]
        found = exact_overlap(allegro, put(cube), as_grasps(allegro, low))
        expected = torch.full((4,), 1000 * max(0.0, depth))
        torch.testing.assert_close(found.table_mm, expected, rtol=0, atol=2e-3)
    assert (exact_overlap(allegro, cube, as_grasps(allegro, low)).table_mm == 0).all()


def test_raised_hands_stand_at_the_clearance_and_others_stay(allegro: HandModel):
    q = random_hands(allegro, 8)
    q[:4, 2] += 1.0
    up = raised(allegro, BELOW_CUBE, q, 0.001)
    assert torch.equal(up[:4], q[:4])
    found = hand_height(allegro, BELOW_CUBE, up[4:])
    torch.testing.assert_close(found, torch.full((4,), 0.001), rtol=0, atol=1e-6)
    assert torch.equal(up[:, [0, 1]], q[:, [0, 1]])


# -- starts, closing, opening, squeezing ---------------------------------------------------------


@pytest.mark.parametrize("start", [around_sphere, above_surface])
@pytest.mark.parametrize("name", ["mouse", "mustard_bottle"])
def test_hands_start_above_the_table_and_look_down_or_sideways(allegro, start, name: str):
    obj = on_table(find_object(name))
    assert obj.table is not None
    q = start(allegro, obj, 64, seeded())
    assert hand_height(allegro, obj.table, q).min() >= -1e-6
    looks = allegro.palm(q)[1] @ torch.as_tensor(obj.table.up, dtype=torch.float32)
    assert looks.max() <= 1e-3
    assert looks.min() < -0.9


@pytest.mark.parametrize("start", [around_sphere, above_surface])
def test_hands_in_free_air_start_from_below_as_well(allegro, start, cube: ObjectModel):
    looks = allegro.palm(start(allegro, cube, 64, seeded()))[1][:, 2]
    assert looks.max() > 0.9
    assert (looks > 0).float().mean().item() == pytest.approx(0.5, abs=0.25)


def test_a_closing_jaw_stops_at_the_table(gripper_model: HandModel, cube: ObjectModel):
    # the cube out of reach; the upper jaw comes down, the lower one rises
    q = jaws_above_each_other(close=0.0)
    q[:, 0] += 0.2
    upper = link_heights(gripper_model, FLOOR, gripper_model.link_poses(q))
    level = float(upper[0, gripper_model.link_names.index("left")]) - 0.02
    closed = close_until_touch(gripper_model, put(cube, Table((0.0, 0.0, 1.0), level)), q)
    assert closed[0, ROOT_DIM].item() == pytest.approx(0.02, abs=0.001)
    assert close_until_touch(gripper_model, cube, q)[0, ROOT_DIM].item() > 0.045


def test_a_jaw_that_lies_on_the_table_may_still_close(gripper_model: HandModel, cube: ObjectModel):
    # looking down with the jaws' ends on the table: closing moves them along it
    q = raised(gripper_model, BELOW_CUBE, gripper_looking(DOWN, close=0.0))
    closed = close_until_touch(gripper_model, put(cube), q)
    assert closed[0, ROOT_DIM].item() == pytest.approx(0.03, abs=0.001)


def test_opening_stops_at_the_table(gripper_model: HandModel, cube: ObjectModel):
    # jaws above each other, 5 mm deep in the cube's top and bottom; the lower opens downward
    q = jaws_above_each_other(close=0.035)
    slope = (-0.6, 0.0, 0.8)  # under the lower jaw; the base is broader than the jaws are far apart
    level = float(hand_height(gripper_model, Table(slope, 0.0), q))
    table = Table(slope, level - 0.003)
    joints = backed_out(gripper_model, put(cube, table), q, 0.0005)
    opened = torch.cat((q[:, :ROOT_DIM], joints), dim=-1)
    assert 0 <= hand_height(gripper_model, table, opened).item() < 0.002
    assert backed_out(gripper_model, cube, q, 0.0005).item() < joints.item() - 0.001


def test_a_hand_that_may_rise_sweeps_along_the_table(gripper_model: HandModel, cube: ObjectModel):
    q = jaws_above_each_other(close=0.0)
    q[:, 0] += 0.2
    upper = link_heights(gripper_model, FLOOR, gripper_model.link_poses(q))
    level = float(upper[0, gripper_model.link_names.index("left")]) - 0.02
    table = Table((0.0, 0.0, 1.0), level)
    q = raised(gripper_model, table, q)
    closed = close_until_touch(gripper_model, put(cube, table), q, rise=True)
    assert closed[0, ROOT_DIM].item() > 0.045
    assert hand_height(gripper_model, table, closed).item() >= -1e-6


def test_targets_lead_no_link_into_the_table(allegro: HandModel):
    q = random_hands(allegro, 16)
    q = raised(allegro, BELOW_CUBE, q)
    wanted = q[:, ROOT_DIM:] + 0.3 * torch.randn(16, len(allegro.joint_names), generator=seeded(1))
    before = torch.cat((q[:, :ROOT_DIM], wanted), dim=-1)
    assert (hand_height(allegro, BELOW_CUBE, before) < -1e-3).any()
    targets = targets_above(allegro, BELOW_CUBE, q, wanted)
    after = torch.cat((q[:, :ROOT_DIM], targets), dim=-1)
    assert hand_height(allegro, BELOW_CUBE, after).min() >= -1e-5
    kept = hand_height(allegro, BELOW_CUBE, before) >= 0
    torch.testing.assert_close(targets[kept], wanted[kept])
    assert not torch.equal(targets, q[:, ROOT_DIM:])


# -- what is kept --------------------------------------------------------------------------------


def test_a_grasp_from_above_is_kept_and_one_from_below_is_not(gripper_model, cube: ObjectModel):
    above, below = gripper_looking(DOWN, away=0.02), gripper_looking(UP, away=0.02)
    grasps = as_grasps(gripper_model, torch.cat((below, above)))
    kept = keep_above(gripper_model, put(cube), grasps)
    assert kept.energies["total"].tolist() == [1.0]
    assert kept.provenance["rejected"] == {IN_TABLE: 1, ON_THE_WAY: 0}
    again = keep_above(gripper_model, put(cube), kept)
    assert again.provenance["rejected"] == {IN_TABLE: 1, ON_THE_WAY: 0}
    assert len(keep_above(gripper_model, cube, grasps)) == 2


def test_a_grasp_that_is_above_the_table_but_is_not_reached_from_above_is_rejected(
    gripper_model: HandModel, cube: ObjectModel
):
    # from 20 degrees below the horizon, the object on a pedestal of a thin table
    slope = (float(np.cos(0.35)), 0.0, float(np.sin(0.35)))
    q = gripper_looking(slope)
    table = Table((0.0, 0.0, 1.0), float(hand_height(gripper_model, BELOW_CUBE, q)) - 0.02 - 0.005)
    assert hand_height(gripper_model, table, q).item() == pytest.approx(0.005, abs=1e-6)
    assert approach_height(gripper_model, table, q).item() < -0.02
    kept = keep_above(gripper_model, put(cube, table), as_grasps(gripper_model, q))
    assert len(kept) == 0
    assert kept.provenance["rejected"] == {IN_TABLE: 0, ON_THE_WAY: 1}


def test_the_way_to_a_grasp_is_never_higher_than_the_grasp(allegro: HandModel):
    q = random_hands(allegro, 8)
    way = approach_height(allegro, BELOW_CUBE, q)
    assert (way <= hand_height(allegro, BELOW_CUBE, q) + 1e-6).all()


def test_fingers_reach_the_top_and_the_upper_part_of_the_sides(cube: ObjectModel):
    reached = reachable(put(cube))
    z, up = cube.points[:, 2] + 0.02, cube.normals[:, 2]
    assert reached[up > 0.9].all()
    assert not reached[up < -0.9].any()
    side = up.abs() < 0.1
    assert torch.equal(reached[side], z[side] >= FINGER_RADIUS_M * (1 - up[side]))
    assert reachable(cube).all()
