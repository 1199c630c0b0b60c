"""Checks of a hand folder, beyond what loading it refuses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import torch

from gdg.errors import GdgError, GdgErrors
from gdg.hands.geometry import HIDDEN_STEP_M, ConvexPart, hand_spheres
from gdg.hands.hand import Hand, load_hand
from gdg.kinds.hand_model import HandModel
from gdg.testing.checks import not_rigid, run_checks, seeded
from gdg.testing.fixtures import model_of
from gdg.testing.surface import nearest_surface

#: Random postures in which the kinematics are tried.
POSTURES = 32
#: Surface points that are checked.
SURFACE_POINTS = 800
#: A joint must move some surface point by this over its range, metres.
MIN_MOTION_M = 1e-4
#: The palm's centre may lie this far off the palm's shapes, metres.
MAX_PALM_GAP_M = 0.02
#: Contact regions may lie this far off their link's shapes, metres, and must be larger, m².
MAX_REGION_GAP_M = 0.008
MIN_REGION_AREA_M2 = 1e-6
#: Inscribed spheres may overlap by this in the open posture, metres.
MAX_OVERLAP_M = 0.003
#: Points per side of the grid on each region.
GRID = 5


@dataclass(frozen=True)
class HandCase:
    """A loaded hand with its model."""

    hand: Hand
    model: HandModel

    def parts_of(self, link: str) -> list[ConvexPart]:
        """The convex parts of one link."""
        return [part for part in self.hand.parts if part.link == link]

    @cached_property
    def postures(self) -> torch.Tensor:
        """Random joint values within limits, (posture, joint)."""
        share = torch.rand(POSTURES, len(self.model.joint_names), generator=seeded())
        return self.model.lower + share * (self.model.upper - self.model.lower)


def hand_problems(folder: Path) -> list[str]:
    """See ``gdg.testing.check_hand``."""
    try:
        hand = load_hand(folder)
        case = HandCase(hand, model_of(hand, SURFACE_POINTS))
    except GdgErrors as errors:
        return list(errors.messages)
    except GdgError as error:
        return [str(error)]
    return run_checks(CHECKS, case)


def joint_limits(case: HandCase) -> Iterator[str]:
    """Limits are finite and ordered."""
    for name, low, high in zip(case.hand.spec.joints, *case.hand.limits()):
        if not (np.isfinite([low, high]).all() and low < high):
            yield f"joint '{name}': the lower limit {low:g} must be below the upper one {high:g}."


def kinematics(case: HandCase) -> Iterator[str]:
    """Link poses are rigid in random postures, and every joint moves the hand's surface."""
    model = case.model
    if bool(not_rigid(model.link_poses_in_root(case.postures)).any()):
        yield "link poses are not finite or not rigid in a random posture within the limits."
    for index, name in enumerate(model.joint_names):
        ends = ((model.lower + model.upper) / 2).repeat(2, 1)
        ends[0, index], ends[1, index] = model.lower[index], model.upper[index]
        first, last = model.place_surface(model.link_poses_in_root(ends))
        if not (first - last).norm(dim=-1).max() > MIN_MOTION_M:
            yield f"joint '{name}' moves no surface of the hand; leave it out of joints."


def postures(case: HandCase) -> Iterator[str]:
    """Open and closed postures are within limits and differ."""
    lower, upper = case.hand.limits()
    both = {which: case.hand.posture(which) for which in ("open", "closed")}
    for which, values in both.items():
        for index in np.flatnonzero((values < lower - 1e-3) | (values > upper + 1e-3)):
            joint = case.hand.spec.joints[index]
            yield f"{which}.{joint}: {values[index]:g} is outside the joint's limits."
    if not (np.abs(both["open"] - both["closed"]) > 1e-3 * (upper - lower)).any():
        yield "open and closed are the same posture; at least one joint must differ."


def palm(case: HandCase) -> Iterator[str]:
    """The centre lies at the palm; the normal is a unit vector and points at what is grasped."""
    spec, model = case.hand.spec.palm, case.model
    if abs(np.linalg.norm(spec.normal) - 1.0) > 1e-6:
        yield f"palm.normal: {spec.normal} is no unit vector."
    gap = _palm_gap(case)
    if gap is not None and gap > MAX_PALM_GAP_M:
        yield (
            f"palm.center: lies {1000 * gap:.0f} mm off the surface of '{spec.link}' (at most "
            f"{1000 * MAX_PALM_GAP_M:.0f} mm)."
        )
    poses = model.link_poses_in_root(model.closed_posture[None])[0]
    T_root_palm = poses[model.link_names.index(spec.link)]
    touching = _what_touches(case, poses)
    in_palm = (touching - T_root_palm[:3, 3]) @ T_root_palm[:3, :3]
    height = (in_palm - torch.tensor(spec.center)) @ torch.tensor(spec.normal)
    if len(height) and not float(height.mean()) > 0:
        yield (
            f"palm.normal: must point out of the palm, but the closed fingers lie "
            f"{-1000 * float(height.mean()):.0f} mm behind the palm's centre on average."
        )


