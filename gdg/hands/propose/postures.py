"""Open and closed postures, and the pairs of links that touch by construction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float

from gdg.hands.propose.closing import Closing, spreads
from gdg.hands.propose.probe import Grips
from gdg.hands.propose.sampling import random_postures
from gdg.hands.self_collision import LinkBodies, Pair
from gdg.kinds.hand_model import HandModel

#: Links that overlap by this in this share of postures touch by construction: metres, 1.
TOUCHING_M, MOST_POSTURES = 1e-3, 0.6
#: Postures that are tried for that.
POSTURES = 16
#: Links of a closed hand may overlap by this, metres.
CLOSED_OVERLAP_M = 2e-3
#: Links that meet within so many steps from the open posture lie side by side and may touch.
EARLY_STEPS = 3
#: The hand opens wider than for the balls that it holds by this share of each turning joint's range
#: (jaws that slide open fully), and closes at most so far towards the end of the range.
WIDER, CLOSED_SHARE = 0.2, 0.8
#: Steps from the open posture to the closed one, and to the widest one.
STEPS, WIDENING_STEPS = 24, 8
#: A joint that takes no part rests at zero or a limit when that is within this share of its range.
NEAR = 0.15


@dataclass(frozen=True)
class Postures:
    """Postures of the actuated joints, rad or m.

    Attributes:
        open: fingers open.
        closed: fingers flexed as far as they don't meet.
        touching: pairs of links that overlap whatever the joints do, beyond neighbours.
        met: the pairs of links at which fingers stopped closing.
    """

    open: Float[np.ndarray, "joint"]
    closed: Float[np.ndarray, "joint"]
    touching: tuple[Pair, ...]
    met: tuple[Pair, ...]


def find_postures(hand: HandModel, grips: Grips, closings: Sequence[Closing]) -> Postures:
    """Postures that open wider than for any grip, and close each finger until it meets a link."""
    lower, upper = (limit.double().numpy() for limit in (hand.lower, hand.upper))
    signs = np.array([closing.sign for closing in closings])
    rest = _resting(grips, signs, lower, upper)
    slides = np.array([hand.hand.urdf.joints[c.joint].type == "prismatic" for c in closings])
    wider = np.where(slides, 1.0, WIDER)
    opened = _equal(_opened(grips, signs, rest, lower, upper, wider), hand, closings)
    widest = np.where(signs > 0, lower, np.where(signs < 0, upper, rest))
    flexed = np.where(signs > 0, upper, np.where(signs < 0, lower, rest))
    bodies, apart = _Bodies(hand), hand.hand.may_collide()
    opened = _apart(bodies, opened, widest, apart)
    touching = _touching(bodies, opened, apart)
    bodies.let_touch(touching, apart)
    ends = opened + CLOSED_SHARE * (flexed - opened)
    beside = bodies.overlaps(opened + EARLY_STEPS / STEPS * (ends - opened), apart, TOUCHING_M)
    touching = tuple(sorted({*touching, *beside}))
    bodies.let_touch(tuple(beside), apart)
    closed, met = _closed(bodies, opened, ends, apart)
    return Postures(opened, closed, touching, met)


class _Bodies:
    """Overlaps of a hand's links by posture."""

    def __init__(self, hand: HandModel):
        self.hand = hand
        self._bodies = LinkBodies(hand.hand)

    def overlaps(
        self,
        joints: Float[np.ndarray, "joint"],
        apart: Bool[np.ndarray, "link link"],
        ignored_m: float,
    ) -> dict[Pair, float]:
        """Pairs of links that lie deeper than ``ignored_m`` in each other in a posture."""
        values = torch.as_tensor(joints, dtype=torch.float32)[None]
        Ts_root_link = self.hand.link_poses_in_root(values)[0].double().numpy()
        return self._bodies.overlaps(Ts_root_link, apart, ignored_m)

    def between(self, pair: Pair) -> Bool[np.ndarray, "joint"]:
        """Which joints move the links of a pair against each other."""
        coupling, above = self.hand.hand.coupling[0], self.hand.hand.rows_above
        between = above[pair[0]] ^ above[pair[1]]
        return (coupling[sorted(between)] != 0).any(0)

    def let_touch(self, pairs: Sequence[Pair], apart: Bool[np.ndarray, "link link"]) -> None:
        """Takes pairs out of those that must stay apart."""
        for pair in pairs:
            first, second = (self.hand.link_names.index(name) for name in pair)
            apart[first, second] = apart[second, first] = False


