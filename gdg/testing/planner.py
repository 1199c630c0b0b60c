"""Checks of planners: at most as many valid grasps as asked for, best first, repeatable."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

from gdg.data.grasps import GraspSet
from gdg.errors import GdgError
from gdg.kinds.fitter import Progress
from gdg.kinds.planner import Planner
from gdg.objects.model import ObjectModel
from gdg.testing.checks import moved_global_state, seeded
from gdg.testing.fixtures import GripperCase, small_cube
from gdg.testing.grasps import grasp_set_problems, progress_problems, repeat_problems
from gdg.testing.trainable import training_problems

COUNT = 3
#: Far fewer than the 2048 points that objects have.
FEW_POINTS = 100


@dataclass(frozen=True)
class PlannerCase(GripperCase):
    """A planner with the two-jaw gripper and a cube."""

    planner: Planner

    def plan(
        self, count: int, progress: Progress | None = None, obj: ObjectModel | None = None
    ) -> GraspSet:
        """Plans from a fixed seed."""
        return self.planner.plan(self.hand, obj or self.obj, count, seeded(), progress)


def grasps(case: PlannerCase) -> Iterator[str]:
    """At most as many valid grasps as asked for, best first; the same in every run."""
    calls: list[tuple[int, int]] = []
    planned = case.plan(COUNT, lambda done, total: calls.append((done, total)))
    if len(planned) > COUNT:
        yield f"{COUNT} grasps were asked for, {len(planned)} given."
    yield from grasp_set_problems(case.hand, case.obj, planned)
    yield from _provenance_mistakes(planned)
    total = planned.energies.get("total")
    if total is not None and bool((total.diff() < 0).any()):
        yield "grasps must come best first: energies['total'] must not fall."
    yield from progress_problems(calls)
    yield from repeat_problems(planned, case.plan(COUNT))


def one_grasp(case: PlannerCase) -> Iterator[str]:
    """A single grasp can be asked for."""
    if len(case.plan(1)) > 1:
        yield "one grasp was asked for, several given."


def randomness(case: PlannerCase) -> Iterator[str]:
    """Planning leaves the global random streams alone."""
    yield from moved_global_state(lambda: case.plan(1))


def other_points(case: PlannerCase) -> Iterator[str]:
    """An object with fewer points is planned for, or refused with the reason."""
    obj = small_cube(FEW_POINTS)
    with suppress(GdgError):
        yield from grasp_set_problems(case.hand, obj, case.plan(1, obj=obj))


def many_objects(case: PlannerCase) -> Iterator[str]:
    """Objects that are planned for in one call each get their own grasps, in order."""
    objects = [case.obj, replace(case.obj, name="other")]
    planned = case.planner.plan_many(case.hand, objects, 1, [seeded(0), seeded(1)])
    if len(planned) != len(objects):
        yield f"plan_many of {len(objects)} objects gave {len(planned)} grasp sets."
        return
    for obj, grasps in zip(objects, planned, strict=True):
        if len(grasps) > 1:
            yield "one grasp of each object was asked for, several given."
        yield from grasp_set_problems(case.hand, obj, grasps)


def training(case: PlannerCase) -> Iterator[str]:
    """A planner that learns can be trained, repeatably."""
    yield from training_problems(case.planner, case.hand, case.obj)


def _provenance_mistakes(planned: GraspSet) -> Iterator[str]:
    rejected = planned.provenance.get("rejected")
    if not isinstance(rejected, Mapping):
        yield "provenance['rejected'] must count the reasons for which candidates were dropped."
        return
    for reason, count in rejected.items():
        if not (isinstance(reason, str) and isinstance(count, int) and count >= 0):
            yield f"provenance['rejected'][{reason!r}] is {count!r}, not a count."


CHECKS = (grasps, one_grasp, randomness, other_points, many_objects, training)
