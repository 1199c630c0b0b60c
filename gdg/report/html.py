"""The interactive report: one HTML file that shows grasps in 3-D and needs no network."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import math
import re
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from gdg.data.atomic import write_text_atomically
from gdg.data.grasps import GraspSet
from gdg.data.verdict import DIRECTIONS, left_out_of
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.report.meshes import PictureMesh
from gdg.report.palette import CONTACT_SCALE, HAND, OBJECT_PLAIN, TOUCHING
from gdg.report.scene import Scene, build_scene
from gdg.report.table import summary_line

#: Triangles in the file; with 32 grasps it stays under 3 MB.
MAX_OBJECT_FACES, MAX_HAND_FACES = 8_000, 24_000
#: Name of each array type in the payload, read by ``viewer_draw.js``; all little-endian.
ARRAY_TYPES = {"<f4": "f32", "<i2": "i16", "|i1": "i8", "|u1": "u8", "<u2": "u16", "<u4": "u32"}
GRASPS_PAGE = ("viewer_draw.js", "viewer_page.js", "viewer_grasps.js")
#: The view of the object when there is no grasp.
PLAIN_EYES = np.array([[0.8, 0.35, 0.49], [-0.35, 0.8, 0.49]])


def html_report(
    hand: HandModel,
    obj: ObjectModel,
    grasps: GraspSet,
    path: Path,
    config_text: str = "",
    title: str = "",
    scene: Scene | None = None,
) -> None:
    """Writes a self-contained HTML page with a 3-D viewer of all grasps, atomically.

    The page loads nothing and its content-security policy forbids it to; all names and texts are
    shown as plain text, whatever they hold. Without grasps it shows the object alone.

    Args:
        hand: the hand that the grasps belong to.
        obj: the object, with the points that the contact maps lie on.
        grasps: what to show.
        path: the HTML file.
        config_text: the run's configuration, shown as it is.
        title: the page's title; by default the names of hand and object.
        scene: ``report_scene`` of these grasps, if it is there.

    Raises:
        GdgError: the grasps belong to another hand, or their contact maps to another object.
    """
    scene = scene or report_scene(hand, obj, grasps)
    payload = report_payload(hand, obj, grasps, scene, config_text, title)
    write_text_atomically(path, render_page(payload, GRASPS_PAGE))


def report_scene(hand: HandModel, obj: ObjectModel, grasps: GraspSet) -> Scene:
    """What the page shows in 3-D, whatever became of the grasps; see ``html_report``."""
    return build_scene(hand, obj, grasps, MAX_OBJECT_FACES, MAX_HAND_FACES)


def report_payload(
    hand: HandModel,
    obj: ObjectModel,
    grasps: GraspSet,
    scene: Scene,
    config_text: str,
    title: str,
) -> dict[str, Any]:
    """What the page shows, as plain values and packed arrays (see ``packed``)."""
    vertices = scene.object_mesh.vertices
    return {
        "title": title or f"{grasps.hand} · {grasps.object_name}",
        "summary": " · ".join([summary_line(grasps), *left_out_of(grasps.verdicts)]),
        "hand": grasps.hand,
        "object": grasps.object_name,
        "directions": list(DIRECTIONS),
        "contact_scale": [list(color) for color in CONTACT_SCALE],
        "colors": {"hand": HAND, "object": OBJECT_PLAIN, "touching": TOUCHING},
        "floor": float(vertices[:, 2].min()),
        "table": obj.table is not None,
        "view": view_of(PLAIN_EYES, vertices),
        "joints": _joints(hand),
        "object_mesh": packed_mesh(scene.object_mesh),
        "link_meshes": [packed_mesh(mesh) for mesh in scene.link_meshes.values()],
        "grasps": [_grasp(scene, grasps, index) for index in range(len(grasps))],
        "config_text": config_text,
        "provenance_text": _pretty(grasps.provenance) if grasps.provenance else "",
    }


def render_page(payload: dict[str, Any], scripts: Sequence[str]) -> str:
    """The page that scripts make of a payload, which can't end its script element."""
    files = resources.files("gdg.report")
    script = "".join(files.joinpath(name).read_text(encoding="utf-8") for name in scripts)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    parts = {
        "title": html.escape(payload["title"]),
        "script_hash": f"sha256-{digest}",
        "script": script,
        "payload": script_safe_json(payload),
    }
    template = files.joinpath("viewer.html").read_text(encoding="utf-8")
    # in one pass: a title that reads {{payload}} stays a title
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], template)


