"""Successive halving: rounds as the options say, and better fits than from few starts."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from gdg_plugins.distance_aligned.distance import AlignedDistance
from gdg_plugins.distance_aligned.options import AlignedOptions
from gdg_plugins.fitter_adam.fitter import AdamFitter
from gdg_plugins.fitter_adam.options import AdamOptions
from gdg_plugins.fitter_halving.fitter import HalvingFitter
from gdg_plugins.fitter_halving.options import HalvingOptions

from gdg.contact_maps import contact_map_of
from gdg.data.contact_map import ContactMap
from gdg.fitting.particles import _best
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.rotations import q_from_pose

DISTANCE = AlignedDistance(AlignedOptions())


def fitter(**options: object) -> HalvingFitter:
    chosen = {"extra_weight": 1.0, **options}
    return HalvingFitter(HalvingOptions.model_validate(chosen), distance=DISTANCE)


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


@pytest.fixture(scope="module")
def maps(gripper_model: HandModel, cube: ObjectModel) -> ContactMap:
    """Of both jaws near the cube's sides, and of one jaw away from it."""
    T = torch.eye(4)[None].repeat(2, 1, 1)
    T[:, 2, 3] = -0.035
    q = q_from_pose(T, torch.tensor([[0.0195], [0.005]]))
    return contact_map_of(gripper_model, cube, q, DISTANCE)


def test_rounds_lie_between_the_first_and_the_last_in_equal_ratios():
    rounds = fitter().rounds()
    assert [(one.particles, one.steps, one.points) for one in rounds] == [
        (64, 33, 64),
        (23, 33, 181),
        (8, 34, 512),
    ]
    rates = [one.learning_rate for one in rounds]
    assert rates == pytest.approx([0.01, 0.01 / 2**0.5, 0.005])


def test_few_starts_are_followed_to_the_end():
    assert [one.particles for one in fitter(particles=4).rounds()] == [4, 4, 4]


def test_the_grasps_of_a_map_are_sorted_and_as_many_as_asked_for(
    gripper_model: HandModel, cube: ObjectModel, maps: ContactMap
):
    run = fitter(particles=12, steps=12, finalists=4, keep=3, sharpen=False)
    found = run.fit(gripper_model, cube, maps, seeded())
    by_map = found.energies["total"].reshape(2, 3)
    assert torch.equal(by_map, by_map.sort(-1).values)
    assert found.contact_values is not None
    contact = (found.contact_values - maps.values.repeat_interleave(3, 0)).abs().mean(-1)
    torch.testing.assert_close(found.energies["contact"], contact)


@pytest.mark.parametrize("number", [0, 1])
def test_every_map_is_fitted_better_than_by_the_same_work_of_few_starts(
    gripper_model: HandModel, cube: ObjectModel, maps: ContactMap, number: int
):
    one = replace(maps, values=maps.values[number : number + 1])
    points = len(cube.points)
    few = AdamFitter(
        AdamOptions(particles=4, steps=40, keep=4, extra_weight=1.0), distance=DISTANCE
    )
    options = {"particles": 64, "steps": 39, "finalists": 4, "keep": 4}
    many = fitter(first_points=points // 16, last_points=points // 2, **options)
    work = sum(step.particles * step.steps * (step.points or points) for step in many.rounds())
    assert work < 4 * 40 * points
    worst = [run.fit(gripper_model, cube, one, seeded()).energies["total"][-1].item()
             for run in (few, many)]  # fmt: skip
    assert worst[1] < 0.9 * worst[0]


def test_the_best_of_each_map_go_on():
    energies = torch.tensor([3.0, 1.0, 2.0, 0.1, 0.3, 0.2])
    assert _best(energies, each=3, count=2).tolist() == [1, 2, 3, 5]


def test_maps_are_fitted_in_groups_that_keep_their_order(
    gripper_model: HandModel, cube: ObjectModel, maps: ContactMap
):
    reported: list[tuple[int, int]] = []
    run = fitter(particles=8, finalists=2, keep=2, steps=6, sharpen=False, max_memory_mb=0.01)
    found = run.fit(gripper_model, cube, maps, seeded(), lambda *step: reported.append(step))
    assert reported == [(step, 12) for step in range(1, 13)]
    assert found.contact_values is not None
    contact = (found.contact_values - maps.values.repeat_interleave(2, 0)).abs().mean(-1)
    torch.testing.assert_close(found.energies["contact"], contact)


def test_neither_the_memory_bound_nor_further_maps_change_a_fit(
    gripper_model: HandModel, cube: ObjectModel, maps: ContactMap
):
    settings = {"particles": 8, "finalists": 2, "keep": 2, "steps": 6}
    together = fitter(**settings).fit(gripper_model, cube, maps, seeded())
    # less than one particle: they are evaluated one by one
    bounded = fitter(**settings, max_memory_mb=1e-3).fit(gripper_model, cube, maps, seeded())
    first = replace(maps, values=maps.values[:1])
    alone = fitter(**settings).fit(gripper_model, cube, first, seeded())
    torch.testing.assert_close(bounded.poses, together.poses, rtol=0, atol=1e-4)
    torch.testing.assert_close(alone.poses, together.poses[:2], rtol=0, atol=1e-4)


def test_as_many_as_are_to_be_kept_reach_the_last_round():
    assert fitter(keep=12).rounds()[-1].particles == 12


def test_the_same_seed_gives_the_same_grasps(
    gripper_model: HandModel, cube: ObjectModel, maps: ContactMap
):
    run = fitter(particles=8, steps=6, finalists=2, first_points=32, last_points=64)
    runs = [run.fit(gripper_model, cube, maps, seeded(seed)) for seed in (3, 3, 4)]
    assert torch.equal(runs[0].poses, runs[1].poses)
    assert not torch.equal(runs[0].poses, runs[2].poses)
