"""Joints and drives in words, for terminals and reports."""

from __future__ import annotations

from gdg.hands.hand import Hand
from gdg.hands.spec import Drive


def followers(hand: Hand) -> list[str]:
    """One phrase per mimic joint: ``tip follows base × 0.34``."""
    phrases = []
    for joint in hand.moving_joints:
        if joint.mimic is not None:
            factor, offset = joint.mimic.multiplier, joint.mimic.offset
            times = "" if factor == 1 else f" × {factor:.3g}"
            plus = "" if offset == 0 else f" {'+' if offset > 0 else '-'} {abs(offset):.3g}"
            phrases.append(f"{joint.name} follows {joint.mimic.joint}{times}{plus}")
    return phrases


def units_of(hand: Hand, joint: str) -> tuple[str, str]:
    """Unit of a joint's value and of its drive's force: ``rad`` and ``N m``, or ``m`` and ``N``."""
    return ("m", "N") if hand.urdf.joints[joint].type == "prismatic" else ("rad", "N m")


def drive_text(drive: Drive, unit: str, force: str) -> str:
    """Gains and force limit in one phrase."""
    return (
        f"drive {drive.stiffness:g} {force}/{unit}, {drive.damping:g} {force} s/{unit}, at most "
        f"{drive.force_limit:g} {force}"
    )
