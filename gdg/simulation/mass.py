"""Mass, centre of mass and inertia of rigid bodies, in the form engines take them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh

from gdg.objects.model import ObjectModel
from gdg.protocols import Body

#: Density of hand links without a plausible mass of their own, kg/m³.
LINK_DENSITY = 1000.0
#: URDF masses that mean a density outside this range are placeholders or slips, kg/m³.
PLAUSIBLE_DENSITY = (100.0, 12_000.0)
#: Lower bounds that keep stiff drives on tiny links well conditioned: kg, and kg m² (a cube of
#: 10 g with sides of 2.4 cm).
MIN_LINK_MASS = 0.01
MIN_LINK_INERTIA = 1e-6


@dataclass(frozen=True)
class MassProperties:
    """Mass properties of one rigid body.

    Attributes:
        mass: kg.
        center: centre of mass, body frame, metres.
        rotation: columns are the principal axes in the body frame.
        moments: principal moments of inertia, kg m².
    """

    mass: float
    center: np.ndarray
    rotation: np.ndarray
    moments: np.ndarray


def object_mass(obj: ObjectModel, body: Body) -> MassProperties:
    """Mass properties of the object, of uniform density, as a protocol gives density or mass."""
    density = body.density if body.mass_kg is None else body.mass_kg / obj.volume
    assert density is not None
    inertia = density * obj.inertia.cpu().double().numpy()
    center = obj.center_of_mass.cpu().double().numpy()
    return _principal(density * obj.volume, center, inertia)


def link_mass(given: float, meshes: Sequence[trimesh.Trimesh]) -> MassProperties:
    """Mass properties of a hand's body, each convex part taken as the box around it.

    Args:
        given: mass by the URDF, kg; replaced by that of ``LINK_DENSITY`` if not plausible.
        meshes: the body's parts in its frame; none for a body without shapes.
    """
    volumes = np.array([abs(float(mesh.volume)) for mesh in meshes])
    low, high = PLAUSIBLE_DENSITY
    volume = float(volumes.sum())
    plausible = low * volume <= given <= high * volume
    mass = max(given if plausible else LINK_DENSITY * volume, MIN_LINK_MASS)
    if not meshes:
        return MassProperties(mass, np.zeros(3), np.eye(3), np.full(3, MIN_LINK_INERTIA))
    shares = mass * volumes / volumes.sum()
    middles = np.array([mesh.bounds.mean(0) for mesh in meshes])
    center = shares @ middles / mass
    inertia = np.zeros((3, 3))
    for share, middle, mesh in zip(shares, middles, meshes, strict=True):
        inertia += _box_inertia(share, mesh.extents) + _shifted(share, middle - center)
    principal = _principal(mass, center, inertia)
    # one floor for all three, in proportion to the largest, keeps the triangle inequality
    floor = max(MIN_LINK_INERTIA, 0.05 * float(principal.moments.max()))
    moments = np.maximum(principal.moments, floor)
    return MassProperties(mass, center, principal.rotation, moments)


def _box_inertia(mass: float, extents: np.ndarray) -> np.ndarray:
    squares = np.asarray(extents, np.float64) ** 2
    return np.diag(mass / 12 * (squares.sum() - squares))


def _shifted(mass: float, arm: np.ndarray) -> np.ndarray:
    """What the parallel-axis theorem adds for a mass at ``arm`` from the centre."""
    return mass * (np.eye(3) * (arm @ arm) - np.outer(arm, arm))


def _principal(mass: float, center: np.ndarray, inertia: np.ndarray) -> MassProperties:
    moments, axes = np.linalg.eigh((inertia + inertia.T) / 2)
    if np.linalg.det(axes) < 0:
        axes[:, 0] = -axes[:, 0]
    return MassProperties(mass, center, axes, np.maximum(moments, 1e-12))
