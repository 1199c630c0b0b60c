"""Checks that links don't lie in each other in the open and in the closed posture."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gdg.geometry.overlap import ConvexBody, body_of, penetration_depth
from gdg.hands.geometry import ConvexPart
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
    for (first, second), depth in link_overlaps(case, Ts_root_link).items():
        yield error(
            case.in_manifest(posture),
            f"'{first}' and '{second}' lie {1000 * depth:.1f} mm in each other (at most "
            f"{1000 * MAX_OVERLAP_M:g} mm); {remedy}, or add [{first}, {second}] to "
            f"allowed_self_contacts if the real parts don't touch.",
        )


def link_overlaps(case: HandCase, Ts_root_link: np.ndarray) -> dict[tuple[str, str], float]:
    """Pairs of links that must not touch -> how deep they lie in each other, metres.

    Only depths above ``MAX_OVERLAP_M``; of links with several convex parts the deepest two count.
    """
    names, apart = case.hand.link_names, case.hand.may_collide()
    placed = {
        index: [_body(part).placed(Ts_root_link[index]) for part in case.parts_of(name)]
        for index, name in enumerate(names)
    }
    found: dict[tuple[str, str], float] = {}
    for a, b in np.argwhere(np.triu(apart)).tolist():
        depth = max(
            (penetration_depth(x, y, MAX_OVERLAP_M) for x in placed[a] for y in placed[b]),
            default=0.0,
        )
        if depth > MAX_OVERLAP_M:
            found[names[a], names[b]] = depth
    return found


def _body(part: ConvexPart) -> ConvexBody:
    if part.kind == "sphere":
        return ConvexBody(part.T_link_part[None, :3, 3], np.zeros((0, 3)), part.size[0])
    return body_of(part.mesh)


CHECKS = (open_posture, closed_posture)
