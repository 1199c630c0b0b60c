"""A simulator on top of any ``GraspWorld``: shifted trials, early decisions, verdicts."""

from __future__ import annotations

import time
from abc import abstractmethod
from dataclasses import dataclass
from weakref import ref

import numpy as np
import torch

from gdg.data.grasps import GraspSet
from gdg.data.verdict import Verdict
from gdg.errors import GdgError
from gdg.hands.hand import Hand
from gdg.kinds.fitter import Progress
from gdg.kinds.hand_model import HandModel
from gdg.kinds.simulator import Simulator
from gdg.objects.model import ObjectModel
from gdg.penetration import penetration_depth
from gdg.protocols import Protocol
from gdg.scenes.place import check_protocol
from gdg.simulation.options import SimulatorOptions
from gdg.simulation.trial import Trial, TrialStart, Until, free_displacement, run_trial
from gdg.simulation.world import GraspWorld

#: Directions in which the hand is shifted, in this order; further shifts repeat them, doubled.
SHIFT_DIRECTIONS = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3.0)


class WorldSimulator(Simulator):
    """A simulator that runs every trial in a ``GraspWorld``; subclasses bring the engine.

    Args:
        options: the component's options.

    Attributes:
        engine: name and version of the engine, as verdicts record them.
    """

    engine: str

    def __init__(self, options: SimulatorOptions):
        super().__init__(options)
        self._trials = options.trials
        self._bench: _Bench | None = None

    @abstractmethod
    def build_world(self, hand: Hand, obj: ObjectModel, protocol: Protocol) -> GraspWorld:
        """A fresh world; subclasses may alter it before trials run in it."""

    def left_out(self, protocol: Protocol) -> tuple[str, ...]:
        """What the engine can't simulate of a protocol, a sentence each; verdicts repeat it."""
        return ()

    def get_ready(self, hand: HandModel, obj: ObjectModel, protocol: Protocol) -> None:
        """Builds the world of the pair, and cooks its shapes."""
        check_protocol(protocol, obj.table is not None)
        self._bench = self._taken_bench(hand.hand, obj, protocol)

    def simulate(
        self,
        hand: HandModel,
        obj: ObjectModel,
        grasps: GraspSet,
        protocol: Protocol,
        progress: Progress | None = None,
    ) -> tuple[Verdict, ...]:
        """One verdict per grasp, in order.

        Raises:
            GdgError: the grasps' joints are not the hand's, or the protocol is not for the object's
                scene.
        """
        check_protocol(protocol, obj.table is not None)
        if grasps.joint_names != hand.joint_names:
            raise GdgError(
                f"The grasps have the joints {', '.join(grasps.joint_names)}, but hand "
                f"'{hand.hand.name}' has {', '.join(hand.joint_names)}."
            )
        if not len(grasps):
            return ()
        bench = self._taken_bench(hand.hand, obj, protocol)
        facts = _Facts(
            protocol,
            bench.free_displacement,
            grasps.targets is not None,
            self.engine,
            self.left_out(protocol),
        )
        depths = _start_penetration(hand, obj, grasps)
        verdicts = []
        for index, start in enumerate(_starts(grasps)):
            began = time.perf_counter()
            trials = self._trials_of(bench, obj, start, depths[index])
            verdicts.append(_verdict(trials, facts, depths[index], began))
            if progress is not None:
                progress(index + 1, len(grasps))
        self._bench = bench
        return tuple(verdicts)

    def _taken_bench(self, hand: Hand, obj: ObjectModel, protocol: Protocol) -> _Bench:
        """The bench of the call before, if that was for the same; shapes are cooked once.

        It is put back at the end of a call: what was interrupted is not used again.
        """
        bench, self._bench = self._bench, None
        if bench is not None and bench.serves(hand, obj, protocol):
            return bench
        del bench  # two worlds need not fit into memory
        world = self.build_world(hand, obj, protocol)
        alone = free_displacement(world, protocol, obj.table)
        return _Bench(hand, ref(obj), protocol, world, alone)

    def _trials_of(
        self, bench: _Bench, obj: ObjectModel, start: TrialStart, depth_mm: float
    ) -> list[Trial]:
        """The trials of one grasp: all of them, or as many as decide it."""
        limit = bench.protocol.start.max_initial_penetration_m
        shifts, trials = _shifts(bench.protocol), list[Trial]()
        if limit is not None and depth_mm > 1000.0 * limit:
            # shifts by fractions of a millimetre change nothing of it
            first = self._trial(bench, obj, start, self._until(trials), "penetrating")
            return [first] * (len(shifts) if self._trials == "all" else _least_failing(len(shifts)))
        for shift in shifts:
            trials.append(self._trial(bench, obj, start.shifted(shift), self._until(trials)))
            if self._trials == "decisive" and _decided(trials, len(shifts)):
                break
        return trials

    def _trial(
        self, bench: _Bench, obj: ObjectModel, start: TrialStart, until: Until, failure: str = ""
    ) -> Trial:
        """One trial; see ``run_trial``."""
        trial = run_trial(bench.world, bench.protocol, start, until, obj.table, failure)
        if trial.diverged:  # NaN stays in a world
            bench.world = self.build_world(bench.hand, obj, bench.protocol)
        return trial

    def _until(self, before: list[Trial]) -> Until:
        """How long the trial after these must run: the first that fails names the failure."""
        if not before and self._trials == "all":
            return "end"
        return "failed" if any(trial.failure for trial in before) else "named"


