"""Which links are palm, fingers, wrist and mount: read from the kinematic tree and the shapes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from gdg.errors import GdgError
from gdg.hands.geometry import ConvexPart
from gdg.hands.urdf import MOVING_TYPES, Joint, Urdf

#: A chain without branches and longer than this is an arm with a tool, not a single finger.
LONGEST_SINGLE_FINGER = 3


@dataclass(frozen=True)
class Finger:
    """One subtree of the palm.

    Attributes:
        joints: its moving joints, from the palm outward.
        links: its links, from the palm outward.
        distal: the outermost links with shapes, one rigid body per tip.
    """

    joints: tuple[str, ...]
    links: tuple[str, ...]
    distal: tuple[str, ...]


@dataclass(frozen=True)
class Structure:
    """The parts of a hand.

    Attributes:
        palm: the link that carries the palm.
        palm_body: all links with shapes that are rigidly joined to it, mounts included.
        wrist: moving joints between the root and the palm.
        fingers: subtrees that move on the palm.
    """

    palm: str
    palm_body: tuple[str, ...]
    wrist: tuple[str, ...]
    fingers: tuple[Finger, ...]


class _Tree:
    """Rigid bodies of a URDF: links that are joined by fixed joints count as one."""

    def __init__(self, urdf: Urdf, parts: Iterable[ConvexPart]):
        self.body = {urdf.root: urdf.root}
        self.parent: dict[str, Joint] = {}
        self.children: dict[str, list[Joint]] = {}
        for joint in urdf.joints.values():
            fixed = joint.type not in MOVING_TYPES
            self.body[joint.child] = self.body[joint.parent] if fixed else joint.child
            if not fixed:
                self.parent[joint.child] = joint
                self.children.setdefault(self.body[joint.parent], []).append(joint)
        self.links: dict[str, list[str]] = {}
        for link, body in self.body.items():
            self.links.setdefault(body, []).append(link)
        self.shaped = {part.link for part in parts}
        self.root = urdf.root

    def has_shapes(self, body: str) -> bool:
        return any(link in self.shaped for link in self.links[body])

    def subtree(self, body: str) -> list[str]:
        """Bodies from ``body`` outward, parents first."""
        found = [body]
        for inner in found:
            found += [joint.child for joint in self.children.get(inner, ())]
        return found

    def bears_shapes(self, body: str) -> bool:
        return any(self.has_shapes(inner) for inner in self.subtree(body))

    def path(self, body: str) -> list[Joint]:
        """Moving joints from the root to a body."""
        joints: list[Joint] = []
        while body != self.root:
            joints.insert(0, self.parent[body])
            body = self.body[self.parent[body].parent]
        return joints


def find_structure(urdf: Urdf, parts: tuple[ConvexPart, ...]) -> Structure:
    """Palm, fingers and wrist of a hand.

    The palm is the body from which the fingers branch: the nearest common ancestor of all tips.
    What lies between it and the root is wrist, forearm or arm.

    Raises:
        GdgError: nothing moves.
    """
    tree = _Tree(urdf, parts)
    branches = _branches(tree, tree.root)
    if not branches:
        raise GdgError(f"{urdf.path}: no joint moves a link that has shapes; this is no hand.")
    body, trunk = tree.root, [tree.root]
    while len(branches) == 1:
        body = branches[0].child
        trunk.append(body)
        branches = _branches(tree, body)
    if not branches:  # one chain: a single finger, or an arm whose last joint moves a jaw
        body = trunk[-2] if len(trunk) - 1 > LONGEST_SINGLE_FINGER else trunk[0]
        branches = _branches(tree, body)
    palm_body = _shaped_body(tree, body)
    fingers = tuple(_finger(tree, joint) for joint in branches)
    wrist = tuple(joint.name for joint in tree.path(body))
    shaped = tuple(link for link in tree.links[palm_body] if link in tree.shaped)
    palm = _palm_link(tree, [joint.parent for joint in branches], shaped, urdf)
    return Structure(palm, shaped, wrist, fingers)


def _branches(tree: _Tree, body: str) -> list[Joint]:
    return [joint for joint in tree.children.get(body, ()) if tree.bears_shapes(joint.child)]


def _shaped_body(tree: _Tree, body: str) -> str:
    """The body itself, else its nearest ancestor that has shapes, else the body."""
    ancestors = [tree.body[joint.parent] for joint in reversed(tree.path(body))]
    return next((b for b in (body, *ancestors) if tree.has_shapes(b)), body)


def _finger(tree: _Tree, joint: Joint) -> Finger:
    bodies = tree.subtree(joint.child)
    tips = [
        body
        for body in bodies
        if tree.has_shapes(body)
        and not any(tree.bears_shapes(j.child) for j in tree.children.get(body, ()))
    ]
    return Finger(
        joints=tuple(tree.parent[body].name for body in bodies),
        links=tuple(link for body in bodies for link in tree.links[body]),
        distal=tuple(link for body in tips for link in tree.links[body] if link in tree.shaped),
    )


def _palm_link(tree: _Tree, parents: list[str], shaped: tuple[str, ...], urdf: Urdf) -> str:
    """Of the palm's body the link that most fingers hang on, else the shaped one next to them."""
    if not shaped:
        return max(parents, key=parents.count)
    hangers = [link for link in parents if link in shaped]
    if hangers:
        return max(hangers, key=hangers.count)
    steps = {link: _steps(urdf, link) for link in (*shaped, *parents)}
    outermost = max(parents, key=parents.count)
    return min(shaped, key=lambda link: len(set(steps[link]) ^ set(steps[outermost])))


def _steps(urdf: Urdf, link: str) -> list[str]:
    """A link and its ancestors."""
    chain = [link]
    while chain[-1] in urdf.joint_above:
        chain.append(urdf.joint_above[chain[-1]].parent)
    return chain
