"""Checks the mass properties of links against their shapes, and computes what is not plausible."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import trimesh

from gdg.hands.intake.description import Description, named
from gdg.hands.intake.surfaces import solid, surface
from gdg.hands.urdf import Inertial, Link

#: Given to links without a plausible mass, kg/m³: plastics and aluminium with hollows.
DENSITY = 1000.0
#: A link that is lighter or heavier than this has a placeholder for a mass, kg/m³ ...
PLAUSIBLE_DENSITY = (30.0, 9000.0)
#: ... but this much may sit in a link that is drawn as a mere dot, kg.
SMALL_MASS = 0.05
#: No computed mass is less, kg: physics engines need some.
MIN_MASS = 0.001
#: A link's box counts as at least so large when inertia is judged, metres.
MIN_BOX_M = 0.01
#: An inertia further than this factor from that of the link's box is a placeholder.
MAX_INERTIA_RATIO = 100.0
#: Rounded figures may break the triangle inequality by this share, as in gdg.testing.hand.masses.
TRIANGLE_SLACK = 0.01


def mend_inertials(description: Description, role: str) -> None:
    """Gives every link with shapes plausible mass properties; keeps those that are.

    Args:
        description: mended in place.
        role: which shapes are the hand's geometry.
    """
    links = dict(description.urdf.links)
    missing, heavy, odd = [], [], []
    for name, link in links.items():
        solids = _solids(description, link, role)
        if not solids:
            if link.inertial is not None and not _is_inertia(link.inertial):
                links[name] = replace(link, inertial=None)
            continue
        computed, given = _of_solids(solids), link.inertial
        if given is None or given.mass == 0.0:
            missing.append(name)
        elif not _plausible_mass(description, link, given.mass):
            heavy.append(name)
        elif not _plausible_inertia(given, solids):
            odd.append(name)
            share = given.mass / computed.mass
            computed = replace(computed, mass=given.mass, inertia=share * computed.inertia)
        else:
            continue
        links[name] = replace(link, inertial=computed)
    description.urdf = replace(description.urdf, links=links)
    _say(description, missing, heavy, odd)


def _say(description: Description, missing: list[str], heavy: list[str], odd: list[str]) -> None:
    computed = f"computed from the shapes at {DENSITY:g} kg/m³."
    if missing:
        description.repairs.append(f"{named(missing)}: no mass given; {computed}")
    if heavy:
        description.repairs.append(
            f"{named(heavy)}: mass impossible for the size (a placeholder); {computed}"
        )
    if odd:
        description.repairs.append(
            f"{named(odd)}: inertia impossible for mass and size (a placeholder); computed from "
            "the shapes and the given mass."
        )


def _solids(description: Description, link: Link, role: str) -> list[trimesh.Trimesh]:
    chosen, other = link.collisions, link.visuals
    if role == "visual":
        chosen, other = other, chosen
    return [solid(surface(description, shape)) for shape in chosen or other]


def _of_solids(solids: Sequence[trimesh.Trimesh]) -> Inertial:
    """Mass properties of solids of uniform density; where they overlap, they count twice."""
    masses = [DENSITY * abs(float(part.volume)) for part in solids]
    mass = sum(masses)
    center = sum(m * part.center_mass for m, part in zip(masses, solids)) / mass
    inertia = np.zeros((3, 3))
    for m, part in zip(masses, solids):
        away = part.center_mass - center
        about_own = DENSITY * np.asarray(part.moment_inertia) * np.sign(float(part.volume))
        inertia += about_own + m * (away @ away * np.eye(3) - np.outer(away, away))
    more = max(1.0, MIN_MASS / mass)
    T_link_center = trimesh.transformations.translation_matrix(center)
    return Inertial(more * mass, T_link_center, more * inertia)


def _plausible_mass(description: Description, link: Link, mass: float) -> bool:
    """Whether the density is possible for the larger of the link's two geometries."""
    volume = max(
        sum(abs(float(part.volume)) for part in _solids(description, link, role))
        for role in ("collision", "visual")
    )
    lightest, heaviest = (density * volume for density in PLAUSIBLE_DENSITY)
    return lightest <= mass <= max(heaviest, SMALL_MASS)


def _is_inertia(inertial: Inertial) -> bool:
    """Whether mass and moments are positive, and no moment above the sum of the other two."""
    moments = np.linalg.eigvalsh(inertial.inertia)
    positive = inertial.mass > 0.0 and moments[0] > 0.0
    return bool(positive and moments[2] <= (1.0 + TRIANGLE_SLACK) * (moments[0] + moments[1]))


def _plausible_inertia(inertial: Inertial, solids: Sequence[trimesh.Trimesh]) -> bool:
    if not _is_inertia(inertial):
        return False
    low = np.min([part.bounds[0] for part in solids], axis=0)
    high = np.max([part.bounds[1] for part in solids], axis=0)
    size = high - low
    center = inertial.T_link_center[:3, 3]
    if (np.abs(center - (low + high) / 2) > size + 0.01).any():
        return False
    # the trace of a box's inertia is m * sum(size²) / 6
    size = np.maximum(size, MIN_BOX_M)
    ratio = float(np.trace(inertial.inertia)) / (inertial.mass * float(size @ size) / 6.0)
    return 1.0 / MAX_INERTIA_RATIO <= ratio <= MAX_INERTIA_RATIO
