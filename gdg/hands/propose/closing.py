"""Which way each joint closes, from the balls that a hand can grip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from gdg.hands.propose.probe import Grips, Placed, Prober, one_of_each

#: Axes count as parallel from this cosine on.
PARALLEL = 0.8
#: A joint whose axis lies across its finger's last one closes if contacts move this straight.
STRAIGHT = 0.6
#: And if this share of the grips agrees on the way.
AGREED = 0.9
#: A joint swings both ways if the middle of its range is off zero by less than this share of the
#: range, and the range is narrower than the second figure, rad or m.
OFF_MIDDLE, NARROW = 0.2, 2.0
#: Contacts that move with this cosine into the balls say all that straightness can say.
CLEARLY = 0.5
#: Certainty stays within these: the least is also that of a joint whose finger outvotes it.
LEAST_CERTAINTY, MOST_CERTAINTY = 0.3, 0.99
#: What a range that lies mostly on one side of zero says, against the grips' 1.
RANGE_SAYS = 0.5
#: And what the way from the hand at rest to the balls says.
REST_SAYS = 0.5
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
    """How one joint moves the contacts of one finger, averaged over grips.

    Attributes:
        finger: index of the finger.
        joint: index of the actuated joint.
        straightness: cosine between the contact's motion and the direction into the ball.
        along_last: cosine between the joint's axis and that of the tip's drive.
        agreement: share of grips in which the straightness has the sign of its mean.
        from_rest: the straightness with the hand at rest and the balls where they are.
    """

    finger: int
    joint: int
    straightness: float
    along_last: float
    agreement: float
    from_rest: float


def find_closing(prober: Prober, grips: Grips) -> tuple[Closing, ...]:
    """One entry per actuated joint, in the declared order."""
    motions = _motions(prober, grips)
    signs = _finger_signs(prober, motions)
    return tuple(
        _closing(prober, index, name, [m for m in motions if m.joint == index], signs)
        for index, name in enumerate(prober.hand.joint_names)
    )


def inward_of(prober: Prober, closings: Sequence[Closing]) -> Float[Tensor, "finger"]:
    """Per finger, the sign in which its tip's drive presses inward; 0 where nothing is known."""
    signs = [0 if drive is None else closings[drive.joint].sign for drive in prober.drives]
    return torch.tensor(signs, dtype=torch.float32)


def _motions(prober: Prober, grips: Grips) -> list[_Motion]:
    placed = prober.place(grips.joints)
    weights = _weights(prober, grips, placed)
    found = []
    for joint in range(len(prober.hand.joint_names)):
        if not prober.free[joint]:
            continue
        step = STEP * float(prober.hand.upper[joint] - prober.hand.lower[joint])
        moved = grips.joints.clone()
        moved[:, joint] += step
        after = prober.place(moved)
        for number in range(len(prober.structure.fingers)):
            contact = grips.contacts[:, number]
            velocity = one_of_each(after.points - placed.points, contact) / step
            speed = velocity.norm(dim=-1)
            moves = speed > MOVES
            if not moves.any():
                continue
            inward = torch.nn.functional.normalize(
                grips.centers - one_of_each(placed.points, contact), dim=-1
            )
            cosine = (velocity * inward).sum(-1) / speed.clamp(min=MOVES) * moves
            counts = weights[number]
            mean = float(counts @ cosine)
            agreement = float(counts @ (cosine.sign() == (1 if mean > 0 else -1)).to(cosine))
            along = max(
                float(counts @ _along_last(prober, number, joint, placed)),
                float(_along_last(prober, number, joint, prober.resting)[0]),
                key=abs,
            )
            from_rest = float(counts @ _from_rest(prober, grips, contact, joint))
            found.append(_Motion(number, joint, mean, along, agreement, from_rest))
    return found


def _weights(prober: Prober, grips: Grips, placed: Placed) -> list[Float[Tensor, "grip"]]:
    """Per finger how much each grip counts; they sum to 1.

    A folded finger may hold a ball with its back, a stretched one hardly.
    """
    weights = []
    for finger in range(len(prober.structure.fingers)):
        contact = grips.contacts[:, finger, None]
        stretched = prober.reach(placed, finger, contact)[:, 0] / prober.lengths[finger]
        counts = grips.weights() * stretched.square()
        weights.append(counts / counts.sum())
    return weights


def _from_rest(prober: Prober, grips: Grips, contact: Tensor, joint: int) -> Float[Tensor, "grip"]:
    """Cosines between how a joint moves the touching points at rest and the way to the balls."""
    values, resting = prober.rest[None].clone(), prober.resting
    step = STEP * float(prober.hand.upper[joint] - prober.hand.lower[joint])
    values[:, joint] += step
    velocity = (prober.place(values).points - resting.points)[0, contact]
    way = grips.centers - resting.points[0, contact]
    return torch.nn.functional.cosine_similarity(velocity / step, way, dim=-1, eps=MOVES)


def _along_last(prober: Prober, number: int, joint: int, placed: Placed) -> Float[Tensor, "grip"]:
    """Cosine between the axes about which an actuated joint and the tip's drive move a finger.

    Each moves it by the innermost of the finger's joints that follow it. 0 if only one of them
    turns the finger.
    """
    hand, last = prober.hand.hand, prober.drives[number]
    coupling = hand.coupling[0][:, joint]
    rows = hand.moving_rows
    finger = prober.structure.fingers[number]
    following = [hand.urdf.joints[n] for n in finger.joints if coupling[rows[n]] != 0]
    if last is None or not following:
        return torch.zeros(len(placed.points))
    first, outer = following[0], last.movers[0]
    if (first.type != "prismatic") != outer.turns:
        return torch.zeros(len(placed.points))
    sign = 1.0 if coupling[rows[first.name]] * outer.rate > 0 else -1.0
    rotations = placed.Ts_palm_link[..., :3, :3]
    axis = torch.as_tensor(first.axis, dtype=torch.float32)
    own = rotations[:, prober.hand.link_names.index(first.child)] @ axis
    return sign * (own * (rotations[:, outer.link] @ outer.axis)).sum(-1)


def _finger_signs(prober: Prober, motions: Sequence[_Motion]) -> dict[int, float]:
    """Per finger, which way its last joint closes: the vote of all joints parallel to it."""
    votes: dict[int, float] = {}
    for motion in motions:
        if abs(motion.along_last) >= PARALLEL:
            side = 1.0 if motion.along_last > 0 else -1.0
            vote = motion.straightness + RANGE_SAYS * _lean(prober, motion.joint)
            vote += REST_SAYS * motion.from_rest
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
    straight = abs(motion.straightness) >= STRAIGHT and motion.agreement > AGREED
    return straight and not spreads(lower, upper)


def spreads(lower: float, upper: float) -> bool:
    """Whether a range is that of a joint which swings a finger both ways from its middle."""
    span = upper - lower
    return bool(abs(upper + lower) / 2 < OFF_MIDDLE * span and span < NARROW)


def _certainty(motion: _Motion, vote: float) -> float:
    """Half from how straight contacts move, half from how much the grips agree."""
    if motion.straightness * vote <= 0:
        return LEAST_CERTAINTY
    straight, agreed = min(1.0, abs(motion.straightness) / CLEARLY), 2 * motion.agreement - 1
    share = 0.5 * straight + 0.5 * agreed
    return max(LEAST_CERTAINTY, min(MOST_CERTAINTY, 0.5 + 0.5 * share))
