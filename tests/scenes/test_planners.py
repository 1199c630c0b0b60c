"""Fitted and sampled hands end above the table, for both planners."""

from __future__ import annotations

import pytest
import torch
from gdg_plugins.distance_aligned.distance import AlignedDistance
from gdg_plugins.distance_aligned.options import AlignedOptions
from gdg_plugins.fitter_adam.fitter import AdamFitter
from gdg_plugins.fitter_adam.options import AdamOptions
from gdg_plugins.planner_dfc.options import DfcOptions
from gdg_plugins.planner_dfc.planner import DfcPlanner
from table_samples import BELOW_CUBE, gripper_looking, put

from gdg.contact_maps import contact_map_of
from gdg.data.contact_map import ContactMap
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.penetration.table import hand_height

DISTANCE = AlignedDistance(AlignedOptions())


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


@pytest.mark.parametrize("option", ["sdf", "nearest"])
def test_a_hand_fitted_to_a_map_from_below_ends_above_the_table(
    gripper_model: HandModel, cube: ObjectModel, option: str
):
    placed = put(cube)
    maps = contact_map_of(gripper_model, cube, gripper_looking((0.0, 0.0, 1.0)), DISTANCE)
    options = AdamOptions(particles=4, steps=30, keep=1000, penetration=option)
    fitter = AdamFitter(options, distance=DISTANCE)
    on_table = gripper_model.q_of(fitter.fit(gripper_model, placed, maps, seeded()))
    assert hand_height(gripper_model, BELOW_CUBE, on_table).min() >= 0.001 - 1e-6
    in_air = gripper_model.q_of(fitter.fit(gripper_model, cube, maps, seeded()))
    assert hand_height(gripper_model, BELOW_CUBE, in_air).min() < -0.01


def test_a_fitted_hands_energy_counts_the_table(gripper_model: HandModel, cube: ObjectModel):
    q = gripper_looking((0.0, 0.0, 1.0), away=0.01)
    maps = ContactMap("cube", torch.zeros(1, len(cube.points)), DISTANCE.label)
    fitter, first = AdamFitter(AdamOptions(), distance=DISTANCE), torch.zeros(1, dtype=torch.long)
    free = fitter.energy(gripper_model, cube, maps).terms(q, first)
    placed = fitter.energy(gripper_model, put(cube), maps).terms(q, first)
    assert placed.penetration.item() > free.penetration.item() + 1.0
    assert torch.equal(placed.contact, free.contact)


def test_sampled_grasps_end_above_the_table(gripper_model: HandModel, cube: ObjectModel):
    options = DfcOptions(
        contacts=2, steps=60, batch=8, max_batches=1, max_force_closure=1e3, max_distance_m=1e3,
        max_penetration_m=1e3, max_self_m=1e3,
    )  # fmt: skip
    placed = put(cube)
    both = DfcPlanner(options).plan_many(gripper_model, [placed, cube], 8, [seeded(), seeded()])
    heights = [hand_height(gripper_model, BELOW_CUBE, gripper_model.q_of(g)) for g in both]
    assert len(both[0]) == 8
    assert heights[0].min() >= -1e-6
    assert heights[1].min() < -0.01
