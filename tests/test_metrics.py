"""Wilson intervals, diversity and penetration against values worked out by hand."""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np
import pytest
import torch
from grasp_samples import make_verdict
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gdg.data.grasps import GraspSet
from gdg.kinds.hand_model import HandModel
from gdg.metrics import (
    Rate,
    chance_error,
    cohen_kappa,
    direction_coverage,
    distinct_grasps,
    joint_diversity,
    mean_interval,
    palm_directions,
    penetration_stats,
    wilson_interval,
)
from gdg.rotations import random_rotations


def make_grasps(joints: list[list[float]], passed: list[bool], depths: list[float]) -> GraspSet:
    verdicts = tuple(
        make_verdict(ok, penetration_start_mm=depth)
        for ok, depth in zip(passed, depths, strict=True)
    )
    values = torch.tensor(joints)
    names = tuple(f"j{index}" for index in range(values.shape[1]))
    poses = torch.eye(4).repeat(len(joints), 1, 1)
    return GraspSet("h", "o", names, "base", poses, values, verdicts=verdicts)


@pytest.mark.parametrize(
    ("k", "n", "low", "high"),
    [
        # Newcombe 1998, table I, method 3
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
        (29, 29, 0.8830, 1.0),
    ],
)
def test_wilson_interval_matches_newcombe(k, n, low, high):
    assert wilson_interval(k, n) == pytest.approx((low, high), abs=5e-5)


def test_wilson_interval_without_trials_says_nothing():
    assert wilson_interval(0, 0) == (0.0, 1.0)


@pytest.mark.parametrize(("k", "n"), [(-1, 3), (4, 3), (1, 0)])
def test_wilson_interval_refuses_impossible_counts(k, n):
    with pytest.raises(ValueError, match="successes"):
        wilson_interval(k, n)


