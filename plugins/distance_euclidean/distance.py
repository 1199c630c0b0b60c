"""Euclidean distance, the ablation in the release of GenDexGrasp."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gdg.kinds.distance import Distance, HandDistance
from gdg.nearest import gather_points, nearest_hand_points

#: Factor on the distance (1/m) before the sigmoid.
SIGMOID_SCALE = 100.0


class EuclideanDistance(Distance):
    """d = min over hand points of ‖h − o‖, metres."""

    label = "euclidean/release"

    def to_hand(
        self,
        object_points: Float[Tensor, "object_point 3"],
        object_normals: Float[Tensor, "object_point 3"],
        hand_points: Float[Tensor, "batch hand_point 3"],
        hand_index: Int[Tensor, "batch object_point"] | None = None,
    ) -> HandDistance:
        """The minimum over hand points; see the interface."""
        index = hand_index
        if index is None:
            index = nearest_hand_points(object_points, object_normals, hand_points, gamma=0.0)
        difference = gather_points(hand_points, index) - object_points
        return HandDistance((difference.square().sum(-1) + 1e-16).sqrt(), index)

    def contact_value(self, distance: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
        """C = 1 − 2 (sigmoid(100 d) − ½)."""
        return 2 * torch.sigmoid(-SIGMOID_SCALE * distance)

    def aligned_gap(self, value: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
        """Gap in metres with that contact value."""
        return -torch.logit((value / 2).clamp(1e-6, 0.5)) / SIGMOID_SCALE

    def of_gap(self, gap: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
        """The gap itself, metres."""
        return gap
