"""Writes a made-up hand as URDF with its meshes."""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import trimesh

from gdg.hands.urdf import SIZES, Inertial, Joint, Link, Shape
from hard_hands.hand import HardHand
from hard_hands.parts import Vector


def write_hard_hand(hand: HardHand, folder: Path) -> Path:
    """Writes the URDF and the meshes beside it into ``folder``; returns the URDF's path."""
    folder.mkdir(parents=True, exist_ok=True)
    for file, mesh in hand.meshes.items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        mesh.export(folder / file)
    path = folder / f"{hand.name}.urdf"
    path.write_text(urdf_text(hand), encoding="utf-8")
    return path


def urdf_text(hand: HardHand) -> str:
    """The hand as URDF."""
    links = [_link_xml(link) for link in hand.links.values()]
    joints = [_joint_xml(joint) for joint in hand.joints]
    return "\n".join([f"<robot name={quoteattr(hand.name)}>", *links, *joints, "</robot>", ""])


def _link_xml(link: Link) -> str:
    parts = [_inertial_xml(link.inertial)] if link.inertial is not None else []
    for tag, shapes in (("visual", link.visuals), ("collision", link.collisions)):
        for shape in shapes:
            origin, geometry = _origin_xml(shape.T_link_shape), _geometry_xml(shape)
            parts.append(f"  <{tag}>{origin}<geometry>{geometry}</geometry></{tag}>\n")
    return f"<link name={quoteattr(link.name)}>\n{''.join(parts)}</link>"


def _inertial_xml(inertial: Inertial) -> str:
    values = inertial.inertia
    entries = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2)}
    entries["iyz"] = (1, 2)
    inertia = " ".join(f'{name}="{values[index]:.9g}"' for name, index in entries.items())
    origin = _origin_xml(inertial.T_link_center)
    mass = f'<mass value="{inertial.mass:.9g}"/>'
    return f"  <inertial>{origin}{mass}<inertia {inertia}/></inertial>\n"


def _geometry_xml(shape: Shape) -> str:
    if shape.kind == "mesh":
        return f"<mesh filename={quoteattr(shape.mesh)} scale={_numbers(shape.size)}/>"
    rest, attributes = shape.size, []
    for name, count in SIZES[shape.kind]:
        attributes.append(f"{name}={_numbers(rest[:count])}")
        rest = rest[count:]
    return f"<{shape.kind} {' '.join(attributes)}/>"


def _joint_xml(joint: Joint) -> str:
    parts = [
        f"<parent link={quoteattr(joint.parent)}/><child link={quoteattr(joint.child)}/>",
        _origin_xml(joint.T_parent_child),
    ]
    if joint.type != "fixed":
        parts.append(f"<axis xyz={_numbers(joint.axis)}/>")
    if joint.type in ("revolute", "prismatic"):
        effort = f' effort="{joint.effort:.9g}"' if joint.effort else ""
        parts.append(f'<limit lower="{joint.lower:.9g}" upper="{joint.upper:.9g}"{effort}/>')
    if joint.mimic is not None:
        mimic = joint.mimic
        factors = f'multiplier="{mimic.multiplier:.9g}" offset="{mimic.offset:.9g}"'
        parts.append(f"<mimic joint={quoteattr(mimic.joint)} {factors}/>")
    body = "".join(parts)
    return f"<joint name={quoteattr(joint.name)} type={quoteattr(joint.type)}>{body}</joint>"


def _origin_xml(pose: np.ndarray) -> str:
    angles = np.array(trimesh.transformations.euler_from_matrix(pose, "sxyz"))
    return f"<origin xyz={_numbers(pose[:3, 3])} rpy={_numbers(angles)}/>"


def _numbers(values: Vector) -> str:
    return '"' + " ".join(f"{value:.12g}" for value in values) + '"'
