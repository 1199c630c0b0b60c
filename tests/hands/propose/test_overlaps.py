"""Overlaps of links are measured in every posture, pair by pair."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from descriptions import INERTIAL, box, joint, link, robot, write
from proposals import draft_model

from gdg.hands.propose.overlaps import Pair, link_overlaps, random_postures
from gdg.kinds.hand_model import HandModel

#: Edges of the two cubes, metres.
LARGE_M, SMALL_M = 0.04, 0.02
RANGE = '<limit lower="0" upper="0.1"/>'


@pytest.fixture(scope="module")
def cubes(tmp_path_factory: pytest.TempPathFactory) -> HandModel:
    """A small cube that slides along y from the middle of a large one; a third link far away."""
    text = robot(
        link("large", box(size="0.04 0.04 0.04"), INERTIAL),
        link("small", box(size="0.02 0.02 0.02"), INERTIAL),
        link("far", box(size="0.02 0.02 0.02", origin='<origin xyz="0 0 1"/>'), INERTIAL),
        joint("slide", "large", "small", RANGE, "prismatic", z=0.0),
        joint("other", "large", "far", RANGE, "prismatic", z=0.0),
    )
    return draft_model(write(tmp_path_factory.mktemp("cubes"), text), points=2000)


def depths(
    hand: HandModel, values: list[float], apart: np.ndarray | None = None
) -> dict[Pair, np.ndarray]:
    joints = torch.tensor([[value, 0.0] for value in values])
    every = ~np.eye(len(hand.link_names), dtype=bool)
    return link_overlaps(hand, joints, every if apart is None else apart)


def test_the_depth_is_that_of_the_deepest_point(cubes: HandModel):
    values = [0.03, 0.029, 0.025, 0.02, 0.015]
    (pair,) = depths(cubes, values)
    assert pair == ("large", "small")
    expected = [LARGE_M / 2 + SMALL_M / 2 - value for value in values]
    np.testing.assert_allclose(depths(cubes, values)[pair], expected, atol=0.0008)


def test_pairs_that_never_touch_are_left_out(cubes: HandModel):
    assert depths(cubes, [0.031, 0.05, 0.1]) == {}


def test_a_posture_without_overlap_has_depth_zero(cubes: HandModel):
    found = depths(cubes, [0.05, 0.02])
    assert found["large", "small"][0] == 0
    assert found["large", "small"][1] > 0.009


def test_only_the_pairs_asked_for_are_looked_at(cubes: HandModel):
    assert depths(cubes, [0.0], np.zeros((3, 3), bool)) == {}


def test_a_batch_of_one_equals_the_batch(cubes: HandModel):
    values = [0.0, 0.013, 0.028, 0.06]
    together = depths(cubes, values)["large", "small"]
    alone = [depths(cubes, [value]).get(("large", "small"), np.zeros(1))[0] for value in values]
    np.testing.assert_allclose(alone, together, atol=1e-7)


def test_random_postures_lie_within_the_limits_and_repeat(cubes: HandModel):
    postures = random_postures(cubes, 200)
    assert (postures >= cubes.lower).all()
    assert (postures <= cubes.upper).all()
    assert postures.std(0).min() > 0.02
    assert torch.equal(postures, random_postures(cubes, 200))
    assert not torch.equal(postures, random_postures(cubes, 200, seed=1))
