"""The distance is what its docstring says."""

from __future__ import annotations

import torch
from gdg_acme.huber import HuberDistance
from gdg_acme.options import HuberOptions

from gdg.contact_maps import in_distance
from gdg.data.contact_map import ContactMap

UP = torch.tensor([[0.0, 0.0, 1.0]])


def to_point(distance: HuberDistance, *point: float) -> float:
    """Distance of one hand point to an object point at the origin that faces up."""
    hand = torch.tensor([[point]])
    return float(distance.to_hand(torch.zeros(1, 3), UP, hand).distance)


def test_it_is_flat_at_contact_and_linear_far_away():
    gap = torch.tensor([0.0, 0.05], requires_grad=True)
    distance = HuberDistance(HuberOptions(knee=0.001)).of_gap(gap)
    (slope,) = torch.autograd.grad(distance.sum(), gap)
    torch.testing.assert_close(slope, torch.tensor([0.0, 1.0]), atol=1e-3, rtol=0)


def test_behind_the_surface_is_farther_than_in_front():
    aligned = HuberDistance(HuberOptions())
    assert to_point(aligned, 0, 0, -0.002) > 10 * to_point(aligned, 0, 0, 0.002)
    both_sides = HuberDistance(HuberOptions(gamma=0))
    assert abs(to_point(both_sides, 0, 0, -0.002) - to_point(both_sides, 0, 0, 0.002)) < 1e-6


def test_the_contact_value_falls_to_1_over_e_at_the_reach():
    distance = HuberDistance(HuberOptions(reach=0.02))
    value = distance.contact_value(torch.tensor([0.02]))
    torch.testing.assert_close(value, torch.tensor([0.36788]), rtol=1e-4, atol=0)


def test_maps_of_other_options_are_rewritten():
    gaps = torch.tensor([[0.0005, 0.002, 0.01]])
    source = HuberDistance(HuberOptions(knee=0.00005, reach=0.03, gamma=0.5))
    target = HuberDistance(HuberOptions())
    maps = ContactMap("apple", source.contact_value(source.of_gap(gaps)), source.label)
    expected = target.contact_value(target.of_gap(gaps))
    torch.testing.assert_close(in_distance(maps, target), expected, rtol=1e-3, atol=0)
