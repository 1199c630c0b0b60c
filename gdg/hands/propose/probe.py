"""Grips balls with a hand of which nothing is known but its kinematics and shapes.

What a hand is for shows in what it can hold: balls of many sizes, held by all fingers at once and
from opposite sides, tell where the palm is and which way each joint closes, whatever the frames,
the zero posture and the signs of the joints.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gdg.hands.propose.bending import tip_drive
from gdg.hands.propose.structure import Structure
from gdg.kinds.hand_model import HandModel
from gdg.penetration import self_penetration

#: Grips tried at once, steps of each, and share of them that is kept.
GRIPS, STEPS, KEPT = 96, 200, 0.25
#: Radii of the balls as a share of the longest finger's length.
RADII = (0.12, 0.5)
#: A gap of this size costs as much as a contact that faces sideways, metres.
GAP_SCALE_M = 0.006
#: Least share of the closing force that the fingers bear together, the palm having the rest.
LEAST_SHARE = 0.3
#: Steps of Adam: on joints as a share of their range, on balls as a share of the longest finger.
JOINT_STEP, BALL_STEP, SHARE_STEP = 0.03, 0.03, 0.05
#: Balls begin scattered this far around where the fingers start, as a share of the longest one.
SCATTER = 0.5
#: Random postures in which the fingers' lengths are measured.
LENGTH_POSTURES = 32
#: A joint with a larger range turns all the way round; it is searched this far from zero, rad.
WHOLE_TURN, WIDEST = 5.5, 1.9
#: Weights of the terms beside touching: the touching face looks at the ball; the finger's last
#: joint presses it there; the finger isn't folded, for then it would hold the ball with its back;
#: forces balance; nothing is inside the ball; links stay apart.
FACING, BENDING, STRETCHED, BALANCE, INSIDE, SELF = 1.0, 1.0, 1.0, 4.0, 1.0, 0.3


@dataclass(frozen=True)
class Grips:
    """Balls held by a hand, best first.

    Attributes:
        joints: actuated joints, declared order.
        centers: of the balls, palm link's frame, metres.
        radii: of the balls, metres.
        on_palm: whether the ball was asked to touch the palm.
        contacts: index of the touching point of each finger, into ``HandModel.surface``.
        energy: dimensionless; below about 1 all fingers touch.
    """

    joints: Float[Tensor, "grip joint"]
    centers: Float[Tensor, "grip 3"]
    radii: Float[Tensor, "grip"]
    on_palm: Bool[Tensor, "grip"]
    contacts: Int[Tensor, "grip finger"]
    energy: Float[Tensor, "grip"]

    def weights(self) -> Float[Tensor, "grip"]:
        """How much each grip counts, from 0 to 1."""
        return torch.exp(-(self.energy - self.energy.min()))


@dataclass(frozen=True)
class Placed:
    """A hand in some postures, palm link's frame, metres.

    Attributes:
        Ts_palm_link: poses of all links.
        points: of the surface.
        normals: of the surface.
    """

    Ts_palm_link: Float[Tensor, "grip link 4 4"]
    points: Float[Tensor, "grip hand_point 3"]
    normals: Float[Tensor, "grip hand_point 3"]


class Prober:
    """Searches grips of balls.

    Args:
        hand: the hand's model; of its manifest only the joints are used.
        structure: palm and fingers; every finger has to touch.
        free: which joints may move; the others stay at ``rest``.
        rest: posture of the joints that stay.
        inward: per finger which way its tip's drive presses (the sign of its value), 0 if unknown.
    """

    def __init__(
        self,
        hand: HandModel,
        structure: Structure,
        free: Bool[Tensor, "joint"],
        rest: Float[Tensor, "joint"],
        inward: Float[Tensor, "finger"] | None = None,
    ):
        self.hand, self.structure, self.free, self.rest = hand, structure, free, rest
        fingers = structure.fingers
        self.inward = torch.zeros(len(fingers)) if inward is None else inward
        number = {name: index for index, name in enumerate(hand.link_names)}
        self.palm_link = number[structure.palm]
        self.tips = [self.points_of(finger.distal) for finger in fingers]
        self.palm = self.points_of(structure.palm_body)
        self.first_links = [number[hand.hand.urdf.joints[f.joints[0]].child] for f in fingers]
        self.drives = [tip_drive(hand, finger) for finger in fingers]
        self._lower, self._upper = _searched(hand)
        self.lengths = self._finger_lengths()

    def points_of(self, links: tuple[str, ...]) -> Int[Tensor, "point"]:
        """Surface points that lie on some links."""
        wanted = torch.tensor([self.hand.link_names.index(name) for name in links])
        return torch.isin(self.hand.surface.link_index, wanted).nonzero()[:, 0]

    def place(self, joints: Float[Tensor, "grip joint"]) -> Placed:
        """The hand in the palm link's frame."""
        Ts_root_link = self.hand.link_poses_in_root(joints)
        T_palm_root = torch.linalg.inv(Ts_root_link[:, self.palm_link])
        Ts = T_palm_root[:, None] @ Ts_root_link
        surface, turned = self.hand.surface, Ts.clone()
        turned[..., :3, 3] = 0
        return Placed(
            Ts,
            self.hand.place(Ts, surface.points, surface.link_index),
            self.hand.place(turned, surface.normals, surface.link_index),
        )

    @cached_property
    def resting(self) -> Placed:
        """The hand in the posture of the joints that stay, alone in its batch."""
        return self.place(self.rest[None])

    def reach(self, placed: Placed, finger: int, points: Tensor) -> Float[Tensor, "grip *point"]:
        """Distances of surface points, (point,) or one per grip, from a finger's first joint.

        One point per grip is given as (grip, 1).
        """
        base = placed.Ts_palm_link[:, self.first_links[finger], None, :3, 3]
        if points.ndim == 1:
            return (placed.points[:, points] - base).norm(dim=-1)
        return (placed.points.gather(1, points[..., None].expand(-1, -1, 3)) - base).norm(dim=-1)

    def search(self, generator: torch.Generator, count: int = GRIPS, steps: int = STEPS) -> Grips:
        """The best grips found, half of them with the ball on the palm (if that has shapes)."""
        length = float(self.lengths.max())
        low, high = RADII
        radii = length * low * (high / low) ** torch.rand(count, generator=generator)
        # a single finger has nothing but the palm to hold a ball against
        one_finger = len(self.tips) == 1
        on_palm = ((torch.arange(count) % 2 == 0) | one_finger) & (len(self.palm) > 0)
        share = torch.rand(count, len(self.rest), generator=generator)
        start = self.place(self._joints(share)).Ts_palm_link
        bases = start[:, self.first_links, :3, 3].mean(1)
        centers = bases + SCATTER * length * torch.randn(count, 3, generator=generator)
        forces = torch.zeros(count, len(self.tips) + 1)
        leaves = [leaf.detach().requires_grad_(True) for leaf in (share, centers, forces)]
        rates = (JOINT_STEP, BALL_STEP * length, SHARE_STEP)
        groups = [{"params": [leaf], "lr": rate} for leaf, rate in zip(leaves, rates)]
        optimiser = torch.optim.Adam(groups)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
        for _ in range(steps):
            energy, _ = self._energy(leaves, radii, on_palm)
            optimiser.zero_grad()
            energy.sum().backward()
            optimiser.step()
            schedule.step()
            with torch.no_grad():
                leaves[0].clamp_(0.0, 1.0)
        with torch.no_grad():
            energy, contacts = self._energy(leaves, radii, on_palm)
            kept = _best_of_each(energy, on_palm)
            joints = self._joints(leaves[0])[kept]
            return Grips(
                joints, leaves[1].detach()[kept], radii[kept], on_palm[kept], contacts[kept],
                energy[kept],
            )  # fmt: skip

    def _finger_lengths(self) -> Float[Tensor, "finger"]:
        """How far each fingertip gets from its finger's first joint, metres."""
        generator = torch.Generator().manual_seed(0)
        share = torch.rand(LENGTH_POSTURES, len(self.rest), generator=generator)
        placed = self.place(self._joints(share))
        reach = [self.reach(placed, index, tips).amax() for index, tips in enumerate(self.tips)]
        return torch.stack(reach)

    def _joints(self, share: Float[Tensor, "grip joint"]) -> Float[Tensor, "grip joint"]:
        values = self._lower + share * (self._upper - self._lower)
        return torch.where(self.free, values, self.rest)

    def _energy(
        self, leaves: list[Tensor], radii: Tensor, on_palm: Tensor
    ) -> tuple[Float[Tensor, "grip"], Int[Tensor, "grip finger"]]:
        share, centers, forces = leaves
        placed = self.place(self._joints(share))
        offset = centers[:, None] - placed.points
        distance = offset.norm(dim=-1).clamp(min=1e-9)
        inward = offset / distance[..., None]
        gap = (distance - radii[:, None]) / GAP_SCALE_M
        # quadratic near contact, linear far away
        cost = (1 + gap.square()).sqrt() - 1 + FACING * (1 - (placed.normals * inward).sum(-1))
        touch, directions, contacts = [], [], []
        for finger, points in enumerate(self.tips):
            presses = (self._bending(finger, placed) * inward[:, points]).sum(-1)
            sign = self.inward[finger]
            aligned = presses.square() if sign == 0 else sign * presses
            folded = 1 - self.reach(placed, finger, points) / self.lengths[finger]
            pressing = BENDING * (1 - aligned) + STRETCHED * folded
            least, index = (cost[:, points] + pressing).min(-1)
            touch.append(least)
            contacts.append(points[index])
            directions.append(one_of_each(inward, contacts[-1]))
        if len(self.palm):
            least, index = cost[:, self.palm].min(-1)
            on_it = on_palm.to(least)
            directions.append(on_it[:, None] * one_of_each(inward, self.palm[index]))
        else:
            least, on_it = torch.zeros_like(radii), torch.zeros_like(radii)
            directions.append(torch.zeros_like(centers))
        force = self._shares(forces)[..., None] * torch.stack(directions, 1)
        balance = force.sum(1).square().sum(-1)
        inside = (torch.relu(-gap).square().sum(-1) + 1e-6).sqrt()
        own = self_penetration(self.hand, placed.Ts_palm_link) / GAP_SCALE_M
        energy = torch.stack(touch, 1).mean(1) + on_it * least
        energy = energy + BALANCE * balance + INSIDE * inside + SELF * own
        return energy, torch.stack(contacts, 1)

    def _bending(self, finger: int, placed: Placed) -> Float[Tensor, "grip point 3"]:
        """Unit directions in which a finger's drive moves the points of its tip."""
        drive, points = self.drives[finger], placed.points[:, self.tips[finger]]
        if drive is None:
            return torch.zeros_like(points)
        velocity = drive.velocity(placed.Ts_palm_link, points)
        return torch.nn.functional.normalize(velocity, dim=-1)

    def _shares(self, forces: Tensor) -> Float[Tensor, "grip finger_or_palm"]:
        """Shares of the closing force: each finger has a least one, the palm has none."""
        least = torch.full_like(forces, LEAST_SHARE / len(self.tips))
        least[:, -1] = 0
        return least + (1 - LEAST_SHARE) * torch.softmax(forces, -1)


def _searched(hand: HandModel) -> tuple[Float[Tensor, "joint"], Float[Tensor, "joint"]]:
    """The ranges that are searched: of joints that turn all the way round, a part about zero."""
    around = hand.upper - hand.lower > WHOLE_TURN
    widest = torch.full_like(hand.upper, WIDEST)
    return torch.where(around, -widest, hand.lower), torch.where(around, widest, hand.upper)


def one_of_each(
    vectors: Float[Tensor, "grip point 3"], index: Int[Tensor, "grip"]
) -> Float[Tensor, "grip 3"]:
    """The vector of one point per grip."""
    return vectors[torch.arange(len(index)), index]


def _best_of_each(energy: Tensor, on_palm: Tensor) -> Int[Tensor, "grip"]:
    """Of the grips on the palm and of those off it the best ``KEPT``, all best first."""
    order = energy.argsort()
    kept = []
    for flag in (True, False):
        ranked = order[on_palm[order] == flag]
        kept.append(ranked[: int(KEPT * len(ranked))])
    chosen = torch.cat(kept)
    return chosen[energy[chosen].argsort()]
