"""Balanced contacts have no net wrench; lopsided ones do."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from gdg.force_closure import force_closure_error, net_wrench
from gdg.rotations import random_rotations

RADIUS = 0.05


def on_sphere(*directions: tuple[float, float, float]) -> tuple[Tensor, Tensor]:
    """Contacts of one grasp on a sphere of 50 mm: points and outward normals."""
    normals = torch.nn.functional.normalize(torch.tensor([directions]).float(), dim=-1)
    return RADIUS * normals, normals


def around(count: int) -> tuple[Tensor, Tensor]:
    angles = [2 * math.pi * k / count for k in range(count)]
    return on_sphere(*((math.cos(a), math.sin(a), 0.0) for a in angles))


def test_two_opposite_contacts_on_a_sphere_balance():
    assert force_closure_error(*on_sphere((1, 0, 0), (-1, 0, 0))).item() < 1e-5


@pytest.mark.parametrize("count", [3, 4, 5])
def test_evenly_spread_contacts_balance(count: int):
    assert force_closure_error(*around(count)).item() < 1e-5


def test_contacts_on_one_side_do_not_balance():
    assert force_closure_error(*on_sphere((1, 0.1, 0), (1, -0.1, 0))).item() > 0.9
    # two at a right angle: half of a force of √2
    error = force_closure_error(*on_sphere((1, 0, 0), (0, 1, 0))).item()
    assert error == pytest.approx(math.sqrt(2) / 2, abs=1e-5)


def test_a_missing_third_contact_is_noticed():
    points, normals = around(3)
    assert force_closure_error(points[:, :2], normals[:, :2]).item() == pytest.approx(0.5, abs=1e-5)


def test_offset_opposite_forces_are_a_torque_that_the_length_weighs():
    points = torch.tensor([[[0.05, 0.02, 0.0], [-0.05, -0.02, 0.0]]])
    normals = torch.tensor([[[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]])
    wrench = net_wrench(points, normals)[0]
    torch.testing.assert_close(wrench, torch.tensor([0.0, 0.0, 0.0, 0.0, 0.0, -0.02]))
    # in newton metres it goes unnoticed; per object radius it does not
    assert force_closure_error(points, normals).item() == pytest.approx(0.02, rel=1e-3)
    assert force_closure_error(points, normals, 0.05).item() == pytest.approx(0.4, rel=1e-3)


def test_the_error_does_not_grow_with_repeated_contacts():
    points, normals = on_sphere((1, 0, 0), (0, 1, 0))
    once = force_closure_error(points, normals, RADIUS)
    twice = force_closure_error(points.repeat(1, 2, 1), normals.repeat(1, 2, 1), RADIUS)
    torch.testing.assert_close(once, twice)


@given(st.integers(0, 1000))
def test_turning_everything_changes_nothing(seed: int):
    generator = torch.Generator().manual_seed(seed)
    points = 0.05 * torch.randn(3, 4, 3, generator=generator)
    normals = torch.nn.functional.normalize(torch.randn(3, 4, 3, generator=generator), dim=-1)
    R = random_rotations(1, generator)[0]
    before = force_closure_error(points, normals, RADIUS)
    after = force_closure_error(points @ R.T, normals @ R.T, RADIUS)
    torch.testing.assert_close(before, after, rtol=1e-4, atol=1e-5)
    assert torch.equal(before[:1], force_closure_error(points[:1], normals[:1], RADIUS))


def test_the_gradient_is_finite_at_zero():
    points, normals = on_sphere((1, 0, 0), (-1, 0, 0))
    points.requires_grad_(True)
    normals.requires_grad_(True)
    error = force_closure_error(points, normals, RADIUS)
    assert error.item() < 1e-5
    for gradient in torch.autograd.grad(error.sum(), (points, normals)):
        assert gradient.isfinite().all()


def test_the_gradient_leads_to_balance():
    points, normals = on_sphere((1, 0, 0), (0.2, 1, 0.1))
    free = normals.clone().requires_grad_(True)
    for _ in range(100):
        unit = torch.nn.functional.normalize(free, dim=-1)
        (gradient,) = torch.autograd.grad(
            force_closure_error(RADIUS * unit, unit, RADIUS).sum(), free
        )
        free = (free - 0.05 * gradient).detach().requires_grad_(True)
    unit = torch.nn.functional.normalize(free.detach(), dim=-1)
    assert force_closure_error(RADIUS * unit, unit, RADIUS).item() < 0.1
    assert force_closure_error(points, normals, RADIUS).item() > 0.5
