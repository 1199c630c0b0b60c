"""Made-up hands whose palm, fingers and closing directions are known, each hard in its own way.

Every generator in ``HARD_HANDS`` gives a ``HardHand``: a bare URDF (no ``hand.yaml``) as data, with
its truth. ``write_hard_hand`` writes the URDF and its meshes into a folder; ``scramble`` gives the
same hand in other frame conventions, ``rename`` with names that say nothing::

    hand = scramble(HARD_HANDS["forearm"](), seed=3)
    urdf = write_hard_hand(hand, tmp_path)

As generated, anthropomorphic hands have their fingers along +z, the palm facing +x and a right
hand's thumb on the +y side; grippers face +z. Sizes are those of real hands, metres.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import trimesh

from gdg.hands.urdf import SIZES, Inertial, Joint, Link, Mimic, Shape

#: Angle by which a finger joint can close in most of these hands, rad.
FLEXION = 1.6
#: Spread joints reach this far to either side, rad.
SPREAD = 0.35
#: Scale of the meshes of ``millimetre_meshes``.
MILLIMETRE = 0.001

Vector = Sequence[float] | np.ndarray


@dataclass(frozen=True)
class HardHand:
    """A hand and the truth about it.

    Attributes:
        name: of the robot and of its file.
        links: by name; shapes as ``read_urdf`` gives them.
        joints: parents before children. An effort of 0 is left out of the file.
        meshes: file -> mesh in the units of the file (the shape has the scale).
        palm_links: any of these is right; the first carries the palm's surface.
        palm_normal: unit vector out of the palm toward what is grasped; root frame, all joints at
            zero.
        palm_center: a point on the palm's surface; root frame, all joints at zero.
        closing: +1 or -1 for every joint that curls a finger or closes a jaw. Spread, opposition
            and wrist joints and those that only keep a pad parallel are left out.
        distal_links: the last link with geometry of each finger or jaw.
        pads: finger link -> outward unit normal of its inner side, link frame.
    """

    name: str
    links: dict[str, Link]
    joints: tuple[Joint, ...]
    meshes: dict[str, trimesh.Trimesh]
    palm_links: tuple[str, ...]
    palm_normal: np.ndarray
    palm_center: np.ndarray
    closing: dict[str, int]
    distal_links: tuple[str, ...]
    pads: dict[str, np.ndarray]

    @property
    def root(self) -> str:
        """The link that is no joint's child."""
        children = {joint.child for joint in self.joints}
        return next(name for name in self.links if name not in children)


# -- parts ------------------------------------------------------------------------------------


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    """The pose at a point, axes as the parent's."""
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


def facing(z: Vector, x: Vector, point: Vector) -> np.ndarray:
    """The pose whose z axis has direction ``z`` and whose x axis is ``x`` made orthogonal to it."""
    z_axis = np.array(z, float) / np.linalg.norm(z)
    x_axis = np.array(x, float) - np.dot(x, z_axis) * z_axis
    x_axis /= np.linalg.norm(x_axis)
    pose = at(*point)
    pose[:3, :3] = np.stack([x_axis, np.cross(z_axis, x_axis), z_axis], axis=1)
    return pose


def box(x: float, y: float, z: float, pose: np.ndarray | None = None) -> Shape:
    """A box by its edges, its centre at ``pose``."""
    return Shape("box", (x, y, z), at() if pose is None else pose)


def cylinder(radius: float, length: float, pose: np.ndarray | None = None) -> Shape:
    """A cylinder along the z axis of ``pose``, its centre there."""
    return Shape("cylinder", (radius, length), at() if pose is None else pose)


def sphere(radius: float, pose: np.ndarray) -> Shape:
    """A sphere by its radius."""
    return Shape("sphere", (radius,), pose)


def crosswise(radius: float, length: float, z: float = 0.0) -> Shape:
    """A cylinder along y, as a hinge or motor has it."""
    return cylinder(radius, length, facing((0, 1, 0), (1, 0, 0), (0, 0, z)))


