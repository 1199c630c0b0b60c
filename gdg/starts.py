"""How a grasp starts under a protocol, backed out of penetration and closed, and is tested."""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from gdg.data.grasps import GraspSet
from gdg.kinds.fitter import Progress
from gdg.kinds.hand_model import HandModel
from gdg.kinds.simulator import Simulator
from gdg.objects.model import ObjectModel
from gdg.penetration import penetration_depth
from gdg.penetration.table import hand_height
from gdg.protocols import Protocol, Refinement
from gdg.rotations import ROOT_DIM
from gdg.scenes.above import targets_above

#: Positions tried on the way from the grasp to the open posture.
BACK_OUT_STEPS = 40


def simulated(
    simulator: Simulator,
    hand: HandModel,
    obj: ObjectModel,
    grasps: GraspSet,
    protocol: Protocol,
    refine: bool = True,
    progress: Progress | None = None,
) -> GraspSet:
    """The grasps as planned, with verdicts and the drive targets that they were tested with.

    Args:
        simulator: tests them.
        hand: the hand.
        obj: the object, in its scene.
        grasps: as planned.
        protocol: the test.
        refine: as of ``prepare``.
        progress: called as the simulator advances.
    """
    prepared = prepare(hand, obj, grasps, protocol, refine)
    # backing out needs targets of its own, so a simulator can't tell by them
    refined = refine and protocol.refinement.step != "none"
    verdicts = simulator.simulate(hand, obj, prepared, protocol, progress)
    return replace(
        grasps,
        targets=prepared.targets,
        verdicts=tuple(replace(verdict, refined=refined) for verdict in verdicts),
    )


def prepare(
    hand: HandModel, obj: ObjectModel, grasps: GraspSet, protocol: Protocol, refine: bool = True
) -> GraspSet:
    """Grasps with the joints and drive targets that the protocol starts them with.

    Args:
        hand: the hand.
        obj: the object.
        grasps: as planned.
        protocol: says whether to back out, and how to close.
        refine: False leaves the contact-aware refinement out, for with/without comparisons.
    """
    if len(grasps) == 0:
        return grasps
    targets = None
    if refine and protocol.refinement.step != "none":
        targets = closing_targets(hand, obj, hand.q_of(grasps), protocol.refinement).cpu()
    joints = grasps.joints
    if protocol.start.mode == "backed-out":
        targets = grasps.joints if targets is None else targets
        joints = backed_out(hand, obj, hand.q_of(grasps), protocol.start.clearance_m).cpu()
    return replace(grasps, joints=joints, targets=targets)


def closing_targets(
    hand: HandModel,
    obj: ObjectModel,
    q: Float[Tensor, "batch dof"],
    refinement: Refinement,
) -> Float[Tensor, "batch joint"]:
    """Joint targets by the contact-aware refinement that lead no link into the object's table."""
    targets = contact_aware_targets(hand, obj, q, refinement)
    return targets if obj.table is None else targets_above(hand, obj.table, q, targets)


def contact_aware_targets(
    hand: HandModel,
    obj: ObjectModel,
    q: Float[Tensor, "batch dof"],
    refinement: Refinement,
) -> Float[Tensor, "batch joint"]:
    """Joint targets that press the hand's contacts into the object (paper, Section IV-A).

    Hand points within ``reach_m`` of the surface get goals ``depth_m`` inside it, along the
    object's normal; the joints take one step down the gradient of the mean squared distance to
    these goals. The step is scaled so that the joint that moves most moves by ``size`` (rad, or
    m for a prismatic joint): the source's raw step depends on the number of points. With
    ``sign`` every joint that moves a contact moves by ``size``, as in the release.

    The root stays, and so do joints that take no part in closing (whose open and closed postures
    are equal): the release turns a ShadowHand's wrist by 0.5 rad too, which carries the object
    off.
    """
    joints = q[:, ROOT_DIM:].detach().clone().requires_grad_(True)
    points = hand.surface_points(torch.cat((q[:, :ROOT_DIM], joints), dim=-1))
    distance, normals = obj.sdf.distance(points.detach()), obj.sdf.normals(points.detach())
    near = (distance.abs() < refinement.reach_m)[..., None]
    goals = points.detach() - (distance[..., None] + refinement.depth_m) * normals
    loss = torch.where(near, (points - goals).square(), torch.zeros_like(points)).sum()
    (gradient,) = torch.autograd.grad(loss, joints)
    gradient = torch.where(hand.open_posture == hand.closed_posture, 0.0, gradient)
    if refinement.step == "sign":
        direction = torch.where(gradient.abs() > 1e-9, gradient.sign(), 0.0)
    else:
        direction = gradient / gradient.abs().amax(-1, keepdim=True).clamp(min=1e-12)
    return joints.detach() - refinement.size * direction


@torch.no_grad()
def backed_out(
    hand: HandModel, obj: ObjectModel, q: Float[Tensor, "batch dof"], clearance_m: float
) -> Float[Tensor, "batch joint"]:
    """Joints opened just so far that the hand lies no deeper than ``clearance_m``.

    Joints go straight toward the open posture; a grasp that is still too deep there (its palm is
    inside the object) starts in the open posture. Joints open no further than the hand stays above
    the table that the object rests on.
    """
    joints = q[:, ROOT_DIM:]
    result, pending = joints.clone(), torch.ones(len(q), dtype=torch.bool, device=q.device)
    for share in torch.linspace(0, 1, BACK_OUT_STEPS + 1).tolist():
        trial = joints + share * (hand.open_posture - joints)
        moved = torch.cat((q[:, :ROOT_DIM], trial), dim=-1)
        if obj.table is not None and share > 0:
            pending = pending & (hand_height(hand, obj.table, moved) >= 0)
        depth = penetration_depth(hand, obj, moved)
        result = torch.where(pending[:, None], trial, result)
        pending = pending & (depth > clearance_m)
        if not pending.any():
            break
    return result
