"""Reads MJCF through MuJoCo's own parser, and makes it a kinematic tree of links and joints."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, tostring

import numpy as np
import trimesh

from gdg.errors import GdgError, did_you_mean
from gdg.hands.intake.description import Description, named
from gdg.hands.intake.mjcf_actuators import command_ranges, read_actuators
from gdg.hands.intake.mjcf_couplings import read_couplings
from gdg.hands.intake.mjcf_files import LEAST_MASS, Flat, flatten
from gdg.hands.intake.mjcf_geoms import GeomReader
from gdg.hands.intake.mjcf_loops import Closed, close_loops
from gdg.hands.intake.mjcf_model import (
    FREE,
    HINGE,
    MjcfModel,
    check_numbers,
    free_name,
    load_mujoco,
    pose,
)
from gdg.hands.intake.provenance import stated_source
from gdg.hands.urdf import CONTINUOUS_RANGE, Inertial, Joint, Link, Urdf

UNKNOWN = re.compile(r"unrecognized (attribute|element):? '([^']+)'(?:\s*Element '([^']+)')?")
LINE = re.compile(r",? line \d+")
#: Masses up to this, kg, are those that were given to bodies without any.
NO_MASS = 1.001 * float(LEAST_MASS)


def mjcf_from_xml(
    path: Path, root_element: Element, root: str | None, package_paths: Sequence[Path]
) -> Description:
    """The hand that an MJCF file describes.

    Args:
        path: the file.
        root_element: its outermost element; changed in place.
        root: keep only this body and what hangs on it.
        package_paths: folders in which included files and meshes may lie, beside its own.

    Raises:
        GdgError: MuJoCo is not installed or refuses the file; ball joints inside the hand, slides
            without a range; several hands and no ``root``.
    """
    robot = root_element.get("model", "")
    flat = flatten(path, root_element, package_paths)
    repairs = flat.repairs
    model = MjcfModel(path, _compile(path, flat, repairs))
    tree = _Tree(model, flat, repairs)
    description = tree.convert(root)
    description.source = stated_source(path, "MJCF", robot)
    couplings = read_couplings(model, tree.moving, repairs)
    commands = command_ranges(model, tree.moving, couplings)
    closed = close_loops(model, tree.moving, couplings, commands, repairs)
    actuation = read_actuators(model, tree.moving, closed.couplings, repairs)
    ranges = _Ranges(path, description.urdf.joints, closed, commands, repairs)
    joints = {name: ranges.complete(joint) for name, joint in description.urdf.joints.items()}
    description.urdf = replace(description.urdf, joints=joints)
    description.actuated, description.drives = actuation.actuated, actuation.drives
    description.excluded = tuple(model.excluded_pairs(tree.links))
    return description


def _compile(path: Path, flat: Flat, repairs: list[str]) -> Any:
    """MuJoCo's model; attributes and elements that it does not know are dropped and said."""
    mujoco = load_mujoco(path)
    for _ in range(20):
        text = tostring(flat.root, encoding="unicode")
        try:
            raw = mujoco.MjModel.from_xml_string(text, flat.assets)
            check_numbers(path, raw)
            return raw
        except (ValueError, mujoco.FatalError) as error:
            reason = " ".join(str(error).split())
            unknown = UNKNOWN.search(reason)
            if unknown is None or not _drop_unknown(flat.root, *unknown.groups()):
                reason = LINE.sub("", reason).rstrip(".")
                raise GdgError(f"{path}: MuJoCo refuses it: {reason}.") from error
            kind, name, element = unknown.groups()
            where = f" of <{element}>" if kind == "attribute" else ""
            repairs.append(f"Ignored the {kind} '{name}'{where}, which MuJoCo does not know.")
    raise GdgError(f"{path}: has too much that MuJoCo does not know.")


