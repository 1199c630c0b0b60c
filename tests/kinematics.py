"""Forward kinematics of a parsed URDF, written for tests as plainly as can be."""

from __future__ import annotations

import numpy as np
import trimesh

from gdg.hands.urdf import Urdf


def link_poses(urdf: Urdf, values: dict[str, float]) -> dict[str, np.ndarray]:
    """Link -> ``T_root_link`` at joint values; joints left out are at zero."""
    poses = {urdf.root: np.eye(4)}
    for joint in urdf.joints.values():
        value = values.get(joint.name, 0.0)
        motion = np.eye(4)
        if joint.type == "prismatic":
            motion[:3, 3] = value * joint.axis
        elif joint.type != "fixed":
            motion = trimesh.transformations.rotation_matrix(value, joint.axis)
        poses[joint.child] = poses[joint.parent] @ joint.T_parent_child @ motion
    return poses
