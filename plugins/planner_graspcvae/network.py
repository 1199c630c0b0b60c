"""The networks: GraspCVAE (object → pose vectors of one hand) and ContactNet (Jiang et al. 2021).

Clouds are centred on the object's mean point and measured in decimetres, so that nothing depends
on where an object's frame has its origin.
"""

from __future__ import annotations

from typing import TypeAlias

import torch
from jaxtyping import Float
from torch import Tensor, nn

from gdg.kinds.hand_model import HandModel
from gdg.pads import contact_pads
from gdg.pointnet import SharedMlp, initialise, mlp
from gdg.rotations import ROOT_DIM, rot6d_from_rotation, rotation_from_rot6d

LATENT = 64
#: Features of a whole cloud; the paper has 1024.
FEATURES = 256
#: ContactNet's features of each object point, and of a whole cloud.
POINT_FEATURES, CLOUD_FEATURES = 64, 128
#: The unit of length inside the networks, metres.
UNIT_M = 0.1
#: Fewer hand points than a hand's surface has are enough to tell its pose.
HAND_POINTS = 200

Points: TypeAlias = Float[Tensor, "batch object_point 3"]
HandPoints: TypeAlias = Float[Tensor, "batch hand_point 3"]
Latent: TypeAlias = Float[Tensor, "batch latent"]


class GraspCvae(nn.Module):
    """Conditional variational auto-encoder of pose vectors.

    Args:
        hand: gives the joints, their limits and the grip. The grip is stored with the weights: it
            follows from postures and contact regions, which may change while the body stays.
    """

    joint_middle: Tensor
    joint_half: Tensor
    rest: Tensor
    grip: Tensor

    def __init__(self, hand: HandModel):
        super().__init__()
        middle, half = (hand.upper + hand.lower) / 2, (hand.upper - hand.lower) / 2
        self.register_buffer("joint_middle", middle, persistent=False)
        self.register_buffer("joint_half", half, persistent=False)
        self.register_buffer("rest", rest_points(hand), persistent=False)
        self.register_buffer("grip", grip_center(hand))
        self.object_net = SharedMlp(3, 64, 128, FEATURES)
        self.hand_net = SharedMlp(6, 64, 128, FEATURES)
        self.posterior = mlp(2 * FEATURES, 256, 2 * LATENT)
        self.decoder = mlp(FEATURES + LATENT, 512, 256, ROOT_DIM + len(middle))

    def condition(self, points: Points) -> Float[Tensor, "batch feature"]:
        """Features of objects; ``points`` in metres."""
        return self.object_net((points - center_of(points)) / UNIT_M).amax(1)

    def encode(
        self, condition: Float[Tensor, "batch feature"], points: Points, hand_points: HandPoints
    ) -> tuple[Latent, Latent]:
        """Mean and log-variance of the latent of a hand beside an object; points in metres."""
        hand = self.hand_net(beside(hand_points, points, self.rest)).amax(1)
        mean, log_variance = self.posterior(torch.cat((condition, hand), -1)).chunk(2, -1)
        return mean, log_variance

    def decode(
        self,
        condition: Float[Tensor, "batch feature"],
        center: Float[Tensor, "batch 1 3"],
        latent: Latent,
    ) -> Float[Tensor, "batch dof"]:
        """Pose vectors q with an orthonormal rot6d; joints may exceed their limits.

        The perceptron says where the middle of the grip is, which is near the object, and not
        the root: a forearm's root would carry every error of the rotation over its length.

        Args:
            condition: features of the objects.
            center: of their points, metres.
            latent: standard normal.
        """
        raw = self.decoder(torch.cat((condition, latent), -1)).float()
        rotation = rotation_from_rot6d(raw[:, 3:ROOT_DIM])
        translation = center[:, 0] + UNIT_M * raw[:, :3] - rotation @ self.grip
        joints = self.joint_middle + self.joint_half * raw[:, ROOT_DIM:]
        return torch.cat((translation, rot6d_from_rotation(rotation), joints), -1)


