"""A hand, loaded: manifest, kinematic tree and geometry, checked against each other."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path

import numpy as np

from gdg.cache import content_hash
from gdg.errors import GdgError, did_you_mean, raise_if_any
from gdg.folders import HANDS
from gdg.hands.geometry import ConvexPart, link_parts
from gdg.hands.spec import MANIFEST, HandSpec, read_spec
from gdg.hands.urdf import MOVING_TYPES, Joint, Urdf, read_urdf


@dataclass(frozen=True)
class Hand:
    """What a hand folder holds.

    Attributes:
        folder: where it was read from.
        spec: ``hand.yaml``.
        urdf: the kinematic tree.
        parts: the hand's one geometry, convex parts in link frames.
        content_hash: changes whenever manifest, URDF or geometry change.
    """

    folder: Path
    spec: HandSpec
    urdf: Urdf
    parts: tuple[ConvexPart, ...]
    content_hash: str

    @property
    def name(self) -> str:
        """The hand's name."""
        return self.spec.name

    @property
    def link_names(self) -> tuple[str, ...]:
        """All links, in the order of every link index."""
        return tuple(self.urdf.links)

    @cached_property
    def moving_joints(self) -> tuple[Joint, ...]:
        """All joints that move, mimic and passive ones included, parents before children."""
        return tuple(j for j in self.urdf.joints.values() if j.type in MOVING_TYPES)

    @cached_property
    def moving_rows(self) -> dict[str, int]:
        """Moving joint -> its place in ``moving_joints``, which is its row of ``coupling``."""
        return {joint.name: row for row, joint in enumerate(self.moving_joints)}

    @cached_property
    def rows_above(self) -> dict[str, frozenset[int]]:
        """Link -> rows of the moving joints between it and the root."""
        above: dict[str, frozenset[int]] = {self.urdf.root: frozenset()}
        for joint in self.urdf.joints.values():  # parents before children
            own = {self.moving_rows[joint.name]} if joint.name in self.moving_rows else set()
            above[joint.child] = above[joint.parent] | own
        return above

    @cached_property
    def coupling(self) -> tuple[np.ndarray, np.ndarray]:
        """``A`` (moving, actuated) and ``b`` (moving,): moving = A @ actuated + b.

        A mimic joint follows its master (through chains of mimics); a passive joint, neither
        actuated nor mimic, stays at the value nearest to zero that its limits allow.
        """
        matrix = np.zeros((len(self.moving_joints), len(self.spec.joints)))
        offset = np.zeros(len(self.moving_joints))
        for row, joint in enumerate(self.moving_joints):
            factor, constant = 1.0, 0.0
            while joint.name not in self.spec.joints and joint.mimic is not None:
                constant += factor * joint.mimic.offset
                factor *= joint.mimic.multiplier
                joint = self.urdf.joints[joint.mimic.joint]
            if joint.name in self.spec.joints:
                matrix[row, self.spec.joints.index(joint.name)] = factor
                offset[row] = constant
            else:
                offset[row] = constant + factor * float(np.clip(0.0, joint.lower, joint.upper))
        return matrix, offset

    def parts_of(self, link: str) -> list[ConvexPart]:
        """The convex parts of one link, in the order of ``parts``; maybe none."""
        return [part for part in self.parts if part.link == link]

    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper limits of the actuated joints, declared order; rad or m."""
        joints = [self.urdf.joints[name] for name in self.spec.joints]
        return np.array([j.lower for j in joints]), np.array([j.upper for j in joints])

    def posture(self, which: str) -> np.ndarray:
        """The ``open`` or ``closed`` posture; joints it leaves out rest in mid-range."""
        given: dict[str, float] = getattr(self.spec, which)
        lower, upper = self.limits()
        middle = (lower + upper) / 2
        return np.array([given.get(j, m) for j, m in zip(self.spec.joints, middle, strict=True)])

    @cached_property
    def bodies(self) -> tuple[int, ...]:
        """Per link, the index of its rigid body: links joined by fixed joints share one."""
        index = {self.urdf.root: 0}
        count = 1
        for joint in self.urdf.joints.values():
            if joint.type == "fixed":
                index[joint.child] = index[joint.parent]
            else:
                index[joint.child] = count
                count += 1
        return tuple(index[name] for name in self.link_names)

    def may_collide(self) -> np.ndarray:
        """(link, link) bool: pairs that must not overlap, from the tree and the manifest.

        Links of one rigid body, of neighbouring bodies, and allowed pairs are left out.
        """
        body, number = np.array(self.bodies), {n: i for i, n in enumerate(self.link_names)}
        neighbours = {
            (body[number[j.parent]], body[number[j.child]]) for j in self.urdf.joints.values()
        }
        pairs = body[:, None] != body[None, :]
        for a, b in neighbours:
            pairs &= ~((body[:, None] == a) & (body[None, :] == b))
            pairs &= ~((body[:, None] == b) & (body[None, :] == a))
        for first, second in self.spec.allowed_self_contacts:
            pairs[number[first], number[second]] = pairs[number[second], number[first]] = False
        return pairs


def find_hand(given: str) -> Hand:
    """Loads the hand that a name or a folder's path means."""
    return load_hand(HANDS.find(given).path)


