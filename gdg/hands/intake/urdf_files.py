"""Reads a foreign URDF: mends what loaders elsewhere let pass, then reads it strictly."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import trimesh

from gdg.errors import GdgError, did_you_mean
from gdg.hands.intake.description import named
from gdg.hands.urdf import CONTINUOUS_RANGE, INERTIA, SIZES, Joint, Urdf, build_urdf, check_robot

#: Joints that are no part of a hand where they hold its root: they place it in the world.
MOUNT_TYPES = ("floating", "planar")
#: A revolute joint with a limit beyond this, rad, has it in degrees, or turns freely ...
MAX_TURN_RAD = 4 * math.pi
#: ... which it does beyond this many degrees.
MAX_TURN_DEG = 360.0


#: Prefixes of elements and attributes, and those that are declared.
PREFIX = re.compile(rb"(?:</?|\s)([A-Za-z_][\w.-]*):[A-Za-z_]")
DECLARED = re.compile(rb"xmlns:([\w.-]+)")
ROBOT = re.compile(rb"<(?:robot|mujoco)\b")


def declare_prefixes(data: bytes) -> bytes:
    """An XML document with a declaration for each prefix that it uses without one.

    Descriptions with extensions (``drake:``) lack it and are no XML then, but most loaders don't
    mind.
    """
    missing = set(PREFIX.findall(data)) - set(DECLARED.findall(data)) - {b"xml", b"xmlns"}
    names = b"".join(b' xmlns:%s="%s"' % (name, name) for name in sorted(missing))
    return ROBOT.sub(lambda match: match.group() + names, data, count=1)


def urdf_from_xml(
    path: Path, robot: Element, root: str | None, repairs: list[str]
) -> tuple[Urdf, tuple[str, ...] | None]:
    """The tree that a foreign URDF describes, and the joints that it says are driven.

    Args:
        path: the file, for messages.
        robot: its outermost element; changed in place.
        root: keep only this link and what hangs on it.
        repairs: one sentence per repair is added.

    Raises:
        GdgError: what ``read_urdf`` refuses and no repair is known for.
    """
    check_robot(path, robot)
    if root is not None:
        _keep_subtree(path, robot, root, repairs)
    _drop_mounts(robot, repairs)
    _check_roots(path, robot, repairs)
    for link in robot.findall("link"):
        _mend_shapes(link, repairs)
        _mend_inertial(link)
    _mend_joints(path, robot, repairs)
    urdf = _without_stiff_joints(build_urdf(path, robot), repairs)
    return urdf, _actuated(robot, urdf)


# -- the tree ---------------------------------------------------------------------------------


def _end(joint: Element, role: str) -> str:
    element = joint.find(role)
    return element.get("link", "") if element is not None else ""


def _keep_subtree(path: Path, robot: Element, root: str, repairs: list[str]) -> None:
    names = [link.get("name", "") for link in robot.findall("link")]
    if root not in names:
        raise GdgError(f"{path}: there is no link '{root}'.{did_you_mean(root, names)}")
    kept, grown = {root}, True
    while grown:
        children = {_end(j, "child") for j in robot.findall("joint") if _end(j, "parent") in kept}
        grown = not children <= kept
        kept |= children
    joints = {j.get("name", "") for j in robot.findall("joint")}
    _remove(robot, "link", lambda link: link.get("name", "") not in kept)
    _remove(robot, "joint", lambda j: _end(j, "parent") not in kept or _end(j, "child") == root)
    lost = len(names) - len(robot.findall("link"))
    if lost:
        others = f"{lost} other links were" if lost > 1 else "one other link was"
        repairs.append(f"Kept link '{root}' and what hangs on it; {others} cut off.")
    left = {j.get("name", "") for j in robot.findall("joint")}
    for joint in robot.findall("joint"):
        mimic = joint.find("mimic")
        if mimic is not None and mimic.get("joint", "") in joints - left:
            joint.remove(mimic)
            repairs.append(
                f"Joint '{joint.get('name')}' followed joint '{mimic.get('joint')}', which was "
                "cut off; it now moves by itself."
            )


def _remove(parent: Element, tag: str, unwanted: Callable[[Element], bool]) -> None:
    for element in parent.findall(tag):
        if unwanted(element):
            parent.remove(element)


def _roots(robot: Element) -> list[str]:
    children = {_end(joint, "child") for joint in robot.findall("joint")}
    names = dict.fromkeys(link.get("name", "") for link in robot.findall("link"))
    return [name for name in names if name not in children]


def _drop_mounts(robot: Element, repairs: list[str]) -> None:
    """Drops floating and planar joints that hang the hand on a bare root, with that root."""
    while True:
        by_parent = [j for j in robot.findall("joint") if _end(j, "parent") in _roots(robot)]
        mounts = [j for j in by_parent if j.get("type") in MOUNT_TYPES]
        if not mounts or len(by_parent) != 1:
            return
        (mount,) = mounts
        parent = _end(mount, "parent")
        robot.remove(mount)
        robot.remove(next(e for e in robot.findall("link") if e.get("name", "") == parent))
        repairs.append(
            f"Dropped the {mount.get('type')} joint '{mount.get('name')}' with link '{parent}': it "
            "places the hand in the world."
        )


def _check_roots(path: Path, robot: Element, repairs: list[str]) -> None:
    """Drops bare links that hang on nothing; refuses a description of several trees."""
    roots = _roots(robot)
    if len(roots) <= 1:
        return
    parents = {_end(joint, "parent") for joint in robot.findall("joint")}
    names = [link.get("name", "") for link in robot.findall("link")]
    bare = [
        link
        for link in robot.findall("link")
        if (name := link.get("name", "")) in roots
        and names.count(name) == 1
        and name not in parents
        and link.find("visual") is None
        and link.find("collision") is None
    ]
    if bare and len(bare) < len(roots):
        for link in bare:
            robot.remove(link)
        dropped = [link.get("name", "") for link in bare]
        repairs.append(f"{named(dropped)}: without shapes, hanging on nothing; dropped.")
    roots = _roots(robot)
    if len(roots) > 1:
        raise GdgError(
            f"{path}: the links form {len(roots)} trees, with the roots {', '.join(roots[:8])}; "
            "choose one with --root LINK."
        )


# -- links ------------------------------------------------------------------------------------


def _mend_shapes(link: Element, repairs: list[str]) -> None:
    name = link.get("name", "")
    for shape in [*link.findall("collision"), *link.findall("visual")]:
        geometry = shape.find("geometry")
        given = None if geometry is None else next(iter(geometry), None)
        if given is not None and given.tag == "capsule":
            _replace_capsule(link, shape, given)
            repairs.append(f"{named([name])}: a capsule became a cylinder and two spheres.")
        elif given is None or given.tag not in (*SIZES, "mesh"):
            kind = "empty" if given is None else given.tag
            link.remove(shape)
            repairs.append(f"Dropped a {shape.tag} shape of link '{name}': its geometry is {kind}.")
        elif given.tag in SIZES and _has_no_size(given):
            link.remove(shape)
            repairs.append(f"Dropped a {shape.tag} {given.tag} of link '{name}': its size is zero.")


def _has_no_size(primitive: Element) -> bool:
    sizes = [primitive.get(attribute, "") for attribute, _ in SIZES[primitive.tag]]
    return any(_float(word) == 0.0 for size in sizes for word in size.replace(",", " ").split())


def _replace_capsule(link: Element, shape: Element, capsule: Element) -> None:
    """A cylinder in place of a capsule and a sphere at each end of it, same pose."""
    radius, length = capsule.get("radius", ""), capsule.get("length", "")
    geometry = shape.find("geometry")
    assert geometry is not None
    geometry.remove(capsule)
    if _float(length) == 0.0:
        SubElement(geometry, "sphere", radius=radius)
        return
    SubElement(geometry, "cylinder", radius=radius, length=length)
    origin = shape.find("origin")
    roll, pitch, yaw = _vector(origin, "rpy")
    axis = trimesh.transformations.euler_matrix(roll, pitch, yaw, "sxyz")[:3, 2]
    for end in (-0.5, 0.5):
        center = _vector(origin, "xyz") + end * _finite(length) * axis
        ball = SubElement(link, shape.tag)
        SubElement(ball, "origin", xyz=" ".join(f"{value:.12g}" for value in center))
        SubElement(SubElement(ball, "geometry"), "sphere", radius=radius)


def _vector(element: Element | None, attribute: str) -> np.ndarray:
    words = ("" if element is None else element.get(attribute, "")).replace(",", " ").split()
    return np.array([*map(_finite, words[:3]), 0.0, 0.0, 0.0][:3])


def _mend_inertial(link: Element) -> None:
    """Removes what is no number; the check of mass properties then computes it."""
    inertial = link.find("inertial")
    if inertial is None:
        return
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    if mass is not None and not _is_finite(mass.get("value", ""), least=0.0):
        link.remove(inertial)
    elif inertia is not None and not all(_is_finite(inertia.get(n, "0")) for n in INERTIA):
        inertial.remove(inertia)


def _is_finite(text: str, least: float = -math.inf) -> bool:
    value = _float(text)
    return value is not None and math.isfinite(value) and value >= least


# -- joints -----------------------------------------------------------------------------------


def _mend_joints(path: Path, robot: Element, repairs: list[str]) -> None:
    joints = {joint.get("name", ""): joint for joint in robot.findall("joint")}
    free: list[str] = []
    for name, joint in joints.items():
        kind, parent = joint.get("type", ""), _end(joint, "parent")
        if kind in MOUNT_TYPES:
            raise GdgError(
                f"{path}: joint '{name}' is {kind} and inside the tree: gdg moves hands by "
                "revolute, continuous and prismatic joints. If what lies below link "
                f"'{_end(joint, 'child')}' is the hand, give --root {_end(joint, 'child')}; "
                f"otherwise remove the joint (its parent is '{parent}')."
            )
        if kind in ("revolute", "prismatic"):
            _mend_limits(name, joint, joints, free, repairs)
        limit = joint.find("limit")
        if limit is not None:
            _mend_effort(limit)
    if free:
        repairs.append(f"{named(free, 'joint')}: no limits; taken as turning freely, -pi to pi.")


def _mend_effort(limit: Element) -> None:
    """An effort that is no number, or infinite, says nothing."""
    effort = _float(limit.get("effort", "0"))
    limit.set("effort", str(abs(effort)) if effort is not None and math.isfinite(effort) else "0")


def _mend_limits(
    name: str, joint: Element, joints: dict[str, Element], free: list[str], repairs: list[str]
) -> None:
    limit = joint.find("limit")
    if limit is None:
        limit = SubElement(joint, "limit")
    lower, upper = (_float(limit.get(side, "")) for side in ("lower", "upper"))
    bare = limit.get("lower") is None and limit.get("upper") is None
    if bare or (lower is not None and lower == upper):
        followed = _followed_range(joint, joints)
        if followed is not None:
            _set_limits(limit, *followed)
            repairs.append(
                f"Joint '{name}': no limits; got those of the joint that it follows, carried over."
            )
            return
    if bare:
        if joint.get("type") == "revolute":
            joint.set("type", "continuous")
            free.append(name)
        return
    if lower is None and limit.get("lower") is None:  # the URDF format's default
        lower = 0.0
    if upper is None and limit.get("upper") is None:
        upper = 0.0
    if lower is None or upper is None:
        return  # no numbers: the strict reader says so
    if lower > upper:
        lower, upper = upper, lower
        repairs.append(f"Joint '{name}': its limits were the wrong way round; swapped them.")
    if joint.get("type") == "revolute" and max(-lower, upper) > MAX_TURN_RAD:
        if max(-lower, upper) > MAX_TURN_DEG:
            joint.set("type", "continuous")
            free.append(name)
            return
        repairs.append(f"Joint '{name}': limits {lower:g} and {upper:g} taken as degrees.")
        lower, upper = math.radians(lower), math.radians(upper)
    _set_limits(limit, lower, upper)


def _set_limits(limit: Element, lower: float, upper: float) -> None:
    limit.set("lower", repr(lower))
    limit.set("upper", repr(upper))


def _followed_range(joint: Element, joints: dict[str, Element]) -> tuple[float, float] | None:
    """The range that a mimic joint without limits has, from the joint that it follows."""
    mimic = joint.find("mimic")
    master = joints.get(mimic.get("joint", "")) if mimic is not None else None
    if mimic is None or master is None:
        return None
    ends = CONTINUOUS_RANGE if master.get("type") == "continuous" else _given_range(master)
    if ends is None:
        return None
    multiplier, offset = _float(mimic.get("multiplier", "1")), _float(mimic.get("offset", "0"))
    if multiplier is None or offset is None:
        return None
    values = sorted(multiplier * end + offset for end in ends)
    return values[0], values[1]


def _without_stiff_joints(urdf: Urdf, repairs: list[str]) -> Urdf:
    """The tree with fixed joints in place of those that their limits hold where they are."""
    followed = {joint.mimic.joint for joint in urdf.joints.values() if joint.mimic is not None}
    joints = dict(urdf.joints)
    for name, joint in urdf.joints.items():
        if joint.lower == joint.upper and joint.mimic is None and name not in followed:
            pose = joint.T_parent_child @ _motion(joint, joint.lower)
            joints[name] = replace(
                joint, type="fixed", T_parent_child=pose, lower=math.nan, upper=math.nan, effort=0.0
            )
            repairs.append(f"Joint '{name}': its limits leave it no range; it is fixed now.")
    return replace(urdf, joints=joints)


def _motion(joint: Joint, value: float) -> np.ndarray:
    if joint.type == "prismatic":
        return np.asarray(trimesh.transformations.translation_matrix(value * joint.axis))
    return np.asarray(trimesh.transformations.rotation_matrix(value, joint.axis))


def _given_range(joint: Element) -> tuple[float, float] | None:
    limit = joint.find("limit")
    if limit is None:
        return None
    lower, upper = _float(limit.get("lower", "")), _float(limit.get("upper", ""))
    return (lower, upper) if lower is not None and upper is not None else None


# -- what drives it ---------------------------------------------------------------------------


def _actuated(robot: Element, urdf: Urdf) -> tuple[str, ...] | None:
    """Joints that transmissions or ros2_control drive; None where neither names any."""
    named_ones = set(_driven(robot))
    driven = tuple(
        name
        for name, joint in urdf.joints.items()
        if name in named_ones and joint.type != "fixed" and joint.mimic is None
    )
    return driven or None


def _driven(robot: Element) -> Iterator[str]:
    for joint in robot.findall("transmission/joint"):
        yield joint.get("name", "")
    for joint in robot.findall("ros2_control/joint"):
        if joint.find("command_interface") is not None:
            yield joint.get("name", "")


def _float(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _finite(text: str) -> float:
    """The number, or 0 for what is none: the strict reader names it."""
    value = _float(text)
    return value if value is not None and math.isfinite(value) else 0.0
