"""Successive halving: rounds as the options say, and better fits than from few starts."""

from __future__ import annotations

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
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.rotations import q_from_pose

DISTANCE = AlignedDistance(AlignedOptions())


def fitter(**options: object) -> HalvingFitter:
    return HalvingFitter(HalvingOptions.model_validate(options), distance=DISTANCE)


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
        (128, 33, 128),
        (32, 33, 362),
        (8, 34, 1024),
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


def test_no_map_costs_more_than_a_fit_of_all_its_finalists_alone(
    gripper_model: HandModel, cube: ObjectModel, maps: ContactMap
):
    """The best of many starts, told early, are better than as many starts as are followed."""
    few = AdamFitter(AdamOptions(particles=4, steps=40, keep=4), distance=DISTANCE)
    many = fitter(particles=48, steps=40, finalists=4, keep=4)
    fits = [run.fit(gripper_model, cube, maps, seeded()) for run in (few, many)]
    few_energy, many_energy = (fit.energies["total"].mean().item() for fit in fits)
    assert many_energy < few_energy


def test_the_same_seed_gives_the_same_grasps(
    gripper_model: HandModel, cube: ObjectModel, maps: ContactMap
):
    run = fitter(particles=8, steps=6, finalists=2, first_points=32, last_points=64)
    runs = [run.fit(gripper_model, cube, maps, seeded(seed)) for seed in (3, 3, 4)]
    assert torch.equal(runs[0].poses, runs[1].poses)
    assert not torch.equal(runs[0].poses, runs[2].poses)


def test_all_steps_of_all_parts_are_reported(
    gripper_model: HandModel, cube: ObjectModel, maps: ContactMap, monkeypatch: pytest.MonkeyPatch
):
    hand_points = len(gripper_model.surface.points)
    monkeypatch.setattr("gdg.fitting.particles.MAX_POINTS", 8 * (hand_points + 32))
    reported: list[tuple[int, int]] = []
    run = fitter(rounds=2, particles=8, finalists=2, steps=4, first_points=32, last_points=32)
    run.fit(gripper_model, cube, maps, seeded(), lambda *step: reported.append(step))
    assert reported == [(step, 6) for step in range(1, 7)]  # two parts, then one, of two steps
