"""A hand and the truth about it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh

from gdg.hands.urdf import Joint, Link


@dataclass(frozen=True)
class HardHand:
    """A hand and the truth about it.

    Attributes:
        name: of the robot and of its file.
        links: by name; shapes as ``read_urdf`` gives them.
        joints: parents before children. An effort of 0 is left out of the file.
        meshes: file -> mesh in the units of the file (the shape has the scale).
        palm_links: any of these is right; the first carries the palm's surface.
        palm_normal: unit vector out of the palm toward what is grasped; root frame, all joints at
            zero.
        palm_center: a point on the palm's surface; root frame, all joints at zero.
        closing: +1 or -1 for every joint that curls a finger or closes a jaw. Spread, opposition
            and wrist joints and those that only keep a pad parallel are left out.
        distal_links: the last link with geometry of each finger or jaw.
        pads: finger link -> outward unit normal of its inner side, link frame.
    """

    name: str
    links: dict[str, Link]
    joints: tuple[Joint, ...]
    meshes: dict[str, trimesh.Trimesh]
    palm_links: tuple[str, ...]
    palm_normal: np.ndarray
    palm_center: np.ndarray
    closing: dict[str, int]
    distal_links: tuple[str, ...]
    pads: dict[str, np.ndarray]

    @property
    def root(self) -> str:
        """The link that is no joint's child."""
        children = {joint.child for joint in self.joints}
        return next(name for name in self.links if name not in children)
