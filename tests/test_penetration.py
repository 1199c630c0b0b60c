"""Penetration is the depth that can be measured, and thin walls are seen."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
import trimesh
from conftest import build_model
from gripper import OPEN_M
from torch import Tensor

from gdg.geometry.sdf_stack import SdfStack
from gdg.hands.hand import Hand, find_hand
from gdg.initial_poses import above_surface
from gdg.kinds.hand_model import HandModel
from gdg.objects.batch import ObjectBatch
from gdg.objects.model import ObjectModel, find_object, load_object
from gdg.penetration import (
    eager,
    nearest_point_penetration,
    penetration,
    penetration_depth,
    self_penetration,
)
from gdg.penetration.touching import crossing_pairs, touching_links
from gdg.rotations import ROOT_DIM, q_from_pose

#: Half the edge of the bundled cube, metres.
HALF_M = 0.02


def pose(close: float, x: float = 0.0, z: float = -0.035) -> Tensor:
    """The gripper around the origin: the jaws reach from 30 mm below to 30 mm above it."""
    T = torch.eye(4)[None].clone()
    T[0, 0, 3], T[0, 2, 3] = x, z
    return q_from_pose(T, torch.tensor([[close]]))


def save(mesh: trimesh.Trimesh, folder: Path) -> ObjectModel:
    mesh.export(folder / "object.stl")
    return load_object(folder / "object.stl", "object")


@pytest.fixture(scope="module")
def slab(tmp_path_factory: pytest.TempPathFactory) -> ObjectModel:
    """A wide box whose top is a plane at z = 0, as far as a point near its middle can tell."""
    mesh = trimesh.creation.box((0.3, 0.3, 0.1))
    mesh.apply_translation((0, 0, -0.05))
    return save(mesh, tmp_path_factory.mktemp("slab"))


@pytest.fixture(scope="module")
def wall(tmp_path_factory: pytest.TempPathFactory) -> ObjectModel:
    """A wall of 1.6 mm in the plane y = 0, thin like a cup's."""
    return save(trimesh.creation.box((0.06, 0.0016, 0.06)), tmp_path_factory.mktemp("wall"))


def test_a_hand_far_away_does_not_penetrate(gripper_model: HandModel, cube: ObjectModel):
    found = penetration(gripper_model, cube, gripper_model.link_poses(pose(0.0, x=0.5)))
    assert found.summed.item() == 0
    assert found.depth.item() == 0


def test_touching_jaws_do_not_penetrate(gripper_model: HandModel, cube: ObjectModel):
    assert penetration_depth(gripper_model, cube, pose(OPEN_M - HALF_M)).item() < 1e-4


@pytest.mark.parametrize("depth_m", [0.001, 0.003, 0.006])
def test_jaws_inside_a_cube_are_as_deep_as_they_are(
    gripper_model: HandModel, cube: ObjectModel, depth_m: float
):
    q = pose(OPEN_M - HALF_M + depth_m)
    assert penetration_depth(gripper_model, cube, q).item() == pytest.approx(depth_m, abs=2e-4)


def test_penetration_is_per_batch_element_and_grows_with_depth(
    gripper_model: HandModel, cube: ObjectModel
):
    q = torch.cat([pose(OPEN_M - HALF_M + depth) for depth in (-0.002, 0.001, 0.004)])
    together = penetration(gripper_model, cube, gripper_model.link_poses(q))
    assert together.summed[0] == 0
    assert together.summed[1] < together.summed[2]
    for row in range(3):
        alone = penetration(gripper_model, cube, gripper_model.link_poses(q[row : row + 1]))
        torch.testing.assert_close(alone.summed[0], together.summed[row], rtol=1e-4, atol=1e-7)
        torch.testing.assert_close(alone.depth[0], together.depth[row], rtol=1e-4, atol=1e-7)


def test_a_thin_wall_through_a_jaw_is_seen(gripper_model: HandModel, wall: ObjectModel):
    # the wall stands in the middle of the left jaw, which is 10 mm thick
    q = pose(OPEN_M + 0.005)
    points = gripper_model.surface_points(q)
    inside_by_points = torch.relu(-wall.sdf.distance(points)).amax().item()
    depth = penetration_depth(gripper_model, wall, q).item()
    assert inside_by_points < 0.001
    assert depth > 0.003


