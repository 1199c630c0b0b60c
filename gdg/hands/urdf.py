"""Reads a URDF as untrusted data: parsed once, checked at the boundary, plain afterwards."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from xml.etree.ElementTree import Element

import defusedxml
import defusedxml.ElementTree
import numpy as np
import trimesh

from gdg.errors import GdgError, did_you_mean, raise_if_any

#: A URDF larger than this is refused unread (the largest of ours has 60 kB).
MAX_URDF_BYTES = 5_000_000
#: More links, joints or shapes than these are no hand's (the largest of ours has 31 links).
MAX_ELEMENTS = {"link": 500, "joint": 500, "collision": 2000, "visual": 2000}
#: Longer names are no one's, and longer than YAML lets a key be.
MAX_NAME = 200
MOVING_TYPES = ("revolute", "continuous", "prismatic")
#: Attributes of the primitives, with the numbers in each.
SIZES = {
    "box": (("size", 3),),
    "cylinder": (("radius", 1), ("length", 1)),
    "sphere": (("radius", 1),),
}
#: Attributes of an inertia: the diagonal, then what is beside it.
INERTIA = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
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
        velocity: rad/s or m/s; 0 where the URDF says none.
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
    velocity: float
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
class Inertial:
    """Mass properties of a link.

    Attributes:
        mass: kg.
        T_link_center: frame of the inertia, its origin at the centre of mass, metres.
        inertia: (3, 3) about the centre of mass in that frame, kg m².
    """

    mass: float
    T_link_center: np.ndarray
    inertia: np.ndarray


@dataclass(frozen=True)
class Link:
    """One link: its shapes and its mass properties (None where the URDF has no inertial)."""

    name: str
    collisions: tuple[Shape, ...]
    visuals: tuple[Shape, ...]
    inertial: Inertial | None

    @property
    def mass(self) -> float:
        """kg; 0 where the URDF says none."""
        return self.inertial.mass if self.inertial is not None else 0.0


@dataclass(frozen=True)
class Urdf:
    """A kinematic tree: links by name, and joints with parents before children."""

    path: Path
    name: str
    links: dict[str, Link]
    joints: dict[str, Joint]
    root: str

    @cached_property
    def joint_above(self) -> dict[str, Joint]:
        """Link -> the joint that carries it; the root has none."""
        return {joint.child: joint for joint in self.joints.values()}

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
    robot = read_xml(path)
    check_robot(path, robot)
    return build_urdf(path, robot)


def build_urdf(path: Path, robot: Element) -> Urdf:
    """The tree that a ``<robot>`` element describes; see ``read_urdf``."""
    mistakes: list[str] = []
    link_list = [_link(element, mistakes) for element in robot.findall("link")]
    joint_list = [_joint(element, mistakes) for element in robot.findall("joint")]
    mistakes += _duplicates("link", (link.name for link in link_list))
    mistakes += _duplicates("joint", (joint.name for joint in joint_list))
    links, joints = {link.name: link for link in link_list}, {j.name: j for j in joint_list}
    mistakes += _reference_mistakes(links, joints)
    raise_if_any([f"{path}: {mistake}" for mistake in mistakes])
    root, ordered = _tree_order(path, links, joints)
    return Urdf(path, robot.get("name") or path.stem, links, ordered, root)


def read_xml(path: Path) -> Element:
    """The outermost element of an XML file that is a plausible robot description.

    Raises:
        GdgError: unreadable, too large, malformed, or with entities or a document type.
    """
    return parse_xml(path, read_limited(path))


def read_limited(path: Path) -> bytes:
    """A file's bytes; a ``GdgError`` where it can't be read or is too large for a description."""
    try:
        if path.exists() and not path.is_file():  # a pipe or device may never end
            raise GdgError(f"{path}: is no file.")
        if path.stat().st_size > MAX_URDF_BYTES:
            raise GdgError(f"{path}: larger than {MAX_URDF_BYTES // 10**6} MB, no plausible URDF.")
        return path.read_bytes()
    except OSError as error:
        raise GdgError(f"{path}: cannot be read: {error.strerror or error}") from error


def parse_xml(path: Path, data: bytes) -> Element:
    """The outermost element of an XML document; see ``read_xml``."""
    try:
        return defusedxml.ElementTree.fromstring(data, forbid_dtd=True)
    except defusedxml.DefusedXmlException as error:
        raise GdgError(
            f"{path}: the XML declares entities or a document type, which gdg refuses."
        ) from error
    except (defusedxml.ElementTree.ParseError, ValueError, LookupError) as error:
        raise GdgError(f"{path}: is no well-formed XML: {error}.") from error


def check_robot(path: Path, root: Element) -> None:
    """Raises a ``GdgError`` unless an XML document is a URDF of plausible size."""
    if root.tag != "robot":
        raise GdgError(f"{path}: is no URDF: the outermost element is <{root.tag}>, not <robot>.")
    counts = Counter(element.tag for element in root.iter())
    if any("xacro" in tag for tag in counts):
        raise GdgError(
            f"{path}: is a xacro template, not a URDF. Expand it first: xacro FILE > hand.urdf"
        )
    for tag, most in MAX_ELEMENTS.items():
        if counts[tag] > most:
            raise GdgError(f"{path}: {counts[tag]} <{tag}> elements, no plausible hand.")


# -- elements: each reader appends its complaints and goes on ---------------------------------


def _link(element: Element, mistakes: list[str]) -> Link:
    name = _name(element, mistakes)
    where = f"link '{name}'"
    return Link(
        name,
        tuple(_shape(e, f"{where}: collision", mistakes) for e in element.findall("collision")),
        tuple(_shape(e, f"{where}: visual", mistakes) for e in element.findall("visual")),
        _inertial(element.find("inertial"), where, mistakes),
    )


def _inertial(element: Element | None, where: str, mistakes: list[str]) -> Inertial | None:
    if element is None:
        return None
    (mass,) = _numbers(element.find("mass"), "value", (0.0,), where, mistakes)
    if mass < 0:
        mistakes.append(f"{where}: mass {mass:g} is negative.")
    inertia, given = np.zeros((3, 3)), element.find("inertia")
    for (row, column), name in zip(((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)), INERTIA):
        (value,) = _numbers(given, name, (0.0,), where, mistakes)
        inertia[row, column] = inertia[column, row] = value
    return Inertial(mass, _origin(element, where, mistakes), inertia)


def _shape(element: Element, where: str, mistakes: list[str]) -> Shape:
    origin = _origin(element, where, mistakes)
    for child in element.findall("geometry/*"):
        if child.tag == "mesh":
            return _mesh(child, origin, where, mistakes)
        if child.tag in SIZES:
            size: tuple[float, ...] = ()
            for attribute, count in SIZES[child.tag]:
                size += _numbers(child, attribute, None, where, mistakes, count)
            if min(size) <= 0:
                mistakes.append(f"{where}: a {child.tag} of size {size} must be positive.")
            return Shape(child.tag, size, origin)
    mistakes.append(f"{where}: has no box, cylinder, sphere or mesh.")
    return Shape("sphere", (0.0,), origin)


def _mesh(element: Element, origin: np.ndarray, where: str, mistakes: list[str]) -> Shape:
    filename = element.get("filename", "")
    if not filename:
        mistakes.append(f'{where}: a mesh needs filename="…".')
    single = len(element.get("scale", "").split()) == 1
    default, count = ((1.0,), 1) if single else ((1.0, 1.0, 1.0), 3)
    scale = _numbers(element, "scale", default, where, mistakes, count)
    if 0.0 in scale:
        mistakes.append(f"{where}: mesh scale {scale} must not be zero.")
    return Shape("mesh", scale * 3 if single else scale, origin, filename)


def _joint(element: Element, mistakes: list[str]) -> Joint:
    name, kind = _name(element, mistakes), element.get("type", "")
    where = f"joint '{name}'"
    if kind not in (*MOVING_TYPES, "fixed"):
        known = ", ".join((*MOVING_TYPES, "fixed"))
        mistakes.append(f"{where}: type '{kind}' is not supported (use one of {known}).")
    lower, upper, effort = _limits(element, kind, where, mistakes)
    axis = np.array(_numbers(element.find("axis"), "xyz", (1.0, 0.0, 0.0), where, mistakes, 3))
    norm = float(np.linalg.norm(axis))
    if kind in MOVING_TYPES and norm <= 1e-6:
        mistakes.append(f"{where}: its axis must not be zero.")
    return Joint(
        name=name,
        type=kind,
        parent=_end(element, "parent", where, mistakes),
        child=_end(element, "child", where, mistakes),
        T_parent_child=_origin(element, where, mistakes),
        axis=axis / (norm or 1.0),
        lower=lower,
        upper=upper,
        effort=effort,
        velocity=_velocity(element.find("limit"), kind),
        mimic=_mimic(element, kind, where, mistakes),
    )


def _mimic(element: Element, kind: str, where: str, mistakes: list[str]) -> Mimic | None:
    mimic = element.find("mimic")
    if mimic is None or kind == "fixed":
        return None
    (multiplier,) = _numbers(mimic, "multiplier", (1.0,), where, mistakes)
    (offset,) = _numbers(mimic, "offset", (0.0,), where, mistakes)
    return Mimic(mimic.get("joint", ""), multiplier, offset)


def _limits(
    element: Element, kind: str, where: str, mistakes: list[str]
) -> tuple[float, float, float]:
    if kind not in MOVING_TYPES:
        return math.nan, math.nan, 0.0
    limit = element.find("limit")
    (effort,) = _numbers(limit, "effort", (0.0,), where, mistakes)
    if effort < 0:
        mistakes.append(f"{where}: effort {effort:g} is negative.")
    if kind == "continuous":
        return *CONTINUOUS_RANGE, effort
    if limit is None or limit.get("lower") is None or limit.get("upper") is None:
        mistakes.append(f"{where}: a {kind} joint needs <limit lower=… upper=…>.")
        return 0.0, 0.0, effort
    (lower,) = _numbers(limit, "lower", None, where, mistakes)
    (upper,) = _numbers(limit, "upper", None, where, mistakes)
    if lower > upper:
        mistakes.append(f"{where}: lower limit {lower:g} is above the upper limit {upper:g}.")
    return lower, upper, effort


def _velocity(limit: Element | None, kind: str) -> float:
    """Never an error: nothing depends on it, and exporters write "inf" or nothing."""
    if kind not in MOVING_TYPES or limit is None:
        return 0.0
    try:
        value = abs(float(limit.get("velocity", "0")))
    except ValueError:
        return 0.0
    return value if math.isfinite(value) else 0.0


def _name(element: Element, mistakes: list[str]) -> str:
    name = element.get("name", "")
    if not name.strip() or not name.isprintable():
        mistakes.append(f"a {element.tag} has no name, or one that can't be printed: {name!r}.")
    elif len(name) > MAX_NAME:
        mistakes.append(f"a {element.tag} has a name of over {MAX_NAME} letters: '{name[:40]}…'.")
    return name


def _end(element: Element, role: str, where: str, mistakes: list[str]) -> str:
    end = element.find(role)
    link = end.get("link", "") if end is not None else ""
    if not link:
        mistakes.append(f"{where}: has no <{role} link=…>.")
    return link


def _origin(element: Element, where: str, mistakes: list[str]) -> np.ndarray:
    """The pose that an element's ``<origin>`` gives; the identity where there is none."""
    origin, zero = element.find("origin"), (0.0, 0.0, 0.0)
    roll, pitch, yaw = _numbers(origin, "rpy", zero, where, mistakes, 3)
    pose = trimesh.transformations.euler_matrix(roll, pitch, yaw, "sxyz")
    pose[:3, 3] = _numbers(origin, "xyz", zero, where, mistakes, 3)
    return pose


