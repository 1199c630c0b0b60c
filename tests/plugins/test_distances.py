"""Distances and contact values are the sources' formulas, found exactly and differentiably."""

from __future__ import annotations

import math
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence

import numpy as np
import pytest
import torch
from gdg_plugins.distance_aligned.distance import AlignedDistance
from gdg_plugins.distance_aligned.options import AlignedOptions
from gdg_plugins.distance_euclidean.distance import EuclideanDistance
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from torch import Tensor

from gdg.components import NoOptions
from gdg.kinds.distance import Distance
from gdg.nearest import EPSILON_M, nearest_hand_points
from gdg.nearest.eager import nearest_exhaustive
from gdg.nearest.fused import nearest_fused
from gdg.rotations import random_rotations

ORIGIN = torch.zeros(1, 3)
UP = torch.tensor([[0.0, 0.0, 1.0]])


def aligned(preset: str = "release", gamma: float = 1.0) -> AlignedDistance:
    return AlignedDistance(AlignedOptions(preset=preset, gamma=gamma))


def euclidean() -> EuclideanDistance:
    return EuclideanDistance(NoOptions())


ALL = [
    pytest.param(aligned(), id="release"),
    pytest.param(aligned("paper"), id="paper"),
    pytest.param(aligned(gamma=0.5), id="gamma"),
    pytest.param(euclidean(), id="euclidean"),
]


def value_at(distance: Distance, *hand_point: float) -> float:
    """Contact value of the origin, whose normal is +z, for a hand of one point."""
    found = distance.to_hand(ORIGIN, UP, torch.tensor([[hand_point]]))
    return distance.contact_value(found.distance).item()


def cloud(seed: int, batch: int, hands: int, objects: int) -> tuple[Tensor, Tensor, Tensor]:
    """A sphere-like object of 50 mm and hand points in a box of 300 mm around it."""
    generator = torch.Generator().manual_seed(seed)
    normals = torch.nn.functional.normalize(torch.randn(objects, 3, generator=generator), dim=-1)
    points = 0.05 * normals + 0.003 * torch.randn(objects, 3, generator=generator)
    hand = 0.3 * (torch.rand(batch, hands, 3, generator=generator) - 0.5)
    return points, normals, hand


def reference(points: Tensor, normals: Tensor, hand: Tensor, gamma: float) -> Tensor:
    """D by the release's formula, literally, over all pairs, in double precision."""
    difference = hand.double()[:, None] - points.double()[None, :, None]
    d = difference.norm(dim=-1)
    a = (difference * normals.double()[None, :, None]).sum(-1) / (d + 1e-5)
    return (d * torch.exp(2 * gamma * (1 - a))).amin(-1).sqrt()


# -- golden values -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("gap_m", "release", "paper"),
    [
        (0.001, 0.843191, 0.984190),
        (0.005, 0.660477, 0.964659),
        (0.010, 0.537883, 0.950042),
        (0.050, 0.193116, 0.888660),
    ],
)
def test_contact_values_of_aligned_points_are_the_sources(
    gap_m: float, release: float, paper: float
):
    for preset, golden in (("release", release), ("paper", paper)):
        distance = aligned(preset)
        value = distance.contact_value(distance.of_gap(torch.tensor(gap_m, dtype=torch.float64)))
        assert value.item() == pytest.approx(golden, abs=6e-7)


@pytest.mark.parametrize(
    ("gap_m", "release", "paper"),
    [
        (0.001, 0.841656, 0.984033),
        (0.005, 0.659852, 0.964589),
        (0.010, 0.537490, 0.949992),
        (0.050, 0.193038, 0.888638),
    ],
)
def test_a_hand_point_along_the_normal_gives_the_releases_value(
    gap_m: float, release: float, paper: float
):
    # a little below the sources' ideal values, since the release divides by d + 1e-5
    assert value_at(aligned(), 0.0, 0.0, gap_m) == pytest.approx(release, abs=1e-6)
    assert value_at(aligned("paper"), 0.0, 0.0, gap_m) == pytest.approx(paper, abs=1e-6)


@pytest.mark.parametrize(
    ("gap_m", "golden"), [(0.001, 0.950042), (0.005, 0.755081), (0.01, 0.537883), (0.05, 0.013386)]
)
def test_euclidean_values_are_the_releases_ablation(gap_m: float, golden: float):
    for direction in ((0, 0, 1), (0, 0, -1), (1, 0, 0)):
        point = (gap_m * x for x in direction)
        assert value_at(euclidean(), *point) == pytest.approx(golden, abs=1e-6)


