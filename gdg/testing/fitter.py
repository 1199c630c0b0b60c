"""Checks of fitters: one valid grasp per map, repeatable, on the right distance."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

from gdg.data.contact_map import ContactMap
from gdg.data.grasps import GraspSet
from gdg.errors import GdgError
from gdg.kinds.fitter import Fitter, Progress
from gdg.objects.model import ObjectModel
from gdg.testing.checks import moved_global_state, seeded
from gdg.testing.fixtures import GripperCase, StandInGenerator, small_cube
from gdg.testing.grasps import grasp_set_problems, progress_problems, repeat_problems

MAPS = 2
OBJECT_POINTS = 256


@dataclass(frozen=True)
class FitterCase(GripperCase):
    """A fitter with the two-jaw gripper, a cube and two maps."""

    fitter: Fitter

    @cached_property
    def obj(self) -> ObjectModel:
        """The cube, with fewer points: fits are quicker."""
        return small_cube(OBJECT_POINTS)

    @cached_property
    def maps(self) -> ContactMap:
        """Maps of two opposite spots."""
        return StandInGenerator(self.fitter.distance).generate(self.obj, MAPS, seeded())

    def fit(self, maps: ContactMap, progress: Progress | None = None) -> GraspSet:
        """Fits from a fixed seed."""
        return self.fitter.fit(self.hand, self.obj, maps, seeded(), progress)


def grasps(case: FitterCase) -> Iterator[str]:
    """Equally many valid grasps per map, the same in every run; progress counts up."""
    calls: list[tuple[int, int]] = []
    fitted = case.fit(case.maps, lambda done, total: calls.append((done, total)))
    if len(fitted) == 0 or len(fitted) % MAPS:
        yield f"{MAPS} maps gave {len(fitted)} grasps."
    yield from grasp_set_problems(case.hand, case.obj, fitted)
    yield from progress_problems(calls)
    yield from repeat_problems(fitted, case.fit(case.maps))


def one_map(case: FitterCase) -> Iterator[str]:
    """A single map gives as many grasps as one of several."""
    single = replace(case.maps, values=case.maps.values[:1])
    alone, together = len(case.fit(single)), len(case.fit(case.maps))
    if alone * MAPS != together:
        yield f"{MAPS} maps gave {together} grasps, but one map gave {alone}."


def foreign_maps(case: FitterCase) -> Iterator[str]:
    """Maps of a distance that nobody provides are refused."""
    try:
        case.fit(replace(case.maps, distance="no-such-distance/v1"))
    except GdgError:
        return
    yield "maps of an unknown distance must raise a GdgError (see gdg.contact_maps.in_distance)."


def no_map(case: FitterCase) -> Iterator[str]:
    """No maps give no grasps."""
    if len(case.fit(replace(case.maps, values=case.maps.values[:0]))) != 0:
        yield "no maps must give no grasps."


def maps_of_another_object(case: FitterCase) -> Iterator[str]:
    """Maps on other points than the object's are refused."""
    try:
        case.fit(replace(case.maps, values=case.maps.values[:, : OBJECT_POINTS // 2]))
    except GdgError:
        return
    yield "maps of another number of points must raise a GdgError (see gdg.contact_maps.values_on)."


def randomness(case: FitterCase) -> Iterator[str]:
    """Fitting leaves the global random streams alone."""
    yield from moved_global_state(lambda: case.fit(case.maps))


CHECKS = (grasps, one_map, no_map, foreign_maps, maps_of_another_object, randomness)