def contact_regions(case: HandCase) -> Iterator[str]:
    """Regions lie on their link's surface, face outward and have an area."""
    for link, regions in case.hand.spec.contact_regions.items():
        parts = case.parts_of(link)
        if not parts:
            yield f"contact_regions.{link}: the link has no shapes to touch with."
            continue
        for number, corners in enumerate(regions):
            for text in _region_mistakes(parts, np.array(corners)):
                yield f"contact_regions.{link}[{number}]: {text}"


def surface_points(case: HandCase) -> Iterator[str]:
    """Surface points lie on the outside of the union of each link's parts; normals are unit."""
    surface, names = case.model.surface, case.model.link_names
    if bool(((surface.normals.norm(dim=-1) - 1).abs() > 1e-4).any()):
        yield "normals of surface points are no unit vectors."
    for index in surface.link_index.unique().tolist():
        points = surface.points[surface.link_index == index].cpu().numpy()
        distance = nearest_surface(case.parts_of(names[index]), points).distance
        off = np.abs(distance).max()
        if off > HIDDEN_STEP_M:
            yield f"a surface point lies {1000 * off:.2g} mm off the surface of '{names[index]}'."


def open_posture(case: HandCase) -> Iterator[str]:
    """Links that must not touch don't overlap when the hand is open."""
    model = case.model
    found = hand_spheres(case.hand.urdf, case.hand.parts)
    link, radii = torch.as_tensor(found.link_index), torch.as_tensor(found.radii)
    poses = model.link_poses_in_root(model.open_posture[None])
    centers = model.place(poses, torch.as_tensor(found.centers), link)[0]
    overlap = radii[:, None] + radii - torch.cdist(centers, centers)
    apart = torch.as_tensor(case.hand.may_collide())[link][:, link].triu(1)
    worst: dict[tuple[int, int], float] = {}
    for a, b in (apart & (overlap > MAX_OVERLAP_M)).nonzero().tolist():
        pair = int(link[a]), int(link[b])
        worst[pair] = max(worst.get(pair, 0.0), float(overlap[a, b]))
    for (a, b), depth in worst.items():
        first, second = model.link_names[a], model.link_names[b]
        yield (
            f"'{first}' and '{second}' overlap by {1000 * depth:.1f} mm; open the hand further, or "
            f"add [{first}, {second}] to allowed_self_contacts if they always touch."
        )


def provenance(case: HandCase) -> Iterator[str]:
    """Source and licence are named."""
    for field in ("source", "licence"):
        if not getattr(case.hand.spec.provenance, field).strip():
            yield f"provenance.{field}: must not be empty."


CHECKS = (
    joint_limits, kinematics, postures, palm, contact_regions, surface_points, open_posture,
    provenance,
)  # fmt: skip


def _palm_gap(case: HandCase) -> float | None:
    """Distance of the palm's centre to the rigid body that carries it; None without shapes."""
    hand, model = case.hand, case.model
    poses = model.link_poses_in_root(model.open_posture[None])[0].double().numpy()
    own = hand.link_names.index(hand.spec.palm.link)
    gaps = []
    for index, link in enumerate(hand.link_names):
        parts = case.parts_of(link)
        if parts and hand.bodies[index] == hand.bodies[own]:
            T_link_palm = np.linalg.inv(poses[index]) @ poses[own]
            center = T_link_palm @ np.array([*hand.spec.palm.center, 1.0])
            gaps.append(nearest_surface(parts, center[None, :3]).distance[0])
    return float(abs(min(gaps))) if gaps else None


def _what_touches(case: HandCase, poses: torch.Tensor) -> torch.Tensor:
    """Root-frame middles of the fingers' contact regions, else the fingers' surface points."""
    model, hand = case.model, case.hand
    body = torch.tensor(hand.bodies)
    palm_body = body[hand.link_names.index(hand.spec.palm.link)]
    points, link = model.regions.corners.mean(1), model.regions.link_index
    if not bool((body[link] != palm_body).any()):
        points, link = model.surface.points, model.surface.link_index
    finger = body[link] != palm_body
    return model.place(poses[None], points[finger], link[finger])[0]


def _region_mistakes(parts: list[ConvexPart], corners: np.ndarray) -> Iterator[str]:
    across = np.cross(corners[2] - corners[0], corners[3] - corners[1])
    area = float(np.linalg.norm(across)) / 2
    if area < MIN_REGION_AREA_M2:
        yield f"has only {1e6 * area:.2g} mm² (at least {1e6 * MIN_REGION_AREA_M2:g} mm²)."
        return
    nearest = nearest_surface(parts, _grid_on(corners))
    gap = float(np.abs(nearest.distance).max())
    if gap > MAX_REGION_GAP_M:
        yield (
            f"lies up to {1000 * gap:.0f} mm off the link's surface (at most "
            f"{1000 * MAX_REGION_GAP_M:.0f} mm)."
        )
    if float((nearest.normals @ across).mean()) <= 0:
        yield "faces into the link; list the corners counter-clockwise as seen from outside."


def _grid_on(corners: np.ndarray) -> np.ndarray:
    u, v = (t.ravel()[:, None] for t in np.meshgrid(*[np.linspace(0, 1, GRID)] * 2))
    near = (1 - u) * corners[0] + u * corners[1]
    far = (1 - u) * corners[3] + u * corners[2]
    return (1 - v) * near + v * far
