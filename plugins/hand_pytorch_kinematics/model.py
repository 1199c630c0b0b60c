"""Kinematics of a hand by pytorch-kinematics (Zhong et al. 2023)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from jaxtyping import Float
from torch import Tensor

from gdg.hands.hand import Hand
from gdg.kinds.hand_model import HandModel
from gdg.late_imports import import_without

from .options import PytorchKinematicsOptions

if TYPE_CHECKING:
    import pytorch_kinematics as pk
else:  # its inverse kinematics imports matplotlib, for plots
    pk = import_without("pytorch_kinematics", "matplotlib", "pyplot", "cm")


class PytorchKinematicsHand(HandModel):
    """Builds the chain from the bare kinematic tree and couples mimic joints linearly."""

    def __init__(self, options: PytorchKinematicsOptions, hand: Hand, device: torch.device):
        # the chain is built from our own re-written XML: only checked numbers reach its parser
        chain = pk.build_chain_from_urdf(hand.urdf.kinematics_xml())
        self._chain = chain.to(dtype=torch.float32, device=device)
        order = [joint.name for joint in hand.moving_joints]
        columns = [order.index(name) for name in chain.get_joint_parameter_names()]
        matrix, offset = hand.coupling
        self._matrix = torch.as_tensor(matrix[columns], dtype=torch.float32, device=device)
        self._offset = torch.as_tensor(offset[columns], dtype=torch.float32, device=device)
        frames = [chain.frame_to_idx[name] for name in hand.link_names]
        self._frames = torch.tensor(frames, device=device)
        super().__init__(options, hand, device, options.surface_points)

    def link_poses_in_root(
        self, joints: Float[Tensor, "batch joint"]
    ) -> Float[Tensor, "batch link 4 4"]:
        """Ts_root_link of every link, differentiable in the actuated joints."""
        moving = joints @ self._matrix.T + self._offset
        return self._chain.forward_kinematics_tensor(moving)[self._frames].transpose(0, 1)
