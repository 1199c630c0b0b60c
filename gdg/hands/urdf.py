"""Reads a URDF as untrusted data: parsed once, checked at the boundary, plain afterwards."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import defusedxml
import defusedxml.ElementTree
import numpy as np
import trimesh
import yourdfpy

from gdg.errors import GdgError, did_you_mean, raise_if_any

#: A URDF larger than this is refused unread (the largest of ours has 60 kB).
MAX_URDF_BYTES = 5_000_000
MOVING_TYPES = ("revolute", "continuous", "prismatic")
#: Range in radians given to continuous joints, which have none of their own.
CONTINUOUS_RANGE = (-math.pi, math.pi)


@dataclass(frozen=True)
class Mimic:
    """value = multiplier × value of ``joint`` + offset."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class Joint:
    """One joint of the tree.

    Attributes:
        T_parent_child: pose of the child link at joint value zero, metres.
        axis: unit vector in the child's frame.
        lower: lower limit, rad or m; NaN for fixed joints.
        upper: upper limit, rad or m.
        effort: N m or N; 0 where the URDF says none.
    """

    name: str
    type: str
    parent: str
    child: str
    T_parent_child: np.ndarray
    axis: np.ndarray
    lower: float
    upper: float
    effort: float
    mimic: Mimic | None


@dataclass(frozen=True)
class Shape:
    """A geometric primitive or mesh of a link.

    Attributes:
        kind: ``box`` (size x, y, z), ``cylinder`` (radius, length), ``sphere`` (radius) or
            ``mesh`` (scale x, y, z).
        size: see ``kind``; metres, except for a mesh's scale.
        T_link_shape: pose in the link's frame.
        mesh: the file of a mesh, as the URDF writes it.
    """

    kind: str
    size: tuple[float, ...]
    T_link_shape: np.ndarray
    mesh: str = ""


@dataclass(frozen=True)
class Link:
    """One link: its shapes and its mass in kg (0 where the URDF has no inertial)."""

    name: str
    collisions: tuple[Shape, ...]
    visuals: tuple[Shape, ...]
    mass: float


@dataclass(frozen=True)
class Urdf:
    """A kinematic tree: links by name, and joints with parents before children."""

    path: Path
    name: str
    links: dict[str, Link]
    joints: dict[str, Joint]
    root: str

    def kinematics_xml(self) -> str:
        """The bare tree as URDF text: links without shapes, all limits explicit."""
        links = [f"<link name={_quoted(name)}/>" for name in self.links]
        joints = [_joint_xml(joint) for joint in self.joints.values()]
        return "\n".join(['<robot name="hand">', *links, *joints, "</robot>"])


def read_urdf(path: Path) -> Urdf:
    """Parses and checks a URDF; says every mistake at once.

    Raises:
        GdgError: unreadable, too large, malformed or entity-carrying XML, no tree with one root,
            unsupported joint types, limits that are missing, not finite or inverted, mimic joints
            that follow nothing.
    """
    robot = _parse(path, _read_bytes(path))
    mistakes: list[str] = []
    links = {link.name: _link(link, mistakes) for link in robot.links}
    joints = {joint.name: _joint(joint, mistakes) for joint in robot.joints}
    mistakes += _duplicates("link", (link.name for link in robot.links))
    mistakes += _duplicates("joint", (joint.name for joint in robot.joints))
    mistakes += _reference_mistakes(links, joints)
    raise_if_any([f"{path}: {mistake}" for mistake in mistakes])
    root, ordered = _tree_order(path, links, joints)
    return Urdf(path, robot.name or path.stem, links, ordered, root)


def _read_bytes(path: Path) -> bytes:
    try:
        if path.stat().st_size > MAX_URDF_BYTES:
            raise GdgError(f"{path}: larger than {MAX_URDF_BYTES // 10**6} MB, no plausible URDF.")
        return path.read_bytes()
    except OSError as error:
        raise GdgError(f"{path}: cannot be read: {error.strerror or error}") from error


