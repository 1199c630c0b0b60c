"""Contacts that can be predicted, and what holds of all of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from measured_grasps import HALF_CUBE_M, around_the_cube, closed_on

from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel, find_object, load_object
from gdg.quality.contact_points import (
    LEAST_SPACING_M,
    MAX_PER_LINK,
    _on_surface,
    find_contacts,
)


def test_a_jaw_touches_a_cube_at_four_far_corners(gripper_model: HandModel, cube: ObjectModel):
    contacts = find_contacts(gripper_model, cube, around_the_cube(gripper_model, cube, [0.5]))
    assert sorted(contacts.links) == ["left"] * 4 + ["right"] * 4
    torch.testing.assert_close(contacts.gaps, torch.full((8,), 5e-4), rtol=0, atol=1e-5)
    side = torch.tensor([1.0 if link == "left" else -1.0 for link in contacts.links])
    torch.testing.assert_close(contacts.points[:, 1], HALF_CUBE_M * side, rtol=0, atol=1e-6)
    torch.testing.assert_close(contacts.normals[:, 1], side, rtol=0, atol=1e-3)
    for jaw in (contacts.points[side > 0], contacts.points[side < 0]):
        spread = jaw.amax(0) - jaw.amin(0)
        assert spread[0] > 0.02  # of a jaw 30 mm wide
        assert spread[2] > 0.028  # of a cube 40 mm high


@pytest.mark.parametrize(("gap_mm", "touches"), [(1.9, True), (2.1, False), (-1.0, True)])
def test_contacts_are_what_is_within_reach(
    gripper_model: HandModel, cube: ObjectModel, gap_mm: float, touches: bool
):
    contacts = find_contacts(gripper_model, cube, around_the_cube(gripper_model, cube, [gap_mm]))
    assert (len(contacts.links) > 0) == touches
    assert contacts.gaps.tolist() == pytest.approx([gap_mm / 1000] * len(contacts.gaps), abs=1e-5)


def test_a_longer_reach_finds_more(gripper_model: HandModel, cube: ObjectModel):
    grasps = around_the_cube(gripper_model, cube, [3.0])
    assert find_contacts(gripper_model, cube, grasps).counts.tolist() == [0]
    assert find_contacts(gripper_model, cube, grasps, reach_m=0.004).counts.tolist() == [8]


def test_a_pad_on_a_ball_has_one_contact(gripper_model: HandModel):
    ball = find_object("tennis_ball")
    grasps = around_the_cube(gripper_model, ball, [0.0])
    width = ball.mesh.bounds[:, 1]
    joints = torch.tensor([[0.05 - float(width[1]) - 0.0003]])
    contacts = find_contacts(gripper_model, ball, replace(grasps, joints=joints))
    left = [k for k, link in enumerate(contacts.links) if link == "left"]
    assert len(left) == 1
    assert contacts.gaps[left].item() == pytest.approx(0.0003, abs=1e-4)
    # nearest at the ball's side, which no sample of the pad needs to lie on
    assert contacts.points[left[0], 1].item() == pytest.approx(float(width[1]), abs=2e-4)


@pytest.mark.parametrize("name", ["allegro", "shadowhand", "barrett"])
def test_contacts_of_real_hands_lie_on_the_object(name: str):
    obj = find_object("mug")
    hand, grasps = closed_on(name, obj, 8)
    contacts = find_contacts(hand, obj, grasps)
    assert int(contacts.counts.sum()) == len(contacts.links) > 8
    assert obj.sdf.distance(contacts.points).abs().max() < 5e-4
    torch.testing.assert_close(contacts.normals.norm(dim=-1), torch.ones(len(contacts.links)))
    assert contacts.gaps.max() <= 0.002
    for index in range(len(grasps)):
        rows = contacts.rows(index)
        for link in set(contacts.links[rows]):
            at = torch.tensor([name == link for name in contacts.links[rows]])
            points = contacts.points[rows][at]
            assert len(points) <= MAX_PER_LINK
            apart = torch.cdist(points, points) + torch.eye(len(points))
            assert apart.min() >= LEAST_SPACING_M - 1e-6


def test_every_grasp_is_found_alone_as_in_a_batch():
    obj = find_object("mug")
    hand, grasps = closed_on("barrett", obj, 4)
    together = find_contacts(hand, obj, grasps)
    for index in range(4):
        alone = find_contacts(hand, obj, grasps.select([index]))
        assert alone.links == together.links[together.rows(index)]
        torch.testing.assert_close(
            alone.points, together.points[together.rows(index)], rtol=0, atol=1e-5
        )


def test_a_grasp_that_is_not_finite_has_no_contacts(gripper_model: HandModel, cube: ObjectModel):
    grasps = around_the_cube(gripper_model, cube, [0.5, 0.5])
    poses = grasps.poses.clone()
    poses[0, 0, 3] = torch.nan
    contacts = find_contacts(gripper_model, cube, replace(grasps, poses=poses))
    assert contacts.counts.tolist() == [0, 8]
    none = find_contacts(gripper_model, cube, grasps.select([]))
    assert (len(none), none.points.shape) == (0, (0, 3))


def test_near_sharp_edges_the_outside_is_outside(tmp_path: Path):
    # at an edge of less than 90 degrees a point can lie behind one face and outside all the same
    cone = trimesh.creation.cone(0.02, 0.06, sections=12)
    cone.export(tmp_path / "cone.stl")
    obj = load_object(tmp_path / "cone.stl", "cone")
    rng = np.random.default_rng(0)
    vertices = obj.mesh.vertices[rng.integers(len(obj.mesh.vertices), size=4000)]
    points = vertices + rng.normal(scale=0.002, size=vertices.shape)
    nearest, normals, gaps = _on_surface(obj, points)
    inside = trimesh.proximity.signed_distance(obj.mesh, points) > 0
    clear = np.abs(gaps) > 1e-5
    assert np.array_equal(gaps[clear] < 0, inside[clear])
    outward = np.einsum("ij,ij->i", points - nearest, normals)
    assert (outward[clear & ~inside] > 0).all()
