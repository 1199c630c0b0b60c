"""A simulator that other processes help."""

from __future__ import annotations

from collections.abc import Callable

from gdg.data.grasps import GraspSet
from gdg.data.verdict import Verdict
from gdg.kinds.fitter import Progress
from gdg.kinds.hand_model import HandModel
from gdg.kinds.simulator import Simulator
from gdg.objects.model import ObjectModel
from gdg.pipeline.judges import Judges
from gdg.protocols import Protocol


class SharedSimulator(Simulator):
    """Has grasps tested by this process and others.

    Args:
        own: the simulator of this process; the others have its like.
        judges: the others.
        meanwhile: called while they test, before this process does.
    """

    def __init__(self, own: Simulator, judges: Judges, meanwhile: Callable[[], None]):
        super().__init__(own.options)
        self._own, self._judges, self._meanwhile = own, judges, meanwhile

    def simulate(
        self,
        hand: HandModel,
        obj: ObjectModel,
        grasps: GraspSet,
        protocol: Protocol,
        progress: Progress | None = None,
    ) -> tuple[Verdict, ...]:
        """One verdict per grasp, in order; see the interface."""

        def test(grasp: GraspSet, protocol: Protocol) -> Verdict:
            return self._own.simulate(hand, obj, grasp, protocol)[0]

        report = progress or (lambda done, total: None)
        found = self._judges.verdicts(grasps, protocol, test, report, self._meanwhile)
        return tuple(found)
