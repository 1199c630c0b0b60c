"""Balanced contacts without overlap promise most; a hand that touches nothing least."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from gdg.data.grasps import GraspSet
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.quality.stability import NO_CONTACT, judged_by_stability
from gdg.testing.fixtures import jaw_grasps


def jaws(*squeezed_m: float) -> GraspSet:
    """Jaws around the cube, each so much inside it (negative: off it)."""
    grasps = jaw_grasps((0.0,) * len(squeezed_m), squeeze=None)
    return replace(
        grasps,
        joints=grasps.joints + torch.tensor(squeezed_m)[:, None],
        energies={"total": torch.arange(float(len(squeezed_m))), "contact": torch.ones(1)},
    )


def test_touching_goes_before_overlapping_before_missing(
    gripper_model: HandModel, cube: ObjectModel
):
    judged = judged_by_stability(gripper_model, cube, jaws(-0.02, 0.003, 0.0), 1.5)
    assert judged.energies["total"].argsort().tolist() == [2, 1, 0]
    assert float(judged.energies["total"][0]) == NO_CONTACT
    assert judged.energies["planned"].tolist() == [0.0, 1.0, 2.0]
    assert float(judged.energies["total"][1]) > 0.5 * (3.0 - 1.5) - 1.0  # 3 mm of overlap


def test_overlap_up_to_the_allowed_one_costs_nothing(gripper_model: HandModel, cube: ObjectModel):
    strict, lax = (
        judged_by_stability(gripper_model, cube, jaws(0.003), allowed).energies["total"]
        for allowed in (1.0, 3.5)
    )
    assert float(strict - lax) == pytest.approx(0.5 * 2.0, abs=0.06)


def test_a_grasp_that_is_not_finite_comes_last(gripper_model: HandModel, cube: ObjectModel):
    grasps = jaws(0.0, -0.02)
    grasps.poses[0, 0, 3] = torch.nan
    judged = judged_by_stability(gripper_model, cube, grasps, 1.5)
    assert judged.energies["total"].isinf().tolist() == [True, False]
