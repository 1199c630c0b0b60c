"""What a picture of grasps shows: meshes, link poses, contact values and good views."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import KDTree

from gdg.data.grasps import GraspSet
from gdg.errors import GdgError
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.report.markers import table_mesh
from gdg.report.meshes import PictureMesh, hand_meshes, object_mesh, vertex_values
from gdg.report.views import (
    ABOVE_TABLE_DEG,
    ELEVATIONS_DEG,
    Points,
    best_views,
    frame_points,
)

#: Hand points this near the object's surface are drawn as touching it, metres.
TOUCH_M = 0.002
#: Scale over which closeness to the hand fades where there is no contact map, metres.
CLOSENESS_M = 0.01


@dataclass(frozen=True)
class Scene:
    """Grasps ready to be drawn, in the object's frame; on a table in the table's, whose z is up.

    Attributes:
        object_mesh: the object.
        link_meshes: link index -> mesh in the link's frame.
        Ts_object_link: (grasp, link, 4, 4) float32, metres; T_table_link on a table.
        values: (grasp, vertex) contact values in [0, 1] at the object mesh's vertices, or None.
        touching: per grasp (n, 3): where the hand's surface is within 2 mm of the object's, or
            inside of it; metres.
        eyes: (grasp, 2, 3) unit vectors towards the eyes of two views, the better one first.
        frames: per grasp (n, 3): points that a picture has to show, metres.
        table: the table top, or None.
    """

    object_mesh: PictureMesh
    link_meshes: dict[int, PictureMesh]
    Ts_object_link: np.ndarray
    values: np.ndarray | None
    touching: tuple[np.ndarray, ...]
    eyes: np.ndarray
    frames: tuple[np.ndarray, ...]
    table: PictureMesh | None = None


def build_scene(
    hand: HandModel,
    obj: ObjectModel,
    grasps: GraspSet,
    max_object_faces: int,
    max_hand_faces: int,
) -> Scene:
    """The scene of all grasps of a set.

    Raises:
        GdgError: the grasps belong to another hand, or their contact maps to another object.
    """
    _check_match(hand, obj, grasps)
    q = hand.q_of(grasps)
    with torch.no_grad():
        Ts_object_link = hand.link_poses(q)
        surface = hand.place_surface(Ts_object_link)
        normals = hand.turn(Ts_object_link, hand.surface.normals, hand.surface.link_index)
        gaps = _gaps(obj, surface)
        palm_normals = hand.palm(q)[1]
    T = np.eye(4) if obj.scene is None else obj.scene.T_table_object
    R, t = T[:3, :3].T.astype(np.float32), T[:3, 3].astype(np.float32)
    mesh = object_mesh(obj.mesh, max_object_faces)
    mesh = PictureMesh(mesh.vertices @ R + t, mesh.normals @ R, mesh.faces)
    thing = Points(_array(obj.points) @ R + t, _array(obj.normals) @ R)
    hands = [
        Points(p @ R + t, n @ R) for p, n in zip(_array(surface), _array(normals), strict=True)
    ]
    values = grasps.contact_values
    eyes = [
        best_views(
            thing,
            posed,
            _closeness(thing, posed) if values is None else _array(values[index]),
            _array(palm_normals[index]) @ R,
            ELEVATIONS_DEG if obj.table is None else ABOVE_TABLE_DEG,
        )
        for index, posed in enumerate(hands)
    ]
    return Scene(
        object_mesh=mesh,
        link_meshes=hand_meshes(hand.hand, max_hand_faces),
        Ts_object_link=T.astype(np.float32) @ _array(Ts_object_link),
        values=None
        if values is None
        else vertex_values(mesh, thing.positions, thing.normals, _array(values)),
        touching=tuple(
            posed.positions[gap < TOUCH_M] for posed, gap in zip(hands, gaps, strict=True)
        ),
        eyes=np.array(eyes).reshape(-1, 2, 3),
        frames=tuple(frame_points(thing, posed) for posed in hands),
        table=None if obj.table is None else table_mesh(mesh.vertices.min(0), mesh.vertices.max(0)),
    )


def _check_match(hand: HandModel, obj: ObjectModel, grasps: GraspSet) -> None:
    if grasps.joint_names != tuple(hand.joint_names):
        raise GdgError(
            f"these grasps are of the hand '{grasps.hand}' with the joints "
            f"{', '.join(grasps.joint_names)}; '{hand.hand.name}' has "
            f"{', '.join(hand.joint_names)}. Draw them with the hand they were made for."
        )
    values = grasps.contact_values
    if values is not None and values.shape[1] != len(obj.points):
        raise GdgError(
            f"the contact maps have {values.shape[1]} values, '{obj.name}' has "
            f"{len(obj.points)} points: they belong to another object."
        )


def _gaps(obj: ObjectModel, surface: torch.Tensor) -> list[np.ndarray]:
    """Signed distance to the object of each grasp's hand points, metres."""
    sdf = obj.sdf
    return [_array(sdf.distance(points.to(sdf.values.device))) for points in surface]


def _closeness(thing: Points, hand: Points) -> np.ndarray:
    distance, _ = KDTree(hand.positions).query(thing.positions)
    return np.exp(-distance / CLOSENESS_M)


def _array(values: torch.Tensor) -> np.ndarray:
    return values.detach().cpu().numpy()
