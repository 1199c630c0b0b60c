"""Inverse kinematics: a hand whose fingers touch given points, outside the object."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gdg.adam import Adam
from gdg.initial_poses import above_surface, random_joints
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.penetration import penetration, self_penetration
from gdg.rotations import q_from_pose, root_pose

from .fingers import Fingers
from .options import UniGraspOptions

#: Lever with which normals count beside positions when a hand is put to contact points, metres.
NORMAL_LEVER_M = 0.03
#: The random rotation counts as much as an error of this size; it decides only what is free.
PRIOR_LEVER_M = 0.01
#: The learning rate at the end, as a share of that at the start.
LAST_RATE = 0.1


@dataclass(frozen=True)
class Terms:
    """Energy terms per pose; ``Reach.total`` is their weighted sum.

    Attributes:
        distances: of each finger's nearest pad point from its contact point, metres.
        normals: mean of 1 + ⟨n_pad, n_object⟩ over fingers, 0 where they oppose each other.
        penetration: summed, metres.
        depth: the deepest, metres; not in the energy.
        limits: norm of the joint-limit violation.
        self_penetration: summed, metres.
    """

    distances: Float[Tensor, "batch finger"]
    normals: Float[Tensor, "batch"]
    penetration: Float[Tensor, "batch"]
    depth: Float[Tensor, "batch"]
    limits: Float[Tensor, "batch"]
    self_penetration: Float[Tensor, "batch"]


class Reach:
    """Puts fingers on contact points.

    Args:
        hand: the hand.
        obj: the object.
        fingers: those that touch.
        options: weights, steps and starts.
    """

    def __init__(
        self, hand: HandModel, obj: ObjectModel, fingers: Fingers, options: UniGraspOptions
    ):
        self._hand, self._obj, self._fingers, self._options = hand, obj, fingers, options

    @property
    def steps(self) -> int:
        """Adam steps of one call of ``solve``."""
        return 2 * self._options.steps

    def solve(
        self,
        index: Int[Tensor, "set finger"],
        generator: torch.Generator,
        report: Callable[[int], None],
    ) -> Float[Tensor, "set dof"]:
        """The best pose found for each set of object points, joints within their limits.

        The first half pulls every start to its points and lets it pass through the object; of
        each set the best starts go on with a growing weight on penetration.
        """
        o = self._options
        rows = index.repeat_interleave(o.starts, dim=0)
        q = self._descend(self._starts(rows, generator), rows, False, report)
        kept = self._best(q, rows, len(index), o.refined)
        q, rows = q[kept], rows[kept]
        q = self._descend(q, rows, True, lambda step: report(o.steps + step))
        return q[self._best(q, rows, len(index), 1)]

    def terms(
        self,
        q: Float[Tensor, "batch dof"],
        index: Int[Tensor, "batch finger"],
        solid: bool = True,
    ) -> Terms:
        """All terms; penetrations are left at 0 unless the object is ``solid``."""
        hand, obj, pads = self._hand, self._obj, self._fingers.pads
        poses = hand.link_poses(q)
        points = hand.place(poses, pads.points, pads.link_index)
        normals = hand.turn(poses, pads.normals, pads.link_index)
        wanted, facing = obj.points[index], obj.normals[index]
        distances, opposed = [], []
        for number in range(len(self._fingers)):
            own = self._fingers.finger == number
            apart = (points[:, own] - wanted[:, number, None]).square().sum(-1)
            nearest, which = apart.min(-1)
            spread = which[:, None, None].expand(-1, 1, 3)
            normal = normals[:, own].gather(1, spread)[:, 0]
            distances.append((nearest + 1e-12).sqrt())
            opposed.append(1 + (normal * facing[:, number]).sum(-1))
        zero = torch.zeros(len(q), device=q.device)
        inside = penetration(hand, obj, poses) if solid else None
        return Terms(
            distances=torch.stack(distances, -1),
            normals=torch.stack(opposed, -1).mean(-1),
            penetration=zero if inside is None else inside.summed,
            depth=zero if inside is None else inside.depth,
            limits=hand.limit_violation(q),
            self_penetration=self_penetration(hand, poses) if solid else zero,
        )

    def total(self, terms: Terms, fraction: float = 1.0) -> Float[Tensor, "batch"]:
        """Weighted sum at a fraction of the second half, 0 at its start and 1 at its end."""
        o = self._options
        return (
            o.distance_weight * terms.distances.mean(-1)
            + o.normal_weight * terms.normals
            + o.penetration_weight * o.penetration_ramp ** (fraction - 1) * terms.penetration
            + o.self_weight * terms.self_penetration
            + o.limit_weight * terms.limits
        )

    def _descend(
        self, q: Tensor, index: Tensor, solid: bool, report: Callable[[int], None]
    ) -> Tensor:
        o = self._options
        q = q.clone().requires_grad_(True)
        optimiser = Adam([q], o.learning_rate)
        for step in range(o.steps):
            fraction = step / max(1, o.steps - 1)
            optimiser.lr = o.learning_rate * LAST_RATE**fraction
            optimiser.zero_grad()
            self.total(self.terms(q, index, solid), fraction).sum().backward()
            optimiser.step()
            report(step + 1)
        return self._hand.clamp(q.detach())

    @torch.no_grad()
    def _best(self, q: Tensor, index: Tensor, sets: int, count: int) -> Tensor:
        """Rows of the ``count`` poses of lowest energy of each set, set by set."""
        total = self.total(self.terms(q, index)).nan_to_num(nan=float("inf")).reshape(sets, -1)
        first = torch.arange(sets, device=q.device)[:, None] * total.shape[1]
        return (first + total.argsort(dim=-1, stable=True)[:, :count]).flatten()

    @torch.no_grad()
    def _starts(self, index: Tensor, generator: torch.Generator) -> Tensor:
        """Random postures, each put so that a random pad of every fingertip is at its point.

        What the points leave free, the roll about two of them, is that of a pose from
        ``gdg.initial_poses``.
        """
        hand, obj, pads = self._hand, self._obj, self._fingers.pads
        joints = random_joints(hand, len(index), generator)
        free = root_pose(above_surface(hand, obj, len(index), generator))[:, :3, :3]
        chosen = self._random_tips(len(index), generator)
        poses = hand.link_poses_in_root(joints)
        points = hand.place(poses, pads.points[chosen], pads.link_index[chosen])
        normals = hand.turn(poses, pads.normals[chosen], pads.link_index[chosen])
        return put_to(points, normals, obj.points[index], obj.normals[index], free, joints)

    def _random_tips(self, count: int, generator: torch.Generator) -> Int[Tensor, "count finger"]:
        """Pad points on fingertips, one per finger."""
        columns = []
        for number in range(len(self._fingers)):
            own = (self._fingers.tip & (self._fingers.finger == number)).nonzero()[:, 0]
            drawn = torch.randint(len(own), (count,), generator=generator)
            columns.append(own[drawn.to(own.device)])
        return torch.stack(columns, -1)


def put_to(
    points: Float[Tensor, "batch finger 3"],
    normals: Float[Tensor, "batch finger 3"],
    wanted: Float[Tensor, "batch finger 3"],
    facing: Float[Tensor, "batch finger 3"],
    free: Float[Tensor, "batch 3 3"],
    joints: Float[Tensor, "batch joint"],
) -> Float[Tensor, "batch dof"]:
    """q whose root pose brings points to the wanted ones and normals against the facing ones.

    The least squares of both (Kabsch's algorithm), normals with a lever of ``NORMAL_LEVER_M``.

    Args:
        points: in the root frame, metres.
        normals: there.
        wanted: in the object frame, metres.
        facing: outward normals there.
        free: rotation that decides what the points leave free.
        joints: of q.
    """
    center, goal = points.mean(1, keepdim=True), wanted.mean(1, keepdim=True)
    spread = (wanted - goal).mT @ (points - center)
    spread = spread - NORMAL_LEVER_M**2 * facing.mT @ normals + PRIOR_LEVER_M**2 * free
    left, _, right = torch.linalg.svd(spread)
    mirrored = torch.linalg.det(left @ right) < 0
    sign = torch.ones_like(left[:, 0])
    sign[mirrored, 2] = -1
    pose = torch.eye(4, device=points.device).repeat(len(points), 1, 1)
    pose[:, :3, :3] = (left * sign[:, None]) @ right
    pose[:, :3, 3] = goal[:, 0] - (pose[:, :3, :3] @ center.mT)[..., 0]
    return q_from_pose(pose, joints)
