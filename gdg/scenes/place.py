"""Puts an object into a scene."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gdg.data.scene import TableScene
from gdg.data.table import Table
from gdg.errors import GdgError
from gdg.objects.model import ObjectModel
from gdg.protocols import Protocol
from gdg.scenes.resting import SAME_POSE_RAD, RestingPose, resting_poses


def on_table(obj: ObjectModel, pose: int = 0) -> ObjectModel:
    """The object at rest on a table.

    Args:
        obj: the object.
        pose: which of ``resting_poses``, 0 the most probable.

    Raises:
        GdgError: the object has no such pose.
    """
    poses = resting_poses(obj)
    if pose >= len(poses):
        # two digits: each of a ball's poses is rare
        listed = ", ".join(f"{n} ({100 * p.probability:.2g} %)" for n, p in enumerate(poses))
        raise GdgError(
            f"scene_pose={pose}: '{obj.name}' has the resting poses {listed}; choose one of them."
        )
    return replace(obj, scene=_scene(poses, pose))


def on_table_again(obj: ObjectModel, scene: TableScene) -> ObjectModel:
    """Another version of an object, at rest on the side that the first one rested on.

    Args:
        obj: the version of now, in the frame of the first one.
        scene: of the first one.

    Raises:
        GdgError: it rests on no side within ``SAME_POSE_RAD`` of that one.
    """
    poses = resting_poses(obj)
    cosines = [float(pose.up @ np.array(scene.table.normal)) for pose in poses]
    nearest = int(np.argmax(cosines))
    if cosines[nearest] < np.cos(SAME_POSE_RAD):
        raise GdgError(
            f"'{obj.name}': {obj.path} doesn't rest on a table as the version did that the grasps "
            f"were made with; give that version."
        )
    return replace(obj, scene=_scene(poses, nearest))


def check_protocol(protocol: Protocol, on_table: bool) -> None:
    """Whether a protocol tests grasps of an object that lies on a table, or of one that doesn't.

    Raises:
        GdgError: it lifts from a table that isn't there, or has no table where there is one.
    """
    if on_table and not protocol.needs_table:
        raise GdgError(
            f"protocol={protocol.name}: tests an object that floats in the air, but with "
            f"scene=tabletop it lies on a table; write protocol=tabletop-lift."
        )
    if protocol.needs_table and not on_table:
        raise GdgError(
            f"protocol={protocol.name}: lifts the object from a table, but there is none; write "
            f"scene=tabletop."
        )


def _scene(poses: list[RestingPose], number: int) -> TableScene:
    """The scene of a resting pose."""
    chosen = poses[number]
    x, y, z = (float(value) for value in chosen.up)
    return TableScene(Table((x, y, z), chosen.offset), number, chosen.probability)
