"""Joints of a MuJoCo model that follow another joint: by equalities or coupling tendons."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from gdg.hands.intake.mjcf_model import MjcfModel, among
from gdg.hands.urdf import Mimic

#: A tendon whose length has so little play couples its joints, rad (or m) at the largest
#: coefficient.
MAX_PLAY = 0.3
#: Points at which a curved coupling is fitted by a line.
FIT_POINTS = 50
#: Where the joint that is followed has no range to fit in (less than the first), this far around
#: its reference, rad or m.
MIN_RANGE, CURVE_RANGE = 1e-4, 0.5


@dataclass(frozen=True)
class Relation:
    """``sum(coefficient * joint) = constant``, and what says so."""

    coefficients: dict[int, float]
    constant: float
    by: str


@dataclass
class LinearSystem:
    """Relations between joints, solved for as many joints as there are relations.

    Attributes:
        keep: joints that should not become dependent (an actuator drives them).
        solved: joint -> the relation that gives it: the other joints are independent.
    """

    keep: set[int]
    solved: dict[int, Relation] = field(default_factory=dict)

    def reduced(self, relation: Relation) -> Relation:
        """The same relation between independent joints only."""
        coefficients: dict[int, float] = {}
        constant = relation.constant
        for joint, factor in relation.coefficients.items():
            terms = {joint: 1.0}
            if joint in self.solved:
                constant -= factor * self.solved[joint].constant
                terms = self.solved[joint].coefficients
            for other, value in terms.items():
                coefficients[other] = coefficients.get(other, 0.0) + factor * value
        largest = max(map(abs, relation.coefficients.values()), default=0.0)
        kept = {j: c for j, c in coefficients.items() if abs(c) > 1e-9 * largest}
        return Relation(kept, constant, relation.by)

    def add(self, relation: Relation) -> None:
        """Solves the relation for one of its independent joints, if it has any left."""
        left = self.reduced(relation)
        if not left.coefficients:
            return
        dependent = max(left.coefficients, key=lambda j: (j not in self.keep, j))
        factor = left.coefficients[dependent]
        others = {j: -c / factor for j, c in left.coefficients.items() if j != dependent}
        self.solved[dependent] = Relation(others, left.constant / factor, relation.by)
        for joint, given in list(self.solved.items()):
            if joint != dependent and dependent in given.coefficients:
                share = given.coefficients[dependent]
                rest = {j: c for j, c in given.coefficients.items() if j != dependent}
                for other, value in others.items():
                    rest[other] = rest.get(other, 0.0) + share * value
                constant = given.constant + share * left.constant / factor
                self.solved[joint] = Relation(rest, constant, given.by)


def read_couplings(
    model: MjcfModel, moving: dict[str, int], repairs: list[str]
) -> dict[str, Mimic]:
    """The joints that follow exactly one other joint, with the law that they follow.

    Args:
        model: the compiled model.
        moving: name -> joint id, of the joints of the hand.
        repairs: one sentence per joint is added.
    """
    names = {joint: name for name, joint in moving.items()}
    directly = {model.actuated_joint(a) for a in range(model.actuator_count)} - {None}
    system = LinearSystem({j for j in directly if j is not None})
    for relation in (*_equalities(model, repairs), *_tight_tendons(model)):
        if relation.coefficients.keys() <= names.keys():
            system.add(relation)
    for relation in _driven_tendons(model, system):
        if relation.coefficients.keys() <= names.keys():
            system.add(relation)
    couplings: dict[str, Mimic] = {}
    for joint in sorted(system.solved):
        law, name = system.solved[joint], names[joint]
        if len(law.coefficients) == 1:
            ((other, factor),) = law.coefficients.items()
            couplings[name] = Mimic(names[other], factor, law.constant)
            repairs.append(
                f"Joint '{name}' follows '{names[other]}': {law_text(couplings[name])} ({law.by})."
            )
        else:
            others = " and ".join(f"'{names[j]}'" for j in law.coefficients) or "no other joint"
            repairs.append(
                f"Joint '{name}' depends on {others} ({law.by}); a URDF can't say so: it is left "
                "without a drive."
            )
    return couplings


def law_text(mimic: Mimic) -> str:
    """``0.5 × its value + 0.1``."""
    offset = f" {'+' if mimic.offset > 0 else '-'} {abs(mimic.offset):.3g}"
    return f"{mimic.multiplier:.4g} × its value{offset if abs(mimic.offset) > 1e-9 else ''}"


def _equalities(model: MjcfModel, repairs: list[str]) -> Iterator[Relation]:
    raw = model.raw
    for equality in range(raw.neq):
        if not raw.eq_active0[equality]:
            continue
        first, second = int(raw.eq_obj1id[equality]), int(raw.eq_obj2id[equality])
        kind, law = raw.eq_type[equality], np.array(raw.eq_data[equality][:5])
        if among(kind, model.engine.mjtEq.mjEQ_JOINT):
            yield _between_joints(model, first, second, law, repairs)
        elif among(kind, model.engine.mjtEq.mjEQ_TENDON):
            yield from _between_tendons(model, first, second, law)


def _between_joints(
    model: MjcfModel, first: int, second: int, law: np.ndarray, repairs: list[str]
) -> Relation:
    """``first - first0 = law(second - second0)``, with a line in place of a curve."""
    raw, name = model.raw, model.joint_names[first]
    start = float(raw.qpos0[raw.jnt_qposadr[first]])
    if second < 0:
        return Relation({first: 1.0}, start + float(law[0]), "an equality of the model")
    other = float(raw.qpos0[raw.jnt_qposadr[second]])
    constant, slope = float(law[0]), float(law[1])
    if np.abs(law[2:]).max() > 0.0:
        lower, upper = model.joint_range(second)
        if not upper - lower > MIN_RANGE:  # none, or none that matters
            lower, upper = other - CURVE_RANGE, other + CURVE_RANGE
        values = np.linspace(lower, upper, FIT_POINTS) - other
        exact = np.polynomial.polynomial.polyval(values, law)
        slope, constant = (float(value) for value in np.polyfit(values, exact, 1))
        error = float(np.abs(exact - constant - slope * values).max())
        repairs.append(
            f"Joint '{name}': its coupling to '{model.joint_names[second]}' is curved; the nearest "
            f"line is off by up to {error:.2g}."
        )
    return Relation(
        {first: 1.0, second: -slope}, start + constant - slope * other, "an equality of the model"
    )


def _between_tendons(
    model: MjcfModel, first: int, second: int, law: np.ndarray
) -> Iterator[Relation]:
    """``length1 - length10 = law(length2 - length20)`` for fixed tendons and a straight law."""
    joints = model.tendon_joints(first)
    others = model.tendon_joints(second) if second >= 0 else {}
    if not joints or (second >= 0 and not others) or np.abs(law[2:]).max() > 0.0:
        return
    coefficients = dict(joints)
    for joint, factor in others.items():
        coefficients[joint] = coefficients.get(joint, 0.0) - float(law[1]) * factor
    raw = model.raw
    constant = float(law[0]) + sum(
        factor * float(raw.qpos0[raw.jnt_qposadr[joint]]) for joint, factor in coefficients.items()
    )
    yield Relation(coefficients, constant, f"tendon '{raw.tendon(first).name}'")


def _tight_tendons(model: MjcfModel) -> Iterator[Relation]:
    """Fixed tendons over several joints whose limits leave them next to no play."""
    raw = model.raw
    for tendon in range(raw.ntendon):
        joints = model.tendon_joints(tendon)
        if len(joints) < 2 or not raw.tendon_limited[tendon]:
            continue
        lower, upper = (float(value) for value in raw.tendon_range[tendon])
        play = (upper - lower) / max(map(abs, joints.values()))
        if play < MAX_PLAY:
            by = f"tendon '{raw.tendon(tendon).name}', which leaves a play of {play:.2g}"
            yield Relation(joints, (lower + upper) / 2, by)


def _driven_tendons(model: MjcfModel, system: LinearSystem) -> Iterator[Relation]:
    """Joints that one actuator pulls by a fixed tendon move in proportion to their coefficients.

    So they do in free motion where their friction is the same; what they touch may hold one back.
    """
    for actuator in range(model.actuator_count):
        tendon = model.actuated_tendon(actuator)
        joints = model.tendon_joints(tendon) if tendon is not None else {}
        free = sorted(j for j in joints if j not in system.solved and joints[j] != 0.0)
        for joint in free[1:]:
            ratio = joints[joint] / joints[free[0]]
            by = f"both are pulled by tendon '{model.raw.tendon(tendon).name}'"
            yield Relation({joint: 1.0, free[0]: -ratio}, 0.0, by)
