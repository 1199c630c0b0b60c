"""Closed loops of a MuJoCo model (four-bars): their passive joints follow the one that is driven.

A tree can't hold a loop. The driver is swept through its range, the loop is closed at each value
by least squares, and each passive joint gets the line nearest to the curve that it went through.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from gdg.hands.intake.mjcf_couplings import law_text
from gdg.hands.intake.mjcf_model import MjcfModel, among
from gdg.hands.urdf import CONTINUOUS_RANGE, Mimic

#: Values of the driver at which the loop is closed.
SWEEP_POINTS = 41
#: A line through fewer solutions than these would say little.
MIN_SOLUTIONS = 5
#: A driver with a narrower range, rad or m, does not move.
MIN_RANGE = 1e-4
#: A loop that stays open by more than this, metres, can't be closed there.
MAX_GAP_M = 1e-3
#: A passive joint that moves more than this between two values has gone over to another branch of
#: the mechanism, rad.
MAX_JUMP = 0.5
#: Weights of the residuals: an open loop, per metre; a spring at its stiffest, per rad; leaving
#: the neighbouring solution, per rad, where nothing else says which way to go.
GAP_WEIGHT, SPRING_WEIGHT, STAY_WEIGHT = 1e4, 0.05, 1e-3


@dataclass(frozen=True)
class Loop:
    """Equalities that must hold together and the joints that they tie.

    Attributes:
        equalities: ids.
        joints: ids of the hand's joints on the loop.
    """

    equalities: tuple[int, ...]
    joints: frozenset[int]


@dataclass(frozen=True)
class Closed:
    """What closing the loops gave.

    Attributes:
        couplings: joint -> what it follows; those given and those found.
        ranges: joint -> the range in which the loops close.
    """

    couplings: dict[str, Mimic]
    ranges: dict[str, tuple[float, float]]


def close_loops(
    model: MjcfModel,
    moving: dict[str, int],
    couplings: dict[str, Mimic],
    commands: dict[str, tuple[float, float]],
    repairs: list[str],
) -> Closed:
    """Adds the couplings that the model's connect and weld equalities amount to.

    Args:
        model: the compiled model.
        moving: name -> joint id, of the joints of the hand.
        couplings: those known already.
        commands: joint -> range of its commands, for drivers without limits.
        repairs: one sentence per loop joint is added.
    """
    solver = _Solver(model, moving, couplings)
    found, ranges = dict(couplings), {}
    for loop in _loops(model, moving, solver.fixed_by_others):
        driver, passive = solver.roles(loop)
        reason = "its joints are all driven" if driver is not None else "several joints drive it"
        if driver is not None and passive:
            name = model.joint_names[driver]
            limits = model.joint_range(driver)
            if math.isnan(limits[0]):
                limits = commands.get(name, CONTINUOUS_RANGE)
            values, solutions = solver.sweep(loop, driver, passive, limits)
            if len(values) >= MIN_SOLUTIONS:
                found |= _followers(model, driver, passive, values, solutions, repairs)
                if len(values) < SWEEP_POINTS:
                    ranges[name] = _cut(name, values, repairs)
                continue
            reason = f"it closes for no value of '{name}'"
        names = ", ".join(f"'{model.joint_names[j]}'" for j in sorted(loop.joints))
        repairs.append(f"The closed loop of joints {names} is left open: {reason}.")
    return Closed(found, ranges)


def _followers(
    model: MjcfModel,
    driver: int,
    passive: list[int],
    values: np.ndarray,
    solutions: np.ndarray,
    repairs: list[str],
) -> dict[str, Mimic]:
    """The line nearest to each passive joint's curve over the driver's values."""
    found = {}
    for column, joint in enumerate(passive):
        name, curve = model.joint_names[joint], solutions[:, column]
        slope, constant = np.polyfit(values, curve, 1).round(7).tolist()
        error = np.abs(curve - slope * values - constant).max()
        found[name] = Mimic(model.joint_names[driver], slope, constant)
        repairs.append(
            f"Joint '{name}' is in a closed loop; it now follows '{found[name].joint}': "
            f"{law_text(found[name])} (off by at most {error:.2g})."
        )
    return found


def _cut(name: str, values: np.ndarray, repairs: list[str]) -> tuple[float, float]:
    lower, upper = float(values[0]), float(values[-1])
    repairs.append(
        f"Joint '{name}': range cut to {lower:.4g} to {upper:.4g}, in which its closed loop closes."
    )
    return lower, upper


def _loops(model: MjcfModel, moving: dict[str, int], fixed_by_others: set[int]) -> Iterator[Loop]:
    """Loops of the hand, those that share a passive joint taken together."""
    groups: list[Loop] = []
    for equality in _closing_equalities(model):
        first, second = _bodies(model, equality)
        joints = frozenset(_path_joints(model, first, second)) & set(moving.values())
        if not joints:
            continue
        merged = Loop((equality,), frozenset(joints))
        for group in [g for g in groups if (g.joints & merged.joints) - fixed_by_others]:
            groups.remove(group)
            equalities = (*group.equalities, *merged.equalities)
            merged = Loop(equalities, group.joints | merged.joints)
        groups.append(merged)
    yield from groups


def _closing_equalities(model: MjcfModel) -> Iterator[int]:
    kinds = (model.engine.mjtEq.mjEQ_CONNECT, model.engine.mjtEq.mjEQ_WELD)
    for equality in range(model.raw.neq):
        if model.raw.eq_active0[equality] and among(model.raw.eq_type[equality], *kinds):
            bodies = _bodies(model, equality)
            if all(model.raw.body_mocapid[body] < 0 for body in bodies):
                yield equality


def _bodies(model: MjcfModel, equality: int) -> tuple[int, int]:
    """The two bodies that an equality joins; it may name sites on them."""
    raw = model.raw
    ids = int(raw.eq_obj1id[equality]), int(raw.eq_obj2id[equality])
    if among(raw.eq_objtype[equality], model.engine.mjtObj.mjOBJ_SITE):
        return int(raw.site_bodyid[ids[0]]), int(raw.site_bodyid[ids[1]])
    return ids


def _path_joints(model: MjcfModel, first: int, second: int) -> set[int]:
    """The joints between two bodies: above one of them but not above both."""

    def above(body: int) -> set[int]:
        joints: set[int] = set()
        while body > 0:
            joints |= set(model.joints_of(body))
            body = model.parent(body)
        return joints

    return above(first) ^ above(second)


class _Solver:
    """Closes loops by MuJoCo's own constraint residuals."""

    def __init__(self, model: MjcfModel, moving: dict[str, int], couplings: dict[str, Mimic]):
        self.model, self.couplings, self.moving = model, couplings, moving
        raw = model.raw
        disable = model.engine.mjtDisableBit
        flags = disable.mjDSBL_CONTACT | disable.mjDSBL_LIMIT | disable.mjDSBL_FRICTIONLOSS
        raw.opt.disableflags |= int(flags)
        self.data = model.engine.MjData(raw)
        self._forward = model.engine.mj_fwdPosition
        self._equality = int(model.engine.mjtConstraint.mjCNSTR_EQUALITY)
        self._address = np.array(raw.jnt_qposadr)
        self._stiffness = np.array([np.ravel(raw.jnt_stiffness[j])[0] for j in range(raw.njnt)])
        driven = model.driven_joints()
        followers = {moving[name] for name in couplings}
        #: joints whose value a loop does not decide
        self.fixed_by_others = driven | followers | {moving[m.joint] for m in couplings.values()}

    def roles(self, loop: Loop) -> tuple[int | None, list[int]]:
        """The joint that drives a loop (None: several do), and the joints that must give way."""
        known = loop.joints & self.fixed_by_others
        passive = sorted(loop.joints - known)
        masters = {self._master(joint) for joint in known}
        if not masters:
            return min(loop.joints), sorted(loop.joints)[1:]
        return (masters.pop() if len(masters) == 1 else None), passive

    def _master(self, joint: int) -> int:
        name = self.model.joint_names[joint]
        while name in self.couplings:
            name = self.couplings[name].joint
        return self.moving[name]

    def sweep(
        self, loop: Loop, driver: int, passive: list[int], limits: tuple[float, float]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Driver values at which the loop closes, ascending, and the passive joints' values.

        They go on from the model's initial posture without jumps, as the mechanism does.
        """
        if limits[1] - limits[0] < MIN_RANGE:
            return np.zeros(0), np.zeros((0, len(passive)))
        values = np.linspace(*limits, SWEEP_POINTS)
        start = float(self.model.raw.qpos0[self._address[driver]])
        middle = int(np.abs(values - start).argmin())
        rest = np.array(self.model.raw.qpos0)[self._address[passive]]
        first = self._close(loop, driver, passive, float(values[middle]), rest, 10)
        solutions = {}
        for indices in (range(middle, SWEEP_POINTS), range(middle - 1, -1, -1)):
            near = first
            for index in indices:
                found = self._close(loop, driver, passive, float(values[index]), near)
                gap = self._gap(loop, driver, passive, float(values[index]), found)
                if gap > MAX_GAP_M or np.abs(found - near).max() > MAX_JUMP:
                    break
                solutions[index] = near = found
        closed = sorted(solutions)
        return values[closed], np.array([solutions[index] for index in closed])

    def _close(
        self, loop: Loop, driver: int, passive: list[int], value: float, near: np.ndarray,
        repeats: int = 1,
    ) -> np.ndarray:  # fmt: skip
        """Values of the passive joints, within their limits, that close the loop near others."""
        limits = np.array([self.model.joint_range(joint) for joint in passive])
        lower = np.where(np.isnan(limits[:, 0]), -np.inf, limits[:, 0])
        upper = np.where(np.isnan(limits[:, 1]), np.inf, limits[:, 1])
        stiffness = self._stiffness[passive]
        springs = SPRING_WEIGHT * np.sqrt(stiffness / max(float(stiffness.max()), 1e-12))
        spring_rest = np.array(self.model.raw.qpos_spring)[self._address[passive]]
        for _ in range(repeats):

            def residual(x: np.ndarray, near: np.ndarray = near) -> np.ndarray:
                gaps = GAP_WEIGHT * self._residual(loop, driver, passive, value, x)
                return np.concatenate((gaps, springs * (x - spring_rest), STAY_WEIGHT * (x - near)))

            inside = np.clip(near, lower + 1e-9, upper - 1e-9)
            near = least_squares(residual, inside, bounds=(lower, upper), xtol=1e-12).x
        return near

    def _gap(
        self, loop: Loop, driver: int, passive: list[int], value: float, x: np.ndarray
    ) -> float:
        return float(np.abs(self._residual(loop, driver, passive, value, x)).max())

    def _residual(
        self, loop: Loop, driver: int, passive: list[int], value: float, x: np.ndarray
    ) -> np.ndarray:
        """How far open the loop is: metres, and radians for welds."""
        qpos = np.array(self.model.raw.qpos0)
        qpos[self._address[driver]] = value
        for name, joint in self.moving.items():
            if name in self.couplings and self._master(joint) == driver:
                qpos[self._address[joint]] = self._follow(name, value)
        qpos[self._address[passive]] = x
        self.data.qpos[:] = qpos
        self._forward(self.model.raw, self.data)
        kinds, ids = np.array(self.data.efc_type), np.array(self.data.efc_id)
        rows = (kinds == self._equality) & np.isin(ids, loop.equalities)
        return np.array(self.data.efc_pos)[rows]

    def _follow(self, name: str, value: float) -> float:
        """The value of a joint that follows, through others maybe, the driver at ``value``."""
        mimic = self.couplings.get(name)
        if mimic is None:
            return value
        return mimic.multiplier * self._follow(mimic.joint, value) + mimic.offset