@dataclass
class _Builder:
    """Collects the links and joints of one hand."""

    name: str
    effort: float = 0.0
    links: dict[str, Link] = field(default_factory=dict)
    joints: list[Joint] = field(default_factory=list)
    meshes: dict[str, trimesh.Trimesh] = field(default_factory=dict)
    closing: dict[str, int] = field(default_factory=dict)
    distal: list[str] = field(default_factory=list)
    pads: dict[str, np.ndarray] = field(default_factory=dict)

    def link(self, name: str, *shapes: Shape, visuals: Sequence[Shape] | None = None) -> str:
        """Adds a link; what is seen is what collides unless ``visuals`` says otherwise."""
        seen = shapes if visuals is None else tuple(visuals)
        self.links[name] = Link(name, shapes, seen, None)
        return name

    def fixed(self, parent: str, child: str, pose: np.ndarray | None = None) -> None:
        """Fixes ``child`` to ``parent``."""
        limits = (math.nan, math.nan)
        self.joint(f"{child}_fixed", parent, child, pose, (1, 0, 0), limits, kind="fixed")

    def joint(
        self,
        name: str,
        parent: str,
        child: str,
        pose: np.ndarray | None,
        axis: Sequence[float],
        limits: tuple[float, float],
        *,
        kind: str = "revolute",
        closing: int = 0,
        mimic: Mimic | None = None,
    ) -> None:
        """Adds a joint; ``closing`` 0 leaves it out of the truth."""
        lower, upper = (-math.pi, math.pi) if kind == "continuous" else limits
        joint = Joint(
            name=name,
            type=kind,
            parent=parent,
            child=child,
            T_parent_child=at() if pose is None else pose,
            axis=np.array(axis, float) / np.linalg.norm(axis),
            lower=lower,
            upper=upper,
            effort=self.effort,
            velocity=0.0,
            mimic=mimic,
        )
        self.joints.append(joint)
        if closing:
            self.closing[name] = closing

    def millimetre_mesh(self, file: str, mesh: trimesh.Trimesh) -> Shape:
        """Registers a mesh given in metres to be written in millimetres."""
        mesh = mesh.copy()
        mesh.apply_scale(1 / MILLIMETRE)
        self.meshes[file] = mesh
        return Shape("mesh", (MILLIMETRE,) * 3, at(), file)

    def done(
        self, palm_links: Sequence[str], normal: Sequence[float], center: Sequence[float]
    ) -> HardHand:
        """The finished hand."""
        return HardHand(
            self.name,
            self.links,
            tuple(self.joints),
            self.meshes,
            tuple(palm_links),
            np.array(normal, float),
            np.array(center, float),
            self.closing,
            tuple(self.distal),
            self.pads,
        )


_X = np.array([1.0, 0.0, 0.0])
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

    def add(self, hand: _Builder, name: str, parent: str, pose: np.ndarray) -> None:
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
        self, hand: _Builder, name: str, index: int, parent: str, child: str, pose: np.ndarray
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

    def _add_spread(self, hand: _Builder, name: str, parent: str, pose: np.ndarray) -> str:
        knuckle = hand.link(f"{name}_knuckle", crosswise(0.4 * self.thickness, 0.015))
        hand.joint(f"{name}_spread", parent, knuckle, pose, (1, 0, 0), (-SPREAD, SPREAD))
        return knuckle

    def _phalanx(self, hand: _Builder, name: str, length: float, last: bool) -> str:
        thick, body = self.thickness, length - 0.003
        straight = max(body - thick, 0.001)
        hand.pads[name] = _X
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


def _box_palm(hand: _Builder, name: str = "palm") -> str:
    """A palm of 30 × 85 × 95 mm whose centre is at x = 0; its surface is at x = 15 mm."""
    return hand.link(name, box(0.03, 0.085, 0.095, at(z=0.0475)))


