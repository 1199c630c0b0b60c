"""Checks that links don't lie in each other in the open and in the closed posture."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gdg.hands.self_collision import LinkBodies
from gdg.testing.findings import Finding, error
from gdg.testing.hand.case import HandCase

#: Links may lie in each other by this, metres: closed fingertips touch.
MAX_OVERLAP_M = 0.003


def open_posture(case: HandCase) -> Iterator[Finding]:
    """Links that must not touch don't overlap when the hand is open."""
    yield from _overlaps(case, "open", case.Ts_open, "open the hand further")


def closed_posture(case: HandCase) -> Iterator[Finding]:
    """Links that must not touch don't overlap when the hand is closed, beyond a touch."""
    yield from _overlaps(case, "closed", case.Ts_closed, "close it less")


def _overlaps(
    case: HandCase, posture: str, Ts_root_link: np.ndarray, remedy: str
) -> Iterator[Finding]:
    found = LinkBodies(case.hand).overlaps(Ts_root_link, case.hand.may_collide(), MAX_OVERLAP_M)
    for (first, second), depth in found.items():
        yield error(
            case.in_manifest(posture),
            f"'{first}' and '{second}' lie {1000 * depth:.1f} mm in each other (at most "
            f"{1000 * MAX_OVERLAP_M:g} mm); {remedy}, or add [{first}, {second}] to "
            f"allowed_self_contacts if the real parts don't touch.",
        )


CHECKS = (open_posture, closed_posture)
