"""Rotations are rotations, and every conversion has its inverse."""

from __future__ import annotations

import torch
from hypothesis import given
from hypothesis import strategies as st

from gdg.rotations import (
    ROOT_DIM,
    q_from_pose,
    random_rotations,
    root_pose,
    rot6d_from_rotation,
    rotation_from_quaternion,
    rotation_from_rot6d,
)

SEEDS = st.integers(0, 2**32)


def seeded(seed: int) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def assert_rotations(rotation: torch.Tensor) -> None:
    eye = torch.eye(3).expand_as(rotation)
    torch.testing.assert_close(rotation @ rotation.mT, eye, atol=1e-5, rtol=0)
    torch.testing.assert_close(
        torch.linalg.det(rotation), torch.ones(rotation.shape[:-2]), atol=1e-5, rtol=0
    )


@given(SEEDS)
def test_any_six_numbers_give_a_rotation(seed: int):
    assert_rotations(rotation_from_rot6d(torch.randn(16, 6, generator=seeded(seed))))


@given(SEEDS)
def test_rot6d_is_the_first_two_rows(seed: int):
    rotation = random_rotations(8, seeded(seed))
    rot6d = rot6d_from_rotation(rotation)
    assert torch.equal(rot6d[:, :3], rotation[:, 0])
    assert torch.equal(rot6d[:, 3:], rotation[:, 1])
    torch.testing.assert_close(rotation_from_rot6d(rot6d), rotation)


@given(SEEDS, st.floats(0.1, 10.0), st.floats(-3.0, 3.0))
def test_length_and_skew_of_the_six_numbers_do_not_matter(seed: int, length: float, skew: float):
    rot6d = rot6d_from_rotation(random_rotations(4, seeded(seed)))
    first, second = rot6d[:, :3], rot6d[:, 3:]
    changed = torch.cat((length * first, length * second + skew * first), dim=-1)
    torch.testing.assert_close(
        rotation_from_rot6d(changed), rotation_from_rot6d(rot6d), atol=1e-4, rtol=0
    )


@given(SEEDS)
def test_a_pose_vector_comes_back_from_its_pose(seed: int):
    generator = seeded(seed)
    q = torch.randn(5, ROOT_DIM + 3, generator=generator)
    q[:, 3:ROOT_DIM] = rot6d_from_rotation(random_rotations(5, generator))
    torch.testing.assert_close(q_from_pose(root_pose(q), q[:, ROOT_DIM:]), q)


def test_a_quaternion_is_wxyz_and_turns_right_handed():
    half = 0.5**0.5
    quarter_turn_about_z = rotation_from_quaternion(torch.tensor([half, 0.0, 0.0, half]))
    turned = quarter_turn_about_z @ torch.tensor([1.0, 0.0, 0.0])
    torch.testing.assert_close(turned, torch.tensor([0.0, 1.0, 0.0]))


def test_random_rotations_are_rotations_and_have_no_preferred_direction():
    rotation = random_rotations(20_000, seeded(0))
    assert_rotations(rotation)
    assert rotation.mean(0).abs().max() < 0.02


def test_the_same_seed_gives_the_same_rotations():
    assert torch.equal(random_rotations(3, seeded(1)), random_rotations(3, seeded(1)))


def test_empty_batches_and_any_batch_shape_work():
    assert root_pose(torch.zeros(0, 12)).shape == (0, 4, 4)
    assert rotation_from_rot6d(torch.randn(2, 3, 6)).shape == (2, 3, 3, 3)
    assert random_rotations(0, seeded(0)).shape == (0, 3, 3)


def test_the_gradient_of_a_pose_equals_finite_differences():
    q = torch.randn(1, 12, dtype=torch.float64, generator=seeded(2), requires_grad=True)
    assert torch.autograd.gradcheck(root_pose, q)
