"""Writes a kinematic tree as a clean URDF: what gdg reads and nothing else."""

from __future__ import annotations

from collections.abc import Iterable
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np
import trimesh

from gdg.hands.urdf import INERTIA, SIZES, Inertial, Joint, Link, Shape, Urdf


def write_urdf(urdf: Urdf, name: str) -> str:
    """The URDF text, numbers with 12 significant digits; ``read_urdf`` gives the same tree."""
    robot = Element("robot", name=name)
    for link in urdf.links.values():
        _add_link(robot, link)
    for joint in urdf.joints.values():
        _add_joint(robot, joint)
    indent(robot)
    return '<?xml version="1.0"?>\n' + tostring(robot, encoding="unicode") + "\n"


def _add_link(robot: Element, link: Link) -> None:
    element = SubElement(robot, "link", name=link.name)
    if link.inertial is not None:
        _add_inertial(element, link.inertial)
    for role, shapes in (("visual", link.visuals), ("collision", link.collisions)):
        for shape in shapes:
            _add_shape(SubElement(element, role), shape)


def _add_inertial(link: Element, inertial: Inertial) -> None:
    element = SubElement(link, "inertial")
    _add_origin(element, inertial.T_link_center)
    SubElement(element, "mass", value=_text([inertial.mass]))
    inertia, places = inertial.inertia, ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    values = {name: _text([inertia[place]]) for name, place in zip(INERTIA, places)}
    SubElement(element, "inertia", values)


def _add_shape(element: Element, shape: Shape) -> None:
    _add_origin(element, shape.T_link_shape)
    geometry = SubElement(element, "geometry")
    if shape.kind == "mesh":
        mesh = SubElement(geometry, "mesh", filename=shape.mesh)
        if shape.size != (1.0, 1.0, 1.0):
            mesh.set("scale", _text(shape.size))
        return
    primitive, rest = SubElement(geometry, shape.kind), list(shape.size)
    for attribute, count in SIZES[shape.kind]:
        primitive.set(attribute, _text(rest[:count]))
        rest = rest[count:]


def _add_joint(robot: Element, joint: Joint) -> None:
    element = SubElement(robot, "joint", name=joint.name, type=joint.type)
    _add_origin(element, joint.T_parent_child)
    SubElement(element, "parent", link=joint.parent)
    SubElement(element, "child", link=joint.child)
    if joint.type == "fixed":
        return
    SubElement(element, "axis", xyz=_text(joint.axis))
    limit = SubElement(element, "limit")
    if joint.type != "continuous":
        limit.set("lower", _text([joint.lower]))
        limit.set("upper", _text([joint.upper]))
    limit.set("effort", _text([joint.effort]))
    limit.set("velocity", _text([joint.velocity]))
    if joint.mimic is not None:
        mimic = SubElement(element, "mimic", joint=joint.mimic.joint)
        mimic.set("multiplier", _text([joint.mimic.multiplier]))
        mimic.set("offset", _text([joint.mimic.offset]))


def _add_origin(element: Element, pose: np.ndarray) -> None:
    if np.array_equal(pose, np.eye(4)):
        return
    angles = np.array(trimesh.transformations.euler_from_matrix(pose, "sxyz"))
    SubElement(element, "origin", xyz=_text(pose[:3, 3]), rpy=_text(angles))


def _text(values: Iterable[float]) -> str:
    return " ".join(f"{float(value) + 0.0:.12g}" for value in values)
