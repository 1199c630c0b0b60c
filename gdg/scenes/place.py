"""Puts an object into a scene."""

from __future__ import annotations

from dataclasses import replace

from gdg.data.scene import TableScene
from gdg.data.table import Table
from gdg.errors import GdgError
from gdg.objects.model import ObjectModel
from gdg.protocols import Protocol
from gdg.scenes.resting import resting_poses


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
    chosen = poses[pose]
    x, y, z = (float(value) for value in chosen.up)
    table = Table((x, y, z), chosen.offset)
    return replace(obj, scene=TableScene(table, pose, chosen.probability))


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
