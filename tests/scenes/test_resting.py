"""Objects come to rest on the sides that their centre of mass is above."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from gdg.errors import GdgError
from gdg.objects.model import ObjectModel, find_object
from gdg.rotations import random_rotations
from gdg.scenes.place import on_table
from gdg.scenes.resting import SAME_POSE_RAD, resting_poses

#: A body is tipped by this angle to see whether its centre of mass rises, rad.
TIP_RAD = 1e-3


@pytest.fixture(scope="module")
def like(cube: ObjectModel):
    """An object model with another mesh; all that resting poses look at is that mesh's."""

    def make(mesh: trimesh.Trimesh, name: str) -> ObjectModel:
        center = torch.as_tensor(mesh.center_mass, dtype=torch.float32)
        return replace(cube, mesh=mesh, center_of_mass=center, content_hash=name)

    return make


def heights(obj: ObjectModel, ups: np.ndarray) -> np.ndarray:
    """Height of the centre of mass above the table for each up, metres."""
    center = obj.center_of_mass.double().numpy()
    return -((obj.mesh.convex_hull.vertices - center) @ ups.T).min(0)


@given(st.tuples(*[st.integers(10, 60)] * 3))
@settings(max_examples=15)
def test_a_box_rests_on_a_face_and_mostly_on_its_largest(cube, sides: tuple[int, int, int]):
    mesh = trimesh.creation.box(np.array(sides) / 1000)
    obj = replace(cube, mesh=mesh, center_of_mass=torch.zeros(3), content_hash=f"box-{sides}")
    poses = resting_poses(obj)
    assert sum(pose.probability for pose in poses) == pytest.approx(1.0, abs=0.05)
    for pose in poses:
        axis = int(np.abs(pose.up).argmax())
        assert abs(pose.up[axis]) == pytest.approx(1.0, abs=1e-6)
        assert pose.offset == pytest.approx(-sides[axis] / 2000, abs=1e-6)
    # the table is nearest to the centre of mass in the likeliest pose
    assert -poses[0].offset == pytest.approx(min(sides) / 2000, abs=1e-6)


@pytest.mark.parametrize("name", ["mustard_bottle", "hammer", "mouse", "pyramid_medium"])
def test_tipping_an_object_at_rest_lifts_its_centre_of_mass(name: str):
    obj = find_object(name)
    tips = np.random.default_rng(0).normal(size=(200, 3))
    for pose in resting_poses(obj):
        tipped = pose.up + TIP_RAD * tips / np.linalg.norm(tips, axis=1, keepdims=True)
        tipped /= np.linalg.norm(tipped, axis=1, keepdims=True)
        assert heights(obj, tipped).min() >= heights(obj, pose.up[None])[0] - 1e-7


def test_the_object_stands_on_the_table_not_in_it():
    obj = on_table(find_object("banana"))
    assert obj.table is not None
    assert (obj.mesh.vertices @ obj.table.up).min() == pytest.approx(obj.table.offset, abs=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_poses_turn_with_the_object(like, seed: int):
    mesh = find_object("hammer").mesh
    R = random_rotations(1, torch.Generator().manual_seed(seed))[0].double().numpy()
    T = np.eye(4)
    T[:3, :3] = R
    before = resting_poses(like(mesh, "hammer"))
    after = resting_poses(like(mesh.copy().apply_transform(T), f"hammer-{seed}"))
    for pose in before:
        there = max(after, key=lambda other: other.up @ R @ pose.up)
        # of facets that count as one pose, either may stand for it
        assert there.up @ R @ pose.up > np.cos(SAME_POSE_RAD)
        assert there.probability == pytest.approx(pose.probability, abs=3e-3)
        assert there.offset == pytest.approx(pose.offset, abs=1e-4)


def test_equally_likely_poses_come_in_the_order_of_the_axes(cube: ObjectModel):
    ups = [pose.up.round(6).tolist() for pose in resting_poses(cube)]
    assert ups == [[0, 0, 1], [0, 1, 0], [1, 0, 0], [-1, 0, 0], [0, -1, 0], [0, 0, -1]]


def test_a_pose_that_there_is_not_is_refused_with_those_that_there_are(cube: ObjectModel):
    with pytest.raises(GdgError, match=r"scene_pose=6: 'cube_small' has .* poses 0 \(17 %\), 1"):
        on_table(cube, 6)


def test_a_balls_rare_poses_have_a_probability_that_is_not_zero():
    with pytest.raises(GdgError, match=r"'tennis_ball' has the resting poses 0 \(0\.\d+ %\)"):
        on_table(find_object("tennis_ball"), 1)