_PALM = {"normal": (1, 0, 0), "center": (0.015, 0, 0.05)}


def _row(hand: _Builder, finger: Finger, names: Sequence[str], side: int, parent: str) -> None:
    """Fingers side by side on the upper edge of ``_box_palm``, the first one next to the thumb."""
    for index, name in enumerate(names):
        y = side * (0.011 * (len(names) - 1) - 0.022 * index)
        last = len(names) > 3 and index == len(names) - 1
        scale = 0.8 if last else 1.0
        lengths = tuple(scale * length for length in finger.lengths)
        replace(finger, lengths=lengths).add(hand, name, parent, at(0.002, y, 0.097))


def _thumb(hand: _Builder, finger: Finger, side: int, parent: str, *, beside: bool = False) -> None:
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


def _five_fingers(hand: _Builder, finger: Finger, side: int, parent: str) -> None:
    _row(hand, finger, ("index", "middle", "ring", "little"), side, parent)
    _thumb(hand, finger, side, parent)


def _around(hand: _Builder, finger: Finger, angles: Sequence[float], radius: float) -> None:
    """Upright fingers on a circle about the z axis of ``palm``, closing toward its middle."""
    for index, angle in enumerate(angles, 1):
        out = np.array([math.cos(angle), math.sin(angle), 0.0])
        finger.add(hand, f"finger{index}", "palm", facing((0, 0, 1), -out, radius * out))


THIRDS = (0.0, 2 * math.pi / 3, 4 * math.pi / 3)
#: Two fingers side by side against one.
TWO_TO_ONE = (math.radians(-25), math.radians(25), math.pi)


def _disc_palm(hand: _Builder) -> str:
    """A palm of radius 55 mm whose surface is z = 0."""
    return hand.link("palm", cylinder(0.055, 0.05, at(z=-0.025)))


_DISC = {"normal": (0, 0, 1), "center": (0, 0, 0)}


# -- grippers ---------------------------------------------------------------------------------


def _jaws(name: str, *, drives: str) -> HardHand:
    """Two jaws on a housing; ``drives`` is ``mimic``, ``both`` or ``one``.

    ``mimic`` and ``one``: zero is open and positive closes. ``both``: zero is closed and positive
    opens, as with Panda's hand.
    """
    hand = _Builder(name)
    hand.link("housing", box(0.06, 0.17, 0.08, at(z=-0.04)), cylinder(0.032, 0.02, at(z=-0.09)))
    for side, jaw in ((1, "left_jaw"), (-1, "right_jaw")):
        hand.link(
            jaw,
            box(0.02, 0.03, 0.012, at(y=0.015 * side, z=0.008)),
            box(0.02, 0.012, 0.05, at(y=0.006 * side, z=0.035)),
        )
        hand.pads[jaw] = np.array([0.0, -side, 0.0])
        hand.distal.append(jaw)
        if drives == "one" and side < 0:
            hand.fixed("housing", jaw, at(y=-0.04))
            continue
        travel = 0.08 if drives == "one" else 0.04
        start, closing = (0.0, -1) if drives == "both" else (0.04, 1)
        mimic = Mimic("left_slide", 1.0, 0.0) if drives == "mimic" and side < 0 else None
        hand.joint(
            "left_slide" if side > 0 else "right_slide",
            "housing",
            jaw,
            at(y=side * start),
            (0, -side * closing, 0),
            (0.0, travel),
            kind="prismatic",
            closing=closing,
            mimic=mimic,
        )
    return hand.done(["housing"], (0, 0, 1), (0, 0, 0))


def jaws_mimic() -> HardHand:
    """Parallel jaws, the second follows the first."""
    return _jaws("jaws_mimic", drives="mimic")


def jaws_both_driven() -> HardHand:
    """Parallel jaws with a drive each; they touch at zero."""
    return _jaws("jaws_both_driven", drives="both")