def _numbers(
    element: Element | None,
    attribute: str,
    default: tuple[float, ...] | None,
    where: str,
    mistakes: list[str],
    count: int = 1,
) -> tuple[float, ...]:
    """``count`` finite numbers from an attribute, or the default (None: it must be given)."""
    text = None if element is None else element.get(attribute)
    if element is None or (text is None and default is not None):
        return default or (1.0,) * count
    try:
        values = tuple(float(word) for word in (text or "").replace(",", " ").split())
    except ValueError:
        values = ()
    if len(values) == count and all(map(math.isfinite, values)):
        return values
    wanted = "a finite number" if count == 1 else f"{count} finite numbers"
    given = "nothing" if text is None else f"'{text[:60]}'"
    mistakes.append(f"{where}: <{element.tag}> needs {attribute}=… with {wanted}, not {given}.")
    return default or (1.0,) * count


# -- the tree -------------------------------------------------------------------------------


def _reference_mistakes(links: dict[str, Link], joints: dict[str, Joint]) -> Iterable[str]:
    parents: dict[str, str] = {}
    for joint in joints.values():
        for role, link in (("parent", joint.parent), ("child", joint.child)):
            if link and link not in links:
                hint = did_you_mean(link, links)
                yield f"joint '{joint.name}': {role} link '{link}' does not exist.{hint}"
        if joint.child in parents:
            other = parents[joint.child]
            yield f"link '{joint.child}' is the child of two joints, '{other}' and '{joint.name}'."
        parents[joint.child] = joint.name
        if joint.mimic is not None:
            yield from _mimic_mistakes(joint, joint.mimic.joint, joints)