def _drop_unknown(root: Element, kind: str, name: str, element: str | None) -> bool:
    """Removes an attribute of an element, or an element; whether there was any."""
    found = False
    for parent in list(root.iter()):
        if kind == "attribute" and parent.tag == element and name in parent.attrib:
            del parent.attrib[name]
            found = True
        for child in [c for c in parent if kind == "element" and c.tag == name]:
            parent.remove(child)
            found = True
    return found


@dataclass
class _Ranges:
    """Finds limits for joints that have none: from loops, couplings, and actuators."""

    path: Path
    joints: dict[str, Joint]
    closed: Closed
    commands: dict[str, tuple[float, float]]
    repairs: list[str]

    def complete(self, joint: Joint) -> Joint:
        """The joint with its mimic and with limits."""
        if joint.type == "fixed":
            return joint
        mimic = self.closed.couplings.get(joint.name)
        lower, upper = self._limits(joint)
        if not math.isnan(lower):
            if math.isnan(joint.lower):
                self.repairs.append(
                    f"Joint '{joint.name}': no limits; got "
                    + (
                        "the range of its commands."
                        if mimic is None
                        else "those of what it follows."
                    )
                )
            return replace(joint, lower=lower, upper=upper, mimic=mimic)
        if joint.type == "prismatic":
            raise GdgError(
                f"{self.path}: joint '{joint.name}' slides without limits; write "
                'range="LOWER UPPER" in metres.'
            )
        self.repairs.append(f"Joint '{joint.name}': no limits; taken as turning freely, -pi to pi.")
        lower, upper = CONTINUOUS_RANGE
        return replace(joint, type="continuous", lower=lower, upper=upper, mimic=mimic)

    def _limits(self, joint: Joint) -> tuple[float, float]:
        name = joint.name
        if name in self.closed.ranges:
            return self.closed.ranges[name]
        if not math.isnan(joint.lower):
            return joint.lower, joint.upper
        mimic = self.closed.couplings.get(name)
        if mimic is not None:
            ends = self._limits(self.joints[mimic.joint])
            values = sorted(mimic.multiplier * end + mimic.offset for end in ends)
            return values[0], values[1]
        return self.commands.get(name, (math.nan, math.nan))


