"""Hand model: batched differentiable kinematics and surface of a hand."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gdg.components import Options
from gdg.data.grasps import GraspSet
from gdg.hands.geometry import hand_spheres, hand_surface
from gdg.hands.hand import Hand
from gdg.placement import place_points
from gdg.placement.eager import poses_of
from gdg.rotations import ROOT_DIM, q_from_pose, root_pose


@dataclass(frozen=True)
class LinkPoints:
    """Points fixed to links: positions and unit normals in link frames, metres."""

    points: Float[Tensor, "point 3"]
    normals: Float[Tensor, "point 3"]
    link_index: Int[Tensor, "point"]

    def every(self, stride: int) -> LinkPoints:
        """Every ``stride``-th point: still spread over the whole hand, since near ones follow."""
        return LinkPoints(self.points[::stride], self.normals[::stride], self.link_index[::stride])


@dataclass(frozen=True)
class ContactRegions:
    """Quadrilaterals in which contact points may lie.

    Attributes:
        corners: four corners each, link frame, metres, counter-clockwise from outside.
        normals: outward unit normal of each, link frame.
        link_index: link of each, into ``HandModel.link_names``.
    """

    corners: Float[Tensor, "region 4 3"]
    normals: Float[Tensor, "region 3"]
    link_index: Int[Tensor, "region"]


@dataclass(frozen=True)
class CollisionSpheres:
    """Inscribed spheres, and how far apart the centres of two must stay.

    Attributes:
        centers: link frames, metres.
        radii: metres.
        link_index: into ``HandModel.link_names``.
        reach: sum of the radii of pairs that must not overlap, each pair once (upper triangle);
            −∞-like (−1 m) for all others.
    """

    centers: Float[Tensor, "sphere 3"]
    radii: Float[Tensor, "sphere"]
    link_index: Int[Tensor, "sphere"]
    reach: Float[Tensor, "sphere sphere"]


class HandModel(ABC):
    """A hand as tensors. Subclasses give the kinematics; the rest is here.

    q is (translation 3, rot6d 6, actuated joints N) in the hand's declared joint order; the world
    frame is the object's frame. Metres and radians, float32.

    Args:
        options: the component's options.
        hand: the loaded folder.
        device: where the tensors live.
        surface_points: number of points of ``surface``.

    Attributes:
        joint_names: actuated joints.
        link_names: all links, in the order of every link index.
        lower: lower joint limits.
        upper: upper joint limits.
        open_posture: fingers open.
        closed_posture: fingers flexed.
        surface: points evenly spread over the whole hand, outward normals.
        regions: contact regions of the manifest.
        spheres: inscribed spheres for self-collision.
    """

    def __init__(self, options: Options, hand: Hand, device: torch.device, surface_points: int):
        self.options = options
        self.hand = hand
        self.device = device
        self.joint_names = hand.spec.joints
        self.link_names = hand.link_names
        self.lower, self.upper = (self._tensor(limit) for limit in hand.limits())
        self.open_posture = self._tensor(hand.posture("open"))
        self.closed_posture = self._tensor(hand.posture("closed"))
        sampled = hand_surface(hand.urdf, hand.parts, surface_points, seed=0)
        self.surface = LinkPoints(
            self._tensor(sampled.points),
            self._tensor(sampled.normals),
            torch.as_tensor(sampled.link_index, device=device),
        )
        self.regions = self._regions()
        self._spheres: CollisionSpheres | None = None

    @abstractmethod
    def link_poses_in_root(
        self, joints: Float[Tensor, "batch joint"]
    ) -> Float[Tensor, "batch link 4 4"]:
        """Ts_root_link of every link, differentiable in the actuated joints."""

    # -- poses and points ------------------------------------------------------------------

    def link_poses(self, q: Float[Tensor, "batch dof"]) -> Float[Tensor, "batch link 4 4"]:
        """Ts_world_link of every link."""
        return root_pose(q)[:, None] @ self.link_poses_in_root(q[:, ROOT_DIM:])

    def place(
        self,
        Ts_world_link: Float[Tensor, "batch link 4 4"],
        points: Float[Tensor, "*batch point 3"],
        link_index: Int[Tensor, "*batch point"],
    ) -> Float[Tensor, "batch point 3"]:
        """Link-frame points in the world; ``points`` may differ per batch element or not."""
        return place_points(Ts_world_link, points, link_index)

    def turn(
        self,
        Ts_world_link: Float[Tensor, "batch link 4 4"],
        directions: Float[Tensor, "*batch point 3"],
        link_index: Int[Tensor, "*batch point"],
    ) -> Float[Tensor, "batch point 3"]:
        """Link-frame directions in the world: rotated, never translated."""
        T = poses_of(Ts_world_link, link_index)
        return (T[..., :3, :3] @ directions[..., None])[..., 0]

    def surface_points(self, q: Float[Tensor, "batch dof"]) -> Float[Tensor, "batch hand_point 3"]:
        """World positions of ``surface``, metres."""
        return self.place_surface(self.link_poses(q))

    def place_surface(
        self, Ts_world_link: Float[Tensor, "batch link 4 4"]
    ) -> Float[Tensor, "batch hand_point 3"]:
        """World positions of ``surface`` for given link poses, metres."""
        return self.place(Ts_world_link, self.surface.points, self.surface.link_index)

    def palm(
        self, q: Float[Tensor, "batch dof"]
    ) -> tuple[Float[Tensor, "batch 3"], Float[Tensor, "batch 3"]]:
        """Centre (metres) and outward unit normal of the palm in the world."""
        palm = self.hand.spec.palm
        T = self.link_poses(q)[:, self.link_names.index(palm.link)]
        center = T[:, :3, :3] @ self._tensor(palm.center) + T[:, :3, 3]
        return center, T[:, :3, :3] @ self._tensor(palm.normal)

    # -- penalties -------------------------------------------------------------------------

    def limit_violation(self, q: Float[Tensor, "batch dof"]) -> Float[Tensor, "batch"]:
        """E_n = ‖relu(q − upper) + relu(lower − q)‖₂ over joints (paper), rad."""
        joints = q[:, ROOT_DIM:]
        excess = torch.relu(joints - self.upper) + torch.relu(self.lower - joints)
        # the norm's gradient is undefined at zero, where most batches are
        return (excess.square().sum(-1) + 1e-12).sqrt() - 1e-6

    @property
    def spheres(self) -> CollisionSpheres:
        """Inscribed spheres, built on first use.

        Pairs that overlap in the open posture are left out: they can't be told from links that
        touch by construction.
        """
        if self._spheres is None:
            self._spheres = self._build_spheres()
        return self._spheres

    # -- grasps ----------------------------------------------------------------------------

    def q_of(self, grasps: GraspSet, joints: Float[Tensor, "grasp joint"] | None = None) -> Tensor:
        """Pose vectors of a grasp set, (grasp, dof); optionally with other joint values."""
        values = grasps.joints if joints is None else joints
        return q_from_pose(grasps.poses, values).to(self.device)

    def grasps_from(
        self,
        q: Float[Tensor, "grasp dof"],
        object_name: str,
        energies: Mapping[str, Float[Tensor, "grasp"]],
        **rest: Any,
    ) -> GraspSet:
        """The grasp set of pose vectors, on the CPU: the inverse of ``q_of``.

        Args:
            q: pose vectors.
            object_name: of the object.
            energies: name -> value per grasp.
            rest: further fields of ``GraspSet``.
        """
        return GraspSet(
            hand=self.hand.name,
            object_name=object_name,
            joint_names=self.joint_names,
            root_link=self.hand.spec.root_link,
            poses=root_pose(q).cpu(),
            joints=q[:, ROOT_DIM:].cpu(),
            energies={name: values.cpu() for name, values in energies.items()},
            **rest,
        )

    def clamp(self, q: Float[Tensor, "batch dof"]) -> Float[Tensor, "batch dof"]:
        """q with joints moved into their limits."""
        joints = torch.maximum(torch.minimum(q[:, ROOT_DIM:], self.upper), self.lower)
        return torch.cat((q[:, :ROOT_DIM], joints), dim=-1)

    # -- construction ----------------------------------------------------------------------

    def _tensor(self, values: object) -> Tensor:
        return torch.as_tensor(np.asarray(values), dtype=torch.float32, device=self.device)

    def _regions(self) -> ContactRegions:
        listed = self.hand.spec.contact_regions
        corners = [corner for regions in listed.values() for corner in regions]
        index = [self.link_names.index(k) for k, regions in listed.items() for _ in regions]
        tensor = self._tensor(corners).reshape(-1, 4, 3)
        diagonals = tensor[:, 2] - tensor[:, 0], tensor[:, 3] - tensor[:, 1]
        normals = torch.nn.functional.normalize(torch.linalg.cross(*diagonals), dim=-1)
        return ContactRegions(
            tensor, normals, torch.tensor(index, dtype=torch.long, device=self.device)
        )

    def _build_spheres(self) -> CollisionSpheres:
        found = hand_spheres(self.hand.urdf, self.hand.parts)
        centers, radii = self._tensor(found.centers), self._tensor(found.radii)
        link = torch.as_tensor(found.link_index, device=self.device)
        allowed = torch.as_tensor(self.hand.may_collide(), device=self.device)
        apart: Bool[Tensor, "sphere sphere"] = allowed[link][:, link].triu(1)
        placed = self.place(self.link_poses_in_root(self.open_posture[None]), centers, link)
        summed = radii[:, None] + radii[None, :]
        touching = (torch.cdist(placed, placed) < summed).any(0)
        reach = torch.where(apart & ~touching, summed, torch.full_like(summed, -1.0))
        return CollisionSpheres(centers, radii, link, reach)