def script_safe_json(tree: Any) -> str:
    """JSON that can stand in a script element; numbers that are not finite become null."""
    text = json.dumps(_finite(tree), allow_nan=False, separators=(",", ":"))
    return text.replace("&", r"\u0026").replace("<", r"\u003c").replace(">", r"\u003e")


def packed(values: np.ndarray) -> dict[str, str]:
    """An array as its type's name and the base64 of its bytes, row by row."""
    data = np.ascontiguousarray(values)
    encoded = base64.b64encode(data.tobytes()).decode("ascii")
    return {"type": ARRAY_TYPES[data.dtype.newbyteorder("<").str], "data": encoded}


def packed_mesh(mesh: PictureMesh) -> dict[str, Any]:
    """A mesh for the viewer.

    Positions are 16-bit shares of ``spread`` around ``origin`` (2 µm steps), normals 8-bit.
    """
    low, high = mesh.vertices.min(0), mesh.vertices.max(0)
    origin, spread = (low + high) / 2, max(float((high - low).max()) / 2, 1e-6)
    positions = np.rint((mesh.vertices - origin) / spread * 32767).astype(np.int16)
    small = len(mesh.vertices) <= np.iinfo(np.uint16).max
    return {
        "origin": [float(value) for value in origin],
        "spread": spread,
        "vertex_count": len(mesh.vertices),
        "positions": packed(positions),
        "normals": packed(np.rint(mesh.normals * 127).astype(np.int8)),
        "faces": packed(mesh.faces.astype(np.uint16 if small else np.uint32)),
    }


def _grasp(scene: Scene, grasps: GraspSet, index: int) -> dict[str, Any]:
    poses = scene.Ts_object_link[index, list(scene.link_meshes)]
    values = None if scene.values is None else np.clip(scene.values[index], 0.0, 1.0)
    return {
        "index": index,
        "status": grasps.status[index] if grasps.status else "",
        "verdict": grasps.verdicts[index].as_dict() if grasps.verdicts else None,
        "energies": {name: float(values[index]) for name, values in grasps.energies.items()},
        "joints": [float(value) for value in grasps.joints[index]],
        # column-major, as WebGL takes them
        "link_poses": packed(poses.transpose(0, 2, 1).astype(np.float32)),
        "contact_values": None
        if values is None
        else packed(np.rint(values * 255).astype(np.uint8)),
        "touching": packed(scene.touching[index].astype(np.float32)),
        "view": view_of(scene.eyes[index], scene.frames[index]),
    }


def view_of(eyes: np.ndarray, shown: np.ndarray) -> dict[str, Any]:
    """Directions to look from, (n, 3), with the sphere around the points to be shown."""
    center = (shown.min(0) + shown.max(0)) / 2
    return {
        "eyes": [[float(value) for value in eye] for eye in eyes],
        "center": [float(value) for value in center],
        "radius": float(np.linalg.norm(shown - center, axis=-1).max()),
    }


def _joints(hand: HandModel) -> list[dict[str, Any]]:
    listed = []
    for name, lower, upper in zip(hand.joint_names, hand.lower, hand.upper, strict=True):
        prismatic = hand.hand.urdf.joints[name].type == "prismatic"
        unit = "m" if prismatic else "rad"
        listed.append({"name": name, "unit": unit, "lower": float(lower), "upper": float(upper)})
    return listed


def _pretty(provenance: dict[str, Any]) -> str:
    return json.dumps(provenance, indent=1, default=str, ensure_ascii=False)


def _finite(tree: Any) -> Any:
    if isinstance(tree, dict):
        return {str(key): _finite(value) for key, value in tree.items()}
    if isinstance(tree, list | tuple):
        return [_finite(value) for value in tree]
    return None if isinstance(tree, float) and not math.isfinite(tree) else tree
