"""The right Allegro hand is the left one in a mirror: palm up front, the plane y = 0."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yourdfpy

from gdg.hands.geometry import ConvexPart
from gdg.hands.hand import load_hand

HANDS = Path(__file__).resolve().parents[1] / "hands"
MIRROR = np.diag([1.0, -1.0, 1.0])
#: Joints that turn the same way on both hands (as the maker has them) and so mirror negated.
NEGATED = ("index_abduction", "middle_abduction", "ring_abduction")

left, right = load_hand(HANDS / "allegro"), load_hand(HANDS / "allegro_right")


def _mirrored(T: np.ndarray) -> np.ndarray:
    mirror = np.eye(4)
    mirror[:3, :3] = MIRROR
    return mirror @ T @ mirror


def _robot(name: str) -> yourdfpy.URDF:
    return yourdfpy.URDF.load(str(HANDS / name / f"{name}.urdf"), load_meshes=False)


def _mirror_values(values: dict[str, float]) -> dict[str, float]:
    return {joint: -value if joint in NEGATED else value for joint, value in values.items()}


def test_both_hands_have_the_same_names_limits_drives_and_weights():
    assert right.spec.joints == left.spec.joints
    assert right.link_names == left.link_names
    assert np.array_equal(right.limits(), left.limits())
    assert right.spec.drives == left.spec.drives
    masses = [
        {link.name: link.inertial and link.inertial.mass for link in _robot(name).robot.links}
        for name in ("allegro", "allegro_right")
    ]
    assert masses[0] == masses[1]


def test_every_link_moves_in_the_mirror():
    ours, theirs = _robot("allegro_right"), _robot("allegro")
    rng, (lower, upper) = np.random.default_rng(0), left.limits()
    for _ in range(20):
        values = dict(zip(left.spec.joints, rng.uniform(lower, upper)))
        theirs.update_cfg(values)
        ours.update_cfg(_mirror_values(values))
        for link in left.link_names:
            expected = _mirrored(theirs.get_transform(link, "palm"))
            assert ours.get_transform(link, "palm") == pytest.approx(expected, abs=1e-6), link


def test_the_mirrored_axes_are_the_makers():
    axes = {
        j.name: tuple(j.axis) for j in _robot("allegro_right").robot.joints if j.axis is not None
    }
    assert axes["thumb_opposition"] == (-1, 0, 0)
    assert axes["thumb_abduction"] == (0, 0, 1)
    assert all(axes[joint] == (0, 0, 1) for joint in NEGATED)


def test_outline_is_the_mirrored_one():
    assert len(right.parts) == len(left.parts)
    for ours, theirs in zip(right.parts, left.parts, strict=True):
        assert (ours.link, ours.kind, ours.size) == (theirs.link, theirs.kind, theirs.size)
        assert ours.mesh.volume == pytest.approx(theirs.mesh.volume)
        mirrored = theirs.mesh.vertices @ MIRROR
        assert np.abs(_plane_distance(ours, mirrored)).max() < 3e-4, ours.link


def test_contact_regions_are_the_mirrored_ones():
    assert list(right.spec.contact_regions) == list(left.spec.contact_regions)
    for link, regions in right.spec.contact_regions.items():
        for region, source in zip(regions, left.spec.contact_regions[link], strict=True):
            ours, mirrored = np.array(region), np.array(source) @ MIRROR
            assert sorted(ours.tolist()) == sorted(mirrored.tolist()), link
            # a mirror turns the order of the corners around; ours runs counter-clockwise again
            assert _normal(ours) == pytest.approx(_normal(np.array(source)) @ MIRROR), link
            parts = [part for part in right.parts if part.link == link]
            assert _distance(parts, ours).max() < 1e-3, link
            assert _distance(parts, ours.mean(0) + 0.003 * _normal(ours)).min() > 1e-3, link


@pytest.mark.parametrize(("hand", "thumb_side"), [(left, -1), (right, 1)])
def test_thumb_opposes_the_fingers_on_its_own_side(hand, thumb_side: int):
    """Palm to the viewer, fingers up: the left hand's thumb is at -y, the right one's at +y."""
    robot = _robot(hand.name)
    robot.update_cfg(hand.spec.open | {"thumb_opposition": 0.3})
    aside = robot.get_transform("thumb_tip", "palm")[:3, 3]
    index = robot.get_transform("index_tip", "palm")[:3, 3]
    ring = robot.get_transform("ring_tip", "palm")[:3, 3]
    assert thumb_side * aside[1] > 0.1
    assert thumb_side * index[1] > 0.03 > -0.03 > thumb_side * ring[1]
    robot.update_cfg(hand.spec.open)
    opposed = robot.get_transform("thumb_tip", "palm")
    # in front of the palm, its pad turned to the fingers
    assert opposed[0, 3] > 0.1
    assert abs(opposed[1, 3]) < 0.05
    assert opposed[:3, 0] @ (index - opposed[:3, 3]) > 0


def _plane_distance(part: ConvexPart, points: np.ndarray) -> np.ndarray:
    normals = part.mesh.face_normals
    offsets = np.einsum("ij,ij->i", normals, part.mesh.triangles[:, 0])
    return (points @ normals.T - offsets).max(-1)


def _distance(parts: list[ConvexPart], points: np.ndarray) -> np.ndarray:
    return np.min([_plane_distance(part, np.atleast_2d(points)) for part in parts], axis=0)


def _normal(corners: np.ndarray) -> np.ndarray:
    normal = np.cross(corners[2] - corners[0], corners[3] - corners[1])
    return normal / np.linalg.norm(normal)
