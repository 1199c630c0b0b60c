"""Fingers, and the palms that carry them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import trimesh

from gdg.hands.urdf import Mimic
from hard_hands.builder import Builder
from hard_hands.parts import at, box, crosswise, cylinder, facing, sphere

#: Angle by which a finger joint can close in most of these hands, rad.
FLEXION = 1.6
#: Spread joints reach this far to either side, rad.
SPREAD = 0.35
#: Where the inner side of every link of a finger faces, link frame.
INSIDE = np.array([1.0, 0.0, 0.0])
#: Phalanges of a human-sized finger, metres.
PHALANGES = (0.044, 0.028, 0.024)


@dataclass(frozen=True)
class Finger:
    """How to build a finger.

    In its own frame a finger extends along +z and its inner side faces +x.

    Attributes:
        lengths: of the phalanges, base to tip, metres.
        limits: of a flexion joint when +1 closes.
        sign: +1 or -1: which joint direction closes; -1 turns axis and limits round.
        spread: where the sideways joint comes: ``first``, ``second`` (after the first flexion) or
            ``""`` for none.
        kind: ``revolute`` or ``continuous``.
        couple: coupling of every flexion joint after the first to the first: multiplier, offset.
        shape: ``box``, ``capsule`` (primitives), ``mesh`` (STL in millimetres) or ``many``.
        thickness: metres.
        tip_frame: adds a link without geometry at the tip.
    """

    lengths: tuple[float, ...] = PHALANGES
    limits: tuple[float, float] = (0.0, FLEXION)
    sign: int = 1
    spread: str = ""
    kind: str = "revolute"
    couple: tuple[float, float] | None = None
    shape: str = "box"
    thickness: float = 0.017
    tip_frame: bool = False

    def add(self, hand: Builder, name: str, parent: str, pose: np.ndarray) -> None:
        """Adds the finger ``name`` at ``pose`` of link ``parent``."""
        if self.spread == "first":
            parent, pose = self._add_spread(hand, name, parent, pose), at()
        for index, length in enumerate(self.lengths, 1):
            child = self._phalanx(hand, f"{name}_{index}", length, index == len(self.lengths))
            self._hinge(hand, name, index, parent, child, pose)
            parent, pose = child, at(z=length)
            if self.spread == "second" and index == 1:
                parent, pose = self._add_spread(hand, name, parent, pose), at()
        hand.distal.append(parent)
        if self.tip_frame:
            hand.fixed(parent, hand.link(f"{name}_tip"), pose)

    def _hinge(
        self, hand: Builder, name: str, index: int, parent: str, child: str, pose: np.ndarray
    ) -> None:
        limits = self.limits if self.sign > 0 else (-self.limits[1], -self.limits[0])
        mimic = None
        if self.couple is not None and index > 1:
            mimic = Mimic(f"{name}_flex1", self.couple[0], self.sign * self.couple[1])
        hand.joint(
            f"{name}_flex{index}",
            parent,
            child,
            pose,
            (0, self.sign, 0),
            limits,
            kind=self.kind,
            closing=self.sign,
            mimic=mimic,
        )

    def _add_spread(self, hand: Builder, name: str, parent: str, pose: np.ndarray) -> str:
        knuckle = hand.link(f"{name}_knuckle", crosswise(0.4 * self.thickness, 0.015))
        hand.joint(f"{name}_spread", parent, knuckle, pose, (1, 0, 0), (-SPREAD, SPREAD))
        return knuckle

    def _phalanx(self, hand: Builder, name: str, length: float, last: bool) -> str:
        thick, body = self.thickness, length - 0.003
        straight = max(body - thick, 0.001)
        hand.pads[name] = INSIDE
        if self.shape == "mesh":
            mesh = trimesh.creation.capsule(straight, thick / 2, count=(12, 12))
            mesh.apply_translation((0, 0, length / 2 - mesh.bounds.mean(axis=0)[2]))
            return hand.link(name, hand.millimetre_mesh(f"meshes/{name}.stl", mesh))
        if self.shape == "capsule":
            ends = sphere(thick / 2, at(z=thick / 2)), sphere(thick / 2, at(z=body - thick / 2))
            return hand.link(name, cylinder(thick / 2, straight, at(z=body / 2)), *ends)
        tip = (sphere(thick / 2, at(z=body)),) if last else ()
        core = box(thick, thick + 0.002, body, at(z=body / 2))
        if self.shape == "many":
            screws = [crosswise(0.003, 0.024, z=z) for z in (0.006, body - 0.006)]
            back = box(0.004, 0.012, 0.7 * body, at(-0.38 * thick - 0.002, 0, body / 2))
            bones = [box(0.76 * thick, 0.008, body, at(0, y, body / 2)) for y in (-0.005, 0.005)]
            rubber = box(0.003, 0.014, 0.6 * body, at(thick / 2 - 0.0015, 0, body / 2))
            return hand.link(name, core, *tip, visuals=[*bones, *screws, back, rubber, *tip])
        return hand.link(name, core, *tip)


def box_palm(hand: Builder, name: str = "palm") -> str:
    """A palm of 30 × 85 × 95 mm whose centre is at x = 0; its surface is at x = 15 mm."""
    return hand.link(name, box(0.03, 0.085, 0.095, at(z=0.0475)))


BOX_PALM = {"normal": (1, 0, 0), "center": (0.015, 0, 0.05)}


def row(hand: Builder, finger: Finger, names: Sequence[str], side: int, parent: str) -> None:
    """Fingers side by side on the upper edge of ``box_palm``, the first one next to the thumb."""
    for index, name in enumerate(names):
        y = side * (0.011 * (len(names) - 1) - 0.022 * index)
        last = len(names) > 3 and index == len(names) - 1
        scale = 0.8 if last else 1.0
        lengths = tuple(scale * length for length in finger.lengths)
        replace(finger, lengths=lengths).add(hand, name, parent, at(0.002, y, 0.097))


def thumb(hand: Builder, finger: Finger, side: int, parent: str, *, beside: bool = False) -> None:
    """A thumb behind an opposition joint, before the palm or ``beside`` it at zero.

    The one before the palm closes across it. The one beside it closes toward the fingers and comes
    before the palm when the opposition joint turns.
    """
    base = hand.link("thumb_base", cylinder(0.01, 0.024))
    direction, inside = (0.6, 0.45 * side, 0.7), (0, -side, 0.35)
    axis, limits = (0, 0, side), (-0.3, 1.2)
    if beside:
        direction, inside = (0.1, side, 0.4), (0, 0, 1)
        axis, limits = (0, 0, -side), (0.0, 1.6)
    hand.joint("thumb_opposition", parent, base, at(0.008, side * 0.047, 0.022), axis, limits)
    pose = facing(direction, inside, (0.006, side * 0.006, 0.008))
    thumb = replace(finger, lengths=(0.042, 0.034), spread="", couple=None)
    thumb.add(hand, "thumb", base, pose)


def five_fingers(hand: Builder, finger: Finger, side: int, parent: str) -> None:
    row(hand, finger, ("index", "middle", "ring", "little"), side, parent)
    thumb(hand, finger, side, parent)


def around(hand: Builder, finger: Finger, angles: Sequence[float], radius: float) -> None:
    """Upright fingers on a circle about the z axis of ``palm``, closing toward its middle."""
    for index, angle in enumerate(angles, 1):
        out = np.array([math.cos(angle), math.sin(angle), 0.0])
        finger.add(hand, f"finger{index}", "palm", facing((0, 0, 1), -out, radius * out))


THIRDS = (0.0, 2 * math.pi / 3, 4 * math.pi / 3)
#: Two fingers side by side against one.
TWO_TO_ONE = (math.radians(-25), math.radians(25), math.pi)


def disc_palm(hand: Builder) -> str:
    """A palm of radius 55 mm whose surface is z = 0."""
    return hand.link("palm", cylinder(0.055, 0.05, at(z=-0.025)))


DISC_PALM = {"normal": (0, 0, 1), "center": (0, 0, 0)}
