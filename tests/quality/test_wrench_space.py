"""Measures of the wrench space against cases worked out by hand, and what must not change them."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from gdg.quality.wrench_space import contact_wrenches, force_closure_margin, wrench_space

#: The six points of a unit sphere on the axes; outward normals there are the same.
AXES = np.concatenate((np.eye(3), -np.eye(3)))


def random_contacts(seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    points, normals = rng.normal(size=(2, count, 3))
    return 0.05 * points, normals / np.linalg.norm(normals, axis=-1, keepdims=True)


@pytest.mark.parametrize("friction", [0.2, 0.5, 0.9])
def test_six_contacts_on_a_sphere_with_four_edges(friction: float):
    # least resisted is the torque (1, 1, 1)/√3: every edge has a lever in one of its parts alone
    space = wrench_space(AXES, AXES, 1.0, friction, edges=4)
    assert space.epsilon == pytest.approx(friction / math.sqrt(3), rel=1e-6)
    assert space.residual == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("friction", [0.2, 0.5, 0.9])
def test_six_contacts_on_a_sphere_with_eight_edges(friction: float):
    # the same torque; edges between the axes have levers in two of its parts, √(2/3) together
    epsilon = wrench_space(AXES, AXES, 1.0, friction).epsilon
    assert epsilon == pytest.approx(friction * math.sqrt(2 / 3), rel=1e-6)


def test_no_ball_larger_than_epsilon_fits():
    normals = AXES + 0.3 * np.random.default_rng(1).normal(size=AXES.shape)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    space, wrenches = wrench_space(AXES, normals, 1.0), contact_wrenches(AXES, normals, 1.0)
    directions = np.random.default_rng(0).normal(size=(20_000, 6))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    reached = (directions @ wrenches.T).max(-1)
    assert space.epsilon > 0
    assert space.epsilon <= reached.min() < 5 * space.epsilon


@pytest.mark.parametrize("friction", [0.0, 0.5, 5.0])
def test_two_opposite_contacts_resist_no_torque_about_their_line(friction: float):
    space = wrench_space(AXES[[0, 3]], AXES[[0, 3]], 1.0, friction)
    assert (space.epsilon, space.volume) == (0.0, 0.0)
    assert space.residual == pytest.approx(0.0, abs=1e-12)


def test_without_friction_a_sphere_can_be_turned():
    space = wrench_space(AXES, AXES, 1.0, friction=0.0)
    assert (space.epsilon, space.volume) == (0.0, 0.0)
    assert space.residual == pytest.approx(0.0, abs=1e-12)


def test_residuals_of_unbalanced_contacts():
    assert wrench_space(AXES[:1], AXES[:1], 1.0).residual == pytest.approx(1.0)
    # half of a force of √2, and with friction that turns both by up to atan(0.5)
    right_angle = AXES[:2]
    assert wrench_space(right_angle, right_angle, 1.0, 0.0).residual == pytest.approx(
        math.sqrt(2) / 2
    )
    assert 0 < wrench_space(right_angle, right_angle, 1.0, 0.5).residual < 0.6


def test_the_margin_is_the_residual_outside_and_hardly_more_than_epsilon_inside():
    ratios = []
    for seed in range(60):
        contacts = random_contacts(seed, 4 + seed % 8)
        space, margin = wrench_space(*contacts, 0.1), force_closure_margin(*contacts, 0.1)
        if space.residual > 1e-6:
            assert margin == -space.residual
        else:
            assert margin >= space.epsilon - 1e-9
            ratios.append(margin / space.epsilon)
    assert len(ratios) > 20
    assert np.mean(ratios) < 1.15


def test_the_margin_of_a_flat_space_is_zero_and_unknown_without_contacts():
    assert force_closure_margin(AXES[[0, 3]], AXES[[0, 3]], 1.0) == 0.0
    assert math.isnan(force_closure_margin(AXES[:0], AXES[:0], 1.0))


def test_without_contacts_there_is_nothing_to_measure():
    space = wrench_space(np.zeros((0, 3)), np.zeros((0, 3)), 0.1)
    assert (space.epsilon, space.volume) == (0.0, 0.0)
    assert math.isnan(space.residual)


@pytest.mark.parametrize("count", [1, 2, 3, 20])
def test_contacts_at_one_place_are_no_grasp(count: int):
    points, normals = AXES[:1].repeat(count, 0), AXES[:1].repeat(count, 0)
    space = wrench_space(points, normals, 1.0)
    assert (space.epsilon, space.volume) == (0.0, 0.0)
    assert space.residual == pytest.approx(1.0)


def test_the_volume_of_a_flat_arrangement_is_zero():
    angles = np.arange(5) * 2 * np.pi / 5
    ring = np.stack((np.cos(angles), np.sin(angles), 0 * angles), -1)
    assert wrench_space(ring, ring, 1.0, friction=0.0).volume == 0.0
    assert wrench_space(ring, ring, 1.0, friction=0.5).volume > 0.0


@given(st.integers(0, 10_000), st.integers(2, 6))
def test_the_residual_is_zero_where_the_forces_can_balance(seed: int, count: int):
    points, normals = random_contacts(seed, count)
    space = wrench_space(points, normals, 0.1, friction=1.0)
    wrenches = contact_wrenches(points, normals, 0.1, friction=1.0)
    system = np.concatenate((wrenches.T, np.ones((1, len(wrenches)))))
    balanced = linprog(np.zeros(len(wrenches)), A_eq=system, b_eq=np.eye(7)[6]).status == 0
    assert (space.residual < 1e-6) == balanced
    if space.epsilon > 1e-9:
        assert balanced


@given(st.integers(0, 10_000))
def test_turning_everything_changes_nothing(seed: int):
    points, normals = random_contacts(seed, 5)
    R = Rotation.random(None, np.random.default_rng(seed)).as_matrix()
    before = wrench_space(points, normals, 0.1)
    after = wrench_space(points @ R.T, normals @ R.T, 0.1)
    for name in ("epsilon", "volume", "residual"):
        assert getattr(after, name) == pytest.approx(getattr(before, name), rel=1e-5, abs=1e-8)


@given(st.integers(0, 10_000), st.floats(0.01, 100))
def test_scaling_everything_changes_nothing(seed: int, scale: float):
    points, normals = random_contacts(seed, 5)
    before = wrench_space(points, normals, 0.1)
    after = wrench_space(scale * points, normals, scale * 0.1)
    for name in ("epsilon", "volume", "residual"):
        assert getattr(after, name) == pytest.approx(getattr(before, name), rel=1e-5, abs=1e-8)


@given(st.integers(0, 10_000))
@settings(max_examples=20)
def test_more_friction_and_more_contacts_never_hurt(seed: int):
    points, normals = random_contacts(seed, 6)
    spaces = [wrench_space(points, normals, 0.1, friction) for friction in (0.2, 0.5, 1.0)]
    spaces_by_count = [wrench_space(points[:n], normals[:n], 0.1) for n in (4, 5, 6)]
    for steps in (spaces, spaces_by_count[1:]):
        for less, more in pairwise(steps):
            assert more.epsilon >= less.epsilon - 1e-9
            assert more.volume >= less.volume - 1e-12
            assert more.residual <= less.residual + 1e-9