def jaw_and_fixed_jaw() -> HardHand:
    """One moving jaw against one that is fixed to the housing."""
    return _jaws("jaw_and_fixed_jaw", drives="one")


def four_bar() -> HardHand:
    """Parallel gripper of two four-bars: one drive, five mimics, two leaf chains per finger.

    The right side has its axes the other way round, so that its knuckles close
    with negative values.
    """
    hand = _Builder("four_bar")
    hand.link("base", cylinder(0.037, 0.06, at(z=-0.03)), box(0.04, 0.07, 0.05, at(z=0.02)))
    tilt = math.radians(40)
    for side, name in ((1, "left"), (-1, "right")):
        for part, y, z in (("outer_knuckle", 0.03, 0.03), ("inner_knuckle", 0.012, 0.042)):
            bar = facing((0, side * math.sin(tilt), math.cos(tilt)), (1, 0, 0), (0, 0, 0))
            bar[:3, 3] = 0.025 * bar[:3, 2]
            hand.link(f"{name}_{part}", box(0.02, 0.009, 0.05, bar))
            driver = name == "left" and part == "outer_knuckle"
            mimic = None if driver else Mimic("left_outer_knuckle_joint", float(side), 0.0)
            hand.joint(
                f"{name}_{part}_joint",
                "base",
                f"{name}_{part}",
                at(y=side * y, z=z),
                (1, 0, 0),
                (0.0, 0.7) if side > 0 else (-0.7, 0.0),
                closing=side,
                mimic=mimic,
            )
        finger = hand.link(f"{name}_inner_finger", box(0.018, 0.026, 0.012, at(y=-0.009 * side)))
        hand.joint(
            f"{name}_inner_finger_joint",
            f"{name}_outer_knuckle",
            finger,
            at(y=side * 0.05 * math.sin(tilt), z=0.05 * math.cos(tilt)),
            (-1, 0, 0),
            (0.0, 0.7) if side > 0 else (-0.7, 0.0),
            mimic=Mimic("left_outer_knuckle_joint", float(side), 0.0),
        )
        pad = hand.link(f"{name}_pad", box(0.022, 0.008, 0.045, at(z=0.02)))
        hand.fixed(finger, pad, at(y=-0.024 * side))
        hand.pads[pad] = np.array([0.0, -side, 0.0])
        hand.distal.append(pad)
    return hand.done(["base"], (0, 0, 1), (0, 0, 0.045))


def outstretched() -> HardHand:
    """Two fingers that stretch out sideways at zero and close before the palm, on a world link.

    Shapes to collide but none to see.
    """
    hand = _Builder("outstretched")
    hand.link("world")
    hand.link("palm", box(0.06, 0.07, 0.05, at(z=-0.025)))
    hand.fixed("world", "palm", facing((1, 0, 0), (0, 0, 1), (0.05, 0, 0)))
    finger = Finger((0.06, 0.05), limits=(0.0, 1.9), thickness=0.02)
    for side, name in ((1, "finger1"), (-1, "finger2")):
        pose = facing((0, side, 0.1), (0, 0, 1), (0, 0.035 * side, -0.01))
        finger.add(hand, name, "palm", pose)
    hand.links = {name: replace(link, visuals=()) for name, link in hand.links.items()}
    return hand.done(["palm"], (1, 0, 0), (0.05, 0, 0))


# -- hands with fingers around a palm -----------------------------------------------------------


def three_symmetric() -> HardHand:
    """Three equal fingers every 120 degrees; limits from -1 to 1: only geometry tells inside."""
    hand = _Builder("three_symmetric")
    _disc_palm(hand)
    finger = Finger((0.045, 0.04, 0.03), limits=(-1.0, 1.0), thickness=0.02)
    _around(hand, finger, THIRDS, 0.045)
    return hand.done(["palm"], **_DISC)


