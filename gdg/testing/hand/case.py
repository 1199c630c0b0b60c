"""A loaded hand with what several checks need."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
import trimesh

from gdg.hands.geometry import ConvexPart
from gdg.hands.hand import Hand
from gdg.hands.spec import MANIFEST
from gdg.kinds.hand_model import HandModel
from gdg.testing.checks import seeded

#: Random postures in which the kinematics are tried.
POSTURES = 32
#: Surface points that are checked.
SURFACE_POINTS = 800


@dataclass(frozen=True)
class HandCase:
    """A loaded hand with its model."""

    hand: Hand
    model: HandModel

    def parts_of(self, link: str) -> list[ConvexPart]:
        """The convex parts of one link."""
        return self.hand.parts_of(link)

    @cached_property
    def postures(self) -> torch.Tensor:
        """Random joint values within limits, (posture, joint)."""
        share = torch.rand(POSTURES, len(self.model.joint_names), generator=seeded())
        return self.model.lower + share * (self.model.upper - self.model.lower)

    @cached_property
    def Ts_open(self) -> np.ndarray:
        """Ts_root_link when the hand is open, (link, 4, 4)."""
        return self._poses(self.model.open_posture)

    @cached_property
    def Ts_closed(self) -> np.ndarray:
        """Ts_root_link when the hand is closed, (link, 4, 4)."""
        return self._poses(self.model.closed_posture)

    def _poses(self, joints: torch.Tensor) -> np.ndarray:
        with torch.no_grad():
            return self.model.link_poses_in_root(joints[None])[0].double().cpu().numpy()

    @cached_property
    def bodies(self) -> dict[int, list[str]]:
        """Rigid body -> its links."""
        groups: dict[int, list[str]] = {}
        for link, body in zip(self.hand.link_names, self.hand.bodies, strict=True):
            groups.setdefault(body, []).append(link)
        return groups

    def index(self, link: str) -> int:
        """A link's index."""
        return self.hand.link_names.index(link)

    def body_of(self, link: str) -> int:
        """The rigid body that a link belongs to."""
        return self.hand.bodies[self.index(link)]

    def vertices(self, link: str, Ts_root_link: np.ndarray) -> np.ndarray:
        """Corners of a link's parts in the root's frame, (n, 3); none without parts."""
        placed = [
            trimesh.transform_points(part.mesh.vertices, Ts_root_link[self.index(link)])
            for part in self.parts_of(link)
        ]
        return np.concatenate(placed) if placed else np.zeros((0, 3))

    def in_manifest(self, field: str) -> str:
        """The place of a field of ``hand.yaml``."""
        return f"{self.hand.folder / MANIFEST}: {field}"

    def in_urdf(self, what: str) -> str:
        """The place of an element of the URDF, e.g. ``joint 'thumb'``."""
        return f"{self.hand.urdf.path}: {what}"

    def at_links(self, names: list[str]) -> str:
        """The place of links in the URDF."""
        return self.in_urdf(f"link{'s' if len(names) > 1 else ''} {listed(names)}")


def listed(names: list[str], most: int = 6) -> str:
    """``'a', 'b' and 5 more``."""
    shown = ", ".join(f"'{name}'" for name in names[:most])
    return shown + (f" and {len(names) - most} more" if len(names) > most else "")
