"""Contact regions of the bundled hands: on every fingertip, and where the method's authors touch.

What compares with the authors' regions is skipped without the asset folder (``GDG_TEST_ASSETS``).
"""

from __future__ import annotations

import functools
import json
from dataclasses import dataclass

import numpy as np
import pytest
from kinematics import link_poses
from proposals import degrees_between, grid_on, normal_of
from real_hands import ASSETS, have_assets
from test_bundled_hands import NAMES

from gdg.folders import HANDS
from gdg.hands.hand import Hand, find_hand
from gdg.hands.propose.structure import find_structure

BUNDLED = tuple(name for name, found in HANDS.all().items() if found.tier == "bundled")
#: Authors' regions on the inner side are this near to one of ours, metres.
NEAR_M = 0.006
#: A region belongs to the inner side up to this angle, degrees.
INNER_DEG = 60
#: A link that closing moves less than this has no inner side, metres.
LEAST_MOTION_M = 1e-3


@functools.cache
def _hand(name: str) -> Hand:
    return find_hand(name)


@pytest.mark.parametrize("name", BUNDLED)
def test_every_fingertip_has_regions(name: str):
    hand = _hand(name)
    for finger in find_structure(hand.urdf, hand.parts).fingers:
        # links of one rigid tip count as one
        assert any(hand.spec.contact_regions.get(link) for link in finger.distal), finger.distal


@pytest.mark.parametrize("name", BUNDLED)
def test_regions_lie_on_the_inner_side(name: str):
    hand = _hand(name)
    for link, regions in hand.spec.contact_regions.items():
        inner = inner_side(hand, link)
        if inner is None:  # closing leaves the link alone, as it does a metacarpal
            continue
        for corners in regions:
            assert degrees_between(normal_of(corners), inner) < 90, link


@dataclass(frozen=True)
class _Theirs:
    """A contact region of the authors."""

    link: str
    number: int
    normal: np.ndarray
    center: np.ndarray


def _authors_regions(name: str) -> list[_Theirs]:
    path = ASSETS / "hands" / name / "contact_regions.json"
    theirs = {their_link: link for link, their_link in NAMES[name][0].items()}
    return [
        _Theirs(theirs[link], number, np.array(r["normal"]), np.array(r["center_on_surface"]))
        for link, regions in json.loads(path.read_text()).items()
        for number, r in enumerate(regions)
        if r["usable"]
    ]


@pytest.mark.skipif(not have_assets(), reason="no asset folder (GDG_TEST_ASSETS)")
@pytest.mark.parametrize("name", NAMES)
def test_where_the_authors_touch_inside_there_is_a_region(name: str, record_property):
    hand, gaps = _hand(name), {}
    for region in _authors_regions(name):
        inner = inner_side(hand, region.link)
        if inner is None or degrees_between(region.normal, inner) > INNER_DEG:
            continue
        ours = hand.spec.contact_regions.get(region.link, [])
        points = [grid_on(corners, steps=33) for corners in ours]
        distances = [np.linalg.norm(grid - region.center, axis=1).min() for grid in points]
        gaps[f"{region.link}[{region.number}]"] = min(distances, default=np.inf)
    assert gaps
    record_property("largest_gap_mm", f"{1000 * max(gaps.values()):.1f}")
    assert {place: gap for place, gap in gaps.items() if gap > NEAR_M} == {}


def inner_side(hand: Hand, link: str) -> np.ndarray | None:
    """Where the inner side of a link looks, link frame; None if closing leaves the link alone.

    The palm's looks along its normal. A finger link's looks to where its own joint moves its middle
    when the hand closes; where that joint takes no part, to where the whole finger moves it.
    """
    palm = hand.spec.palm
    if link == palm.link:
        return np.array(palm.normal)
    middle = np.mean([part.mesh.bounds.mean(0) for part in hand.parts if part.link == link], axis=0)
    for moved in (_own_motion(hand, link, middle), _whole_motion(hand, link, middle)):
        if np.linalg.norm(moved) > LEAST_MOTION_M:
            return moved
    return None


def _own_motion(hand: Hand, link: str, middle: np.ndarray) -> np.ndarray:
    """How the nearest moving joint before a link moves a point of it; link frame."""
    carriers = {joint.child: joint for joint in hand.urdf.joints.values()}
    T_child_link, child = np.eye(4), link
    while child in carriers and carriers[child].type == "fixed":
        T_child_link = carriers[child].T_parent_child @ T_child_link
        child = carriers[child].parent
    if child not in carriers:
        return np.zeros(3)
    joint = carriers[child]
    change = hand.coupling[0] @ (hand.posture("closed") - hand.posture("open"))
    share = dict(zip([j.name for j in hand.moving_joints], change))[joint.name]
    point = T_child_link[:3, :3] @ middle + T_child_link[:3, 3]
    motion = joint.axis if joint.type == "prismatic" else np.cross(joint.axis, point)
    return share * T_child_link[:3, :3].T @ motion


def _whole_motion(hand: Hand, link: str, middle: np.ndarray) -> np.ndarray:
    """How closing moves a point of a link, halfway; link frame."""
    opened, closed = hand.posture("open"), hand.posture("closed")
    matrix, offset = hand.coupling
    names = [joint.name for joint in hand.moving_joints]
    Ts = []
    for share in (0.45, 0.55):
        values = matrix @ (opened + share * (closed - opened)) + offset
        Ts.append(link_poses(hand.urdf, dict(zip(names, values)))[link])
    moved = (Ts[1] - Ts[0]) @ np.append(middle, 1.0)
    return 10 * Ts[0][:3, :3].T @ moved[:3]
