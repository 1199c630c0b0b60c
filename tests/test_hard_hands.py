"""The made-up hands are what they say: readable, and the same hand in whatever frames."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hard_hands import (
    HARD_HANDS,
    HardHand,
    left_hand,
    many_shapes,
    millimetre_meshes,
    rename,
    right_hand,
    scramble,
    write_hard_hand,
)

from gdg.hands.urdf import Joint, Shape, Urdf, read_urdf

EVERY_HAND = pytest.mark.parametrize("name", HARD_HANDS)


def _motion(joint: Joint, value: float) -> np.ndarray:
    pose = np.eye(4)
    if joint.type == "prismatic":
        pose[:3, 3] = value * joint.axis
    elif joint.type != "fixed":
        pose = np.array(trimesh.transformations.rotation_matrix(value, joint.axis))
    return pose


def _values(joints: list[Joint], free: dict[str, float]) -> dict[str, float]:
    """The value of every joint, those that follow others included; 0 where nothing is said."""
    values = {joint.name: free.get(joint.name, 0.0) for joint in joints}
    for joint in joints:
        if joint.mimic is not None:
            mimic = joint.mimic
            values[joint.name] = mimic.multiplier * values[mimic.joint] + mimic.offset
    return values


def _poses(hand: HardHand | Urdf, values: dict[str, float]) -> dict[str, np.ndarray]:
    """The pose of every link in the root's frame."""
    joints = list(hand.joints.values() if isinstance(hand, Urdf) else hand.joints)
    Ts_root_link, missing = {hand.root: np.eye(4)}, joints
    while missing:
        for joint in [j for j in missing if j.parent in Ts_root_link]:
            T_root_joint = Ts_root_link[joint.parent] @ joint.T_parent_child
            Ts_root_link[joint.child] = T_root_joint @ _motion(joint, values[joint.name])
        missing = [j for j in missing if j.child not in Ts_root_link]
    return Ts_root_link


def _shapes(hand: HardHand | Urdf, name: str) -> list[Shape]:
    return [*hand.links[name].visuals, *hand.links[name].collisions]


def _random_values(hand: HardHand, seed: int) -> dict[str, float]:
    rng = np.random.default_rng(seed)
    moving = [joint for joint in hand.joints if joint.type != "fixed"]
    return {joint.name: rng.uniform(joint.lower, joint.upper) for joint in moving}


def _signs(hand: HardHand, other: HardHand) -> dict[str, int]:
    """-1 for every joint that ``other`` turns round: its axis in the root's frame is opposite."""
    zero = {joint.name: 0.0 for joint in hand.joints}
    Ts, Ts_other = _poses(hand, zero), _poses(other, zero)
    R_other_root = _root_change(hand, other)[:3, :3]
    signs = {}
    for joint, twin in zip(hand.joints, other.joints, strict=True):
        axis = R_other_root @ Ts[joint.child][:3, :3] @ joint.axis
        signs[joint.name] = round(float(axis @ Ts_other[joint.child][:3, :3] @ twin.axis))
    return signs


def _root_change(hand: HardHand, other: HardHand) -> np.ndarray:
    """The pose of ``hand``'s root frame in ``other``'s, from a shape of the palm at zero."""
    zero, palm = {joint.name: 0.0 for joint in hand.joints}, hand.palm_links[0]
    T, T_other = (_poses(h, zero)[palm] @ _shapes(h, palm)[0].T_link_shape for h in (hand, other))
    return T_other @ np.linalg.inv(T)


@EVERY_HAND
def test_the_urdf_says_what_the_generator_meant(name: str, tmp_path: Path) -> None:
    hand = HARD_HANDS[name]()
    urdf = read_urdf(write_hard_hand(hand, tmp_path))
    assert urdf.root == hand.root
    assert set(urdf.links) == set(hand.links)
    for joint in hand.joints:
        read = urdf.joints[joint.name]
        assert (read.type, read.parent, read.child) == (joint.type, joint.parent, joint.child)
        assert (read.effort, read.mimic) == (joint.effort, joint.mimic)
        np.testing.assert_allclose(read.T_parent_child, joint.T_parent_child, atol=1e-9)
        np.testing.assert_allclose([read.lower, read.upper], [joint.lower, joint.upper], atol=1e-8)
        if joint.type != "fixed":
            np.testing.assert_allclose(read.axis, joint.axis, atol=1e-9)
    for link in hand.links:
        for read, shape in zip(_shapes(urdf, link), _shapes(hand, link), strict=True):
            assert (read.kind, read.mesh) == (shape.kind, shape.mesh)
            np.testing.assert_allclose(read.size, shape.size)
            np.testing.assert_allclose(read.T_link_shape, shape.T_link_shape, atol=1e-9)
            assert not shape.mesh or (tmp_path / shape.mesh).is_file()


@EVERY_HAND
def test_the_truth_names_what_is_there(name: str) -> None:
    hand = HARD_HANDS[name]()
    moving = {joint.name for joint in hand.joints if joint.type != "fixed"}
    assert set(hand.closing) <= moving
    assert set(hand.closing.values()) <= {-1, 1}
    for link in (*hand.palm_links, *hand.distal_links):
        assert _shapes(hand, link), f"{link} has no geometry"
    assert set(hand.distal_links) <= set(hand.pads)
    assert np.linalg.norm(hand.palm_normal) == pytest.approx(1)


