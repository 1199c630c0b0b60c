"""Which way each joint closes, from the balls that a hand can grip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from gdg.hands.propose.probe import Grips, Placed, Prober
from gdg.hands.propose.structure import Finger

#: Axes count as parallel from this cosine on.
PARALLEL = 0.8
#: A joint whose axis lies across its finger's last one closes if contacts move this straight.
STRAIGHT = 0.6
#: What a range that lies mostly on one side of zero says, against the grips' 1.
RANGE_SAYS = 0.5
#: A joint moves a contact from here on, m/rad or m/m.
MOVES = 1e-3
#: Finite differences, as a share of a joint's range.
STEP = 1e-3


@dataclass(frozen=True)
class Closing:
    """What is known of one actuated joint.

    Attributes:
        joint: its name.
        sign: +1 if larger values close, -1 if smaller ones do, 0 if it takes no part.
        certainty: from 0 to 1.
        straightness: mean cosine between the motion of what it moves and the ball, from -1 to 1.
    """

    joint: str
    sign: int
    certainty: float
    straightness: float


@dataclass(frozen=True)
class _Motion:
    """How one joint moves the contacts of one finger, averaged over grips."""

    finger: int
    joint: int
    straightness: float
    along_last: float
    agreement: float


def find_closing(prober: Prober, grips: Grips) -> tuple[Closing, ...]:
    """One entry per actuated joint, in the declared order."""
    motions = _motions(prober, grips)
    signs = _finger_signs(prober, motions)
    return tuple(
        _closing(prober, index, name, [m for m in motions if m.joint == index], signs)
        for index, name in enumerate(prober.hand.joint_names)
    )


def inward_of(prober: Prober, closings: Sequence[Closing]) -> Float[Tensor, "finger"]:
    """Per finger, the sign in which its last joint presses inward; 0 where nothing is known."""
    hand = prober.hand.hand
    rows = {joint.name: row for row, joint in enumerate(hand.moving_joints)}
    signs = []
    for finger in prober.structure.fingers:
        followed = hand.coupling[0][rows[finger.joints[-1]]]
        pushes = [followed[i] * closing.sign for i, closing in enumerate(closings)]
        signs.append(float(torch.sign(torch.tensor(sum(pushes)))))
    return torch.tensor(signs)


def _motions(prober: Prober, grips: Grips) -> list[_Motion]:
    placed, resting = prober.place(grips.joints), prober.place(prober.rest[None])
    weights = _weights(prober, grips, placed)
    found = []
    for joint in range(len(prober.hand.joint_names)):
        if not prober.free[joint]:
            continue
        step = STEP * float(prober.hand.upper[joint] - prober.hand.lower[joint])
        moved = grips.joints.clone()
        moved[:, joint] += step
        after = prober.place(moved)
        for number, finger in enumerate(prober.structure.fingers):
            contact = grips.contacts[:, number]
            velocity = _at(after.points - placed.points, contact) / step
            speed = velocity.norm(dim=-1)
            moves = speed > MOVES
            if not moves.any():
                continue
            inward = torch.nn.functional.normalize(
                grips.centers - _at(placed.points, contact), dim=-1
            )
            cosine = (velocity * inward).sum(-1) / speed.clamp(min=MOVES) * moves
            counts = weights[number]
            mean = float(counts @ cosine)
            agreement = float(counts @ (cosine.sign() == (1 if mean > 0 else -1)).to(cosine))
            along = max(
                float(counts @ _along_last(prober, finger, joint, placed)),
                float(_along_last(prober, finger, joint, resting)[0]),
                key=abs,
            )
            found.append(_Motion(number, joint, mean, along, agreement))
    return found


def _weights(prober: Prober, grips: Grips, placed: Placed) -> list[Float[Tensor, "grip"]]:
    """Per finger how much each grip counts; they sum to 1.

    A folded finger may hold a ball with its back, a stretched one hardly.
    """
    lengths, weights = prober.finger_lengths(), []
    for finger in range(len(prober.structure.fingers)):
        contact = grips.contacts[:, finger, None]
        stretched = prober.reach(placed, finger, contact)[:, 0] / lengths[finger]
        counts = grips.weights() * stretched.square()
        weights.append(counts / counts.sum())
    return weights


def _at(vectors: Float[Tensor, "grip point 3"], index: Tensor) -> Float[Tensor, "grip 3"]:
    return vectors[torch.arange(len(index)), index]


def _along_last(
    prober: Prober, finger: Finger, joint: int, placed: Placed
) -> Float[Tensor, "grip"]:
    """Cosine between the axis of an actuated joint and that of the finger's last joint.

    Of a joint outside of the finger, which moves it by coupling, the axis of the first joint of
    the finger that follows it counts.
    """
    hand = prober.hand.hand
    coupling = hand.coupling[0]
    rows = {other.name: row for row, other in enumerate(hand.moving_joints)}
    following = [name for name in finger.joints if coupling[rows[name], joint] != 0]
    if not following:
        return torch.zeros(len(placed.points))
    ends = [hand.urdf.joints[name] for name in (following[0], finger.joints[-1])]
    if (ends[0].type == "prismatic") != (ends[1].type == "prismatic"):
        return torch.zeros(len(placed.points))
    axes = []
    for end in ends:
        rotation = placed.Ts_palm_link[:, prober.hand.link_names.index(end.child), :3, :3]
        axes.append(rotation @ torch.tensor(end.axis, dtype=torch.float32))
    sign = float(torch.sign(torch.tensor(coupling[rows[following[0]], joint])))
    return sign * (axes[0] * axes[1]).sum(-1)


def _finger_signs(prober: Prober, motions: Sequence[_Motion]) -> dict[int, float]:
    """Per finger, which way its last joint closes: the vote of all joints parallel to it."""
    votes: dict[int, float] = {}
    for motion in motions:
        if abs(motion.along_last) >= PARALLEL:
            side = 1.0 if motion.along_last > 0 else -1.0
            vote = motion.straightness + RANGE_SAYS * _lean(prober, motion.joint)
            votes[motion.finger] = votes.get(motion.finger, 0.0) + side * vote
    return votes


def _lean(prober: Prober, joint: int) -> float:
    """From -1 to 1: on which side of zero most of a joint's range lies."""
    lower, upper = float(prober.hand.lower[joint]), float(prober.hand.upper[joint])
    return (upper + lower) / max(upper - lower, abs(upper), abs(lower), 1e-9)