def test_gradients_open_jaws_that_penetrate(gripper_model: HandModel, cube: ObjectModel):
    q = pose(OPEN_M - HALF_M + 0.003).requires_grad_(True)
    found = penetration(gripper_model, cube, gripper_model.link_poses(q))
    (gradient,) = torch.autograd.grad(found.summed.sum(), q)
    assert gradient.isfinite().all()
    assert gradient[0, -1] > 1


def test_the_stride_keeps_the_sums_size(gripper: Hand, cube: ObjectModel):
    hand = build_model(gripper, points=2000)
    poses = hand.link_poses(pose(OPEN_M - HALF_M + 0.005))
    sums = [penetration(hand, cube, poses, stride).summed.item() for stride in (1, 4)]
    fewest = penetration(hand, cube, poses, stride=2000).summed.item()
    assert sums[1] == pytest.approx(sums[0], rel=0.25)
    assert fewest != pytest.approx(sums[0], rel=0.25)


@pytest.mark.parametrize("depth_m", [0.005, 0.02])
def test_nearest_point_form_is_the_depth_below_a_plane(slab: ObjectModel, depth_m: float):
    hand = torch.tensor([[[0.0, 0.0, -depth_m], [0.02, 0.01, 0.03]]])
    found = nearest_point_penetration(slab, hand).item()
    # the nearest sampled point lies up to a sampling distance aside
    spacing = 0.5 * math.sqrt(slab.mesh.area / len(slab.points))
    assert depth_m / 2 <= found <= math.hypot(depth_m, 3 * spacing) / 2


def test_nearest_point_form_is_zero_outside(slab: ObjectModel):
    hand = torch.tensor([[[0.0, 0.0, 0.005], [0.02, 0.01, 0.03], [0.0, 0.0, 0.2]]])
    assert nearest_point_penetration(slab, hand).item() == 0


def test_nearest_point_form_is_that_of_all_pairs(slab: ObjectModel):
    hand = 0.05 * torch.randn(3, 200, 3, generator=torch.Generator().manual_seed(0))
    nearest = torch.cdist(hand, slab.points[None].expand(3, -1, -1)).argmin(-1)
    way = slab.points[nearest] - hand
    inside = (way * slab.normals[nearest]).sum(-1) > 0
    expected = (way.norm(dim=-1) * inside).mean(-1)
    torch.testing.assert_close(nearest_point_penetration(slab, hand), expected)
    hand[1, 7] = torch.nan  # a hand that diverged spoils no other
    found = nearest_point_penetration(slab, hand)
    torch.testing.assert_close(found[[0, 2]], expected[[0, 2]])


def test_nearest_point_form_pulls_points_out(slab: ObjectModel):
    hand = torch.tensor([[[0.0, 0.0, -0.02], [0.0, 0.0, 0.02]]], requires_grad=True)
    (gradient,) = torch.autograd.grad(nearest_point_penetration(slab, hand).sum(), hand)
    assert gradient[0, 0, 2] < -0.4
    assert gradient[0, 1].abs().max() == 0


# -- compiled and eager ------------------------------------------------------------------------


def scattered(hand: HandModel, obj: ObjectModel, count: int = 32) -> Tensor:
    """Link poses in, at and around an object, joints anywhere in their ranges."""
    generator = torch.Generator().manual_seed(0)
    q = above_surface(hand, obj, count, generator, gap_m=(-0.06, 0.06))
    share = torch.rand(count, len(hand.lower), generator=generator)
    q[:, ROOT_DIM:] = hand.lower + share * (hand.upper - hand.lower)
    q[0, 0] += 0.5  # out of the grid of distances
    return hand.link_poses(q)


def value_and_gradient(energy: Callable[[Tensor], Tensor], Ts: Tensor) -> tuple[Tensor, Tensor]:
    Ts = Ts.clone().requires_grad_(True)
    value = energy(Ts)
    return value.detach(), torch.autograd.grad(value.sum(), Ts)[0]


