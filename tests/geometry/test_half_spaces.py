"""Half-spaces of convex meshes against points and rays that can be worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from gdg.geometry.half_spaces import half_spaces

BOX = trimesh.creation.box((0.2, 0.4, 0.6))
BALL = trimesh.creation.icosphere(2, radius=0.1)
UP = np.array([0.0, 0.0, 1.0])

coordinates = st.floats(-0.15, 0.15)


def test_heights_are_distances_from_the_planes():
    faces = half_spaces(BOX)
    heights = faces.heights(np.array([[0.0, 0.0, 0.0], [0.15, 0.0, 0.0]]))
    assert heights.shape == (2, 12)
    assert heights[0].max() == pytest.approx(-0.1)
    assert heights[1].max() == pytest.approx(0.05)


def test_a_ray_crosses_a_box_where_its_faces_are():
    found = half_spaces(BOX).crossings(np.array([[0.05, 0.1, 1.0], [0.11, 0.0, 0.0]]), UP)
    assert found.entry[0] == pytest.approx(-1.3)
    assert found.exit[0] == pytest.approx(-0.7)
    assert found.facing[0] == pytest.approx(1.0)
    assert np.isnan([found.entry[1], found.exit[1]]).all()


@given(st.tuples(coordinates, coordinates), st.integers(0, 1000))
def test_crossings_lie_on_the_surface_or_the_ray_misses(offset: tuple[float, float], seed: int):
    direction = np.random.default_rng(seed).normal(size=3)
    direction /= np.linalg.norm(direction)
    across = np.cross(direction, np.eye(3)[np.abs(direction).argmin()])
    across /= np.linalg.norm(across)
    start = offset[0] * across + offset[1] * np.cross(direction, across)
    faces = half_spaces(BALL)
    found = faces.crossings(start[None], direction)
    if np.isnan(found.exit[0]):
        assert np.linalg.norm(start) > 0.09
        return
    assert found.entry[0] < found.exit[0]
    assert found.facing[0] > 0
    for way in (found.entry[0], found.exit[0]):
        assert faces.heights((start + way * direction)[None]).max() == pytest.approx(0, abs=1e-9)