def three_spread_first() -> HardHand:
    """Three fingers every 120 degrees whose first joint swings sideways; all limits symmetric."""
    hand = _Builder("three_spread_first")
    _disc_palm(hand)
    finger = Finger((0.045, 0.045), limits=(-1.5, 1.5), spread="first", thickness=0.022)
    _around(hand, finger, THIRDS, 0.045)
    return hand.done(["palm"], **_DISC)


def three_opposed() -> HardHand:
    """Two fingers against one; zero is the most closed value of the base joints, negative closes.

    The base joints reach from 0 to 1 and positive values open; the others from -1 to 1.
    """
    hand = _Builder("three_opposed")
    _disc_palm(hand)
    finger = Finger((0.05, 0.035, 0.03), limits=(-1.0, 1.0), sign=-1, thickness=0.02)
    _around(hand, finger, TWO_TO_ONE, 0.045)
    hand.joints = [
        replace(joint, lower=0.0, upper=1.0) if joint.name.endswith("flex1") else joint
        for joint in hand.joints
    ]
    return hand.done(["palm"], **_DISC)


def continuous_joints() -> HardHand:
    """Two fingers against one, joints without limits."""
    hand = _Builder("continuous_joints")
    _disc_palm(hand)
    _around(hand, Finger((0.05, 0.04), kind="continuous"), TWO_TO_ONE, 0.045)
    return hand.done(["palm"], **_DISC)


def adapter_plate() -> HardHand:
    """A mounting plate wider than the hand and a coupling, both fixed under the palm."""
    hand = _Builder("adapter_plate")
    hand.link("plate", cylinder(0.08, 0.012), box(0.04, 0.03, 0.05, at(0.06, 0, -0.02)))
    hand.link("coupling", cylinder(0.03, 0.06, at(z=0.03)))
    hand.fixed("plate", "coupling", at(z=0.006))
    _disc_palm(hand)
    hand.fixed("coupling", "palm", at(z=0.11))
    _around(hand, Finger((0.05, 0.04, 0.03)), TWO_TO_ONE, 0.045)
    return hand.done(["palm"], (0, 0, 1), (0, 0, 0.116))


# -- anthropomorphic hands ----------------------------------------------------------------------


def _anthropomorphic(name: str, finger: Finger, side: int = 1) -> HardHand:
    hand = _Builder(name)
    _five_fingers(hand, finger, side, _box_palm(hand))
    return hand.done(["palm"], **_PALM)


def right_hand() -> HardHand:
    """Five fingers, spread joints first, thumb on the +y side."""
    return _anthropomorphic("right_hand", Finger(spread="first"))


def left_hand() -> HardHand:
    """The mirror image of ``right_hand``."""
    return _anthropomorphic("left_hand", Finger(spread="first"), side=-1)


def symmetric_limits() -> HardHand:
    """A right hand whose flexion joints reach from -1 to 1: only the thumb tells its palm."""
    return _anthropomorphic("symmetric_limits", Finger(limits=(-1.0, 1.0)))


def negative_closes() -> HardHand:
    """A left hand of capsules whose joints close with negative values."""
    return _anthropomorphic("negative_closes", Finger(sign=-1, shape="capsule"), side=-1)


def underactuated() -> HardHand:
    """A right hand with one drive per finger: the other joints follow with an offset."""
    return _anthropomorphic("underactuated", Finger(couple=(0.9, 0.1), limits=(0.0, 1.7)))


def thumb_beside() -> HardHand:
    """A right hand whose thumb lies beside the palm at zero, all of it in one plane."""
    hand = _Builder("thumb_beside")
    _row(hand, Finger(), ("index", "middle", "ring", "little"), 1, _box_palm(hand))
    _thumb(hand, Finger(), 1, "palm", beside=True)
    return hand.done(["palm"], **_PALM)


