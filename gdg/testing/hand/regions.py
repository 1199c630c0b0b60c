"""Checks of contact regions: on the surface, facing outward, on every fingertip."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gdg.geometry.quadrilateral import grid_on
from gdg.hands.geometry import ConvexPart
from gdg.testing.findings import Finding, error, warning
from gdg.testing.hand.case import HandCase, listed
from gdg.testing.surface import nearest_surface

#: Contact regions may lie this far off their link's shapes, metres, and must be larger, m².
MAX_REGION_GAP_M = 0.002
MIN_REGION_AREA_M2 = 1e-6
#: Points per side of the grid on each region.
GRID = 5


def contact_regions(case: HandCase) -> Iterator[Finding]:
    """Regions lie on their link's surface, face outward and have an area."""
    for link, regions in case.hand.spec.contact_regions.items():
        parts = case.parts_of(link)
        if not parts:
            yield error(
                case.in_manifest(f"contact_regions.{link}"),
                f"the link has no {case.hand.spec.geometry} shapes to touch with; give the "
                f"regions to a link that has.",
            )
            continue
        for number, corners in enumerate(regions):
            place = case.in_manifest(f"contact_regions.{link}[{number}]")
            for text in _region_mistakes(parts, np.array(corners)):
                yield error(place, text)


def _region_mistakes(parts: list[ConvexPart], corners: np.ndarray) -> Iterator[str]:
    across = np.cross(corners[2] - corners[0], corners[3] - corners[1])
    area = float(np.linalg.norm(across)) / 2
    if area < MIN_REGION_AREA_M2:
        yield (
            f"has only {1e6 * area:.2g} mm² (at least {1e6 * MIN_REGION_AREA_M2:g} mm²); are the "
            f"corners in metres?"
        )
        return
    nearest = nearest_surface(parts, grid_on(corners, GRID))
    gap = float(np.abs(nearest.distance).max())
    if gap > MAX_REGION_GAP_M:
        yield (
            f"lies up to {1000 * gap:.1f} mm off the link's surface (at most "
            f"{1000 * MAX_REGION_GAP_M:.0f} mm); move the corners onto it, or split the region "
            f"where the surface bends."
        )
    if float((nearest.normals @ across).mean()) <= 0:
        yield "faces into the link; list the corners counter-clockwise as seen from outside."


def fingertips(case: HandCase) -> Iterator[Finding]:
    """Each finger's last body has a contact region."""
    hand = case.hand
    if not any(hand.spec.contact_regions.values()):
        yield warning(
            case.in_manifest("contact_regions"),
            "there is none: planners that choose contact points can't use this hand.",
        )
        return
    carriers = {case.body_of(joint.parent) for joint in hand.moving_joints}
    bare = []
    for joint in hand.moving_joints:
        body = case.body_of(joint.child)
        links = [link for link in case.bodies[body] if case.parts_of(link)]
        touched = any(hand.spec.contact_regions.get(link) for link in case.bodies[body])
        if body not in carriers and links and not touched:
            bare.append(links[-1])
    if bare:
        yield warning(
            case.in_manifest("contact_regions"),
            f"none on {listed(bare)}, the last of a finger: no contact is planned there.",
        )


CHECKS = (contact_regions, fingertips)
