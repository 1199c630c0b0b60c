"""Grasps of the two-jaw gripper on the cube, and planners trained on them in seconds."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from gdg.kinds.hand_model import HandModel
from gdg.kinds.trainable import Trainable
from gdg.objects.model import ObjectModel
from gdg.registry import get_registry
from gdg.rotations import q_from_pose
from gdg.testing.gripper import OPEN_M
from gdg.training.batches import GraspBatch

#: Half the edge of the cube, and how far under its middle the gripper's base lies, metres.
HALF_M, BELOW_M = 0.02, 0.035
METADATA = {"distance": "aligned/release", "train_objects": ["cube_small"]}


def jaw_poses(count: int, seed: int = 0) -> Tensor:
    """q of grasps that close on the cube from below, shifted a little along its edges."""
    random = torch.Generator().manual_seed(seed)
    pose = torch.eye(4).repeat(count, 1, 1)
    pose[:, 0, 3] = 0.006 * (2 * torch.rand(count, generator=random) - 1)
    pose[:, 2, 3] = -BELOW_M + 0.006 * (2 * torch.rand(count, generator=random) - 1)
    return q_from_pose(pose, torch.full((count, 1), OPEN_M - HALF_M))


def jaw_batch(cube: ObjectModel, count: int, points: int = 128, seed: int = 0) -> GraspBatch:
    """Training items; the contact values are those of the two faces that the jaws touch."""
    random = torch.Generator().manual_seed(seed)
    chosen = torch.randperm(len(cube.points), generator=random)[:points]
    values = torch.exp(-100 * (HALF_M - cube.points[chosen, 1].abs()))
    return GraspBatch(
        cube.points[chosen].expand(count, -1, -1),
        cube.normals[chosen].expand(count, -1, -1),
        values.expand(count, -1),
        jaw_poses(count, seed),
    )


def trained(
    planner: str, hand: HandModel, cube: ObjectModel, path: Path, steps: int
) -> list[dict[str, float]]:
    """Trains a planner for the gripper, writes its weights; gives what each step logged."""
    record = get_registry().find("planner", planner)
    cls = record.load()
    assert issubclass(cls, Trainable)
    module = cls.trainable(record.options(), 2e-3, seed=0, hand=hand)
    logged: list[dict[str, float]] = []

    def log_dict(values: dict[str, Tensor], **_: object) -> None:
        logged.append({name: float(value) for name, value in values.items()})

    module.log_dict = log_dict  # type: ignore[method-assign]
    optimiser = module.configure_optimizers()
    assert isinstance(optimiser, torch.optim.Optimizer)
    module.train()
    for step in range(steps):
        optimiser.zero_grad()
        loss = module.training_step(jaw_batch(cube, 8, points=64, seed=step), step)
        assert isinstance(loss, Tensor)
        loss.backward()
        optimiser.step()
    cls.export(module.eval(), path, METADATA)
    return logged