def _resting(
    grips: Grips, signs: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> Float[np.ndarray, "joint"]:
    """Values of the joints that take no part in closing: as in the grips, made round."""
    joints, weights = grips.joints.double().numpy(), grips.weights().double().numpy()
    middle = np.array([_weighted_median(column, weights) for column in joints.T])
    span = upper - lower
    for round_value in (lower, upper, np.clip(0.0, lower, upper)):
        middle = np.where(np.abs(middle - round_value) < NEAR * span, round_value, middle)
    both_ways = np.array([spreads(*limits) for limits in zip(lower, upper)])
    return np.where((signs == 0) & both_ways, 0.0, middle)


def _weighted_median(values: np.ndarray, weights: np.ndarray) -> float:
    order = values.argsort()
    share = weights[order].cumsum() / weights.sum()
    return float(values[order][np.searchsorted(share, 0.5)])


def _opened(
    grips: Grips,
    signs: np.ndarray,
    rest: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    wider: np.ndarray,
) -> Float[np.ndarray, "joint"]:
    """Closing joints wider open than in grips of the larger balls, by shares of their ranges."""
    large = grips.radii >= grips.radii.median()
    joints = grips.joints[large].double().numpy()
    weights = grips.weights()[large].double().numpy()
    typical = np.array([_weighted_median(column, weights) for column in joints.T])
    opened = np.clip(typical - wider * signs * (upper - lower), lower, upper)
    return np.where(signs == 0, rest, opened)


def _equal(
    values: Float[np.ndarray, "joint"], hand: HandModel, closings: Sequence[Closing]
) -> Float[np.ndarray, "joint"]:
    """Closing joints of equal fingers get the mean of their values.

    Joints are equal that have the same limits and sign and as many closing joints before them.
    """
    urdf, closing_joints = hand.hand.urdf, {c.joint for c in closings if c.sign}
    depth = {urdf.root: 0}
    for joint in urdf.joints.values():
        depth[joint.child] = depth[joint.parent] + (joint.name in closing_joints)
    groups: dict[tuple[object, ...], list[int]] = {}
    for index, closing in enumerate(closings):
        joint = urdf.joints[closing.joint]
        limits = round(joint.lower, 3), round(joint.upper, 3)
        key = (depth[joint.child], *limits, closing.sign) if closing.sign else (index, "rests")
        groups.setdefault(key, []).append(index)
    equal = values.copy()
    for members in groups.values():
        equal[members] = values[members].mean()
    return equal


def _apart(
    bodies: _Bodies,
    opened: Float[np.ndarray, "joint"],
    widest: Float[np.ndarray, "joint"],
    apart: Bool[np.ndarray, "link link"],
) -> Float[np.ndarray, "joint"]:
    """Opens joints further whose links still lie in each other."""
    step = (widest - opened) / WIDENING_STEPS
    for _ in range(WIDENING_STEPS):
        pairs = bodies.overlaps(opened, apart, TOUCHING_M)
        moving = np.zeros(len(opened), bool)
        for pair in pairs:
            moving |= bodies.between(pair)
        if not (moving & (step != 0)).any():
            break
        opened = opened + np.where(moving, step, 0.0)
    return opened


def _touching(
    bodies: _Bodies, opened: Float[np.ndarray, "joint"], apart: Bool[np.ndarray, "link link"]
) -> tuple[Pair, ...]:
    postures = random_postures(bodies.hand, POSTURES).double().numpy()
    counts: dict[Pair, int] = {}
    for posture in postures:
        for pair in bodies.overlaps(posture, apart, TOUCHING_M):
            counts[pair] = counts.get(pair, 0) + 1
    often = {pair for pair, count in counts.items() if count >= MOST_POSTURES * POSTURES}
    return tuple(sorted(often | set(bodies.overlaps(opened, apart, TOUCHING_M))))


def _closed(
    bodies: _Bodies,
    opened: Float[np.ndarray, "joint"],
    flexed: Float[np.ndarray, "joint"],
    apart: Bool[np.ndarray, "link link"],
) -> tuple[Float[np.ndarray, "joint"], tuple[Pair, ...]]:
    """Flexes all joints together; those between two links that meet stop, the others go on."""
    joints, step = opened.copy(), (flexed - opened) / STEPS
    free = step != 0
    met: dict[Pair, None] = {}
    for _ in range(STEPS):
        trial = joints + np.where(free, step, 0.0)
        for pair in bodies.overlaps(trial, apart, CLOSED_OVERLAP_M):
            stopped = bodies.between(pair) & free
            met[pair] = None
            trial = np.where(stopped, joints, trial)
            free &= ~stopped
        joints = trial
        if not free.any():
            break
    return joints, tuple(met)