class ContactNet(nn.Module):
    """Object points and hand points → a contact value at every object point.

    Args:
        hand: whose points it gets.
    """

    rest: Tensor

    def __init__(self, hand: HandModel):
        super().__init__()
        self.register_buffer("rest", rest_points(hand), persistent=False)
        self.pointwise = SharedMlp(3, 64, POINT_FEATURES)
        self.overall = SharedMlp(POINT_FEATURES, CLOUD_FEATURES)
        self.hand_net = SharedMlp(6, 64, CLOUD_FEATURES)
        self.own = nn.Linear(POINT_FEATURES, 128)
        self.shared = nn.Linear(2 * CLOUD_FEATURES, 128)
        self.head = mlp(128, 64, 1)

    def forward(
        self, points: Float[Tensor, "#batch object_point 3"], hand_points: HandPoints
    ) -> Float[Tensor, "batch object_point"]:
        """Values in (0, 1); points in metres. ``points`` may be one object for many hands."""
        center = center_of(points)
        own = self.pointwise((points - center) / UNIT_M)
        hand = self.hand_net(beside(hand_points, points, self.rest)).amax(1)
        overall = self.overall(torch.relu(own)).amax(1).expand(len(hand), -1)
        shared = self.shared(torch.cat((overall, hand), -1))
        mixed = torch.relu(self.own(torch.relu(own)) + shared[:, None])
        return torch.sigmoid(self.head(mixed)[..., 0].float())


class GraspNetworks(nn.Module):
    """Both networks, as one weights file holds them.

    Args:
        hand: what GraspCVAE is for.
    """

    def __init__(self, hand: HandModel):
        super().__init__()
        self.cvae = GraspCvae(hand)
        self.contact = ContactNet(hand)

    def initialise(self, generator: torch.Generator) -> None:
        """Random weights; the first outputs are small: hands near the object, values near ½."""
        initialise(self, generator)
        decoded = self.cvae.decoder[-1]
        assert isinstance(decoded, nn.Linear)
        with torch.no_grad():
            for last in (decoded, self.cvae.posterior[-1], self.contact.head[-1]):
                assert isinstance(last, nn.Linear)
                last.weight.mul_(0.1)
            # rot6d of no rotation: zeros would have no direction
            decoded.bias[3], decoded.bias[7] = 1.0, 1.0


def center_of(points: Points) -> Float[Tensor, "batch 1 3"]:
    """Mean of each cloud."""
    return points.mean(1, keepdim=True)


def beside(
    hand_points: HandPoints,
    points: Float[Tensor, "#batch object_point 3"],
    rest: Float[Tensor, "hand_point 3"],
) -> Float[Tensor, "batch hand_point 6"]:
    """What a network sees of a hand: where its points are, and which points they are."""
    centred = (hand_points - center_of(points)) / UNIT_M
    return torch.cat((centred, rest.expand(len(centred), -1, -1)), -1)


@torch.no_grad()
def grip_center(hand: HandModel) -> Float[Tensor, "3"]:
    """Mean of the pads of the half closed hand in its root frame, metres."""
    pads = contact_pads(hand)
    poses = hand.link_poses_in_root(((hand.open_posture + hand.closed_posture) / 2)[None])
    return hand.place(poses, pads.points, pads.link_index)[0].mean(0)


@torch.no_grad()
def rest_points(hand: HandModel) -> Float[Tensor, "few_point 3"]:
    """The thinned points of the hand in its root frame, which name each point; decimetres.

    All joints are in mid-range: these points follow from the hand's body alone.
    """
    poses = hand.link_poses_in_root(((hand.lower + hand.upper) / 2)[None])
    return thinned(hand.place_surface(poses))[0] / UNIT_M


def thinned(hand_points: HandPoints) -> Float[Tensor, "batch few_point 3"]:
    """At most some ``HAND_POINTS`` of a hand's surface points, evenly spread."""
    return hand_points[:, :: max(1, hand_points.shape[1] // HAND_POINTS)]
