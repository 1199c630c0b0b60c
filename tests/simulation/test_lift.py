"""The rise of the hand is smooth, and its accelerations are those of its heights."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gdg.data.table import Table
from gdg.protocols import SIX, Lift
from gdg.simulation.lift import accelerations, direction_vector, heights, weight


@given(height=st.floats(0.01, 1.0), steps=st.integers(20, 400), dt=st.floats(0.001, 0.02))
def test_accelerations_integrate_to_the_heights(height: float, steps: int, dt: float):
    lift = Lift(height_m=height, steps=steps)
    speeds = np.cumsum(accelerations(lift, dt)) * dt
    np.testing.assert_allclose(np.cumsum(speeds) * dt, heights(lift), atol=1e-9 * height)
    assert heights(lift)[-1] == pytest.approx(height)
    # at rest at both ends
    assert abs(speeds[0]) < 0.1 * speeds.max()
    assert abs(speeds[-1]) < 0.1 * speeds.max()


def test_the_largest_acceleration_is_that_of_the_polynomial():
    lift = Lift(height_m=0.1, steps=1000)
    peak = 10 / np.sqrt(3) * 0.1
    assert np.abs(accelerations(lift, 0.001)).max() == pytest.approx(peak, rel=0.01)


def test_directions_are_unit_vectors_in_the_order_of_verdicts():
    vectors = [direction_vector(direction).tolist() for direction in SIX]
    assert vectors == [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]


def test_weight_acts_against_the_normal_of_a_table():
    lift = Lift(height_m=0.1, steps=10, support="table")
    table = Table((0.6, 0.0, 0.8), 0.0)
    np.testing.assert_allclose(weight(lift, table), [-0.6 * 9.81, 0, -0.8 * 9.81])
    np.testing.assert_allclose(weight(Lift(height_m=0, steps=1), None), [0, 0, -9.81])


@given(
    normal=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1),
    offset=st.floats(-1, 1),
    lowered=st.floats(0, 1),
)
def test_a_table_stands_on_its_plane(
    normal: tuple[float, float, float], offset: float, lowered: float
):
    length = float(np.linalg.norm(normal))
    unit = (normal[0] / length, normal[1] / length, normal[2] / length)
    T = Table(unit, offset).pose(lowered)
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-9)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
    np.testing.assert_allclose(T[:3, 2], unit, atol=1e-9)
    assert T[:3, 3] @ np.array(unit) == pytest.approx(offset - lowered, abs=1e-9)


@pytest.mark.parametrize("normal", [(0.0, 0.0, 0.0), (0.0, 0.0, 2.0), (float("nan"), 0.0, 1.0)])
def test_a_table_needs_a_unit_normal(normal: tuple[float, float, float]):
    with pytest.raises(ValueError, match="unit normal"):
        Table(normal, 0.0)
