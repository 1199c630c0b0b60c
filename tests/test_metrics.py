"""Wilson intervals, diversity and penetration against values worked out by hand."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from gdg.data.grasps import GraspSet
from gdg.data.verdict import Verdict
from gdg.metrics import joint_diversity, penetration_stats, wilson_interval


def make_grasps(joints: list[list[float]], passed: list[bool], depths: list[float]) -> GraspSet:
    verdicts = tuple(
        Verdict(
            success=ok,
            failure="" if ok else "moved",
            displacement_m=(0.0,) * 6,
            rotation_rad=(0.0,) * 6,
            drift_m=0.0,
            contact_kept=(True,) * 6,
            penetration_start_mm=depth,
            penetration_end_mm=0.0,
            free_displacement_m=0.1,
            shift_successes=(ok,),
            protocol="p-v1",
            engine="e 1",
            refined=False,
            seconds=0.0,
        )
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
