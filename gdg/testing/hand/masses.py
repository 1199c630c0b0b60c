"""Checks of masses and inertias against the shapes that they belong to."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import trimesh

from gdg.hands.urdf import Inertial
from gdg.testing.findings import Finding, error, warning
from gdg.testing.hand.case import HandCase

#: Simulators give a body without a plausible mass this density, kg/m³, and hold densities outside
#: the second figures for implausible: foam, and more than lead.
ASSUMED_DENSITY = 1000.0
PLAUSIBLE_DENSITY = (100.0, 12_000.0)
#: Principal moments may break the triangle inequality by this share, which rounding does.
TRIANGLE_TOLERANCE = 0.01
#: Moments may differ by this factor from those of a box around the shapes.
MOMENT_FACTOR = 10.0
#: The centre of mass may lie this far outside the box around the shapes, metres.
CENTER_SLACK_M = 0.01


def masses(case: HandCase) -> Iterator[Finding]:
    """Every body with shapes has a mass that its volume explains."""
    told: dict[str, list[str]] = {}
    for links in case.bodies.values():
        volume = sum(abs(part.mesh.volume) for link in links for part in case.parts_of(link))
        mass = sum(case.hand.urdf.links[link].mass for link in links)
        text = _mass_mistake(mass, volume) if volume > 0 else ""
        if text:
            told.setdefault(text, []).extend(link for link in links if case.parts_of(link))
    for text, links in told.items():
        yield warning(case.at_links(links), text)


def _mass_mistake(mass: float, volume: float) -> str:
    """What is wrong with a body's mass; empty if nothing is."""
    instead = f"simulators compute it from the volume at {ASSUMED_DENSITY:g} kg/m³"
    if mass <= 0:
        return f"no mass is given, so {instead}; add an <inertial>."
    low, high = PLAUSIBLE_DENSITY
    if low <= mass / volume <= high:
        return ""
    return (
        f"a mass of {mass:.3g} kg in {1e6 * volume:.3g} cm³ is {mass / volume:.3g} kg/m³, not "
        f"between {low:g} and {high:g}, so {instead}; check mass and shapes."
    )


def inertias(case: HandCase) -> Iterator[Finding]:
    """Inertias are physically possible and of the size that mass and shapes give."""
    unlike: dict[str, list[str]] = {}
    for link in case.hand.urdf.links.values():
        if link.inertial is None:
            continue
        where = case.at_links([link.name])
        mistake = _impossible(link.inertial)
        if mistake:
            yield error(where, mistake)
            continue
        vertices = [part.mesh.vertices for part in case.parts_of(link.name)]
        if vertices and link.inertial.mass > 0:
            points = np.concatenate(vertices)
            center = _center_off(link.inertial, points)
            if center > CENTER_SLACK_M:
                yield warning(
                    where,
                    f"the centre of mass lies {1000 * center:.0f} mm outside the box around the "
                    f"link's shapes; check the inertial's origin.",
                )
            text = _unlike_box(link.inertial, points)
            if text:
                unlike.setdefault(text, []).append(link.name)
    for text, links in unlike.items():
        yield warning(case.at_links(links), text)


def _impossible(inertial: Inertial) -> str:
    """Why no body can have this mass and inertia; empty if one can."""
    moments = np.linalg.eigvalsh(inertial.inertia)
    told = ", ".join(f"{moment:.3g}" for moment in moments)
    if inertial.mass <= 0:
        if not (moments == 0).all():
            return f"an inertia ({told} kg m²) without a mass; write <mass value=…>."
        return ""
    if not moments[0] > 0:
        return (
            f"the principal moments {told} kg m² must all be positive; compute the inertia from "
            f"the shapes."
        )
    if moments[2] > (moments[0] + moments[1]) * (1 + TRIANGLE_TOLERANCE):
        return (
            f"the principal moments {told} kg m² are those of no body: each is at most the sum "
            f"of the others. Compute the inertia from the shapes."
        )
    return ""


def _center_off(inertial: Inertial, points: np.ndarray) -> float:
    """How far the centre of mass lies outside the box around points of the link's frame."""
    center = inertial.T_link_center[:3, 3]
    outside = np.maximum(points.min(0) - center, center - points.max(0))
    return float(np.linalg.norm(np.maximum(outside, 0.0)))


def _unlike_box(inertial: Inertial, points: np.ndarray) -> str:
    """How the inertia differs from that of a box around the shapes; empty if it is alike."""
    local = trimesh.transform_points(points, np.linalg.inv(inertial.T_link_center))
    squares = np.ptp(local, axis=0) ** 2
    box = np.sort(inertial.mass / 12 * (squares.sum() - squares))
    moments = np.linalg.eigvalsh(inertial.inertia)
    ratio = moments / np.maximum(box, 1e-15)
    if ((ratio < 1 / MOMENT_FACTOR) | (ratio > MOMENT_FACTOR)).any():
        given, boxed = (", ".join(f"{m:.2g}" for m in three) for three in (moments, box))
        return (
            f"the principal moments {given} kg m² are far from those of a box of that mass around "
            f"the shapes ({boxed}); gdg's simulators compute them from the shapes."
        )
    return ""


CHECKS = (masses, inertias)
