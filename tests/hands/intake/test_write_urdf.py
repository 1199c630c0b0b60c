"""A tree that is written and read again is the same tree."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from gdg.hands.intake.write_urdf import write_urdf
from gdg.hands.urdf import Inertial, Joint, Link, Mimic, Shape, Urdf, read_urdf

NUMBER = st.floats(-3.0, 3.0).map(lambda value: round(value, 9))
POSITIVE = st.floats(1e-4, 3.0).map(lambda value: round(value, 9))
NAME = st.text(st.characters(categories=("L", "N", "P", "S")), min_size=1, max_size=6)


def poses() -> st.SearchStrategy[np.ndarray]:
    def made(position: list[float], axis: list[float], angle: float) -> np.ndarray:
        axis = axis if np.linalg.norm(axis) > 0.1 else [0.0, 0.0, 1.0]
        T = trimesh.transformations.rotation_matrix(angle, axis)
        T[:3, 3] = position
        return T

    triple = st.lists(NUMBER, min_size=3, max_size=3)
    return st.builds(made, triple, triple, NUMBER)


def shapes() -> st.SearchStrategy[tuple[Shape, ...]]:
    kinds = {"box": 3, "cylinder": 2, "sphere": 1, "mesh": 3}
    one = st.sampled_from(sorted(kinds)).flatmap(
        lambda kind: st.builds(
            Shape,
            st.just(kind),
            st.lists(POSITIVE, min_size=kinds[kind], max_size=kinds[kind]).map(tuple),
            poses(),
            NAME if kind == "mesh" else st.just(""),
        )
    )
    return st.lists(one, max_size=2).map(tuple)


@st.composite
def trees(draw: st.DrawFn) -> Urdf:
    names = draw(st.lists(NAME, min_size=2, max_size=5, unique=True))
    joint_names = draw(st.lists(NAME, min_size=len(names) - 1, max_size=4, unique=True))
    links: dict[str, Link] = {}
    for name in names:
        inertial = st.builds(Inertial, POSITIVE, poses(), POSITIVE.map(lambda v: v * np.eye(3)))
        links[name] = Link(name, draw(shapes()), draw(shapes()), draw(st.none() | inertial))
    joints: dict[str, Joint] = {}
    for index, name in enumerate(joint_names[: len(names) - 1]):
        kind = draw(st.sampled_from(("revolute", "prismatic", "continuous", "fixed")))
        lower, upper = (
            (-np.pi, np.pi) if kind == "continuous" else (-draw(POSITIVE), draw(POSITIVE))
        )
        masters = [j for j in joints.values() if j.type != "fixed"]
        mimic = None
        if masters and kind != "fixed" and draw(st.booleans()):
            mimic = Mimic(draw(st.sampled_from(masters)).name, draw(NUMBER), draw(NUMBER))
        axis = draw(st.sampled_from(list(np.vstack((np.eye(3), -np.eye(3))))))
        fixed = kind == "fixed"
        joints[name] = Joint(
            name, kind, names[index], names[index + 1], draw(poses()),
            np.array([1.0, 0.0, 0.0]) if fixed else axis,
            np.nan if fixed else lower, np.nan if fixed else upper,
            0.0 if fixed else draw(POSITIVE), 0.0 if fixed else draw(POSITIVE), mimic,
        )  # fmt: skip
    return Urdf(Path("made"), "made", links, joints, names[0])


def assert_same(first: Urdf, second: Urdf) -> None:
    assert list(first.links) == list(second.links)
    assert list(first.joints) == list(second.joints)
    assert first.root == second.root
    for name, link in first.links.items():
        other = second.links[name]
        assert (link.inertial is None) == (other.inertial is None)
        if link.inertial is not None and other.inertial is not None:
            assert link.inertial.mass == pytest.approx(other.inertial.mass, rel=1e-11)
            for a, b in (
                (link.inertial.T_link_center, other.inertial.T_link_center),
                (link.inertial.inertia, other.inertial.inertia),
            ):
                np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-10)
        for mine, theirs in ((link.collisions, other.collisions), (link.visuals, other.visuals)):
            assert [(s.kind, s.mesh) for s in mine] == [(s.kind, s.mesh) for s in theirs]
            for a, b in zip(mine, theirs, strict=True):
                np.testing.assert_allclose(a.size, b.size, rtol=1e-11)
                np.testing.assert_allclose(a.T_link_shape, b.T_link_shape, atol=1e-10)
    for name, joint in first.joints.items():
        other = second.joints[name]
        assert (joint.type, joint.parent, joint.child) == (other.type, other.parent, other.child)
        np.testing.assert_allclose(joint.T_parent_child, other.T_parent_child, atol=1e-10)
        np.testing.assert_allclose(joint.axis, other.axis, atol=1e-11)
        numbers = "lower", "upper", "effort", "velocity"
        given, read = ([getattr(j, n) for n in numbers] for j in (joint, other))
        np.testing.assert_allclose(given, read, rtol=1e-11)
        assert (joint.mimic is None) == (other.mimic is None)
        if joint.mimic is not None and other.mimic is not None:
            assert joint.mimic.joint == other.mimic.joint
            assert joint.mimic.multiplier == pytest.approx(other.mimic.multiplier, abs=1e-11)
            assert joint.mimic.offset == pytest.approx(other.mimic.offset, abs=1e-11)


@pytest.mark.filterwarnings("ignore:Do not use the `random` module")  # beartype does
@given(trees())
def test_any_tree_is_written_and_read_again_the_same(
    tmp_path_factory: pytest.TempPathFactory, tree: Urdf
):
    path = tmp_path_factory.getbasetemp() / "again.urdf"
    path.write_text(write_urdf(tree, "made"), encoding="utf-8")
    assert_same(tree, read_urdf(path))


def test_the_makers_urdfs_are_written_and_read_again_the_same(real_hands: Path, tmp_path: Path):
    for source in real_hands.glob("*/*.urdf"):
        path = tmp_path / source.name
        path.write_text(write_urdf(read_urdf(source), "made"), encoding="utf-8")
        assert_same(read_urdf(source), read_urdf(path))


def test_nothing_beside_the_model_is_written(tmp_path: Path):
    path = tmp_path / "a.urdf"
    path.write_text(
        '<robot name="r"><material name="red"/><gazebo/>'
        '<link name="a"><self_collide/></link></robot>'
    )
    text = write_urdf(read_urdf(path), "b")
    assert '<robot name="b">' in text
    assert "material" not in text
    assert "gazebo" not in text
    assert "self_collide" not in text