@pytest.mark.parametrize("gamma", [0.0, 0.5, 1.0, 3.0])
def test_a_point_behind_or_beside_the_surface_is_pushed_away_by_gamma(gamma: float):
    distance = aligned(gamma=gamma)
    for z, x in ((-0.01, 0.0), (0.0, 0.01)):
        found = distance.to_hand(ORIGIN, UP, torch.tensor([[[x, 0.0, z]]])).distance.item()
        away = 1 - z / (0.01 + EPSILON_M)
        assert found == pytest.approx(math.exp(gamma * away) * 0.1, rel=1e-5)


def test_the_far_side_of_a_thin_wall_stays_untouched():
    assert value_at(aligned(), 0.0, 0.0, -0.002) < 0.08
    assert value_at(aligned(), 0.0, 0.0, 0.002) > 0.75


def test_the_aligned_point_wins_over_a_nearer_one_behind():
    hand = torch.tensor([[[0.0, 0.0, -0.002], [0.0, 0.0, 0.03]]])
    assert aligned().to_hand(ORIGIN, UP, hand).hand_index.item() == 1
    assert euclidean().to_hand(ORIGIN, UP, hand).hand_index.item() == 0


def test_labels_tell_what_a_map_was_made_with():
    labels = [aligned().label, aligned("paper").label, aligned(gamma=0.5).label, euclidean().label]
    assert labels == [
        "aligned/release", "aligned/paper", "aligned/release-gamma0.5", "euclidean/release"
    ]  # fmt: skip


@pytest.mark.parametrize("gamma", [-0.1, 4.5, math.nan])
def test_gamma_out_of_range_is_refused(gamma: float):
    with pytest.raises(ValidationError, match="gamma"):
        AlignedOptions(gamma=gamma)


# -- contact values ----------------------------------------------------------------------------


@pytest.mark.parametrize("distance", ALL)
def test_contact_value_falls_from_one(distance: Distance):
    gaps = torch.linspace(0, 0.15, 200, dtype=torch.float64)
    values = distance.contact_value(distance.of_gap(gaps))
    assert values[0] == 1
    assert (values.diff() < 0).all()
    assert values[-1] > 0


@pytest.mark.parametrize("distance", ALL)
@given(gap=st.floats(1e-5, 0.08))
def test_aligned_gap_inverts_the_contact_value(distance: Distance, gap: float):
    given_gap = torch.tensor(gap, dtype=torch.float64)
    value = distance.contact_value(distance.of_gap(given_gap))
    assert distance.aligned_gap(value).item() == pytest.approx(gap, rel=1e-6)


def test_release_sharpening_lifts_contacts_toward_one():
    values = torch.tensor([[0.1, 0.4, 0.41, 0.45], [0.1, 0.4, 0.5, 0.9]])
    # max 0.45: lifted by 0.55; max above 0.5: lifted by 0.5
    expected = torch.tensor([[0.1, 0.4, 0.96, 1.0], [0.1, 0.4, 1.0, 1.0]])
    torch.testing.assert_close(aligned().sharpen(values), expected)
    # each map by its own maximum
    assert torch.equal(aligned().sharpen(values)[0], aligned().sharpen(values[:1])[0])


def test_paper_sharpening_makes_contacts_one_and_leaves_the_rest():
    values = torch.tensor([[0.0, 0.4, 0.4999, 0.5, 0.7]])
    expected = torch.tensor([[0.0, 0.4, 0.4999, 1.0, 1.0]])
    assert torch.equal(aligned("paper").sharpen(values), expected)


def test_euclidean_maps_are_not_sharpened():
    values = torch.rand(3, 20, generator=torch.Generator().manual_seed(0))
    assert torch.equal(euclidean().sharpen(values), values)


# -- symmetries --------------------------------------------------------------------------------


@pytest.mark.parametrize("distance", ALL)
def test_moving_hand_and_object_together_changes_nothing(distance: Distance):
    points, normals, hand = cloud(0, 2, 100, 60)
    R = random_rotations(1, torch.Generator().manual_seed(1))[0]
    t = torch.tensor([0.1, -0.2, 0.05])
    before = distance.to_hand(points, normals, hand)
    after = distance.to_hand(points @ R.T + t, normals @ R.T, hand @ R.T + t)
    torch.testing.assert_close(after.distance, before.distance, rtol=1e-4, atol=1e-6)
    assert (after.hand_index == before.hand_index).float().mean() > 0.99