def two_and_thumb() -> HardHand:
    """Two fingers and a thumb, left; joints reach almost as far back as they close."""
    hand = _Builder("two_and_thumb")
    finger = Finger((0.05, 0.045), limits=(-1.2, 1.5), spread="first", thickness=0.02)
    _row(hand, finger, ("index", "middle"), -1, _box_palm(hand))
    _thumb(hand, finger, -1, "palm")
    return hand.done(["palm"], **_PALM)


def flexion_first() -> HardHand:
    """Three fingers and a thumb; the first joint flexes, the second spreads."""
    hand = _Builder("flexion_first")
    _box_palm(hand)
    finger = Finger((0.05, 0.035, 0.03), limits=(-0.3, 2.0), spread="second")
    _row(hand, finger, ("index", "middle", "ring"), 1, "palm")
    _thumb(hand, finger, 1, "palm")
    return hand.done(["palm"], **_PALM)


def four_fingers() -> HardHand:
    """Three fingers and a thumb, left; tip frames and a camera on a bracket beside the palm."""
    hand = _Builder("four_fingers")
    _box_palm(hand)
    finger = Finger(spread="first", tip_frame=True)
    _row(hand, finger, ("index", "middle", "ring"), -1, "palm")
    _thumb(hand, finger, -1, "palm")
    hand.link("bracket", box(0.004, 0.05, 0.03, at(y=0.025)))
    hand.fixed("palm", "bracket", at(0.005, 0.0425, 0.03))
    hand.link("camera", box(0.03, 0.03, 0.09, at(0.015, 0, 0)))
    hand.fixed("bracket", "camera", at(0.002, 0.06, 0))
    hand.link("camera_optical_frame")
    hand.fixed("camera", "camera_optical_frame", at(0.03, 0, 0))
    return hand.done(["palm"], **_PALM)


def forearm() -> HardHand:
    """A right hand behind a forearm larger than itself and a wrist of two joints.

    The wrist's second joint has the direction of the finger joints.
    """
    hand = _Builder("forearm", effort=2.0)
    hand.link(
        "forearm",
        cylinder(0.055, 0.22, at(z=0.11)),
        box(0.14, 0.12, 0.09, at(-0.01, 0, 0.05)),
    )
    hand.link("wrist", crosswise(0.015, 0.05))
    hand.joint("wrist_deviation", "forearm", "wrist", at(z=0.24), (1, 0, 0), (-0.4, 0.2))
    _box_palm(hand)
    hand.joint("wrist_flexion", "wrist", "palm", at(z=0.02), (0, 1, 0), (-0.7, 0.5))
    _five_fingers(hand, Finger(spread="first"), 1, "palm")
    return hand.done(["palm"], (1, 0, 0), (0.015, 0, 0.31))


def bare_roots() -> HardHand:
    """A left hand behind ``world``, ``base_footprint`` and ``base_link``, none with geometry."""
    hand = _Builder("bare_roots")
    for name in ("world", "base_footprint", "base_link"):
        hand.link(name)
    hand.fixed("world", "base_footprint", facing((1, 0, 0), (0, 0, -1), (0, 0, 0)))
    hand.fixed("base_footprint", "base_link", at(0.02, 0, 0.1))
    hand.fixed("base_link", _box_palm(hand), at(z=0.05))
    _five_fingers(hand, Finger(), -1, "palm")
    return hand.done(["palm"], (0, 0, -1), (0.2, 0, -0.035))


def millimetre_meshes() -> HardHand:
    """A right hand of STL meshes in millimetres, scaled by 0.001."""
    hand = _Builder("millimetre_meshes")
    slab = trimesh.creation.box((0.03, 0.085, 0.095))
    slab.apply_translation((0, 0, 0.0475))
    hand.link("palm", hand.millimetre_mesh("meshes/palm.stl", slab))
    _five_fingers(hand, Finger(shape="mesh"), 1, "palm")
    return hand.done(["palm"], **_PALM)


