"""Hands like ours: fingers along +z, the palm faces +x, a right hand's thumb on the +y side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import trimesh

from gdg.hands.urdf import Inertial
from hard_hands.builder import Builder
from hard_hands.fingers import BOX_PALM, Finger, box_palm, five_fingers, row, thumb
from hard_hands.hand import HardHand
from hard_hands.parts import at, box, crosswise, cylinder, facing


def _anthropomorphic(name: str, finger: Finger, side: int = 1) -> HardHand:
    hand = Builder(name)
    five_fingers(hand, finger, side, box_palm(hand))
    return hand.done(["palm"], **BOX_PALM)


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
    hand = Builder("thumb_beside")
    row(hand, Finger(), ("index", "middle", "ring", "little"), 1, box_palm(hand))
    thumb(hand, Finger(), 1, "palm", beside=True)
    return hand.done(["palm"], **BOX_PALM)


def two_and_thumb() -> HardHand:
    """Two fingers and a thumb, left; joints reach almost as far back as they close."""
    hand = Builder("two_and_thumb")
    finger = Finger((0.05, 0.045), limits=(-1.2, 1.5), spread="first", thickness=0.02)
    row(hand, finger, ("index", "middle"), -1, box_palm(hand))
    thumb(hand, finger, -1, "palm")
    return hand.done(["palm"], **BOX_PALM)


def flexion_first() -> HardHand:
    """Three fingers and a thumb; the first joint flexes, the second spreads."""
    hand = Builder("flexion_first")
    box_palm(hand)
    finger = Finger((0.05, 0.035, 0.03), limits=(-0.3, 2.0), spread="second")
    row(hand, finger, ("index", "middle", "ring"), 1, "palm")
    thumb(hand, finger, 1, "palm")
    return hand.done(["palm"], **BOX_PALM)


def four_fingers() -> HardHand:
    """Three fingers and a thumb, left; tip frames and a camera on a bracket beside the palm."""
    hand = Builder("four_fingers")
    box_palm(hand)
    finger = Finger(spread="first", tip_frame=True)
    row(hand, finger, ("index", "middle", "ring"), -1, "palm")
    thumb(hand, finger, -1, "palm")
    hand.link("bracket", box(0.004, 0.05, 0.03, at(y=0.025)))
    hand.fixed("palm", "bracket", at(0.005, 0.0425, 0.03))
    hand.link("camera", box(0.03, 0.03, 0.09, at(0.015, 0, 0)))
    hand.fixed("bracket", "camera", at(0.002, 0.06, 0))
    hand.link("camera_optical_frame")
    hand.fixed("camera", "camera_optical_frame", at(0.03, 0, 0))
    return hand.done(["palm"], **BOX_PALM)


def forearm() -> HardHand:
    """A right hand behind a forearm larger than itself and a wrist of two joints.

    The wrist's second joint has the direction of the finger joints.
    """
    hand = Builder("forearm", effort=2.0)
    hand.link(
        "forearm",
        cylinder(0.055, 0.22, at(z=0.11)),
        box(0.14, 0.12, 0.09, at(-0.01, 0, 0.05)),
    )
    hand.link("wrist", crosswise(0.015, 0.05))
    hand.joint("wrist_deviation", "forearm", "wrist", at(z=0.24), (1, 0, 0), (-0.4, 0.2))
    box_palm(hand)
    hand.joint("wrist_flexion", "wrist", "palm", at(z=0.02), (0, 1, 0), (-0.7, 0.5))
    five_fingers(hand, Finger(spread="first"), 1, "palm")
    return hand.done(["palm"], (1, 0, 0), (0.015, 0, 0.31))


def bare_roots() -> HardHand:
    """A left hand behind ``world``, ``base_footprint`` and ``base_link``, none with geometry."""
    hand = Builder("bare_roots")
    for name in ("world", "base_footprint", "base_link"):
        hand.link(name)
    hand.fixed("world", "base_footprint", facing((1, 0, 0), (0, 0, -1), (0, 0, 0)))
    hand.fixed("base_footprint", "base_link", at(0.02, 0, 0.1))
    hand.fixed("base_link", box_palm(hand), at(z=0.05))
    five_fingers(hand, Finger(), -1, "palm")
    return hand.done(["palm"], (0, 0, -1), (0.2, 0, -0.035))


def millimetre_meshes() -> HardHand:
    """A right hand of STL meshes in millimetres, scaled by 0.001."""
    hand = Builder("millimetre_meshes")
    slab = trimesh.creation.box((0.03, 0.085, 0.095))
    slab.apply_translation((0, 0, 0.0475))
    hand.link("palm", hand.millimetre_mesh("meshes/palm.stl", slab))
    five_fingers(hand, Finger(shape="mesh"), 1, "palm")
    return hand.done(["palm"], **BOX_PALM)


def many_shapes() -> HardHand:
    """A right hand of several shapes per link; what is seen differs from what collides."""
    hand = Builder("many_shapes")
    shell = [box(0.004, 0.085, 0.095, at(x, 0, 0.0475)) for x in (-0.013, 0.013)]
    walls = [box(0.03, 0.004, 0.095, at(0, y, 0.0475)) for y in (-0.0405, 0.0405)]
    motors = [cylinder(0.009, 0.07, at(-0.002, y, 0.045)) for y in (-0.03, -0.01, 0.01, 0.03)]
    floor = box(0.03, 0.085, 0.004, at(z=0.002))
    hull = box(0.03, 0.085, 0.095, at(z=0.0475))
    hand.link("palm", hull, visuals=[*shell, *walls, *motors, floor])
    five_fingers(hand, Finger(shape="many", spread="first"), 1, "palm")
    return hand.done(["palm"], **BOX_PALM)


def split_palm() -> HardHand:
    """A left hand whose palm is several links, one of which moves: the little finger's metacarpal.

    Shapes to see but none to collide; links have masses.
    """
    hand = Builder("split_palm")
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
    thumb(hand, finger, -1, "palm")
    for name, link in hand.links.items():
        inertial = Inertial(0.05, at(z=0.01), np.diag([1e-5, 1e-5, 2e-5]))
        hand.links[name] = replace(link, collisions=(), inertial=inertial)
    return hand.done(["palm_cover", "palm"], (1, 0, 0), (0.015, -0.0115, 0.05))
