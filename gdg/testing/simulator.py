"""Checks of simulators: control grasps with a known outcome, order, repeatability."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
import torch

from gdg.data.grasps import GraspSet
from gdg.data.scene import TableScene
from gdg.data.table import Table
from gdg.data.verdict import DIRECTIONS, FAILURES, Verdict
from gdg.errors import GdgError
from gdg.kinds.fitter import Progress
from gdg.kinds.simulator import Simulator
from gdg.objects.model import ObjectModel
from gdg.protocols import Protocol, load_protocol
from gdg.testing.fixtures import HALF_CUBE_M, GripperCase, jaw_grasps, quick_protocol
from gdg.testing.grasps import progress_problems

#: A hand that is shifted so far holds nothing, metres.
ABSENT_M = 1.0
#: Two runs of one trial in one process, metres.
REPEAT_TOLERANCE_M = 1e-4
#: The palm looks down on the cube from so far above its middle: the jaws' tips are 5 mm above the
#: table, metres.
PALM_ABOVE_M = 0.05


@dataclass(frozen=True)
class SimulatorCase(GripperCase):
    """A simulator with the two-jaw gripper, a cube and a quick protocol."""

    simulator: Simulator

    @cached_property
    def protocol(self) -> Protocol:
        """The preset ``dro-2024`` without shifted trials."""
        return quick_protocol(per_direction=False)

    @cached_property
    def firm_then_absent(self) -> tuple[Verdict, ...]:
        """Verdicts of a firm grasp and of a hand that is not there."""
        return self.run(jaw_grasps((0.0, ABSENT_M)), self.protocol)

    def run(
        self,
        grasps: GraspSet,
        protocol: Protocol,
        progress: Progress | None = None,
        obj: ObjectModel | None = None,
    ) -> tuple[Verdict, ...]:
        """Verdicts of grasps of the cube, or of the same cube elsewhere."""
        return self.simulator.simulate(self.hand, obj or self.obj, grasps, protocol, progress)


def verdicts(case: SimulatorCase) -> Iterator[str]:
    """One verdict per grasp, in order, with all its fields filled in."""
    found = case.firm_then_absent
    if len(found) != 2:
        yield f"two grasps gave {len(found)} verdicts."
        return
    for verdict in found:
        yield from _field_mistakes(verdict, case.protocol)
    swapped = case.run(jaw_grasps((ABSENT_M, 0.0)), case.protocol)
    if [v.success for v in swapped] != [v.success for v in reversed(found)]:
        yield "grasps in another order gave other verdicts, or verdicts in another order."
    if case.run(jaw_grasps(()), case.protocol) != ():
        yield "no grasps must give no verdicts."


def firm_grasp(case: SimulatorCase) -> Iterator[str]:
    """Two jaws that press on a cube hold it."""
    verdict = case.firm_then_absent[0]
    if not verdict.success:
        yield f"two jaws that press on the cube's middle must hold it, but: {verdict.failure}."


def absent_hand(case: SimulatorCase) -> Iterator[str]:
    """A hand that is not there fails in every direction."""
    protocol = quick_protocol(per_direction=True)
    (verdict,) = case.run(jaw_grasps((ABSENT_M,)), protocol)
    if verdict.success:
        yield "a hand one metre away must not pass."
    if any(verdict.contact_kept):
        yield "a hand one metre away has no contact to keep."
    measured = [value for value in verdict.displacement_m if not math.isnan(value)]
    least = min(measured, default=0.0)
    if not least > (protocol.success.max_displacement_m or 0.0):
        yield (
            f"a free object moved only {1000 * least:.1f} mm in some direction, less than the "
            f"protocol's limit."
        )


def lifted_grasp(case: SimulatorCase) -> Iterator[str]:
    """Two jaws that press on a cube lift it; a hand that is not there doesn't."""
    firm, absent = case.run(jaw_grasps((0.0, ABSENT_M)), _without_shifts("gdg-realistic-1"))
    for verdict in (firm, absent):
        yield from _plain_mistakes(verdict)
    if not (firm.success and firm.lift_contact):
        yield f"two jaws that press on the cube must lift it, but: {firm.failure}."
    if absent.success or absent.lift_contact:
        yield "a hand one metre away must not lift the cube."
    if not (math.isnan(absent.lift_displacement_m) or absent.lift_displacement_m > ABSENT_M):
        yield "a free object under gravity for a second falls by metres, but did not."


def cube_on_a_table(case: SimulatorCase) -> Iterator[str]:
    """Two jaws lift a cube off a table; without them it stays there."""
    protocol = _without_shifts("tabletop-lift")
    grasps = jaw_grasps((0.0, ABSENT_M), squeeze=0.004)
    grasps.poses[:, 1, 1] = grasps.poses[:, 2, 2] = -1.0
    grasps.poses[:, 2, 3] = PALM_ABOVE_M
    table = Table((0.0, 0.0, 1.0), -HALF_CUBE_M)
    placed = replace(case.obj, scene=TableScene(table, 0, 1.0))
    firm, absent = case.run(grasps, protocol, obj=placed)
    if not (firm.success and firm.lift_contact):
        yield f"two jaws that press on the cube must lift it off a table, but: {firm.failure}."
    if absent.failure != "dropped" or absent.drift_m > 0.001:
        yield f"a cube that nobody lifts must stay on the table: {absent.failure or 'success'}."
    free = absent.free_displacement_m
    if protocol.lift is not None and not math.isclose(free, protocol.lift.height_m, rel_tol=0.05):
        yield f"a cube on a table that sinks by 100 mm must sink with it, not by {1000 * free:.0f}."
    for name, obj in (("tabletop-lift", case.obj), ("gdg-realistic-1", placed)):
        try:
            case.run(grasps, _without_shifts(name), obj=obj)
        except GdgError:
            continue
        yield "a table without a lift from it, or the other way round, must raise a GdgError."


