"""Actuators of a MuJoCo model: which joints they drive, how stiffly and how strongly."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gdg.hands.intake.mjcf_model import MjcfModel, among
from gdg.hands.spec import Drive
from gdg.hands.urdf import Mimic

#: Joints by which the length of an actuator's tendon changes less than this, m/rad, are not on it.
MIN_ARM = 1e-7


@dataclass(frozen=True)
class Actuation:
    """What the actuators of a model say about the hand's joints.

    Attributes:
        actuated: joints that they drive, in the order of the tree; None where there are none.
        drives: gains and force limits of those of which anything is known.
    """

    actuated: tuple[str, ...] | None
    drives: dict[str, Drive]


@dataclass
class _Sums:
    """Contributions of all actuators to one joint; None: unknown."""

    stiffness: float = 0.0
    damping: float = 0.0
    force: float | None = None


def read_actuators(
    model: MjcfModel, moving: dict[str, int], couplings: dict[str, Mimic], repairs: list[str]
) -> Actuation:
    """Which joints are driven, and their drives.

    An actuator of a joint that follows another one drives that other one, by the coupling's ratio.

    Args:
        model: the compiled model.
        moving: name -> joint id, of the joints of the hand.
        couplings: joint -> what it follows.
        repairs: actuators whose effect on joints is not fixed are named.
    """
    names = {joint: name for name, joint in moving.items()}
    sums: dict[str, _Sums] = {}
    for actuator in range(model.actuator_count):
        for name, arm in _arms(model, actuator, names, couplings, repairs).items():
            _add(model, actuator, arm, sums.setdefault(name, _Sums()))
    drives = {
        name: drive
        for name, total in sums.items()
        if (drive := _drive(model, moving[name], total)) is not None
    }
    actuated = tuple(name for name in moving if name in sums)
    return Actuation(actuated or None, drives)


def command_ranges(
    model: MjcfModel, moving: dict[str, int], couplings: dict[str, Mimic]
) -> dict[str, tuple[float, float]]:
    """Joint -> range of the commands of its position servo, rad or m."""
    names = {joint: name for name, joint in moving.items()}
    ranges: dict[str, tuple[float, float]] = {}
    for actuator in range(model.actuator_count):
        command = _command_range(model, actuator)
        if command is None or not _is_position_servo(model, actuator):
            continue
        arms = _arms(model, actuator, names, couplings, [])
        gain = float(model.raw.actuator_gainprm[actuator][0])
        stiffness = -float(model.raw.actuator_biasprm[actuator][1])
        for name, arm in arms.items():
            if len(arms) == 1 and arm != 0.0:
                ends = sorted(gain * value / stiffness / arm for value in command)
                ranges[name] = ends[0], ends[1]
    return ranges


def _arms(
    model: MjcfModel,
    actuator: int,
    names: dict[int, str],
    couplings: dict[str, Mimic],
    repairs: list[str],
) -> dict[str, float]:
    """Joint that moves by itself -> change of the actuator's length with its value."""
    joint, tendon = model.actuated_joint(actuator), model.actuated_tendon(actuator)
    parts = {joint: 1.0} if joint is not None else {}
    if tendon is not None:
        parts = model.tendon_joints(tendon)
    if not parts:
        parts = dict(_spatial_arms(model, actuator, names))
        if parts:
            moved = ", ".join(f"'{names[j]}'" for j in parts)
            repairs.append(
                f"Actuator '{model.raw.actuator(actuator).name}' does not act on joints directly; "
                f"those that it moves count as driven one by one: {moved}."
            )
        return {names[j]: arm for j, arm in parts.items() if names[j] not in couplings}
    gear = float(model.raw.actuator_gear[actuator][0])
    arms: dict[str, float] = {}
    for part, coefficient in parts.items():
        if part in names:
            name, factor = names[part], gear * coefficient
            while name in couplings:
                name, factor = couplings[name].joint, factor * couplings[name].multiplier
            arms[name] = arms.get(name, 0.0) + factor
    return arms


def _spatial_arms(
    model: MjcfModel, actuator: int, names: dict[int, str]
) -> Iterator[tuple[int, float]]:
    """Joints by which the length of an actuator's path through space changes."""
    raw, data = model.raw, model.engine.MjData(model.raw)
    step = 1e-4

    def length(joint: int, change: float) -> float:
        data.qpos[:] = raw.qpos0
        data.qpos[raw.jnt_qposadr[joint]] += change
        model.engine.mj_fwdPosition(raw, data)
        return float(np.ravel(data.actuator_length)[actuator])

    for joint in sorted(names):
        arm = (length(joint, step) - length(joint, -step)) / (2 * step)
        if abs(arm) > MIN_ARM:
            yield joint, arm


def _is_position_servo(model: MjcfModel, actuator: int) -> bool:
    raw = model.raw
    affine = among(raw.actuator_biastype[actuator], model.engine.mjtBias.mjBIAS_AFFINE)
    return bool(affine and raw.actuator_biasprm[actuator][1] < 0.0)


def _add(model: MjcfModel, actuator: int, arm: float, total: _Sums) -> None:
    """Adds an actuator's gains and force limit, seen from a joint with that moment arm."""
    raw = model.raw
    bias = raw.actuator_biasprm[actuator]
    if _is_position_servo(model, actuator):
        total.stiffness -= float(bias[1]) * arm**2
        total.damping -= float(bias[2]) * arm**2
    force = None
    if raw.actuator_forcelimited[actuator]:
        force = float(np.abs(raw.actuator_forcerange[actuator]).max()) * abs(arm)
    elif among(raw.actuator_biastype[actuator], model.engine.mjtBias.mjBIAS_NONE) and among(
        raw.actuator_gaintype[actuator], model.engine.mjtGain.mjGAIN_FIXED
    ):
        command = _command_range(model, actuator)
        if command is not None:
            gain = abs(float(raw.actuator_gainprm[actuator][0]) * arm)
            force = max(map(abs, command)) * gain
    if force is not None:
        total.force = (total.force or 0.0) + force


def _command_range(model: MjcfModel, actuator: int) -> tuple[float, float] | None:
    raw = model.raw
    if not raw.actuator_ctrllimited[actuator]:
        return None
    lower, upper = raw.actuator_ctrlrange[actuator]
    return float(lower), float(upper)


def _drive(model: MjcfModel, joint: int, total: _Sums) -> Drive | None:
    """The drive of a joint; figures of which nothing is known are gdg's defaults."""
    dof = int(model.raw.jnt_dofadr[joint])
    passive = float(np.ravel(model.raw.dof_damping[dof])[0])
    most = model.joint_force(joint)
    force = min(f for f in (total.force, most or None, np.inf) if f is not None)
    known: dict[str, float] = {}
    if total.stiffness > 0.0:
        known = {"stiffness": total.stiffness, "damping": total.damping + passive}
    if 0.0 < force < np.inf:
        known["force_limit"] = force
    return Drive(**known) if known else None