@pytest.mark.parametrize("distance", ALL)
def test_permuted_points_give_permuted_distances(distance: Distance):
    points, normals, hand = cloud(2, 2, 70, 50)
    order = torch.randperm(50, generator=torch.Generator().manual_seed(3))
    before = distance.to_hand(points, normals, hand)
    objects = distance.to_hand(points[order], normals[order], hand)
    assert torch.equal(objects.distance, before.distance[:, order])
    shuffle = torch.randperm(70, generator=torch.Generator().manual_seed(4))
    hands = distance.to_hand(points, normals, hand[:, shuffle])
    torch.testing.assert_close(hands.distance, before.distance, rtol=1e-5, atol=0)
    assert torch.equal(shuffle[hands.hand_index], before.hand_index)


@pytest.mark.parametrize("distance", ALL)
def test_a_batch_of_one_equals_the_batch(distance: Distance):
    points, normals, hand = cloud(5, 4, 70, 50)
    together = distance.to_hand(points, normals, hand)
    for row in range(4):
        alone = distance.to_hand(points, normals, hand[row : row + 1])
        assert torch.equal(alone.distance[0], together.distance[row])
        assert torch.equal(alone.hand_index[0], together.hand_index[row])


def test_the_lowest_index_wins_a_tie():
    points, normals, hand = cloud(6, 1, 40, 30)
    found = aligned().to_hand(points, normals, hand.repeat(1, 3, 1))
    assert found.hand_index.max() < 40


# -- gradients ---------------------------------------------------------------------------------


@pytest.mark.parametrize("distance", ALL)
def test_gradients_flow_through_the_selected_pair_alone(distance: Distance):
    points, normals, hand = cloud(7, 2, 90, 12)
    hand.requires_grad_(True)
    found = distance.to_hand(points, normals, hand)
    found.distance.sum().backward()
    assert hand.grad is not None
    selected = torch.zeros(2, 90, dtype=torch.bool).scatter_(1, found.hand_index, True)
    moved = hand.grad.abs().sum(-1) > 0
    assert 0 < selected.sum() <= 24
    assert torch.equal(moved, selected)


@pytest.mark.parametrize("distance", ALL)
def test_gradients_equal_finite_differences(distance: Distance):
    points, normals, hand = cloud(8, 1, 20, 10)
    hand.requires_grad_(True)
    found = distance.to_hand(points, normals, hand)
    (gradient,) = torch.autograd.grad(distance.contact_value(found.distance).sum(), hand)
    direction = torch.randn(hand.shape, generator=torch.Generator().manual_seed(9))
    step = 2e-5

    def moved(sign: int) -> Tensor:
        at = distance.to_hand(points, normals, hand.detach() + sign * step * direction)
        assert torch.equal(at.hand_index, found.hand_index)
        return distance.contact_value(at.distance.double()).sum()

    numeric = (moved(1) - moved(-1)) / (2 * step)
    assert (gradient * direction).sum().item() == pytest.approx(numeric.item(), rel=0.01, abs=0.01)


@pytest.mark.parametrize("distance", ALL)
def test_gradients_are_finite_where_hand_and_object_points_coincide(distance: Distance):
    hand = torch.zeros(1, 1, 3, requires_grad=True)
    found = distance.to_hand(ORIGIN, UP, hand)
    distance.contact_value(found.distance).sum().backward()
    assert hand.grad is not None
    assert hand.grad.isfinite().all()
    assert distance.contact_value(found.distance).item() == pytest.approx(1, abs=0.01)


# -- exact search ------------------------------------------------------------------------------


def chosen_value(points: Tensor, normals: Tensor, hand: Tensor, index: Tensor, gamma: float):
    """Contact values of the pairs that a search chose, in double precision."""
    rows = torch.gather(hand, 1, index[..., None].expand(-1, -1, 3)).double()
    difference = rows - points.double()
    d = difference.norm(dim=-1)
    a = (difference * normals.double()).sum(-1) / (d + 1e-5)
    return 2 * torch.sigmoid(-10 * (d * torch.exp(2 * gamma * (1 - a))).sqrt())


Search = Callable[[Tensor, Tensor, Tensor, float], Tensor]


def eager(points: Tensor, normals: Tensor, hand: Tensor, gamma: float) -> Tensor:
    return nearest_exhaustive(points, normals, hand, gamma, EPSILON_M)


def fused(points: Tensor, normals: Tensor, hand: Tensor, gamma: float) -> Tensor:
    return nearest_fused(points, normals, hand, gamma, EPSILON_M)


