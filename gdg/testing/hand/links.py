"""Checks of a hand's size, of where its links and its root frame lie, and of its surface."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gdg.hands.geometry import HIDDEN_STEP_M
from gdg.testing.findings import Finding, error, warning
from gdg.testing.hand.case import HandCase
from gdg.testing.surface import nearest_surface

#: The largest extent of an open hand, metres: from a finger-sized gripper to an arm.
MIN_SIZE_M, MAX_SIZE_M = 0.02, 2.0
#: A body may hang this far off the one that carries it, metres.
MAX_FLOATING_M = 0.03
#: The root frame may lie this far off the hand's shapes, metres.
MAX_ROOT_GAP_M = 0.3


def size(case: HandCase) -> Iterator[Finding]:
    """The hand has the size of a hand, and its root frame lies at it."""
    points = np.concatenate([case.vertices(link, case.Ts_open) for link in case.hand.link_names])
    extent = float(np.ptp(points, axis=0).max())
    if not MIN_SIZE_M <= extent <= MAX_SIZE_M:
        unit = "millimetres or inches" if extent > 1 else "another unit"
        yield error(
            case.in_urdf("links"),
            f"the open hand is {extent:.3g} m long: its lengths seem to be in {unit}; a URDF's "
            f"are in metres.",
        )
    low, high = points.min(0), points.max(0)
    gap = float(np.linalg.norm(np.maximum(0.0, np.maximum(low, -high))))
    if gap > MAX_ROOT_GAP_M:
        yield warning(
            case.in_manifest("root_link"),
            f"the frame of '{case.hand.urdf.root}' lies {1000 * gap:.0f} mm off the hand; poses "
            f"of grasps are given in it. Cut the tree at a link nearer to the palm.",
        )


def floating_links(case: HandCase) -> Iterator[Finding]:
    """Each body's shapes lie at the shapes of the body that carries it."""
    hand = case.hand
    for joint in hand.moving_joints:
        body, carrier = case.body_of(joint.child), case.body_of(joint.parent)
        own = [case.vertices(link, case.Ts_open) for link in case.bodies[body]]
        points = np.concatenate(own)
        gaps = [_gap(case, link, points) for link in case.bodies[carrier] if case.parts_of(link)]
        if len(points) and gaps and min(gaps) > MAX_FLOATING_M:
            yield warning(
                case.in_urdf(f"joint '{joint.name}'"),
                f"the shapes of '{joint.child}' lie {1000 * min(gaps):.0f} mm off those of "
                f"'{joint.parent}', which carries it; check the origins of joint and shapes.",
            )


def _gap(case: HandCase, link: str, points: np.ndarray) -> float:
    """Least distance of root-frame points to a link's shapes, metres."""
    T_link_root = np.linalg.inv(case.Ts_open[case.index(link)])
    local = points @ T_link_root[:3, :3].T + T_link_root[:3, 3]
    return float(nearest_surface(case.parts_of(link), local).distance.min(initial=np.inf))


def surface_points(case: HandCase) -> Iterator[Finding]:
    """Surface points lie on the outside of the union of each link's parts; normals are unit."""
    surface, names = case.model.surface, case.model.link_names
    if bool(((surface.normals.norm(dim=-1) - 1).abs() > 1e-4).any()):
        yield error(case.in_urdf("links"), "normals of surface points are no unit vectors.")
    for index in surface.link_index.unique().tolist():
        points = surface.points[surface.link_index == index].cpu().numpy()
        distance = nearest_surface(case.parts_of(names[index]), points).distance
        off = np.abs(distance).max()
        if off > HIDDEN_STEP_M:
            yield error(
                case.at_links([names[index]]),
                f"a surface point lies {1000 * off:.2g} mm off its surface; its shapes are no "
                f"clean convex parts. Simplify them.",
            )


CHECKS = (size, floating_links, surface_points)