@dataclass
class _Tree:
    """Bodies and joints of a compiled model as links and joints.

    A link's frame is its body's, moved to the anchor of the body's last joint: a URDF joint turns
    its child about the child's origin. Bodies with several joints get a bare link for each more.

    Attributes:
        moving: name in the URDF -> joint id, of the joints that were kept.
        links: body id -> link name, of the bodies that were kept.
    """

    model: MjcfModel
    flat: Flat
    repairs: list[str]
    moving: dict[str, int] = field(default_factory=dict)
    links: dict[int, str] = field(default_factory=dict)

    def convert(self, root: str | None) -> Description:
        body = self._root(root)
        kept = list(self.model.subtree(body))
        self.links = {b: self.model.body_names[b] for b in kept}
        lost = self.model.body_count - 1 - len(kept) + (body == 0)
        if lost:
            others = f"{lost} other bodies were" if lost > 1 else "one other body was"
            self.repairs.append(
                f"Kept body '{self.links[body]}' and what hangs on it; {others} left out."
            )
        self._drop_mount(body)
        description = Description(
            Urdf(self.model.path, "", {}, {}, self.links[body]), "", repairs=self.repairs
        )
        geoms = GeomReader(self.model, description, self.flat.missing)
        links: dict[str, Link] = {}
        joints: dict[str, Joint] = {}
        Ts_link_body = {body: np.eye(4)}
        for b in kept:
            if b != body:
                for link, joint in self._joints(b, Ts_link_body):
                    links[link] = Link(link, (), (), None)
                    joints[joint.name] = joint
            name = self.links[b]
            visuals, collisions = geoms.shapes(b, name, Ts_link_body[b])
            links[name] = Link(name, collisions, visuals, self._inertial(b, Ts_link_body[b]))
        geoms.finish()
        description.urdf = replace(description.urdf, links=links, joints=joints)
        return description

    def _root(self, root: str | None) -> int:
        names = self.model.body_names
        if root is None:
            return self._likely_root()
        if root not in names:
            hint = did_you_mean(root, names[1:])
            raise GdgError(f"{self.model.path}: there is no body '{root}'.{hint}")
        return names.index(root)

    def _likely_root(self) -> int:
        """The one body in the world that moves by joints; the world where it is the palm."""
        model = self.model
        children = [b for b in range(1, model.body_count) if model.parent(b) == 0]
        jointed = [b for b in children if self._moves_inside(b)]
        driven = [b for b in jointed if model.driven_joints() & set(model.joints_below(b))]
        for candidates in (driven, jointed, [b for b in children if model.has_shapes(b)]):
            if len(candidates) == 1:
                return candidates[0]
            if any(model.hinged_to_world(b) for b in candidates):
                return 0
            if candidates:
                names = ", ".join(model.body_names[b] for b in candidates[:8])
                raise GdgError(
                    f"{model.path}: several bodies could be the hand: {names}; choose one with "
                    "--root BODY."
                )
        raise GdgError(f"{model.path}: has no body with shapes or joints.")

    def _moves_inside(self, body: int) -> bool:
        return any(self.model.joint_type(j) != FREE for j in self.model.joints_below(body))

    def _drop_mount(self, body: int) -> None:
        mount = [self.model.joint_names[j] for j in self.model.joints_of(body)]
        if mount:
            self.repairs.append(
                f"{named(mount, 'joint')}: moves the whole hand in the world; dropped."
                if len(mount) == 1
                else f"{named(mount, 'joint')}: move the whole hand in the world; dropped."
            )

    def _joints(
        self, body: int, Ts_link_body: dict[int, np.ndarray]
    ) -> Iterator[tuple[str, Joint]]:
        """The joints between a body's parent and the body, each with the link that it carries."""
        model, parent = self.model, self.model.parent(body)
        link, T = self.links[parent], Ts_link_body[parent] @ model.body_pose(body)
        joints = model.joints_of(body)
        if not joints:
            Ts_link_body[body] = np.eye(4)
            name = self.links[body]
            fixed = free_name(f"{name}_fixed", model.joint_names)
            yield name, _joint(fixed, "fixed", link, name, T, np.array([1.0, 0.0, 0.0]))
            return
        for index, j in enumerate(joints):
            name, kind = model.joint_names[j], model.joint_type(j)
            if kind not in ("hinge", "slide"):
                raise GdgError(
                    f"{model.path}: joint '{name}' of body '{self.links[body]}' is a {kind} joint; "
                    "gdg moves hands by hinges and slides only."
                )
            last = index == len(joints) - 1
            child = self.links[body] if last else free_name(f"{name}_link", model.body_names)
            axis, anchor, ref = model.joint_frame(j)
            if kind == HINGE:
                T = T @ pose(anchor) @ trimesh.transformations.rotation_matrix(-ref, axis)
            else:
                anchor = np.zeros(3)
                T = T @ pose(-ref * axis)
            lower, upper = model.joint_range(j)
            self.moving[name] = j
            joint = _joint(name, "revolute" if kind == HINGE else "prismatic", link, child, T, axis)
            yield child, replace(joint, lower=lower, upper=upper, effort=model.joint_force(j))
            link, T = child, pose(-anchor)
        Ts_link_body[body] = T

    def _inertial(self, body: int, T_link_body: np.ndarray) -> Inertial | None:
        mass, T_body_center, moments = self.model.inertial(body)
        if mass <= NO_MASS:
            return None
        return Inertial(mass, T_link_body @ T_body_center, np.diag(moments))


def _joint(name: str, kind: str, parent: str, child: str, T: np.ndarray, axis: np.ndarray) -> Joint:
    return Joint(name, kind, parent, child, T, axis, math.nan, math.nan, 0.0, 0.0, None)