@EVERY_HAND
def test_closing_moves_the_pads_inward(name: str) -> None:
    hand = HARD_HANDS[name]()
    joints = list(hand.joints)
    children = {joint.name: joint.child for joint in joints}
    zero = _poses(hand, _values(joints, {}))
    for joint, sign in hand.closing.items():
        values = _values(joints, {})
        values[joint] += 1e-4 * sign
        moved = _poses(hand, values)
        child = children[joint]
        if child not in hand.pads:
            continue
        middle = np.append(np.mean([s.T_link_shape[:3, 3] for s in _shapes(hand, child)], 0), 1)
        if not middle[:3].any():
            middle[:3] = hand.meshes[_shapes(hand, child)[0].mesh].bounds.mean(axis=0) / 1000
        step = ((moved[child] - zero[child]) @ middle)[:3]
        pad = zero[child][:3, :3] @ hand.pads[child]
        assert step @ pad > 0.9 * np.linalg.norm(step) > 0, joint


@EVERY_HAND
def test_the_palm_looks_at_where_the_fingers_close(name: str) -> None:
    hand = HARD_HANDS[name]()
    closed = {
        joint.name: 0.5 * sign * min(abs(joint.upper if sign > 0 else joint.lower), 1.6)
        for joint in hand.joints
        if (sign := hand.closing.get(joint.name))
    }
    poses = _poses(hand, _values(list(hand.joints), closed))
    for link in hand.distal_links:
        tip = poses[link][:3, 3] - hand.palm_center
        assert tip @ hand.palm_normal > -1e-9, link


@EVERY_HAND
@pytest.mark.parametrize("seed", range(3))
def test_scramble_moves_no_shape(name: str, seed: int) -> None:
    hand = HARD_HANDS[name]()
    other = scramble(hand, seed)
    T_other_root = _root_change(hand, other)
    signs = _signs(hand, other)
    values = _values(list(hand.joints), _random_values(hand, seed))
    turned = {joint: signs[joint] * value for joint, value in values.items()}
    assert _values(list(other.joints), turned) == pytest.approx(turned)
    poses, poses_other = _poses(hand, values), _poses(other, turned)
    for link in hand.links:
        for shape, twin in zip(_shapes(hand, link), _shapes(other, link), strict=True):
            assert (shape.kind, shape.size, shape.mesh) == (twin.kind, twin.size, twin.mesh)
            np.testing.assert_allclose(
                poses_other[link] @ twin.T_link_shape,
                T_other_root @ poses[link] @ shape.T_link_shape,
                atol=1e-9,
            )


@EVERY_HAND
def test_scramble_takes_the_truth_along(name: str) -> None:
    hand = HARD_HANDS[name]()
    other = scramble(hand, 7)
    T_other_root = _root_change(hand, other)
    signs = _signs(hand, other)
    R = T_other_root[:3, :3]
    np.testing.assert_allclose(other.palm_normal, R @ hand.palm_normal, atol=1e-9)
    center = T_other_root @ np.append(hand.palm_center, 1)
    np.testing.assert_allclose(other.palm_center, center[:3], atol=1e-9)
    assert other.closing == {joint: signs[joint] * sign for joint, sign in hand.closing.items()}
    zero = {joint.name: 0.0 for joint in hand.joints}
    poses, poses_other = _poses(hand, zero), _poses(other, zero)
    for link, pad in hand.pads.items():
        there = poses_other[link][:3, :3] @ other.pads[link]
        np.testing.assert_allclose(there, R @ poses[link][:3, :3] @ pad, atol=1e-9)


@EVERY_HAND
def test_a_scrambled_and_renamed_hand_is_readable(name: str, tmp_path: Path) -> None:
    hand = rename(scramble(HARD_HANDS[name](), 1), 1)
    urdf = read_urdf(write_hard_hand(hand, tmp_path))
    assert urdf.root == hand.root
    assert all(link.startswith("link_") for link in urdf.links)
    assert set(hand.closing) <= set(urdf.joints)
    assert {*hand.palm_links, *hand.distal_links, *hand.pads} <= set(urdf.links)


def test_scramble_turns_frames_and_joints_round() -> None:
    hand = right_hand()
    other = scramble(hand, 0)
    assert set(_signs(hand, other).values()) == {-1, 1}
    assert abs(other.palm_normal @ hand.palm_normal) < 0.99
    assert scramble(hand, 0).closing == other.closing


def test_the_left_hand_mirrors_the_right() -> None:
    mirror = np.diag([1.0, -1.0, 1.0])
    right, left = right_hand(), left_hand()
    values = {joint.name: 0.0 for joint in right.joints}
    poses, poses_left = _poses(right, values), _poses(left, values)
    for link in right.links:
        for shape, twin in zip(_shapes(right, link), _shapes(left, link), strict=True):
            center = (poses[link] @ shape.T_link_shape)[:3, 3]
            center_left = (poses_left[link] @ twin.T_link_shape)[:3, 3]
            np.testing.assert_allclose(center_left, mirror @ center, atol=1e-12)


def test_the_meshes_are_in_millimetres(tmp_path: Path) -> None:
    hand = millimetre_meshes()
    write_hard_hand(hand, tmp_path)
    palm = trimesh.load_mesh(tmp_path / "meshes" / "palm.stl")
    np.testing.assert_allclose(palm.extents, (30, 85, 95), rtol=1e-6)
    assert hand.links["palm"].visuals[0].size == (0.001, 0.001, 0.001)


def test_many_shapes_differ_in_looks_and_contact() -> None:
    link = many_shapes().links["index_2"]
    assert len(link.visuals) > len(link.collisions) >= 1
