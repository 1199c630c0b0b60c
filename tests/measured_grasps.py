"""Grasps to measure: the gripper around a cube, and bundled hands closed on an object."""

from __future__ import annotations

import torch
from conftest import build_model
from torch import Tensor

from gdg.closure import close_until_touch
from gdg.data.grasps import GraspSet
from gdg.hands.hand import find_hand
from gdg.initial_poses import above_surface
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.rotations import ROOT_DIM, root_pose

#: Half the cube's edge, and how far the gripper's base lies below its middle, metres.
HALF_CUBE_M, BELOW_M = 0.02, 0.035


def grasp_set(hand: HandModel, obj: ObjectModel, poses: Tensor, joints: Tensor) -> GraspSet:
    root = hand.hand.spec.root_link
    return GraspSet(hand.hand.name, obj.name, hand.joint_names, root, poses, joints)


def around_the_cube(hand: HandModel, cube: ObjectModel, gaps_mm: list[float]) -> GraspSet:
    """The gripper around the cube's middle, each jaw so far off (negative: in it)."""
    poses = torch.eye(4).repeat(len(gaps_mm), 1, 1)
    poses[:, 2, 3] = -BELOW_M
    joints = 0.05 - HALF_CUBE_M - 0.001 * torch.tensor(gaps_mm)
    return grasp_set(hand, cube, poses, joints[:, None])


def closed_on(name: str, obj: ObjectModel, count: int) -> tuple[HandModel, GraspSet]:
    """A bundled hand, closed on an object from random starts."""
    hand = build_model(find_hand(name), points=1600)
    starts = above_surface(hand, obj, count, torch.Generator().manual_seed(0), gap_m=(0.01, 0.03))
    q = close_until_touch(hand, obj, starts)
    return hand, grasp_set(hand, obj, root_pose(q), q[:, ROOT_DIM:])
