"""Every stored form of a rotation gives the rotation back, at the poles of Euler angles too."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gdg.data.layouts.rotations import (
    columns_from_rotation,
    nearest_rotation,
    quaternion_from_rotation,
    rotation_from_columns,
    rotation_from_moving_xyz,
    rotation_from_quaternion,
    rotation_from_sxyz,
    sxyz_from_rotation,
)

ANGLE = st.floats(-math.pi, math.pi)
#: Exactly at a pole, a hair beside it, and anywhere.
PITCH = st.one_of(
    st.sampled_from((math.pi / 2, -math.pi / 2)),
    st.floats(-1e-3, 1e-3).map(lambda d: math.pi / 2 + d),
    st.floats(-1e-7, 1e-7).map(lambda d: -math.pi / 2 + d),
    ANGLE,
)
ANGLES = st.tuples(ANGLE, PITCH, ANGLE)


def in_float32(rotation: np.ndarray) -> np.ndarray:
    """As a grasp set holds it."""
    return rotation.astype(np.float32).astype(np.float64)


@given(ANGLES)
def test_euler_angles_give_the_rotation_back(angles: tuple[float, float, float]) -> None:
    rotation = in_float32(rotation_from_sxyz(np.array(angles)))
    again = rotation_from_sxyz(sxyz_from_rotation(rotation))
    np.testing.assert_allclose(again, rotation, atol=3e-7)


@given(ANGLES)
def test_six_numbers_give_the_rotation_back(angles: tuple[float, float, float]) -> None:
    rotation = in_float32(rotation_from_sxyz(np.array(angles)))
    stored = columns_from_rotation(rotation).astype(np.float32).astype(np.float64)
    np.testing.assert_allclose(rotation_from_columns(stored), rotation, atol=3e-7)


@given(ANGLES)
def test_quaternions_give_the_rotation_back(angles: tuple[float, float, float]) -> None:
    rotation = in_float32(rotation_from_sxyz(np.array(angles)))
    quaternion = quaternion_from_rotation(rotation).astype(np.float32)
    assert quaternion[0] >= 0
    assert np.linalg.norm(quaternion) == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(rotation_from_quaternion(quaternion), rotation, atol=5e-7)


@given(ANGLES)
def test_angle_conventions_are_those_of_scipy(angles: tuple[float, float, float]) -> None:
    fixed = Rotation.from_euler("xyz", angles).as_matrix()
    moving = Rotation.from_euler("XYZ", angles).as_matrix()
    np.testing.assert_allclose(rotation_from_sxyz(np.array(angles)), fixed, atol=1e-12)
    np.testing.assert_allclose(rotation_from_moving_xyz(np.array(angles)), moving, atol=1e-12)


def test_six_numbers_are_the_first_two_columns() -> None:
    rotation = Rotation.from_euler("xyz", (0.3, -0.7, 1.1)).as_matrix()
    np.testing.assert_array_equal(columns_from_rotation(rotation)[:3], rotation[:, 0])
    np.testing.assert_array_equal(columns_from_rotation(rotation)[3:], rotation[:, 1])


def test_columns_that_are_not_orthogonal_are_mended_symmetrically() -> None:
    first, second = np.array([1.0, 0.1, 0.0]), np.array([0.1, 1.0, 0.0])
    rotation = rotation_from_columns(3.0 * np.concatenate((first, second)))
    np.testing.assert_allclose(rotation, np.eye(3), atol=1e-12)


def test_columns_without_a_direction_give_no_number() -> None:
    assert not np.isfinite(rotation_from_columns(np.zeros(6))).any()


def test_angles_of_a_batch_are_those_of_each() -> None:
    rotation = Rotation.random(20, random_state=0).as_matrix()
    singly = np.stack([sxyz_from_rotation(matrix) for matrix in rotation])
    np.testing.assert_allclose(sxyz_from_rotation(rotation), singly, atol=1e-12)
    np.testing.assert_allclose(nearest_rotation(rotation), rotation, atol=1e-12)
