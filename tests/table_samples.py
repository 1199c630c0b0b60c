"""Tables for tests, and the gripper at places around the cube."""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from gdg.data.scene import TableScene
from gdg.data.table import Table
from gdg.objects.model import ObjectModel
from gdg.rotations import q_from_pose

#: Half the small cube's edge; the table below it; metres.
HALF_CUBE_M = 0.02
BELOW_CUBE = Table((0.0, 0.0, 1.0), -HALF_CUBE_M)
#: Of the gripper: from its base to the middle of the jaws' faces, metres.
REACH_M = 0.035


def put(obj: ObjectModel, table: Table = BELOW_CUBE) -> ObjectModel:
    """The object on a table."""
    return replace(obj, scene=TableScene(table, 0, 1.0))


def gripper_looking(
    direction: tuple[float, float, float], close: float = 0.03, away: float = 0.0
) -> Float[Tensor, "1 dof"]:
    """The gripper with its jaws around the origin and the palm looking along a unit vector.

    ``away``: so much farther back, metres. Jaws close horizontally.
    """
    z = torch.tensor(direction)
    side = torch.tensor([1.0, 0.0, 0.0]) if abs(direction[2]) > 0.9 else torch.tensor([0, 0, 1.0])
    x = torch.nn.functional.normalize(side - (side @ z) * z, dim=0)
    T = torch.eye(4)[None]
    T[0, :3, :3] = torch.stack((x, torch.linalg.cross(z, x), z), dim=1)
    T[0, :3, 3] = -(REACH_M + away) * z
    return q_from_pose(T, torch.tensor([[close]]))
