"""Hands whose fingers stand around a palm that faces +z."""

from __future__ import annotations

from dataclasses import replace

from hard_hands.builder import Builder
from hard_hands.fingers import DISC_PALM, THIRDS, TWO_TO_ONE, Finger, around, disc_palm
from hard_hands.hand import HardHand
from hard_hands.parts import at, box, cylinder


def three_symmetric() -> HardHand:
    """Three equal fingers every 120 degrees; limits from -1 to 1: only geometry tells inside."""
    hand = Builder("three_symmetric")
    disc_palm(hand)
    finger = Finger((0.045, 0.04, 0.03), limits=(-1.0, 1.0), thickness=0.02)
    around(hand, finger, THIRDS, 0.045)
    return hand.done(["palm"], **DISC_PALM)


def three_spread_first() -> HardHand:
    """Three fingers every 120 degrees whose first joint swings sideways; all limits symmetric."""
    hand = Builder("three_spread_first")
    disc_palm(hand)
    finger = Finger((0.045, 0.045), limits=(-1.5, 1.5), spread="first", thickness=0.022)
    around(hand, finger, THIRDS, 0.045)
    return hand.done(["palm"], **DISC_PALM)


def three_opposed() -> HardHand:
    """Two fingers against one; zero is the most closed value of the base joints, negative closes.

    The base joints reach from 0 to 1 and positive values open; the others from -1 to 1.
    """
    hand = Builder("three_opposed")
    disc_palm(hand)
    finger = Finger((0.05, 0.035, 0.03), limits=(-1.0, 1.0), sign=-1, thickness=0.02)
    around(hand, finger, TWO_TO_ONE, 0.045)
    hand.joints = [
        replace(joint, lower=0.0, upper=1.0) if joint.name.endswith("flex1") else joint
        for joint in hand.joints
    ]
    return hand.done(["palm"], **DISC_PALM)


def continuous_joints() -> HardHand:
    """Two fingers against one, joints without limits."""
    hand = Builder("continuous_joints")
    disc_palm(hand)
    around(hand, Finger((0.05, 0.04), kind="continuous"), TWO_TO_ONE, 0.045)
    return hand.done(["palm"], **DISC_PALM)


def adapter_plate() -> HardHand:
    """A mounting plate wider than the hand and a coupling, both fixed under the palm."""
    hand = Builder("adapter_plate")
    hand.link("plate", cylinder(0.08, 0.012), box(0.04, 0.03, 0.05, at(0.06, 0, -0.02)))
    hand.link("coupling", cylinder(0.03, 0.06, at(z=0.03)))
    hand.fixed("plate", "coupling", at(z=0.006))
    disc_palm(hand)
    hand.fixed("coupling", "palm", at(z=0.11))
    around(hand, Finger((0.05, 0.04, 0.03)), TWO_TO_ONE, 0.045)
    return hand.done(["palm"], (0, 0, 1), (0, 0, 0.116))
