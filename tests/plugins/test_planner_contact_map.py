"""The contact-map planner closes the fingers that the fit left off the object, unless told not."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import torch
from gdg_plugins.distance_euclidean.distance import EuclideanDistance
from gdg_plugins.planner_contact_map import planner as planner_module
from gdg_plugins.planner_contact_map.options import ContactMapOptions
from gdg_plugins.planner_contact_map.planner import ContactMapPlanner

from gdg.components import NoOptions
from gdg.config import compose
from gdg.data.contact_map import ContactMap
from gdg.data.grasps import GraspSet
from gdg.errors import GdgError
from gdg.kinds.fitter import Fitter, Progress
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.pipeline.jobs import DEFAULTS as DEFAULT_COMPONENTS
from gdg.pipeline.jobs import GraspJob
from gdg.registry import get_registry
from gdg.testing.fixtures import HALF_CUBE_M, StandInGenerator, jaw_grasps
from gdg.testing.gripper import OPEN_M

#: What is chosen where nothing is said.
DEFAULTS = {
    "maps": 4.0, "close": True, "rank": "stability", "spread": 0.5, "max_overlap_mm": 1.5,
}  # fmt: skip
#: How far the stand-in's fits leave the jaws open, worst fit first; metres per grasp.
LEFT_OPEN_M = (0.02, 0.0, 0.01)


class OpenFits(Fitter):
    """Puts the gripper around the cube, its jaws off it."""

    def fit(
        self,
        hand: HandModel,
        obj: ObjectModel,
        maps: ContactMap,
        generator: torch.Generator,
        progress: Progress | None = None,
    ) -> GraspSet:
        left_open = torch.tensor(LEFT_OPEN_M[: len(maps)])
        grasps = jaw_grasps((0.0,) * len(maps), squeeze=None)
        return replace(
            grasps,
            joints=grasps.joints - left_open[:, None],
            energies={"total": left_open},
            status=("converged",) * len(maps),
        )


def planned(
    hand: HandModel,
    obj: ObjectModel,
    count: int,
    close: bool,
    fitter: type[Fitter] = OpenFits,
    **options: Any,
) -> GraspSet:
    distance = EuclideanDistance(NoOptions())
    planner = ContactMapPlanner(
        ContactMapOptions(close=close, **{"maps": 1, **options}),
        generator=StandInGenerator(distance),
        fitter=fitter(NoOptions(), distance=distance),
    )
    return planner.plan(hand, obj, count, torch.Generator().manual_seed(0))


def test_fingers_are_closed_until_they_touch(gripper_model: HandModel, cube: ObjectModel):
    grasps = planned(gripper_model, cube, 3, close=True)
    opening = OPEN_M - grasps.joints
    torch.testing.assert_close(opening, torch.full((3, 1), HALF_CUBE_M), rtol=0, atol=0.001)


def test_close_false_keeps_what_the_fitter_gave(gripper_model: HandModel, cube: ObjectModel):
    grasps = planned(gripper_model, cube, 3, close=False, rank="energy")
    left_open = OPEN_M - HALF_CUBE_M - grasps.joints[:, 0]
    # best first: the energy is how far the jaws are open
    torch.testing.assert_close(left_open, torch.tensor([0.0, 0.01, 0.02]), rtol=0, atol=1e-6)


def test_of_more_maps_than_grasps_the_best_are_kept(gripper_model: HandModel, cube: ObjectModel):
    grasps = planned(gripper_model, cube, 2, close=False, rank="energy", maps=1.5)
    left_open = OPEN_M - HALF_CUBE_M - grasps.joints[:, 0]
    torch.testing.assert_close(left_open, torch.tensor([0.0, 0.01]), rtol=0, atol=1e-6)


@pytest.mark.parametrize("close", [True, False])
def test_no_maps_give_no_grasps(gripper_model: HandModel, cube: ObjectModel, close: bool):
    assert len(planned(gripper_model, cube, 0, close)) == 0


class SeveralFits(OpenFits):
    """Of each map: a fit of low energy that overlaps, one that is off, one that holds."""

    def fit(self, hand: HandModel, obj: ObjectModel, maps: ContactMap, *rest: Any) -> GraspSet:
        squeezed = torch.tensor([0.004, -0.01, 0.0] * len(maps))
        grasps = jaw_grasps((0.0,) * len(squeezed), squeeze=None)
        return replace(
            grasps,
            joints=grasps.joints + squeezed[:, None],
            energies={"total": torch.tensor([0.1, 0.2, 0.3] * len(maps))},
            status=("hit_limit", "hit_limit", "hit_limit") * len(maps),
        )


@pytest.mark.parametrize(("rank", "squeezed"), [("energy", 0.004), ("stability", 0.0)])
def test_one_fit_of_each_map_is_kept(
    rank: str, squeezed: float, gripper_model: HandModel, cube: ObjectModel
):
    grasps = planned(gripper_model, cube, 2, False, SeveralFits, rank=rank, spread=0, maps=4)
    held = OPEN_M - HALF_CUBE_M
    torch.testing.assert_close(
        grasps.joints, torch.full((2, 1), held + squeezed), rtol=0, atol=1e-6
    )


def test_of_fewer_maps_than_grasps_several_fits_to_a_map_are_kept(
    gripper_model: HandModel, cube: ObjectModel
):
    grasps = planned(gripper_model, cube, 4, False, SeveralFits, maps=0.5)
    assert len(grasps) == 4  # of two maps with three fits each


@pytest.mark.parametrize("words", [{"rank": "energy"}, {"spread": 0}])
def test_a_grasp_of_each_map_asks_for_a_map_per_grasp(words: dict[str, Any]):
    given = [f"planner.{name}={value}" for name, value in {"maps": 0.5, **words}.items()]
    needs = r"^planner: maps below 1 need rank=stability and spread > 0\.$"
    with pytest.raises(GdgError, match=needs):
        compose(GraspJob, get_registry(), DEFAULT_COMPONENTS, (), ["hand=a", "object=b", *given])


def test_grasps_that_hold_and_differ_go_before_those_that_are_alike_or_fail():
    grasps = replace(
        jaw_grasps((0.0,) * 5, squeeze=None),
        joints=torch.tensor([[0.0], [0.01], [0.5], [1.0], [0.9]]),
        energies={"total": torch.tensor([-0.3, -0.29, -0.1, 0.2, -0.05])},
        metrics={planner_module.MAP: torch.arange(5.0)},
    )
    alike, spread, all_five = (
        planner_module._spread_out(grasps, count, weight).joints[:, 0].tolist()
        for count, weight in ((3, 0.0), (3, 1.0), (9, 1.0))
    )
    assert alike == pytest.approx([0.0, 0.01, 0.5])
    assert spread == pytest.approx([0.0, 0.5, 0.9])
    assert all_five == pytest.approx([0.0, 0.01, 0.5, 0.9, 1.0])


@pytest.mark.parametrize(("rank", "closed"), [("energy", 2), ("stability", 6)])
def test_what_the_energy_does_not_choose_is_not_closed(
    rank: str,
    closed: int,
    gripper_model: HandModel,
    cube: ObjectModel,
    monkeypatch: pytest.MonkeyPatch,
):
    seen: list[int] = []

    def close(hand: HandModel, obj: ObjectModel, q: torch.Tensor, **rest: Any) -> torch.Tensor:
        seen.append(len(q))
        return q

    monkeypatch.setattr(planner_module, "close_until_touch", close)
    grasps = planned(gripper_model, cube, 2, True, SeveralFits, rank=rank)
    assert (len(grasps), seen) == (2, [closed])
    assert set(grasps.provenance["seconds"]) == {"generate", "fit", "close", "rank"}


def test_seconds_of_a_stage_that_is_off_are_not_told(gripper_model: HandModel, cube: ObjectModel):
    seconds = planned(gripper_model, cube, 1, close=False).provenance["seconds"]
    assert set(seconds) == {"generate", "fit", "rank"}


def test_closing_is_the_default_and_can_be_set_by_name():
    options = get_registry().find("planner", "contact-map").options
    assert options().model_dump() == DEFAULTS
    assert options.model_validate({"close": False}).model_dump() == {**DEFAULTS, "close": False}
