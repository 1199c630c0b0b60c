"""Grippers: two jaws or two fingers, which face +z."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from gdg.hands.urdf import Mimic
from hard_hands.builder import Builder
from hard_hands.fingers import Finger
from hard_hands.hand import HardHand
from hard_hands.parts import at, box, cylinder, facing


def _jaws(name: str, *, drives: str) -> HardHand:
    """Two jaws on a housing; ``drives`` is ``mimic``, ``both`` or ``one``.

    ``mimic`` and ``one``: zero is open and positive closes. ``both``: zero is closed and positive
    opens, as with Panda's hand.
    """
    hand = Builder(name)
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
    hand = Builder("four_bar")
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
    hand = Builder("outstretched")
    hand.link("world")
    hand.link("palm", box(0.06, 0.07, 0.05, at(z=-0.025)))
    hand.fixed("world", "palm", facing((1, 0, 0), (0, 0, 1), (0.05, 0, 0)))
    finger = Finger((0.06, 0.05), limits=(0.0, 1.9), thickness=0.02)
    for side, name in ((1, "finger1"), (-1, "finger2")):
        pose = facing((0, side, 0.1), (0, 0, 1), (0, 0.035 * side, -0.01))
        finger.add(hand, name, "palm", pose)
    hand.links = {name: replace(link, visuals=()) for name, link in hand.links.items()}
    return hand.done(["palm"], (1, 0, 0), (0.05, 0, 0))