def many_shapes() -> HardHand:
    """A right hand of several shapes per link; what is seen differs from what collides."""
    hand = _Builder("many_shapes")
    shell = [box(0.004, 0.085, 0.095, at(x, 0, 0.0475)) for x in (-0.013, 0.013)]
    walls = [box(0.03, 0.004, 0.095, at(0, y, 0.0475)) for y in (-0.0405, 0.0405)]
    motors = [cylinder(0.009, 0.07, at(-0.002, y, 0.045)) for y in (-0.03, -0.01, 0.01, 0.03)]
    floor = box(0.03, 0.085, 0.004, at(z=0.002))
    hull = box(0.03, 0.085, 0.095, at(z=0.0475))
    hand.link("palm", hull, visuals=[*shell, *walls, *motors, floor])
    _five_fingers(hand, Finger(shape="many", spread="first"), 1, "palm")
    return hand.done(["palm"], **_PALM)


def split_palm() -> HardHand:
    """A left hand whose palm is several links, one of which moves: the little finger's metacarpal.

    Shapes to see but none to collide; links have masses.
    """
    hand = _Builder("split_palm")
    hand.link("carpus", box(0.03, 0.06, 0.03, at(z=-0.015)))
    hand.link("palm", box(0.022, 0.062, 0.095, at(-0.004, -0.0115, 0.0475)))
    hand.fixed("carpus", "palm")
    hand.link("palm_cover", box(0.008, 0.06, 0.09))
    hand.fixed("palm", "palm_cover", at(0.011, -0.0115, 0.047))
    hand.link("metacarpal", box(0.028, 0.02, 0.075, at(z=0.0375)))
    hand.joint("palm_fold", "palm", "metacarpal", at(0, 0.031, 0.02), (0.0, 0.3, 1.0), (-0.7, 0.0))
    finger = Finger(spread="first")
    for index, name in enumerate(("index", "middle", "ring")):
        finger.add(hand, name, "palm", at(0.002, -0.033 + 0.022 * index, 0.097))
    finger.add(hand, "little", "metacarpal", at(0.002, 0.001, 0.077))
    _thumb(hand, finger, -1, "palm")
    for name, link in hand.links.items():
        inertial = Inertial(0.05, at(z=0.01), np.diag([1e-5, 1e-5, 2e-5]))
        hand.links[name] = replace(link, collisions=(), inertial=inertial)
    return hand.done(["palm_cover", "palm"], (1, 0, 0), (0.015, -0.0115, 0.05))


HARD_HANDS: dict[str, Callable[[], HardHand]] = {
    make.__name__: make
    for make in (
        jaws_mimic,
        jaws_both_driven,
        jaw_and_fixed_jaw,
        four_bar,
        outstretched,
        three_symmetric,
        three_spread_first,
        three_opposed,
        continuous_joints,
        adapter_plate,
        right_hand,
        left_hand,
        symmetric_limits,
        negative_closes,
        underactuated,
        thumb_beside,
        two_and_thumb,
        flexion_first,
        four_fingers,
        forearm,
        bare_roots,
        millimetre_meshes,
        many_shapes,
        split_palm,
    )
}


# -- the same hand, told differently ------------------------------------------------------------


