"""Simulator: grasps → verdicts under a stability protocol."""

from __future__ import annotations

from abc import ABC, abstractmethod

from gdg.components import Options
from gdg.data.grasps import GraspSet
from gdg.data.verdict import Verdict
from gdg.kinds.fitter import Progress
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.protocols import Protocol


class Simulator(ABC):
    """Runs grasps through a protocol in a physics engine.

    Args:
        options: the component's options.
    """

    def __init__(self, options: Options):
        self.options = options

    def get_ready(  # noqa: B027 a simulator may leave it as it is
        self, hand: HandModel, obj: ObjectModel, protocol: Protocol
    ) -> None:
        """Does ahead what the first grasps of a pair would wait for; by default nothing."""

    @abstractmethod
    def simulate(
        self,
        hand: HandModel,
        obj: ObjectModel,
        grasps: GraspSet,
        protocol: Protocol,
        progress: Progress | None = None,
    ) -> tuple[Verdict, ...]:
        """One verdict per grasp, in order.

        The root link is held fixed at ``grasps.poses``; joints start at ``grasps.joints`` and are
        driven to ``grasps.targets`` (or to ``joints`` where targets are None). An object that
        rests on a table (``obj.table``) is tested by a protocol that lifts it off; a simulator
        refuses other pairs (``gdg.scenes.place.check_protocol``).

        ``Verdict.refined`` says whether there were targets; who prepared the grasps knows better
        (``gdg.starts.simulated``).

        A simulator may leave out trials and pushes that can't change ``success`` and ``failure``
        any more, if its options ask for it; the verdict then says what ran (see ``Verdict``).
        """