def initial_overlap(case: SimulatorCase) -> Iterator[str]:
    """A grasp that starts too deep in the object fails, whatever the solver makes of it."""
    grasps = jaw_grasps((0.0,), squeeze=0.004)
    grasps.joints[:] += 0.003
    (verdict,) = case.run(grasps, _without_shifts("gdg-realistic-1"))
    if verdict.failure != "penetrating":
        yield f"jaws 3 mm inside the cube must fail as penetrating, not '{verdict.failure}'."


def repetition(case: SimulatorCase) -> Iterator[str]:
    """The same grasp gets the same verdict."""
    again = case.run(jaw_grasps((0.0, ABSENT_M)), case.protocol)
    for first, second in zip(case.firm_then_absent, again):
        yield from _apart(first, second, "in a second run")


def alone(case: SimulatorCase) -> Iterator[str]:
    """A grasp gets the same verdict alone as among others."""
    (verdict,) = case.run(jaw_grasps((0.0,)), case.protocol)
    yield from _apart(case.firm_then_absent[0], verdict, "alone instead of among others")


def turned_grasp(case: SimulatorCase) -> Iterator[str]:
    """A cube looks the same from its sides: a grasp turned by 90° holds it as well."""
    firm = jaw_grasps((0.0,))
    turn = torch.tensor([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    (verdict,) = case.run(replace(firm, poses=turn @ firm.poses), case.protocol)
    if verdict.success != case.firm_then_absent[0].success:
        yield f"a grasp turned by 90° around the cube is judged otherwise: {verdict.failure}."


def no_targets(case: SimulatorCase) -> Iterator[str]:
    """Grasps without drive targets are tested as they are, and said not to be refined."""
    (verdict,) = case.run(jaw_grasps((0.0,), squeeze=None), case.protocol)
    if verdict.refined:
        yield "refined must be false for grasps without drive targets."


def foreign_grasps(case: SimulatorCase) -> Iterator[str]:
    """Grasps of a hand with other joints are refused."""
    try:
        case.run(replace(jaw_grasps((0.0,)), joint_names=("other",)), case.protocol)
    except GdgError:
        return
    yield "grasps of a hand with other joints must raise a GdgError."


def progress(case: SimulatorCase) -> Iterator[str]:
    """Progress counts up."""
    calls: list[tuple[int, int]] = []
    case.run(jaw_grasps((0.0,)), case.protocol, lambda done, total: calls.append((done, total)))
    yield from progress_problems(calls)


def _without_shifts(name: str) -> Protocol:
    preset = load_protocol(name)
    return preset.model_copy(update={"shifts": preset.shifts.model_copy(update={"count": 0})})


def _apart(first: Verdict, second: Verdict, when: str) -> Iterator[str]:
    pairs = zip(first.displacement_m, second.displacement_m)
    # what was not measured in both can't differ
    apart = (abs(a - b) for a, b in pairs if not (math.isnan(a) and math.isnan(b)))
    moved = float(np.max([0.0, *apart]))  # unlike max(), NaN where one is
    if first.success != second.success or not moved <= REPEAT_TOLERANCE_M:
        yield f"{when}, a grasp's object moved by {1000 * moved:.2g} mm more or less."


def _plain_mistakes(verdict: Verdict) -> Iterator[str]:
    for field in fields(verdict):
        value = getattr(verdict, field.name)
        for one in value if isinstance(value, tuple) else (value,):
            if type(one) not in (bool, float, int, str):
                yield f"{field.name} holds a {type(one).__name__}, not a plain Python value."
                break


def _trial_mistakes(verdict: Verdict, protocol: Protocol) -> Iterator[str]:
    total, ran = 1 + protocol.shifts.count, len(verdict.shift_successes)
    if verdict.trials not in (0, total):
        yield f"trials is {verdict.trials}, but the protocol asks for {total}."
    if ran == total:
        return
    passed = sum(verdict.shift_successes)
    decided = 2 * passed > total or 2 * (ran - passed) >= total
    if not (ran < total == verdict.trials and decided):
        yield (
            "shift_successes must have the unshifted trial and one value per shift; fewer only "
            "where they decide the majority and trials gives the full number."
        )


def _field_mistakes(verdict: Verdict, protocol: Protocol) -> Iterator[str]:
    yield from _plain_mistakes(verdict)
    yield from _trial_mistakes(verdict, protocol)
    for name in ("displacement_m", "rotation_rad", "contact_kept"):
        if len(getattr(verdict, name)) != len(DIRECTIONS):
            yield f"{name} must have one value per direction {', '.join(DIRECTIONS)}."
    if verdict.success != (verdict.failure == ""):
        yield "failure must be empty on success, and on success alone."
    if verdict.failure and verdict.failure not in FAILURES:
        yield f"failure '{verdict.failure}' is none of {', '.join(FAILURES)}."
    if verdict.protocol != protocol.label:
        yield f"protocol is '{verdict.protocol}', not '{protocol.label}'."
    if not verdict.engine.strip():
        yield "engine must name the engine and its version."
    if not verdict.refined:
        yield "refined must be true for grasps with drive targets."


CHECKS = (
    verdicts, firm_grasp, absent_hand, lifted_grasp, cube_on_a_table, initial_overlap, repetition,
    alone, turned_grasp, no_targets, foreign_grasps, progress,
)  # fmt: skip
