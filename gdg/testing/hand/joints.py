"""Checks of a hand's joints: limits, motion, postures, drives."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch

from gdg.hands.urdf import Joint
from gdg.testing.checks import not_rigid
from gdg.testing.findings import Finding, error, warning
from gdg.testing.hand.case import HandCase

#: A joint must move some surface point by this over its range, metres.
MIN_MOTION_M = 1e-4
#: Limits beyond these are in another unit; beyond the second figures they are unusual. rad, m.
MAX_LIMIT = {"revolute": 4 * np.pi, "continuous": 4 * np.pi, "prismatic": 1.0}
USUAL_LIMIT = {"revolute": 2 * np.pi, "continuous": 2 * np.pi, "prismatic": 0.3}
WRONG_UNIT = {"revolute": "degrees", "continuous": "degrees", "prismatic": "millimetres"}
UNITS = {"revolute": "rad", "continuous": "rad", "prismatic": "m"}
#: A mimic joint may leave its own limits by this share of its range.
MIMIC_TOLERANCE = 0.02


def joint_limits(case: HandCase) -> Iterator[Finding]:
    """Limits are finite, ordered and of a size that a hand can have."""
    for joint in case.hand.moving_joints:
        where = case.in_urdf(f"joint '{joint.name}'")
        if not (np.isfinite([joint.lower, joint.upper]).all() and joint.lower < joint.upper):
            yield error(
                where,
                f"the lower limit {joint.lower:g} must be below the upper one {joint.upper:g}.",
            )
            continue
        yield from _unlikely_limits(where, joint)


def _unlikely_limits(where: str, joint: Joint) -> Iterator[Finding]:
    largest = max(abs(joint.lower), abs(joint.upper))
    limits = f"[{joint.lower:g}, {joint.upper:g}] {UNITS[joint.type]}"
    if largest > MAX_LIMIT[joint.type]:
        unit = WRONG_UNIT[joint.type]
        yield error(where, f"the limits {limits} seem to be in {unit}; convert them.")
    elif largest > USUAL_LIMIT[joint.type]:
        yield warning(where, f"the limits {limits} are unusually wide; check them.")


def mimic_joints(case: HandCase) -> Iterator[Finding]:
    """Joints that follow others stay within limits of their own."""
    matrix, offset = case.hand.coupling
    lower, upper = case.hand.limits()
    ends = np.sort(np.stack((matrix * lower, matrix * upper)), axis=0).sum(-1) + offset
    for joint, low, high in zip(case.hand.moving_joints, *ends):
        slack = MIMIC_TOLERANCE * (joint.upper - joint.lower)
        if joint.mimic and (low < joint.lower - slack or high > joint.upper + slack):
            yield warning(
                case.in_urdf(f"joint '{joint.name}'"),
                f"follows '{joint.mimic.joint}' over [{low:.3g}, {high:.3g}], beyond its own "
                f"limits [{joint.lower:.3g}, {joint.upper:.3g}]; widen these or narrow the other.",
            )


def passive_joints(case: HandCase) -> Iterator[Finding]:
    """Every joint that can move is driven or follows another."""
    actuated = case.hand.spec.joints
    values = case.hand.coupling[1]
    for joint, value in zip(case.hand.moving_joints, values):
        if joint.name not in actuated and joint.mimic is None:
            yield warning(
                case.in_manifest("joints"),
                f"'{joint.name}' can move but is not listed: it stays at {value:.3g}. List it, or "
                f"make it a fixed joint in the URDF.",
            )


def kinematics(case: HandCase) -> Iterator[Finding]:
    """Link poses are rigid in random postures, and every joint moves the hand's surface."""
    model = case.model
    if bool(not_rigid(model.link_poses_in_root(case.postures)).any()):
        yield error(
            case.in_urdf("joints"),
            "link poses are not finite or not rigid in a random posture within the limits.",
        )
    for index, name in enumerate(model.joint_names):
        # two ends and the middle: a full turn ends where it began
        values = ((model.lower + model.upper) / 2).repeat(3, 1)
        values[0, index], values[2, index] = model.lower[index], model.upper[index]
        first, middle, last = model.place_surface(model.link_poses_in_root(values))
        motions = torch.stack((first - last, first - middle)).norm(dim=-1)
        if not motions.max() > MIN_MOTION_M:
            yield error(
                case.in_manifest("joints"),
                f"joint '{name}' moves no surface of the hand; leave it out.",
            )


def postures(case: HandCase) -> Iterator[Finding]:
    """Open and closed postures are within limits and differ."""
    lower, upper = case.hand.limits()
    both = {which: case.hand.posture(which) for which in ("open", "closed")}
    for which, values in both.items():
        for index in np.flatnonzero((values < lower - 1e-3) | (values > upper + 1e-3)):
            joint = case.hand.spec.joints[index]
            yield error(
                case.in_manifest(f"{which}.{joint}"),
                f"{values[index]:g} is outside the joint's limits [{lower[index]:g}, "
                f"{upper[index]:g}].",
            )
    if not (np.abs(both["open"] - both["closed"]) > 1e-3 * (upper - lower)).any():
        yield error(
            case.in_manifest("closed"),
            "open and closed are the same posture; at least one joint must differ.",
        )


def drives(case: HandCase) -> Iterator[Finding]:
    """Every actuated joint has a drive that somebody chose."""
    given = case.hand.spec.drives
    if "default" in given.model_fields_set:
        return
    efforts = {name: case.hand.urdf.joints[name].effort for name in case.hand.spec.joints}
    for name, effort in efforts.items():
        if name in given.joints:
            continue
        stated = f"the URDF states an effort of {effort:g}" if effort > 0 else "the URDF has none"
        unit = "N" if case.hand.urdf.joints[name].type == "prismatic" else "N m"
        yield warning(
            case.in_manifest(f"drives.joints.{name}"),
            f"no drive is given, so simulators limit it to {given.of(name).force_limit:g} {unit} "
            f"({stated}); write drives: {{default: {{force_limit: …}}}} or one for this joint.",
        )


CHECKS = (joint_limits, mimic_joints, passive_joints, kinematics, postures, drives)