@pytest.mark.parametrize("name", ["allegro", "barrett"])
@pytest.mark.parametrize(("stride", "margin_m"), [(1, 0.0), (4, 0.0), (1, 0.003)])
def test_compiled_penetration_is_the_eager_one(name: str, stride: int, margin_m: float):
    hand, mug = build_model(find_hand(name)), find_object("mug")
    Ts = scattered(hand, mug)
    fast = value_and_gradient(lambda T: penetration(hand, mug, T, stride, margin_m).summed, Ts)
    slow = value_and_gradient(
        lambda T: eager.object_penetration(hand, mug.sdf, T, stride, margin_m)[0], Ts
    )
    assert slow[0].max() > 0.02
    torch.testing.assert_close(fast[0], slow[0], rtol=1e-5, atol=1e-6)
    torch.testing.assert_close(fast[1], slow[1], rtol=1e-4, atol=1e-3)
    depth = eager.object_penetration(hand, mug.sdf, Ts, stride, margin_m)[1]
    found = penetration(hand, mug, Ts, stride, margin_m).depth
    torch.testing.assert_close(found, depth, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("name", ["allegro", "shadowhand", "ezgripper"])
def test_compiled_self_penetration_is_the_eager_one(name: str):
    hand = build_model(find_hand(name))
    Ts = scattered(hand, find_object("mug"))
    fast = value_and_gradient(lambda T: self_penetration(hand, T), Ts)
    slow = value_and_gradient(lambda T: eager.self_penetration(hand, T), Ts)
    assert slow[0].max() > 0.01
    # the eager one subtracts squares, which rounds by up to 0.1 mm per touching pair
    torch.testing.assert_close(fast[0], slow[0], rtol=1e-3, atol=1e-4)
    torch.testing.assert_close(fast[1], slow[1], rtol=0.02, atol=0.02)


def test_a_pose_that_is_not_finite_gives_nan_and_spoils_no_other(
    gripper_model: HandModel, cube: ObjectModel
):
    good = gripper_model.link_poses(torch.cat([pose(OPEN_M - HALF_M + 0.004)] * 3))
    for bad in (math.nan, math.inf):
        Ts = good.clone()
        Ts[1, 0, 0, 3] = bad
        for found, wanted in (
            (penetration(gripper_model, cube, Ts).summed,
             penetration(gripper_model, cube, good).summed),
            (self_penetration(gripper_model, Ts), self_penetration(gripper_model, good)),
        ):  # fmt: skip
            assert found[1].isnan()
            assert torch.equal(found[[0, 2]], wanted[[0, 2]])


# -- several objects ---------------------------------------------------------------------------


def test_each_of_several_objects_is_penetrated_by_its_own_hands(
    gripper_model: HandModel, cube: ObjectModel, wall: ObjectModel
):
    objects = (cube, wall, cube)
    Ts = torch.cat([scattered(gripper_model, obj, 8) for obj in objects])
    together = value_and_gradient(
        lambda T: penetration(gripper_model, ObjectBatch(objects), T).summed, Ts
    )
    alone = [
        value_and_gradient(lambda T, obj=obj: penetration(gripper_model, obj, T).summed, part)
        for obj, part in zip(objects, Ts.chunk(3))
    ]
    assert together[0].max() > 0.01
    for part in (0, 1):
        assert torch.equal(together[part], torch.cat([found[part] for found in alone]))
    # as on a GPU
    stack = SdfStack(tuple(obj.sdf for obj in objects), padded=True)
    padded = value_and_gradient(
        lambda T: eager.object_penetration(gripper_model, stack, T, 1)[0], Ts
    )
    torch.testing.assert_close(padded[0], together[0], rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(padded[1], together[1], rtol=1e-3, atol=5e-3)


@pytest.mark.parametrize("name", ["allegro", "shadowhand"])
def test_compiled_touching_and_crossing_are_the_eager_ones(name: str):
    hand, mug = build_model(find_hand(name)), find_object("mug")
    Ts = scattered(hand, mug)
    touching, crossing = touching_links(hand, mug, Ts), crossing_pairs(hand, Ts)
    assert touching.any()
    assert not touching.all()
    assert crossing.any()
    assert torch.equal(touching, eager.touching_links(hand, mug.sdf, Ts, 0.0))
    near = touching_links(hand, mug, Ts, 0.004)
    assert near.sum() > touching.sum()
    assert torch.equal(near, eager.touching_links(hand, mug.sdf, Ts, 0.004))
    assert torch.equal(crossing, eager.crossing_pairs(hand, Ts))
    # summed overlap is positive where any pair crosses, and only there
    assert torch.equal(crossing.any(-1), self_penetration(hand, Ts) > 0)
