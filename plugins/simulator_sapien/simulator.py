"""The simulator component: verdicts by PhysX on the CPU."""

from __future__ import annotations

import time

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

from .engine import sapien
from .options import SapienOptions
from .scene import GraspScene
from .trial import Start, Trial, Until, free_displacement, run_trial

ENGINE = f"sapien {sapien.__version__}"
#: Directions in which the hand is shifted, in this order; further shifts repeat them, doubled.
SHIFT_DIRECTIONS = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3.0)


class SapienSimulator(Simulator):
    """PhysX through SAPIEN: no GPU, no display, one scene for all grasps of a call.

    The hand's root is fixed; every moving joint, mimic and passive ones included, is held by a
    drive whose target follows from the actuated joints. Links of the hand don't collide with each
    other, since the hulls of neighbours overlap.
    """

    options: SapienOptions

    def __init__(self, options: SapienOptions):
        super().__init__(options)

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
            GdgError: the grasps' joints are not the hand's.
        """
        if grasps.joint_names != hand.joint_names:
            raise GdgError(
                f"The grasps have the joints {', '.join(grasps.joint_names)}, but hand "
                f"'{hand.hand.name}' has {', '.join(hand.joint_names)}."
            )
        if not len(grasps):
            return ()
        scene = self.build_scene(hand.hand, obj, protocol)
        free = free_displacement(scene, protocol)
        depths = _start_penetration(hand, obj, grasps)
        shifts = _shifts(protocol)
        verdicts = []
        for index, start in enumerate(_starts(grasps)):
            began = time.perf_counter()
            trials: list[Trial] = []
            for shift in shifts:
                trials.append(run_trial(scene, protocol, start.shifted(shift), self._until(trials)))
                if trials[-1].diverged:
                    # NaN stays in a PhysX scene
                    scene = self.build_scene(hand.hand, obj, protocol)
                if self.options.trials == "decisive" and _decided(trials, len(shifts)):
                    break
            seconds = time.perf_counter() - began
            refined = grasps.targets is not None
            verdicts.append(_verdict(trials, protocol, depths[index], free, refined, seconds))
            if progress is not None:
                progress(index + 1, len(grasps))
        return tuple(verdicts)

    def _until(self, before: list[Trial]) -> Until:
        """How long the trial after these must run: the first that fails names the failure."""
        if not before and self.options.trials == "all":
            return "end"
        return "failed" if any(trial.failure for trial in before) else "named"

    def build_scene(self, hand: Hand, obj: ObjectModel, protocol: Protocol) -> GraspScene:
        """A fresh scene; subclasses may alter it before trials run in it."""
        return GraspScene(hand, obj, protocol, self.options)


def _starts(grasps: GraspSet) -> list[Start]:
    poses = grasps.poses.detach().cpu().double().numpy()
    joints = grasps.joints.detach().cpu().double().numpy()
    targets = joints
    if grasps.targets is not None:
        targets = grasps.targets.detach().cpu().double().numpy()
    return [Start(*row) for row in zip(poses, joints, targets, strict=True)]


def _shifts(protocol: Protocol) -> list[np.ndarray]:
    """No shift, then those of the protocol, metres."""
    shifts = [np.zeros(3)]
    for number in range(protocol.shifts.count):
        ring, direction = divmod(number, len(SHIFT_DIRECTIONS))
        shifts.append((ring + 1) * protocol.shifts.distance_m * SHIFT_DIRECTIONS[direction])
    return shifts


def _decided(trials: list[Trial], total: int) -> bool:
    """Whether the trials still to come, up to ``total``, can't change the majority."""
    failed = sum(1 for trial in trials if trial.failure)
    return 2 * (len(trials) - failed) > total or 2 * failed >= total


def _start_penetration(hand: HandModel, obj: ObjectModel, grasps: GraspSet) -> list[float]:
    """Penetration depth of each grasp as it starts, millimetres."""
    with torch.no_grad():
        return (1000.0 * penetration_depth(hand, obj, hand.q_of(grasps))).tolist()


def _verdict(
    trials: list[Trial],
    protocol: Protocol,
    penetration_mm: float,
    free: float,
    refined: bool,
    seconds: float,
) -> Verdict:
    first, passed = trials[0], tuple(not trial.failure for trial in trials)
    total = 1 + protocol.shifts.count
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
        free_displacement_m=free,
        shift_successes=passed,
        protocol=protocol.label,
        engine=ENGINE,
        refined=refined,
        seconds=seconds,
        trials=total,
    )