def _parse(path: Path, data: bytes) -> yourdfpy.Robot:
    try:
        root = defusedxml.ElementTree.fromstring(data, forbid_dtd=True)
    except defusedxml.DefusedXmlException as error:
        raise GdgError(
            f"{path}: the XML declares entities or a document type, which gdg refuses."
        ) from error
    except (defusedxml.ElementTree.ParseError, ValueError, LookupError) as error:
        raise GdgError(f"{path}: is no well-formed XML: {error}") from error
    if root.tag != "robot":
        raise GdgError(f"{path}: is no URDF: the outermost element is <{root.tag}>, not <robot>.")
    logging.getLogger("yourdfpy").setLevel(logging.ERROR)
    try:
        return yourdfpy.URDF.load(
            BytesIO(data), build_scene_graph=False, load_meshes=False, mesh_dir=""
        ).robot
    except (ValueError, TypeError, KeyError, AttributeError, IndexError) as error:
        raise GdgError(f"{path}: is no valid URDF: {' '.join(str(error).split())}") from error


def _link(link: yourdfpy.Link, mistakes: list[str]) -> Link:
    mass = float(link.inertial.mass or 0.0) if link.inertial else 0.0
    if not math.isfinite(mass) or mass < 0:
        mistakes.append(f"link '{link.name}': mass {mass} is no positive finite number.")
    return Link(
        link.name,
        tuple(_shape(link.name, "collision", c, mistakes) for c in link.collisions),
        tuple(_shape(link.name, "visual", v, mistakes) for v in link.visuals),
        mass,
    )


def _shape(link: str, role: str, element: yourdfpy.Collision, mistakes: list[str]) -> Shape:
    geometry, origin = element.geometry, _pose(element.origin)
    where = f"link '{link}': {role}:"
    if not np.isfinite(origin).all():
        mistakes.append(f"{where} its origin is not finite.")
    if geometry is not None and geometry.box is not None:
        return _sized("box", geometry.box.size, origin, where, mistakes)
    if geometry is not None and geometry.cylinder is not None:
        size = (geometry.cylinder.radius, geometry.cylinder.length)
        return _sized("cylinder", size, origin, where, mistakes)
    if geometry is not None and geometry.sphere is not None:
        return _sized("sphere", (geometry.sphere.radius,), origin, where, mistakes)
    if geometry is not None and geometry.mesh is not None and geometry.mesh.filename:
        scale = geometry.mesh.scale
        scale = (1.0, 1.0, 1.0) if scale is None else scale
        scale = (scale,) * 3 if isinstance(scale, (int, float)) else tuple(scale)
        if not np.isfinite(scale).all() or 0.0 in scale:
            mistakes.append(f"{where} mesh scale {scale} must be finite and not zero.")
        return Shape("mesh", tuple(map(float, scale)), origin, geometry.mesh.filename)
    mistakes.append(f"{where} has no box, cylinder, sphere or mesh.")
    return Shape("sphere", (0.0,), origin)


def _sized(
    kind: str, size: Iterable[float], origin: np.ndarray, where: str, mistakes: list[str]
) -> Shape:
    values = tuple(float(value) for value in size)
    if not all(math.isfinite(value) and value > 0 for value in values):
        mistakes.append(f"{where} {kind} of size {values} must be finite and positive.")
    return Shape(kind, values, origin)


def _joint(joint: yourdfpy.Joint, mistakes: list[str]) -> Joint:
    where = f"joint '{joint.name}':"
    if joint.type not in (*MOVING_TYPES, "fixed"):
        mistakes.append(f"{where} type '{joint.type}' is not supported (use {MOVING_TYPES}).")
    lower, upper, effort = _limits(joint, where, mistakes)
    axis = np.array([1.0, 0.0, 0.0]) if joint.axis is None else np.asarray(joint.axis, float)
    norm = float(np.linalg.norm(axis))
    if joint.type in MOVING_TYPES and not (math.isfinite(norm) and norm > 1e-6):
        mistakes.append(f"{where} axis {axis.tolist()} must be finite and not zero.")
        norm = 1.0
    origin = _pose(joint.origin)
    if not np.isfinite(origin).all():
        mistakes.append(f"{where} its origin is not finite.")
    mimic = None
    if joint.mimic is not None and joint.type != "fixed":
        factor = 1.0 if joint.mimic.multiplier is None else float(joint.mimic.multiplier)
        mimic = Mimic(joint.mimic.joint, factor, float(joint.mimic.offset or 0.0))
    return Joint(
        joint.name, joint.type, joint.parent, joint.child, origin, axis / (norm or 1.0),
        lower, upper, effort, mimic,
    )  # fmt: skip