@dataclass
class _Bench:
    """The world in which trials of one hand and object take place; it keeps no object alive.

    Attributes:
        free_displacement: of the object without a hand, metres.
    """

    hand: Hand
    obj: ref[ObjectModel]
    protocol: Protocol
    world: GraspWorld
    free_displacement: float

    def serves(self, hand: Hand, obj: ObjectModel, protocol: Protocol) -> bool:
        """Whether it is for these."""
        return hand is self.hand and obj is self.obj() and protocol == self.protocol


@dataclass(frozen=True)
class _Facts:
    """What the verdicts of all grasps of a call have in common."""

    protocol: Protocol
    free_displacement: float
    refined: bool
    engine: str
    left_out: tuple[str, ...]


def _starts(grasps: GraspSet) -> list[TrialStart]:
    poses = grasps.poses.detach().cpu().double().numpy()
    joints = grasps.joints.detach().cpu().double().numpy()
    targets = joints
    if grasps.targets is not None:
        targets = grasps.targets.detach().cpu().double().numpy()
    return [TrialStart(*row) for row in zip(poses, joints, targets, strict=True)]


def _shifts(protocol: Protocol) -> list[np.ndarray]:
    """No shift, then those of the protocol, metres."""
    shifts = [np.zeros(3)]
    for number in range(protocol.shifts.count):
        ring, direction = divmod(number, len(SHIFT_DIRECTIONS))
        shifts.append((ring + 1) * protocol.shifts.distance_m * SHIFT_DIRECTIONS[direction])
    return shifts


def _least_failing(total: int) -> int:
    """How many failing trials of ``total`` decide that a grasp fails."""
    return (total + 1) // 2


def _decided(trials: list[Trial], total: int) -> bool:
    """Whether the trials still to come, up to ``total``, can't change the majority."""
    failed = sum(1 for trial in trials if trial.failure)
    return 2 * (len(trials) - failed) > total or 2 * failed >= total


def _start_penetration(hand: HandModel, obj: ObjectModel, grasps: GraspSet) -> list[float]:
    """Penetration depth of each grasp as it starts, millimetres."""
    with torch.no_grad():
        return (1000.0 * penetration_depth(hand, obj, hand.q_of(grasps))).tolist()


def _verdict(trials: list[Trial], facts: _Facts, penetration_mm: float, began: float) -> Verdict:
    first, passed = trials[0], tuple(not trial.failure for trial in trials)
    total = 1 + facts.protocol.shifts.count
    # of all trials, since those that were left out can't change a majority
    success = 2 * sum(passed) > total
    failures = [trial.failure for trial in trials if trial.failure]
    return Verdict(
        success=success,
        failure="" if success else failures[0],
        displacement_m=first.displacement,
        rotation_rad=first.rotation,
        drift_m=first.drift,
        contact_kept=first.contact_kept,
        penetration_start_mm=penetration_mm,
        penetration_end_mm=1000.0 * first.overlap,
        free_displacement_m=facts.free_displacement,
        shift_successes=passed,
        protocol=facts.protocol.label,
        engine=facts.engine,
        refined=facts.refined,
        seconds=time.perf_counter() - began,
        trials=total,
        lift_displacement_m=first.lifted.displacement,
        lift_rotation_rad=first.lifted.rotation,
        lift_contact=first.lifted.held,
        left_out=facts.left_out,
    )
