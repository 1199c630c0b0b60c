"""A contact distance in metres that is smooth at contact."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gdg.kinds.distance import Distance, HandDistance
from gdg.nearest import gather_points, nearest_hand_points

from .options import HuberOptions


class HuberDistance(Distance):
    """D = √(s² + k²) − k with s = d · exp(2γ (1 − ⟨u, n⟩)), metres; contact value exp(−D / reach).

    s is the square of gdg's aligned distance: the gap d where a hand point lies straight in front
    of the surface, more beside it, most behind it. √d, the aligned distance, has an infinite slope
    at contact; this one (a pseudo-Huber of knee k) has none there and a slope of one far away.
    """

    options: HuberOptions

    def __init__(self, options: HuberOptions):
        super().__init__(options)
        values = f"-knee{options.knee:g}-reach{options.reach:g}-gamma{options.gamma:g}"
        self.label = f"huber/v1{values}"

    def to_hand(
        self,
        object_points: Float[Tensor, "object_point 3"],
        object_normals: Float[Tensor, "object_point 3"],
        hand_points: Float[Tensor, "batch hand_point 3"],
        hand_index: Int[Tensor, "batch object_point"] | None = None,
    ) -> HandDistance:
        """The minimum over hand points; see the interface."""
        index, gamma = hand_index, self.options.gamma
        if index is None:  # D grows with s, so the point of least s is the one of least D
            index = nearest_hand_points(object_points, object_normals, hand_points, gamma)
        difference = gather_points(hand_points, index) - object_points
        length = (difference.square().sum(-1) + 1e-16).sqrt()
        alignment = (difference * object_normals).sum(-1) / length
        return HandDistance(self.of_gap(length * torch.exp(2 * gamma * (1 - alignment))), index)

    def contact_value(self, distance: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
        """C = exp(−D / reach), never quite 0."""
        return torch.exp(-distance / self.options.reach).clamp(min=1e-30)

    def aligned_gap(self, value: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
        """Gap in metres with that contact value."""
        distance = -self.options.reach * value.clamp(min=1e-30, max=1.0).log()
        return (distance * (distance + 2 * self.options.knee)).sqrt()

    def of_gap(self, gap: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
        """Distance of a hand point straight in front of the surface, ``gap`` metres away."""
        knee = self.options.knee
        squared = gap.square()  # √(s² + k²) − k, written so that nothing cancels
        return squared / ((squared + knee**2).sqrt() + knee)