def load_hand(folder: Path) -> Hand:
    """Reads a hand folder; says every mistake in the manifest's references at once.

    Raises:
        GdgError: a file is missing or malformed, or the manifest does not fit the URDF.
    """
    spec = read_spec(folder)
    urdf_path = Path(os.path.realpath(folder / spec.urdf))
    if not urdf_path.is_relative_to(folder.resolve()):
        raise GdgError(f"{folder / MANIFEST}: urdf: '{spec.urdf}' lies outside the folder.")
    if not os.path.isfile(urdf_path):
        raise GdgError(f"{folder / MANIFEST}: urdf: there is no file '{spec.urdf}' in {folder}.")
    urdf = read_urdf(urdf_path)
    raise_if_any([f"{folder / MANIFEST}: {text}" for text in reference_mistakes(spec, urdf)])
    parts = link_parts(urdf, folder, spec.geometry)
    meshes = [np.ascontiguousarray(part.mesh.vertices).tobytes() for part in parts]
    # defaults left out: a field that joins the schema later changes no hash
    text = spec.model_dump_json(exclude_defaults=True)
    key = content_hash(text, urdf_path.read_bytes(), *meshes)
    return Hand(folder, spec, urdf, parts, key)


def reference_mistakes(spec: HandSpec, urdf: Urdf) -> Iterable[str]:
    """Names and values of a manifest that do not fit the URDF, each beginning with its place."""
    for place, link in spec.link_references():
        if link not in urdf.links:
            hint = did_you_mean(link, urdf.links)
            yield f"{place}: link '{link}' is not in {urdf.path.name}.{hint}"
    moving = [name for name, joint in urdf.joints.items() if joint.type in MOVING_TYPES]
    excused = _misspelt(spec, urdf)
    for place, joint in spec.joint_references():
        if joint not in moving:
            what = "a fixed joint" if joint in urdf.joints else "not"
            hint = did_you_mean(joint, moving)
            yield f"{place}: joint '{joint}' is {what} in {urdf.path.name}.{hint}"
        elif urdf.joints[joint].mimic is not None:
            yield f"{place}: joint '{joint}' mimics another one, so it has no value of its own."
        elif place.startswith(("open.", "closed.")):
            yield from _posture_mistakes(spec, urdf, place, joint)
            if joint not in spec.joints and joint not in excused:
                yield f"{place}: joint '{joint}' is not among the actuated joints."
    if len(set(spec.joints)) != len(spec.joints):
        yield "joints: a joint is listed twice."
    if spec.root_link in urdf.links and spec.root_link != urdf.root:
        yield f"root_link: '{spec.root_link}' is not the root of the tree, which is '{urdf.root}'."


def _posture_mistakes(spec: HandSpec, urdf: Urdf, place: str, name: str) -> Iterable[str]:
    joint, value = urdf.joints[name], getattr(spec, place.partition(".")[0])[name]
    if not joint.lower - 1e-3 <= value <= joint.upper + 1e-3:
        limits = f"[{joint.lower:g}, {joint.upper:g}]"
        yield f"{place}: {value:g} is outside the joint's limits {limits}."


def _misspelt(spec: HandSpec, urdf: Urdf) -> set[str]:
    """Joints of a posture that ``joints`` may only misspell: one, the likest, per unknown name."""
    unlisted = {*spec.open, *spec.closed}.intersection(urdf.joints).difference(spec.joints)
    meant: set[str] = set()
    for name in spec.joints:
        if name not in urdf.joints:
            meant.update(get_close_matches(name, sorted(unlisted - meant), n=1, cutoff=0.0))
    return meant
