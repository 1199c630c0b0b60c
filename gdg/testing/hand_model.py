"""Checks of hand models: rigid link poses, gradients, batches, a hand that can be predicted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from gdg.components import Options
from gdg.hands.hand import Hand, find_hand
from gdg.kinds.hand_model import HandModel
from gdg.rotations import ROOT_DIM, random_rotations
from gdg.testing.checks import differ, not_rigid, seeded
from gdg.testing.fixtures import two_jaws
from gdg.testing.gripper import OPEN_M

#: A bundled hand with revolute joints, some of which mimic others.
BUNDLED = "barrett"
BATCH = 4
#: Poses are compared to this, metres and unit axes.
TOLERANCE = 1e-5
#: Step of the finite differences, rad or m (a fourth-order stencil allows steps that float32 can
#: tell apart), and how far gradients may be off.
STEP = 2e-2
GRADIENT_TOLERANCE = 3e-3


@dataclass(frozen=True)
class Maker:
    """A hand model's class and options."""

    cls: type
    options: Options

    def of(self, hand: Hand) -> HandModel:
        """The model of a hand on the CPU."""
        return self.cls(self.options, hand, torch.device("cpu"))


@dataclass(frozen=True)
class HandModelCase:
    """The models of the two-jaw gripper and of a bundled hand."""

    maker: Maker

    @cached_property
    def jaws(self) -> HandModel:
        """The two-jaw gripper."""
        return self.maker.of(two_jaws())

    @cached_property
    def models(self) -> tuple[HandModel, ...]:
        """Both hands' models."""
        return self.jaws, self.maker.of(find_hand(BUNDLED))


def _joints(model: HandModel, count: int = BATCH) -> Tensor:
    share = torch.rand(count, len(model.joint_names), generator=seeded())
    return model.lower + share * (model.upper - model.lower)


def link_poses(case: HandModelCase) -> Iterator[str]:
    """Poses are rigid, one per link, and the root link's is the identity."""
    for model in case.models:
        name, poses = model.hand.name, model.link_poses_in_root(_joints(model))
        wanted = (BATCH, len(model.link_names), 4, 4)
        if poses.shape != wanted or poses.dtype != torch.float32:
            yield f"{name}: link poses must be float32 of shape {wanted}."
            continue
        if bool(not_rigid(poses).any()):
            yield f"{name}: link poses are not rigid."
        root = poses[:, model.link_names.index(model.hand.urdf.root)]
        if differ(root, torch.eye(4).expand(BATCH, 4, 4), TOLERANCE):
            yield f"{name}: T_root_root must be the identity."


def predicted_poses(case: HandModelCase) -> Iterator[str]:
    """The two jaws are where the joint value says; the right one mimics the left."""
    joints = torch.tensor([[0.0], [0.02], [0.05]])
    poses = case.jaws.link_poses_in_root(joints)
    for link, side in (("left", 1.0), ("right", -1.0)):
        expected = torch.zeros(3, 3)
        expected[:, 1] = side * (OPEN_M - joints[:, 0])
        if differ(poses[:, case.jaws.link_names.index(link), :3, 3], expected, TOLERANCE):
            yield f"two_jaws: link '{link}' is not where its joint puts it."


def root_motion(case: HandModelCase) -> Iterator[str]:
    """The root part of q moves all links rigidly."""
    for model in case.models:
        joints = _joints(model)
        rotation = random_rotations(BATCH, seeded(1))
        shift = torch.randn(BATCH, 3, generator=seeded(2))
        q = torch.cat((shift, rotation[:, 0], rotation[:, 1], joints), dim=-1)
        expected = model.link_poses_in_root(joints)[..., :3, 3] @ rotation.mT + shift[:, None]
        if differ(model.link_poses(q)[..., :3, 3], expected, 10 * TOLERANCE):
            yield f"{model.hand.name}: link_poses does not follow the root's pose."


def gradient(case: HandModelCase) -> Iterator[str]:
    """Gradients in the joints equal finite differences."""
    for model in case.models:
        weights = torch.randn(len(model.link_names), 4, 4, generator=seeded(3))
        joints = _joints(model, 1)
        probe = joints.clone().requires_grad_(True)
        value = (model.link_poses_in_root(probe) * weights).sum()
        (slope,) = torch.autograd.grad(value, probe)
        steps = STEP * torch.eye(joints.shape[1])
        far, near = (
            _weighted(model, joints + k * steps, weights)
            - _weighted(model, joints - k * steps, weights)
            for k in (2, 1)
        )
        expected = (8 * near - far) / (12 * STEP)
        largest = float(expected.abs().max())
        if differ(slope[0], expected, GRADIENT_TOLERANCE * max(1.0, largest)):
            yield f"{model.hand.name}: gradients in the joints differ from finite differences."


def _weighted(model: HandModel, joints: Tensor, weights: Tensor) -> Tensor:
    return (model.link_poses_in_root(joints) * weights).sum((1, 2, 3))


def batches(case: HandModelCase) -> Iterator[str]:
    """A batch of one equals its row in the batch; an empty batch stays empty."""
    for model in case.models:
        joints = _joints(model)
        together = model.link_poses_in_root(joints)
        for row in range(BATCH):
            alone = model.link_poses_in_root(joints[row : row + 1])
            if differ(alone, together[row : row + 1], TOLERANCE):
                yield f"{model.hand.name}: row {row} of a batch differs from the same row alone."
        if differ(model.link_poses_in_root(joints), together, 0):
            yield f"{model.hand.name}: the same joint values give other poses the second time."
        if len(model.link_poses_in_root(joints[:0])) != 0:
            yield f"{model.hand.name}: an empty batch must give an empty batch of link poses."
        q = torch.zeros(0, ROOT_DIM + len(model.joint_names))
        if model.surface_points(q).shape != (0, len(model.surface.points), 3):
            yield f"{model.hand.name}: an empty batch must give an empty batch of surface points."


def names_and_limits(case: HandModelCase) -> Iterator[str]:
    """Joints, links and limits are those of the folder, in its order."""
    for model in case.models:
        hand = model.hand
        if model.joint_names != hand.spec.joints or model.link_names != hand.link_names:
            yield f"{hand.name}: joint_names and link_names must be the folder's, in its order."
        limits = np.stack(hand.limits())
        if differ(torch.stack((model.lower, model.upper)), torch.tensor(limits).float(), 1e-6):
            yield f"{hand.name}: lower and upper must be the limits of the URDF."


CHECKS = (link_poses, predicted_poses, root_motion, gradient, batches, names_and_limits)
