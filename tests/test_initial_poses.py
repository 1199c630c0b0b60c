"""Starts face the object from outside it, within limits, whatever the hand."""

from __future__ import annotations

import math

import pytest
import torch
from conftest import build_model
from hypothesis import example, given
from hypothesis import strategies as st
from torch import Tensor

from gdg.hands.hand import find_hand
from gdg.initial_poses import (
    LARGEST_CLOSURE,
    above_surface,
    around_sphere,
    facing,
    random_joints,
    rotation_between,
)
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel, find_object
from gdg.penetration import penetration_depth
from gdg.rotations import ROOT_DIM, random_rotations, root_pose

COUNT = 64


@pytest.fixture(scope="module", params=["barrett", "allegro", "two_jaws"])
def hand(request: pytest.FixtureRequest, gripper_model: HandModel) -> HandModel:
    return gripper_model if request.param == "two_jaws" else build_model(find_hand(request.param))


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def test_joints_start_between_open_and_half_closed(hand: HandModel):
    joints = random_joints(hand, 500, seeded())
    assert (joints >= hand.lower).all()
    assert (joints <= hand.upper).all()
    span = hand.closed_posture - hand.open_posture
    moving = span != 0
    share = ((joints - hand.open_posture) / span)[:, moving]
    assert (share.mean(0) - LARGEST_CLOSURE / 2).abs().max() < 0.1
    assert share.std(0).min() > 0.1


def test_facing_puts_the_palms_centre_where_it_is_told(hand: HandModel):
    joints, rotations = random_joints(hand, 5, seeded()), random_rotations(5, seeded())
    centers = 0.1 * torch.randn(5, 3, generator=seeded())
    q = facing(hand, joints, centers, rotations)
    torch.testing.assert_close(hand.palm(q)[0], centers, rtol=0, atol=1e-6)
    torch.testing.assert_close(root_pose(q)[:, :3, :3], rotations, rtol=0, atol=1e-5)


@pytest.mark.parametrize("factor", [1.0, 1.4])
def test_on_the_sphere_the_palm_looks_at_the_centre(
    hand: HandModel, cube: ObjectModel, factor: float
):
    center, normal = hand.palm(around_sphere(hand, cube, COUNT, seeded(), factor))
    torch.testing.assert_close(
        center.norm(dim=-1), torch.full((COUNT,), factor * cube.radius), rtol=0, atol=1e-5
    )
    towards = -torch.nn.functional.normalize(center, dim=-1)
    assert (normal * towards).sum(-1).min() > 0.9999
    # from all sides
    assert towards.mean(0).norm() < 0.4


def test_above_the_surface_the_palm_faces_the_object(hand: HandModel, cube: ObjectModel):
    center, normal = hand.palm(above_surface(hand, cube, COUNT, seeded(), tilt_rad=0.0))
    # straight below each palm lies the hull, between the smallest and the largest gap away
    distance = cube.sdf.distance(center)
    assert distance.min() > 0.02 - 0.001
    assert distance.max() < 0.08 + 0.001
    assert distance.std() > 0.01
    outward = cube.sdf.normals(center)
    assert (normal * -outward).sum(-1).median() > 0.95
    reached = cube.sdf.distance(center + distance[:, None] * normal)
    assert reached.abs().median() < 0.002


def test_tilt_turns_the_palm_by_about_what_was_asked(hand: HandModel, cube: ObjectModel):
    def angles(tilt_rad: float) -> Tensor:
        straight = hand.palm(above_surface(hand, cube, 128, seeded(), tilt_rad=0.0))[1]
        tilted = hand.palm(above_surface(hand, cube, 128, seeded(), tilt_rad=tilt_rad))[1]
        return (straight * tilted).sum(-1).clamp(-1, 1).acos()

    assert angles(0.0).max() < 0.01
    small, large = (angles(tilt).square().mean().sqrt().item() for tilt in (0.1, 0.3))
    assert small == pytest.approx(0.1 * 0.577 * math.sqrt(2), rel=0.2)
    assert 2 * small < large < 4 * small


