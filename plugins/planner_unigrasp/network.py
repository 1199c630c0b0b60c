"""The point-set selection network: one contact point per stage, given those before it.

As in UniGrasp, features of every object point are computed once, and each stage scores all points
with the points chosen so far as further input. A PointNet computes the features, UniGrasp's
PointNet++; there are no features of the hand, since a network serves one hand.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from gdg.pointnet import SharedMlp, initialise, mlp

POINT_FEATURES, CLOUD_FEATURES, HIDDEN = 64, 128, 128
#: Of a point relative to a chosen one: offset 3, length, angle of normals, the chosen normal 3.
RELATION = 8
#: The unit of length inside the network, metres.
UNIT_M = 0.1

Points: TypeAlias = Float[Tensor, "batch object_point 3"]


@dataclass(frozen=True)
class Scene:
    """Object points with their features; lengths in decimetres about the cloud's mean."""

    points: Points
    normals: Points
    features: Float[Tensor, "batch object_point feature"]
    cloud: Float[Tensor, "batch cloud_feature"]

    def of(self, rows: Tensor) -> Scene:
        """Some items of the batch, or one of them several times."""
        return Scene(self.points[rows], self.normals[rows], self.features[rows], self.cloud[rows])


class Stage(nn.Module):
    """Scores every point as the next contact.

    Args:
        earlier: contacts that are chosen before this one.
    """

    def __init__(self, earlier: int):
        super().__init__()
        self.own = nn.Linear(POINT_FEATURES, HIDDEN)
        self.cloud = nn.Linear(CLOUD_FEATURES, HIDDEN, bias=False)
        self.relation = nn.Linear(RELATION * earlier, HIDDEN, bias=False) if earlier else None
        self.chosen = nn.Linear(POINT_FEATURES * earlier, HIDDEN, bias=False) if earlier else None
        self.head = mlp(HIDDEN, 64, 1)

    def forward(
        self, scene: Scene, chosen: Int[Tensor, "batch earlier"]
    ) -> Float[Tensor, "batch object_point"]:
        """Scores; their softmax over points is the contact's distribution."""
        shared = self.cloud(scene.cloud)
        hidden = self.own(scene.features)
        if self.relation is not None and self.chosen is not None:
            spread = chosen[..., None].expand(-1, -1, POINT_FEATURES)
            shared = shared + self.chosen(scene.features.gather(1, spread).flatten(1))
            hidden = hidden + self.relation(_relations(scene, chosen))
        hidden = hidden + shared[:, None]
        return self.head(torch.relu(hidden))[..., 0].float()


class ContactSelection(nn.Module):
    """Features of object points, and one stage per finger.

    Args:
        fingers: number of stages.
    """

    def __init__(self, fingers: int):
        super().__init__()
        self.pointwise = SharedMlp(6, 64, POINT_FEATURES)
        self.overall = SharedMlp(POINT_FEATURES, 64, CLOUD_FEATURES)
        self.stages = nn.ModuleList(Stage(earlier) for earlier in range(fingers))

    def scene(self, points: Points, normals: Points) -> Scene:
        """Features of objects; ``points`` in metres, ``normals`` outward."""
        centred = (points - points.mean(1, keepdim=True)) / UNIT_M
        own = torch.relu(self.pointwise(torch.cat((centred, normals), -1)))
        return Scene(centred, normals, own, torch.relu(self.overall(own).amax(1)))

    def initialise(self, generator: torch.Generator) -> None:
        """Random weights; the first distributions are nearly uniform."""
        initialise(self, generator)
        for stage in self.stages:
            assert isinstance(stage, Stage)
            last = stage.head[-1]
            assert isinstance(last, nn.Linear)
            with torch.no_grad():
                last.weight.mul_(0.1)


def _relations(
    scene: Scene, chosen: Int[Tensor, "batch earlier"]
) -> Float[Tensor, "batch object_point relation"]:
    """How every point lies to each chosen one."""
    spread = chosen[..., None].expand(-1, -1, 3)
    points, normals = scene.points.gather(1, spread), scene.normals.gather(1, spread)
    offset = scene.points[:, :, None] - points[:, None]
    length = (offset.square().sum(-1, keepdim=True) + 1e-12).sqrt()
    angle = (scene.normals[:, :, None] * normals[:, None]).sum(-1, keepdim=True)
    wide = normals[:, None].expand(-1, offset.shape[1], -1, -1)
    return torch.cat((offset, length, angle, wide), -1).flatten(2)