def _mimic_mistakes(joint: Joint, master: str, joints: dict[str, Joint]) -> Iterable[str]:
    if master not in joints:
        hint = did_you_mean(master, joints)
        yield f"joint '{joint.name}': mimics '{master}', which does not exist.{hint}"
    elif joints[master].type not in MOVING_TYPES:
        yield f"joint '{joint.name}': mimics '{master}', which does not move."
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
    counts = Counter(names)
    return [f"{what} '{name}' is defined twice." for name, count in counts.items() if count > 1]


def _tree_order(
    path: Path, links: dict[str, Link], joints: dict[str, Joint]
) -> tuple[str, dict[str, Joint]]:
    if not links:
        raise GdgError(f"{path}: has no <link>.")
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


def _quoted(name: str) -> str:
    escaped = name.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
    return f'"{escaped}"'


def _joint_xml(joint: Joint) -> str:
    kind = "revolute" if joint.type == "continuous" else joint.type
    xyz = " ".join(f"{value:.12g}" for value in joint.T_parent_child[:3, 3])
    angles = trimesh.transformations.euler_from_matrix(joint.T_parent_child, "sxyz")
    rpy = " ".join(f"{value:.12g}" for value in angles)
    axis = " ".join(f"{value:.12g}" for value in joint.axis)
    limit = ""
    if kind != "fixed":
        limit = f'<limit lower="{joint.lower}" upper="{joint.upper}" effort="0" velocity="0"/>'
    return (
        f"<joint name={_quoted(joint.name)} type={_quoted(kind)}>"
        f"<parent link={_quoted(joint.parent)}/><child link={_quoted(joint.child)}/>"
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>{limit}</joint>'
    )