@given(st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_wilson_interval_holds_the_rate_and_mirrors(counts):
    k, n = counts
    low, high = wilson_interval(k, n)
    assert 0.0 <= low <= k / n <= high <= 1.0
    assert wilson_interval(n - k, n) == pytest.approx((1 - high, 1 - low))


def test_a_rate_knows_its_share_and_interval():
    assert Rate(15, 148).share == pytest.approx(15 / 148)
    assert Rate(15, 148).interval == wilson_interval(15, 148)
    assert math.isnan(Rate(0, 0).share)
    assert Rate(math.nan, 5).interval == (0.0, 1.0)


def test_the_interval_of_a_mean_is_student_s():
    # mean 3, standard error sqrt(2.5 / 5), t(0.975, 4) = 2.7764
    half = 2.7764 * math.sqrt(0.5)
    assert mean_interval([1.0, 2.0, 3.0, 4.0, 5.0]) == pytest.approx((3 - half, 3 + half), abs=1e-4)
    assert all(map(math.isnan, mean_interval([1.0])))


@given(st.lists(st.floats(-1, 1), min_size=2, max_size=9), st.floats(0, 1))
def test_the_interval_of_a_mean_is_never_narrower_than_a_known_error_makes_it(values, error):
    low, high = mean_interval(values, error)
    plain_low, plain_high = mean_interval(values)
    assert low <= plain_low + 1e-9
    assert high >= plain_high - 1e-9
    assert high - low >= 2 * 1.96 * error  # Student's quantile is above the normal one


def test_the_error_by_chance_is_that_of_independent_trials_and_never_nothing():
    assert chance_error([Rate(500, 1000)]) == pytest.approx(math.sqrt(0.25 / 1002))
    assert chance_error([Rate(500, 1000)] * 4) == pytest.approx(chance_error([Rate(500, 1000)]) / 2)
    assert chance_error([Rate(2, 2)]) > chance_error([Rate(64, 64)]) > 0


def test_kappa_is_cohen_s():
    # 20 both, 5 only the first, 10 only the second, 15 neither: 0.7 seen, 0.5 by chance
    assert cohen_kappa(20, 5, 10, 15) == pytest.approx(0.4)
    assert cohen_kappa(3, 0, 0, 4) == 1.0
    assert cohen_kappa(0, 2, 2, 0) == -1.0
    assert math.isnan(cohen_kappa(5, 0, 0, 0))
    assert math.isnan(cohen_kappa(0, 0, 0, 0))


def test_diversity_is_the_mean_deviation_over_passing_grasps():
    grasps = make_grasps(
        [[0.0, 1.0], [9.0, 9.0], [0.2, 1.0], [0.4, 1.6]], [True, False, True, True], [0.0] * 4
    )
    # deviations 0.2 and sqrt(0.12) with n - 1 = 2
    assert joint_diversity(grasps) == pytest.approx((0.2 + math.sqrt(0.12)) / 2, rel=1e-5)


def test_diversity_needs_two_passing_grasps():
    assert math.isnan(joint_diversity(make_grasps([[0.0], [1.0]], [True, False], [0.0] * 2)))


def test_penetration_is_over_all_simulated_grasps():
    grasps = make_grasps([[0.0]] * 4, [True, False, True, True], [0.0, 1.0, 2.0, 5.0])
    stats = penetration_stats(grasps)
    assert stats is not None
    assert (stats.mean_mm, stats.median_mm, stats.max_mm) == (2.0, 1.5, 5.0)
    assert stats.p95_mm == pytest.approx(4.55)
    assert penetration_stats(make_grasps([[0.0]], [True], [1.0]).select([])) is None


def posed(rotations: torch.Tensor, places: torch.Tensor, passed: bool = True) -> GraspSet:
    grasps = make_grasps(
        [[0.0]] * len(rotations), [passed] * len(rotations), [0.0] * len(rotations)
    )
    poses = torch.eye(4).repeat(len(rotations), 1, 1)
    poses[:, :3, :3], poses[:, :3, 3] = rotations, places
    return replace(grasps, root_link="base", joint_names=("close",), poses=poses)


def about_x(*degrees: float) -> torch.Tensor:
    turns = Rotation.from_euler("x", np.array(degrees)[:, None], degrees=True)
    return torch.as_tensor(turns.as_matrix(), dtype=torch.float32)


def test_the_palm_s_side_is_counted_once(gripper_model: HandModel):
    # the gripper's palm looks along z: up, up, down
    grasps = posed(about_x(0, 5, 180), torch.zeros(3, 3))
    assert direction_coverage(gripper_model, grasps) == pytest.approx(2 / 48)
    assert direction_coverage(gripper_model, replace(grasps, verdicts=())) == 0.0
    assert direction_coverage(gripper_model, posed(about_x(0), torch.zeros(1, 3), False)) == 0.0


def test_palms_look_where_the_hand_is_turned(gripper_model: HandModel):
    grasps = posed(about_x(0, 90, 180), torch.zeros(3, 3), passed=False)
    expected = torch.tensor([[0.0, 0, 1], [0, -1, 0], [0, 0, -1]])
    assert torch.allclose(palm_directions(gripper_model, grasps), expected, atol=1e-6)
    assert palm_directions(gripper_model, grasps.select([])).shape == (0, 3)


def test_random_directions_cover_what_even_cells_lead_to_expect(gripper_model: HandModel):
    rotations = random_rotations(1000, torch.Generator().manual_seed(0))
    every = posed(rotations, torch.zeros(1000, 3))
    assert direction_coverage(gripper_model, every) == 1.0
    shares = [
        direction_coverage(gripper_model, every.select(range(k, k + 50)))
        for k in range(0, 1000, 50)
    ]
    assert np.mean(shares) == pytest.approx(1 - (1 - 1 / 48) ** 50, abs=0.02)


def test_grasps_are_distinct_by_place_or_by_rotation():
    places = torch.tensor([[0.0, 0, 0], [0.009, 0, 0], [0.011, 0, 0], [0.0, 0, 0], [0.0, 0, 0]])
    assert distinct_grasps(posed(about_x(0, 0, 0, 14, 16), places)) == 3
    assert distinct_grasps(posed(about_x(0, 0, 0, 14, 16), places), place_m=0.1) == 2
    assert distinct_grasps(posed(about_x(0, 0, 0, 14, 16), places), rotation_rad=4.0) == 2
    assert distinct_grasps(posed(about_x(0, 90), torch.zeros(2, 3), passed=False)) == 0


@given(st.integers(0, 1000))
def test_the_count_of_distinct_grasps_outlasts_copies_and_turns(seed: int):
    generator = torch.Generator().manual_seed(seed)
    rotations = random_rotations(8, generator)
    places = 0.02 * torch.randn(8, 3, generator=generator)
    count = distinct_grasps(posed(rotations, places))
    assert 1 <= count <= 8
    assert distinct_grasps(posed(rotations.repeat(2, 1, 1), places.repeat(2, 1))) == count
    R = random_rotations(1, generator)[0]
    assert distinct_grasps(posed(R @ rotations, places @ R.T)) == count


def test_a_thousand_grasps_are_counted_quickly():
    generator = torch.Generator().manual_seed(0)
    grasps = posed(random_rotations(1000, generator), torch.randn(1000, 3, generator=generator))
    start = time.process_time()
    assert distinct_grasps(grasps) == 1000
    assert time.process_time() - start < 2.0
