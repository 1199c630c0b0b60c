"""Checks of fitters: one valid grasp per map, repeatable, on the right distance."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

from gdg.data.contact_map import ContactMap
from gdg.data.grasps import GraspSet
from gdg.errors import GdgError
from gdg.kinds.fitter import Fitter, Progress
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.testing.checks import seeded
from gdg.testing.fixtures import StandInGenerator, model_of, small_cube, two_jaws
from gdg.testing.grasps import grasp_set_problems, progress_problems, repeat_problems

MAPS = 2
OBJECT_POINTS = 256


@dataclass(frozen=True)
class FitterCase:
    """A fitter with the two-jaw gripper, a cube and two maps."""

    fitter: Fitter

    @cached_property
    def hand(self) -> HandModel:
        """The two-jaw gripper."""
        return model_of(two_jaws())

    @cached_property
    def obj(self) -> ObjectModel:
        """The cube."""
        return small_cube(OBJECT_POINTS)

    @cached_property
    def maps(self) -> ContactMap:
        """Maps of two opposite spots."""
        return StandInGenerator(self.fitter.distance).generate(self.obj, MAPS, seeded())

    def fit(self, maps: ContactMap, progress: Progress | None = None) -> GraspSet:
        """Fits from a fixed seed."""
        return self.fitter.fit(self.hand, self.obj, maps, seeded(), progress)


def grasps(case: FitterCase) -> Iterator[str]:
    """One valid grasp per map, the same in every run; progress counts up."""
    calls: list[tuple[int, int]] = []
    fitted = case.fit(case.maps, lambda done, total: calls.append((done, total)))
    if len(fitted) != MAPS:
        yield f"{MAPS} maps gave {len(fitted)} grasps."
    yield from grasp_set_problems(case.hand, case.obj, fitted)
    yield from progress_problems(calls)
    yield from repeat_problems(fitted, case.fit(case.maps))


def one_map(case: FitterCase) -> Iterator[str]:
    """A single map gives a single grasp."""
    single = replace(case.maps, values=case.maps.values[:1])
    if len(case.fit(single)) != 1:
        yield "one map must give one grasp."


def foreign_maps(case: FitterCase) -> Iterator[str]:
    """Maps of a distance that nobody provides are refused."""
    try:
        case.fit(replace(case.maps, distance="no-such-distance/v1"))
    except GdgError:
        return
    yield "maps of an unknown distance must raise a GdgError (see gdg.contact_maps.in_distance)."


CHECKS = (grasps, one_map, foreign_maps)