def scramble(hand: HardHand, seed: int) -> HardHand:
    """The same hand with other link frames and joint directions; the truth is changed along.

    Every link's frame (the root's too) is turned at random and its origin moved as far as a URDF
    allows: along the axis of the joint that carries it. Half of the joints are turned round: axis,
    limits, couplings and closing sign negated.
    """
    rng = np.random.default_rng(seed)
    carriers = {joint.child: joint for joint in hand.joints}
    Ts_old_new = {name: _random_frame(rng, carriers.get(name)) for name in hand.links}
    signs = {joint.name: int(rng.choice((-1, 1))) for joint in hand.joints}
    T_new_root = np.linalg.inv(Ts_old_new[hand.root])
    return replace(
        hand,
        links={n: _moved(link, np.linalg.inv(Ts_old_new[n])) for n, link in hand.links.items()},
        joints=tuple(_turned(joint, Ts_old_new, signs) for joint in hand.joints),
        palm_normal=T_new_root[:3, :3] @ hand.palm_normal,
        palm_center=T_new_root[:3, :3] @ hand.palm_center + T_new_root[:3, 3],
        closing={name: signs[name] * sign for name, sign in hand.closing.items()},
        pads={name: Ts_old_new[name][:3, :3].T @ pad for name, pad in hand.pads.items()},
    )


def _random_frame(rng: np.random.Generator, carrier: Joint | None) -> np.ndarray:
    pose = trimesh.transformations.random_rotation_matrix(rng.random(3))
    if carrier is None or carrier.type in ("fixed", "prismatic"):
        pose[:3, 3] = rng.uniform(-0.03, 0.03, 3)
    else:
        pose[:3, 3] = rng.uniform(-0.03, 0.03) * carrier.axis
    return pose


def _moved(link: Link, T_new_old: np.ndarray) -> Link:
    def moved(shapes: Sequence[Shape]) -> tuple[Shape, ...]:
        return tuple(replace(s, T_link_shape=T_new_old @ s.T_link_shape) for s in shapes)

    inertial = link.inertial
    if inertial is not None:
        inertial = replace(inertial, T_link_center=T_new_old @ inertial.T_link_center)
    return Link(link.name, moved(link.collisions), moved(link.visuals), inertial)


def _turned(joint: Joint, Ts_old_new: dict[str, np.ndarray], signs: dict[str, int]) -> Joint:
    T_old_new, sign, mimic = Ts_old_new[joint.child], signs[joint.name], joint.mimic
    if mimic is not None:
        multiplier = float(sign * signs[mimic.joint]) * mimic.multiplier
        mimic = Mimic(mimic.joint, multiplier, sign * mimic.offset)
    lower, upper = (joint.lower, joint.upper) if sign > 0 else (-joint.upper, -joint.lower)
    return replace(
        joint,
        T_parent_child=np.linalg.inv(Ts_old_new[joint.parent]) @ joint.T_parent_child @ T_old_new,
        axis=sign * T_old_new[:3, :3].T @ joint.axis,
        lower=lower,
        upper=upper,
        mimic=mimic,
    )


def rename(hand: HardHand, seed: int) -> HardHand:
    """The same hand, links and joints named ``link_7`` and ``joint_3`` in random order."""
    rng = np.random.default_rng(seed)
    link = _numbered("link", list(hand.links), rng)
    joint = _numbered("joint", [j.name for j in hand.joints], rng)
    joints = [_renamed(j, link, joint) for j in hand.joints]
    return replace(
        hand,
        links={link[name]: replace(value, name=link[name]) for name, value in hand.links.items()},
        joints=tuple(joints),
        palm_links=tuple(link[name] for name in hand.palm_links),
        closing={joint[name]: sign for name, sign in hand.closing.items()},
        distal_links=tuple(link[name] for name in hand.distal_links),
        pads={link[name]: pad for name, pad in hand.pads.items()},
    )


def _numbered(word: str, names: list[str], rng: np.random.Generator) -> dict[str, str]:
    return {name: f"{word}_{n}" for name, n in zip(names, rng.permutation(len(names)), strict=True)}


def _renamed(value: Joint, link: dict[str, str], joint: dict[str, str]) -> Joint:
    mimic = value.mimic
    if mimic is not None:
        mimic = replace(mimic, joint=joint[mimic.joint])
    return replace(
        value,
        name=joint[value.name],
        parent=link[value.parent],
        child=link[value.child],
        mimic=mimic,
    )


# -- files --------------------------------------------------------------------------------------


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