def assert_exact(
    points: Tensor,
    normals: Tensor,
    hand: Tensor,
    gamma: float,
    searches: Sequence[Search] = (nearest_hand_points, eager),
) -> None:
    expected = 2 * torch.sigmoid(-10 * reference(points, normals, hand, gamma))
    for search in searches:
        index = search(points, normals, hand, gamma)
        assert index.min() >= 0
        assert index.max() < hand.shape[1]
        value = chosen_value(points, normals, hand, index, gamma)
        torch.testing.assert_close(value, expected, rtol=0, atol=1e-5)


@settings(max_examples=30)
@given(
    st.integers(0, 10**6),
    st.integers(1, 100),
    st.integers(1, 40),
    st.sampled_from([0.0, 0.5, 1.0, 3.0]),
    st.booleans(),
)
@example(0, 31, 30, 1.0, False)
@example(1, 32, 30, 3.0, True)
@example(2, 33, 30, 0.5, False)
@example(3, 1, 1, 1.0, False)
@example(4, 1600, 64, 1.0, True)
@example(5, 1600, 64, 3.0, True)
def test_both_searches_find_what_the_literal_formula_finds(
    seed: int, hands: int, objects: int, gamma: float, sorted_: bool
):
    points, normals, hand = cloud(seed, 2, hands, objects)
    if sorted_:  # neighbours follow each other, as on a hand, so that blocks are small
        hand = hand[:, hand[0, :, 0].argsort()]
    assert_exact(points, normals, hand, gamma)


@settings(max_examples=30)
@given(st.integers(0, 10**6), st.sampled_from([0.5, 1.0, 3.0]), st.sampled_from([1e-5, 1e-4, 1e-3]))
def test_both_searches_are_exact_close_to_the_surface(seed: int, gamma: float, close_m: float):
    points, normals, _ = cloud(seed, 1, 1, 20)
    generator = torch.Generator().manual_seed(seed)
    near = points.repeat(4, 1) + close_m * torch.randn(80, 3, generator=generator)
    assert_exact(points, normals, near[None], gamma)


def test_a_block_of_one_point_just_behind_the_surface_is_not_missed():
    # 1e-4 m behind, the release's d + 1e-5 makes a point 17 % nearer than its direction says
    beside = torch.tensor([6.8e-4, 0.0, 0.0]).repeat(32, 1)
    behind = torch.tensor([[0.0, 0.0, -1e-4]])
    hand = torch.cat((beside, behind))[None]
    assert nearest_hand_points(ORIGIN, UP, hand, 1.0).item() == 32


@pytest.mark.skipif(shutil.which("g++") is None, reason="on a CPU torch's compiler needs g++")
def test_the_search_for_gpus_finds_what_the_literal_formula_finds():
    for seed, hands, objects in ((0, 200, 300), (1, 33, 50)):
        points, normals, hand = cloud(seed, 2, hands, objects)
        assert_exact(points, normals, hand, 1.0, (fused,))


def test_the_search_survives_points_that_are_not_finite():
    points, normals, hand = cloud(0, 2, 50, 20)
    expected = nearest_hand_points(points, normals, hand, 1.0)[1]
    hand[0] = math.nan
    index = nearest_hand_points(points, normals, hand, 1.0)
    assert torch.equal(index[1], expected)
    assert index.min() >= 0
    assert index.max() < 50


GROWTH = """
import resource, torch
from gdg.nearest import nearest_hand_points
g = torch.Generator().manual_seed(0)
normals = torch.nn.functional.normalize(torch.randn(2048, 3, generator=g), dim=-1)
hand = 0.2 * torch.rand(32, 1600, 3, generator=g)
nearest_hand_points(normals[:8], normals[:8], hand[:2, :40], 1.0)
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
from gdg.registry import get_registry
record = get_registry().find("distance", "aligned")
hand = hand[:, hand[0, :, 0].argsort()].requires_grad_(True)
record.load()(record.options()).to_hand(0.05 * normals, normals, hand).distance.sum().backward()
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024)
"""


def test_a_full_batch_stays_far_below_a_gigabyte():
    done = subprocess.run(
        [sys.executable, "-c", GROWTH], capture_output=True, text=True, check=True, timeout=120
    )
    # object × hand × 3 of this batch would be 1.2 GB
    assert float(done.stdout) < 200


def test_euclidean_distance_is_the_nearest_point():
    points, normals, hand = cloud(10, 3, 77, 40)
    found = euclidean().to_hand(points, normals, hand)
    expected = torch.cdist(points.double().repeat(3, 1, 1), hand.double())
    np.testing.assert_allclose(found.distance, expected.amin(-1), atol=1e-6)
    assert torch.equal(found.hand_index, expected.argmin(-1))
