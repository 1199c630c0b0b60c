"""Checks of planners: at most as many valid grasps as asked for, best first, repeatable."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

from gdg.data.grasps import GraspSet
from gdg.kinds.fitter import Progress
from gdg.kinds.hand_model import HandModel
from gdg.kinds.planner import Planner
from gdg.objects.model import ObjectModel
from gdg.testing.checks import seeded
from gdg.testing.fixtures import model_of, small_cube, two_jaws
from gdg.testing.grasps import grasp_set_problems, progress_problems, repeat_problems

COUNT = 3


@dataclass(frozen=True)
class PlannerCase:
    """A planner with the two-jaw gripper and a cube."""

    planner: Planner

    @cached_property
    def hand(self) -> HandModel:
        """The two-jaw gripper."""
        return model_of(two_jaws())

    @cached_property
    def obj(self) -> ObjectModel:
        """The cube, with all its points: networks may rely on their number."""
        return small_cube()

    def plan(self, count: int, progress: Progress | None = None) -> GraspSet:
        """Plans from a fixed seed."""
        return self.planner.plan(self.hand, self.obj, count, seeded(), progress)


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


def _provenance_mistakes(planned: GraspSet) -> Iterator[str]:
    rejected = planned.provenance.get("rejected")
    if not isinstance(rejected, Mapping):
        yield "provenance['rejected'] must count the reasons for which candidates were dropped."
        return
    for reason, count in rejected.items():
        if not (isinstance(reason, str) and isinstance(count, int) and count >= 0):
            yield f"provenance['rejected'][{reason!r}] is {count!r}, not a count."


CHECKS = (grasps, one_grasp)
