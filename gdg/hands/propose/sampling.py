"""Random postures."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gdg.kinds.hand_model import HandModel


def random_postures(hand: HandModel, count: int, seed: int = 0) -> Float[Tensor, "posture joint"]:
    """Postures spread over the joints' ranges; the same seed gives the same ones."""
    generator = torch.Generator().manual_seed(seed)
    share = torch.rand(count, len(hand.joint_names), generator=generator)
    return hand.lower + share * (hand.upper - hand.lower)
