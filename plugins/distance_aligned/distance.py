"""Aligned distance of GenDexGrasp (Li et al. 2022, Eq. 3 and 4)."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gdg.kinds.distance import Distance, HandDistance
from gdg.nearest import EPSILON_M, gather_points, nearest_hand_points

from .options import AlignedOptions

#: Factor on the distance (metre^½) before the sigmoid.
SIGMOID_SCALE = {"release": 10.0, "paper": 1.0}


class AlignedDistance(Distance):
    """D = min over hand points h of exp(γ (1 − ⟨u, n⟩)) · √‖h − o‖, u = (h − o)/‖h − o‖.

    Unit: metre^½. A hand point straight out along the outward normal n has ⟨u, n⟩ = 1 and
    exponent 0; one behind the surface is pushed away by e^{2γ}, so that the far side of a thin
    wall stays untouched.
    """

    options: AlignedOptions

    def __init__(self, options: AlignedOptions):
        super().__init__(options)
        gamma = "" if options.gamma == 1.0 else f"-gamma{options.gamma:g}"
        self.label = f"aligned/{options.preset}{gamma}"

    def to_hand(
        self,
        object_points: Float[Tensor, "object_point 3"],
        object_normals: Float[Tensor, "object_point 3"],
        hand_points: Float[Tensor, "batch hand_point 3"],
        hand_index: Int[Tensor, "batch object_point"] | None = None,
    ) -> HandDistance:
        """The minimum over hand points; see the interface."""
        index, gamma = hand_index, self.options.gamma
        if index is None:
            index = nearest_hand_points(object_points, object_normals, hand_points, gamma)
        difference = gather_points(hand_points, index) - object_points
        length = (difference.square().sum(-1) + 1e-16).sqrt()
        alignment = (difference * object_normals).sum(-1) / (length + EPSILON_M)
        distance = torch.exp(gamma * (1 - alignment)) * length.sqrt()
        return HandDistance(distance, index)

    def contact_value(self, distance: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
        """C = 1 − 2 (sigmoid(s D) − ½), s = 10 (release) or 1 (paper, Eq. 4)."""
        return 2 * torch.sigmoid(-SIGMOID_SCALE[self.options.preset] * distance)

    def aligned_gap(self, value: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
        """Gap in metres of an aligned point with that contact value: D = √d."""
        half = (value / 2).clamp(1e-6, 0.5)
        return (-torch.logit(half) / SIGMOID_SCALE[self.options.preset]).square()

    def of_gap(self, gap: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
        """√gap, metre^½: the exponent is 0 for aligned points."""
        return gap.clamp(min=0.0).sqrt()

    def sharpen(self, values: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
        """Paper: values ≥ 0.5 become 1. Release ("sharp_lift"): c > 0.4 is lifted toward 1.

        The lift is min(c + 1 − min(max c, 0.5), 1), max over the last axis.
        """
        if self.options.preset == "paper":
            return torch.where(values >= 0.5, torch.ones_like(values), values)
        lift = 1 - values.amax(-1, keepdim=True).clamp(max=0.5)
        return torch.where(values > 0.4, (values + lift).clamp(max=1.0), values)