def _closing(
    prober: Prober, index: int, name: str, motions: Sequence[_Motion], signs: dict[int, float]
) -> Closing:
    total, certainty, straightness = 0.0, 0.0, 0.0
    for motion in motions:
        if abs(motion.along_last) >= PARALLEL:
            side = 1.0 if motion.along_last > 0 else -1.0
            vote = side * signs[motion.finger]
        elif _presses_anyway(prober, motion):
            vote = motion.straightness
        else:
            continue
        total += vote
        certainty = max(certainty, _certainty(motion, vote))
        straightness = max(straightness, motion.straightness, key=abs)
    sign = 0 if total == 0 else (1 if total > 0 else -1)
    return Closing(name, sign, certainty, straightness)


def _presses_anyway(prober: Prober, motion: _Motion) -> bool:
    """Whether a joint that doesn't bend its finger drives contacts into the ball all the same."""
    lower, upper = (float(x[motion.joint]) for x in (prober.hand.lower, prober.hand.upper))
    straight = abs(motion.straightness) >= STRAIGHT and motion.agreement > 0.9
    return straight and not spreads(lower, upper)


def spreads(lower: float, upper: float) -> bool:
    """Whether a range is that of a joint which swings a finger both ways from its middle."""
    return abs(upper + lower) < 0.4 * (upper - lower) < 0.8


def _certainty(motion: _Motion, vote: float) -> float:
    """Half from how straight contacts move, half from how much the grips agree."""
    agrees = motion.straightness * vote > 0
    share = 0.5 * min(1.0, 2 * abs(motion.straightness)) + 0.5 * (2 * motion.agreement - 1)
    return max(0.3, min(0.99, 0.5 + 0.5 * share)) if agrees else 0.3
