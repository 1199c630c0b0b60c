"""Overlaps of links are measured in every posture, pair by pair."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from descriptions import INERTIAL, box, joint, link, robot, write
from proposals import draft_model

from gdg.hands.propose.sampling import random_postures
from gdg.hands.self_collision import LinkBodies, Pair
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


def depths(hand: HandModel, value: float, ignored_m: float = 0.0) -> dict[Pair, float]:
    Ts = hand.link_poses_in_root(torch.tensor([[value, 0.0]]))[0].double().numpy()
    every = ~np.eye(len(hand.link_names), dtype=bool)
    return LinkBodies(hand.hand).overlaps(Ts, every, ignored_m)


@pytest.mark.parametrize("value", [0.029, 0.025, 0.02, 0.015])
def test_the_depth_is_the_way_out(cubes: HandModel, value: float):
    expected = {("large", "small"): LARGE_M / 2 + SMALL_M / 2 - value}
    assert depths(cubes, value) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("value", [0.031, 0.05, 0.1])
def test_pairs_that_are_apart_are_left_out(cubes: HandModel, value: float):
    assert depths(cubes, value) == {}


def test_small_depths_are_left_out(cubes: HandModel):
    assert depths(cubes, 0.029, ignored_m=0.002) == {}
    assert depths(cubes, 0.027, ignored_m=0.002) != {}


def test_only_the_pairs_asked_for_are_looked_at(cubes: HandModel):
    Ts = cubes.link_poses_in_root(torch.zeros(1, 2))[0].double().numpy()
    assert LinkBodies(cubes.hand).overlaps(Ts, np.zeros((3, 3), bool), 0.0) == {}


def test_random_postures_lie_within_the_limits_and_repeat(cubes: HandModel):
    postures = random_postures(cubes, 200)
    assert (postures >= cubes.lower).all()
    assert (postures <= cubes.upper).all()
    assert postures.std(0).min() > 0.02
    assert torch.equal(postures, random_postures(cubes, 200))
    assert not torch.equal(postures, random_postures(cubes, 200, seed=1))
