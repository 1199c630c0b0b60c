"""Open and closed postures, and the pairs of links that touch by construction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float

from gdg.hands.propose.closing import Closing, spreads
from gdg.hands.propose.overlaps import Pair, link_overlaps, random_postures
from gdg.hands.propose.probe import Grips
from gdg.kinds.hand_model import HandModel

#: Pairs that overlap by this in this share of postures touch by construction: metres, 1.
TOUCHING_M, MOST_POSTURES = 5e-4, 0.6
#: Postures that are tried for that.
POSTURES = 40
#: Closed fingers may overlap by this, metres.
CLOSED_OVERLAP_M = 1e-3
#: The hand opens wider than for the balls that it holds by this share of each turning joint's range
#: (jaws that slide open fully), and closes at most so far towards the end of the range.
WIDER, CLOSED_SHARE = 0.2, 0.8
#: Steps from the open posture to the closed one.
STEPS = 32
#: A joint that takes no part rests at zero or a limit when that is within this share of its range.
NEAR = 0.15


@dataclass(frozen=True)
class Postures:
    """Postures of the actuated joints, rad or m.

    Attributes:
        open: fingers open.
        closed: fingers flexed as far as they don't meet.
        touching: pairs of links that overlap whatever the joints do, beyond neighbours.
        stopped_by: the pair of links at which closing ended; None if the range ended first.
    """

    open: Float[np.ndarray, "joint"]
    closed: Float[np.ndarray, "joint"]
    touching: tuple[Pair, ...]
    stopped_by: Pair | None


def find_postures(hand: HandModel, grips: Grips, closings: Sequence[Closing]) -> Postures:
    """Postures that open wider than for any grip, and close until fingers meet."""
    lower, upper = (limit.double().numpy() for limit in (hand.lower, hand.upper))
    signs = np.array([closing.sign for closing in closings])
    rest = _resting(grips, signs, lower, upper)
    slides = np.array([hand.hand.urdf.joints[c.joint].type == "prismatic" for c in closings])
    wider = np.where(slides, 1.0, WIDER)
    opened = _equal(_opened(grips, signs, rest, lower, upper, wider), hand, closings)
    ends = np.where(signs > 0, upper, np.where(signs < 0, lower, rest))
    apart = hand.hand.may_collide()
    touching = _touching(hand, opened, apart)
    for first, second in touching:
        a, b = hand.link_names.index(first), hand.link_names.index(second)
        apart[a, b] = apart[b, a] = False
    closed, stopped_by = _closed(hand, opened, ends, apart)
    return Postures(opened, closed, touching, stopped_by)


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


def _touching(
    hand: HandModel, opened: Float[np.ndarray, "joint"], apart: Bool[np.ndarray, "link link"]
) -> tuple[Pair, ...]:
    postures = random_postures(hand, POSTURES)
    first = torch.as_tensor(opened, dtype=torch.float32)[None]
    found = link_overlaps(hand, torch.cat((first, postures)), apart)
    return tuple(
        pair
        for pair, depth in sorted(found.items())
        if depth[0] > TOUCHING_M or (depth > TOUCHING_M).mean() >= MOST_POSTURES
    )


def _closed(
    hand: HandModel,
    opened: Float[np.ndarray, "joint"],
    ends: Float[np.ndarray, "joint"],
    apart: Bool[np.ndarray, "link link"],
) -> tuple[Float[np.ndarray, "joint"], Pair | None]:
    shares = np.linspace(0.0, CLOSED_SHARE, STEPS + 1)
    path = opened + shares[:, None] * (ends - opened)
    found = link_overlaps(hand, torch.as_tensor(path, dtype=torch.float32), apart)
    last, stopped_by = STEPS, None
    for pair, depth in found.items():
        deep = np.nonzero(depth > CLOSED_OVERLAP_M)[0]
        if len(deep) and deep[0] - 1 < last:
            last, stopped_by = max(1, int(deep[0]) - 1), pair
    return path[last], stopped_by