@pytest.mark.parametrize("start", [around_sphere, above_surface])
def test_starts_are_within_limits_and_depend_on_the_generator_alone(start, hand, cube):
    first, again = start(hand, cube, 8, seeded()), start(hand, cube, 8, seeded())
    assert torch.equal(first, again)
    assert not torch.allclose(first, start(hand, cube, 8, seeded(1)))
    assert first.isfinite().all()
    joints = first[:, ROOT_DIM:]
    assert ((joints >= hand.lower) & (joints <= hand.upper)).all()
    R = root_pose(first)[:, :3, :3]
    torch.testing.assert_close(R @ R.mT, torch.eye(3).expand(8, 3, 3), rtol=0, atol=1e-5)


def test_the_next_starts_of_a_generator_are_others(hand: HandModel, cube: ObjectModel):
    generator = seeded()
    first = above_surface(hand, cube, 4, generator)
    assert not torch.allclose(first, above_surface(hand, cube, 4, generator))


@pytest.mark.parametrize("name", ["cube_small", "mug", "banana"])
def test_palms_start_outside_typical_objects(hand: HandModel, name: str):
    obj = find_object(name)
    center, _ = hand.palm(above_surface(hand, obj, COUNT, seeded()))
    assert obj.sdf.distance(center).min() > 0.015


def test_few_hands_penetrate_when_they_start_high_enough(hand: HandModel, cube: ObjectModel):
    q = above_surface(hand, cube, COUNT, seeded(), gap_m=(0.1, 0.15))
    share = (penetration_depth(hand, cube, q) > 0.001).float().mean().item()
    assert share < 0.2


unit = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: sum(x * x for x in v) > 0.01)


def assert_turns(source: Tensor, target: Tensor) -> None:
    R = rotation_between(source, target)
    torch.testing.assert_close(R @ R.mT, torch.eye(3).expand_as(R), rtol=0, atol=1e-5)
    assert (torch.linalg.det(R) - 1).abs().max() < 1e-5
    assert ((R @ source[..., None])[..., 0] * target).sum(-1).min() > 1 - 2e-6


@given(unit, unit)
@example((1, 0, 0), (0, 1, 0))
@example((1, 0, 0), (1, 0, 0))
@example((1, 0, 0), (-1, 0, 0))
@example((0, 1, 0), (0, -1, 0))
@example((0, 0, 1), (0, 0, -1))
@example((1, 0, 0), (-1, 0.014, 0))
@example((1, 0, 0), (-1, 0.015, 0))
def test_the_rotation_between_vectors_turns_one_to_the_other(
    source: tuple[float, ...], target: tuple[float, ...]
):
    pair = torch.nn.functional.normalize(torch.tensor([source, target]).float(), dim=-1)
    assert_turns(pair[:1], pair[1:])


def test_every_vector_can_be_turned_to_its_opposite():
    source = torch.nn.functional.normalize(torch.randn(20000, 3, generator=seeded()), dim=-1)
    # these are parallel to (x3, x1, x2) + (0.3, 0.1, 0.7), an axis once chosen as arbitrary
    parallel = torch.tensor(
        [[-0.3652307, -0.8326252, -0.4163434], [0.5964907, 0.4230264, 0.6820906]]
    )
    for vectors in (source, torch.eye(3), parallel):
        assert_turns(vectors, -vectors)


def test_the_rotation_is_about_the_common_normal():
    a, b = torch.tensor([[1.0, 0.0, 0.0]]), torch.tensor([[0.0, 1.0, 0.0]])
    R = rotation_between(a, b)[0]
    torch.testing.assert_close(R @ torch.tensor([0.0, 0.0, 1.0]), torch.tensor([0.0, 0.0, 1.0]))