def _limits(joint: yourdfpy.Joint, where: str, mistakes: list[str]) -> tuple[float, float, float]:
    if joint.type not in MOVING_TYPES:
        return math.nan, math.nan, 0.0
    limit = joint.limit
    effort = float(limit.effort or 0.0) if limit is not None else 0.0
    if joint.type == "continuous":
        return *CONTINUOUS_RANGE, effort
    if limit is None or limit.lower is None or limit.upper is None:
        mistakes.append(f"{where} a {joint.type} joint needs <limit lower=… upper=…>.")
        return 0.0, 0.0, effort
    lower, upper = float(limit.lower), float(limit.upper)
    if not (math.isfinite(lower) and math.isfinite(upper)):
        mistakes.append(f"{where} limits [{lower}, {upper}] must be finite.")
    elif lower > upper:
        mistakes.append(f"{where} lower limit {lower:g} is above the upper limit {upper:g}.")
    return lower, upper, effort


def _reference_mistakes(links: dict[str, Link], joints: dict[str, Joint]) -> Iterable[str]:
    parents: dict[str, str] = {}
    for joint in joints.values():
        for role, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                hint = did_you_mean(str(link), links)
                yield f"joint '{joint.name}': {role} link '{link}' does not exist.{hint}"
        if joint.child in parents:
            other = parents[joint.child]
            yield f"link '{joint.child}' is the child of two joints, '{other}' and '{joint.name}'."
        parents[joint.child] = joint.name
        if joint.mimic is None:
            continue
        if joint.mimic.joint not in joints:
            hint = did_you_mean(joint.mimic.joint, joints)
            yield f"joint '{joint.name}': mimics '{joint.mimic.joint}', unknown.{hint}"
        elif not (math.isfinite(joint.mimic.multiplier) and math.isfinite(joint.mimic.offset)):
            yield f"joint '{joint.name}': mimic multiplier and offset must be finite."
        elif _mimics_in_circles(joint, joints):
            yield f"joint '{joint.name}': mimics itself in a circle."


def _mimics_in_circles(joint: Joint, joints: dict[str, Joint]) -> bool:
    seen = set()
    while joint.mimic is not None and joint.mimic.joint in joints:
        if joint.name in seen:
            return True
        seen.add(joint.name)
        joint = joints[joint.mimic.joint]
    return False


def _duplicates(what: str, names: Iterable[str]) -> list[str]:
    listed = list(names)
    return [f"{what} '{n}' is defined twice." for n in sorted(set(listed)) if listed.count(n) > 1]


def _tree_order(
    path: Path, links: dict[str, Link], joints: dict[str, Joint]
) -> tuple[str, dict[str, Joint]]:
    children = {joint.child for joint in joints.values()}
    roots = [link for link in links if link not in children]
    if len(roots) != 1:
        listed = ", ".join(roots) or "none (the joints form a loop)"
        raise GdgError(f"{path}: the links must form one tree; links without a parent: {listed}.")
    ordered: dict[str, Joint] = {}
    queue = [roots[0]]
    while queue:
        link = queue.pop(0)
        for joint in joints.values():
            if joint.parent == link:
                ordered[joint.name] = joint
                queue.append(joint.child)
    if len(ordered) != len(joints):
        lost = next(name for name in joints if name not in ordered)
        raise GdgError(f"{path}: joint '{lost}' hangs on no link of the tree (a loop).")
    return roots[0], ordered


def _pose(matrix: np.ndarray | None) -> np.ndarray:
    return np.eye(4) if matrix is None else np.asarray(matrix, dtype=np.float64)


def _quoted(name: str) -> str:
    escaped = name.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
    return f'"{escaped}"'


def _joint_xml(joint: Joint) -> str:
    kind = "revolute" if joint.type == "continuous" else joint.type
    xyz = " ".join(f"{value:.12g}" for value in joint.T_parent_child[:3, 3])
    angles = trimesh.transformations.euler_from_matrix(joint.T_parent_child, "sxyz")
    rpy = " ".join(f"{value:.12g}" for value in angles)
    axis = " ".join(f"{value:.12g}" for value in joint.axis)
    limit = "" if kind == "fixed" else (
        f'<limit lower="{joint.lower}" upper="{joint.upper}" effort="0" velocity="0"/>'
    )
    return (
        f"<joint name={_quoted(joint.name)} type={_quoted(kind)}>"
        f"<parent link={_quoted(joint.parent)}/><child link={_quoted(joint.child)}/>"
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>{limit}</joint>'
    )
