"""Points on a quadrilateral run from corner to corner, row by row."""

from __future__ import annotations

import numpy as np

from gdg.geometry.quadrilateral import grid_on

CORNERS = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.5], [0.0, 1.0, 0.0]])


def test_the_corners_are_the_ends_of_the_first_and_last_row():
    points = grid_on(CORNERS, 4)
    assert points.shape == (16, 3)
    np.testing.assert_array_equal(points[[0, 3, 15, 12]], CORNERS)


def test_the_middle_is_the_mean_of_the_corners():
    np.testing.assert_allclose(grid_on(CORNERS, 3)[4], CORNERS.mean(0))
