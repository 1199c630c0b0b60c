"""Checks of the palm: its centre on the surface, its normal toward what the fingers hold."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch

from gdg.testing.findings import Finding, error
from gdg.testing.hand.case import HandCase
from gdg.testing.surface import nearest_surface

#: The palm's centre may lie this far off the palm's shapes, metres.
MAX_PALM_GAP_M = 0.02


def palm(case: HandCase) -> Iterator[Finding]:
    """The centre lies at the palm; the normal is a unit vector and points at what is grasped."""
    spec = case.hand.spec.palm
    if abs(np.linalg.norm(spec.normal) - 1.0) > 1e-6:
        yield error(case.in_manifest("palm.normal"), f"{spec.normal} is no unit vector.")
    gap = _palm_gap(case)
    if gap is not None and gap > MAX_PALM_GAP_M:
        yield error(
            case.in_manifest("palm.center"),
            f"lies {1000 * gap:.0f} mm off the surface of '{spec.link}' (at most "
            f"{1000 * MAX_PALM_GAP_M:.0f} mm); give a point on the palm, metres, in that link's "
            f"frame.",
        )
    T_root_palm = case.Ts_closed[case.index(spec.link)]
    in_palm = (_what_touches(case) - T_root_palm[:3, 3]) @ T_root_palm[:3, :3]
    height = (in_palm - np.array(spec.center)) @ np.array(spec.normal)
    if len(height) and not float(height.mean()) > 0:
        yield error(
            case.in_manifest("palm.normal"),
            f"must point out of the palm, but the closed fingers lie {-1000 * height.mean():.0f} "
            f"mm behind the palm's centre on average; turn it round, or check centre and closed.",
        )


def _palm_gap(case: HandCase) -> float | None:
    """Distance of the palm's centre to the rigid body that carries it; None without shapes."""
    spec = case.hand.spec.palm
    T_root_palm = case.Ts_open[case.index(spec.link)]
    gaps = []
    for link in case.bodies[case.body_of(spec.link)]:
        parts = case.parts_of(link)
        if parts:
            T_link_palm = np.linalg.inv(case.Ts_open[case.index(link)]) @ T_root_palm
            center = T_link_palm @ np.array([*spec.center, 1.0])
            gaps.append(nearest_surface(parts, center[None, :3]).distance[0])
    return float(abs(min(gaps))) if gaps else None


def _what_touches(case: HandCase) -> np.ndarray:
    """Root-frame middles of the closed fingers' contact regions, else of their surface points."""
    model, hand = case.model, case.hand
    body, palm_body = torch.tensor(hand.bodies), case.body_of(hand.spec.palm.link)
    points, link = model.regions.corners.mean(1), model.regions.link_index
    if not bool((body[link] != palm_body).any()):
        points, link = model.surface.points, model.surface.link_index
    finger = body[link] != palm_body
    poses = torch.as_tensor(case.Ts_closed, dtype=torch.float32)[None]
    return model.place(poses, points[finger], link[finger])[0].double().numpy()


CHECKS = (palm,)
