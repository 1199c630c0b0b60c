"""A URDF is untrusted: what is wrong or hostile is refused with one sentence, never obeyed."""

from __future__ import annotations

import contextlib
import math
import os
from pathlib import Path

import numpy as np
import pytest
import yourdfpy
from gripper import URDF as GRIPPER
from hypothesis import given
from hypothesis import strategies as st

from gdg.errors import GdgError
from gdg.hands.urdf import MAX_URDF_BYTES, Urdf, read_urdf

BOX = '<collision><geometry><box size="1 1 1"/></geometry></collision>'
LIMIT = '<limit lower="-1" upper="1" effort="5" velocity="1"/>'


def parse(folder: Path, text: str | bytes) -> Urdf:
    path = folder / "hand.urdf"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_urdf(path)


def two_links(joint: str = LIMIT, kind: str = "revolute", link: str = "") -> str:
    return (
        f'<robot name="r"><link name="a">{link}</link><link name="b"/>'
        f'<joint name="j" type="{kind}">'
        f'<parent link="a"/><child link="b"/>{joint}</joint></robot>'
    )


def chain(*joints: tuple[str, str, str], links: str = "abcd", extra: str = "") -> str:
    body = "".join(f'<link name="{name}"/>' for name in links)
    for name, parent, child in joints:
        body += (
            f'<joint name="{name}" type="revolute"><parent link="{parent}"/>'
            f'<child link="{child}"/>{LIMIT}</joint>'
        )
    return f'<robot name="r">{body}{extra}</robot>'


def mistake(folder: Path, text: str | bytes) -> str:
    with pytest.raises(GdgError) as caught:
        parse(folder, text)
    message = str(caught.value)
    assert all(line.startswith(f"{folder / 'hand.urdf'}: ") for line in message.splitlines())
    return message


def test_a_tree_is_read_with_parents_before_children(tmp_path: Path):
    joints = ("3", "c", "d"), ("1", "a", "b"), ("2", "b", "c")
    urdf = parse(tmp_path, chain(*joints))
    assert list(urdf.joints) == ["1", "2", "3"]
    assert urdf.root == "a"


def test_shapes_carry_size_origin_and_scale(tmp_path: Path):
    shapes = """
      <collision><!-- a comment --><origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/>
        <geometry><!-- another --><cylinder radius="0.1" length="0.2"/></geometry></collision>
      <collision><geometry><sphere radius="0.3"/></geometry></collision>
      <collision><geometry><box size="1,2,3"/></geometry></collision>
      <visual><geometry><mesh filename="a.stl" scale="0.001 -1 2"/></geometry></visual>
      <visual><geometry><mesh filename="b.stl" scale="0.01"/></geometry></visual>
      <visual><geometry><mesh filename="c.stl"/></geometry></visual>
      <inertial><mass value="0.25"/></inertial>"""
    link = parse(tmp_path, two_links(link=shapes)).links["a"]
    assert [shape.kind for shape in link.collisions] == ["cylinder", "sphere", "box"]
    assert [shape.size for shape in link.collisions] == [(0.1, 0.2), (0.3,), (1, 2, 3)]
    assert [shape.size for shape in link.visuals] == [(0.001, -1, 2), (0.01,) * 3, (1, 1, 1)]
    assert link.mass == 0.25
    T_link_shape = link.collisions[0].T_link_shape
    np.testing.assert_allclose(T_link_shape @ [1, 0, 0, 1], [1, 3, 3, 1], atol=1e-12)


def test_all_joint_types_are_read(tmp_path: Path):
    continuous = parse(tmp_path, two_links('<axis xyz="0 3 0"/>', "continuous")).joints["j"]
    assert (continuous.lower, continuous.upper) == (-math.pi, math.pi)
    np.testing.assert_allclose(continuous.axis, [0, 1, 0])
    prismatic = parse(tmp_path, two_links(kind="prismatic")).joints["j"]
    assert (prismatic.lower, prismatic.upper, prismatic.effort) == (-1, 1, 5)
    assert math.isnan(parse(tmp_path, two_links("", "fixed")).joints["j"].lower)
    np.testing.assert_allclose(prismatic.axis, [1, 0, 0])


@pytest.mark.parametrize(
    ("joint", "reason"),
    [
        ("", "joint 'j': a revolute joint needs <limit lower=… upper=…>."),
        ('<limit upper="1"/>', "joint 'j': a revolute joint needs <limit lower=… upper=…>."),
        ('<limit lower="nan" upper="1"/>', "needs lower=… with a finite number, not 'nan'"),
        ('<limit lower="0" upper="inf"/>', "needs upper=… with a finite number, not 'inf'"),
        ('<limit lower="0" upper="wide"/>', "needs upper=… with a finite number, not 'wide'"),
        ('<limit lower="2" upper="1"/>', "lower limit 2 is above the upper limit 1"),
        ('<limit lower="0" upper="1" effort="-3"/>', "effort -3 is negative"),
        ('<limit lower="0" upper="1" effort="nan"/>', "needs effort=… with a finite number"),
        (LIMIT + '<axis xyz="0 0 0"/>', "its axis must not be zero"),
        (LIMIT + '<axis xyz="0 1"/>', "<axis> needs xyz=… with 3 finite numbers, not '0 1'"),
        (LIMIT + '<axis xyz="0 nan 0"/>', "<axis> needs xyz=…"),
        (LIMIT + '<origin xyz="0 0 inf"/>', "<origin> needs xyz=…"),
        (LIMIT + '<origin rpy="0 0"/>', "<origin> needs rpy=… with 3 finite numbers, not '0 0'"),
        (LIMIT + "<mimic/>", "mimics '', which does not exist"),
        (LIMIT + '<mimic joint="k"/>', "mimics 'k', which does not exist"),
        (LIMIT + '<mimic joint="j"/>', "mimics itself in a circle"),
        (LIMIT + '<mimic joint="j" multiplier="x"/>', "needs multiplier=… with a finite number"),
        (LIMIT + '<mimic joint="j" offset="inf"/>', "needs offset=… with a finite number"),
    ],
)
def test_a_mistaken_joint_is_named(tmp_path: Path, joint: str, reason: str):
    assert reason in mistake(tmp_path, two_links(joint))


@pytest.mark.parametrize("kind", ["planar", "floating", "spherical", ""])
def test_unsupported_joint_types_are_named(tmp_path: Path, kind: str):
    assert f"type '{kind}' is not supported" in mistake(tmp_path, two_links(kind=kind))


def shape(inner: str) -> str:
    return two_links(link=f"<collision><geometry>{inner}</geometry></collision>")


@pytest.mark.parametrize(
    ("inner", "reason"),
    [
        ("", "has no box, cylinder, sphere or mesh"),
        ('<capsule radius="1" length="1"/>', "has no box, cylinder, sphere or mesh"),
        ("<box/>", "<box> needs size=… with 3 finite numbers, not nothing"),
        ('<box size="1 2"/>', "<box> needs size=… with 3 finite numbers, not '1 2'"),
        ('<box size="1 2 -3"/>', "must be positive"),
        ('<box size="1 2 nan"/>', "<box> needs size=…"),
        ('<cylinder radius="1"/>', "<cylinder> needs length=… with a finite number, not nothing"),
        ('<cylinder radius="0" length="1"/>', "must be positive"),
        ('<sphere radius="big"/>', "<sphere> needs radius=… with a finite number, not 'big'"),
        ("<mesh/>", 'a mesh needs filename="…"'),
        ('<mesh filename="a.stl" scale="1 1"/>', "<mesh> needs scale=… with 3 finite numbers"),
        ('<mesh filename="a.stl" scale="1 0 1"/>', "must not be zero"),
        ('<mesh filename="a.stl" scale="inf"/>', "<mesh> needs scale=…"),
    ],
)
def test_a_mistaken_shape_is_named(tmp_path: Path, inner: str, reason: str):
    message = mistake(tmp_path, shape(inner))
    assert "link 'a': collision: " in message
    assert reason in message


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (chain(("1", "a", "b"), ("2", "b", "c")), "links without a parent: a, d"),
        (chain(("1", "a", "b"), ("2", "b", "a"), links="ab"), "the joints form a loop"),
        (chain(("1", "b", "c"), ("2", "c", "b"), links="abc"), "hangs on no link of the tree"),
        (chain(("1", "a", "b"), ("2", "c", "b"), links="abc"), "child of two joints, '1' and '2'"),
        (chain(("1", "a", "a"), links="a"), "loop"),
        (chain(("1", "a", "b"), ("1", "b", "c"), links="abc"), "joint '1' is defined twice"),
        (chain(("1", "a", "b"), links="abb"), "link 'b' is defined twice"),
        (chain(("1", "palm", "b"), links="b", extra='<link name="plam"/>'),
         "parent link 'palm' does not exist. Did you mean 'plam'?"),
        (chain(("1", "a", "x"), links="a"), "child link 'x' does not exist"),
        ('<robot name="r"/>', "has no <link>"),
        ('<robot><link/><link name="a"/></robot>', "a link has no name"),
        ('<robot><link name="a&#10;b"/></robot>', "can't be printed"),
        (f'<robot><link name="{"a" * 201}"/></robot>', "a name of over 200 letters: 'aaa"),
        ('<robot><link name="a"/><joint type="fixed"/></robot>', "a joint has no name"),
        ('<robot><link name="a"/><joint name="j" type="fixed"/></robot>', "has no <parent link=…>"),
        ('<robot><link name="a"><inertial><mass value="-1"/></inertial></link></robot>',
         "mass -1 is negative"),
        ('<robot><link name="a"><inertial><mass value="x"/></inertial></link></robot>', "not 'x'"),
        ("<urdf/>", "the outermost element is <urdf>, not <robot>"),
        ('<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="a"/></robot>',
         "is a xacro template"),
        ("", "is no well-formed XML"),
        ("<robot>", "is no well-formed XML"),
        (b"\0" * 100, "is no well-formed XML"),
        (b'<?xml version="1.0" encoding="utf-7"?><robot/>', "is no well-formed XML"),
        (b'<?xml version="1.0" encoding="nonsense"?><robot/>', "is no well-formed XML"),
    ],
)  # fmt: skip
def test_what_is_no_tree_is_refused(tmp_path: Path, text: str | bytes, reason: str):
    assert reason in mistake(tmp_path, text)


def test_a_mimic_of_a_fixed_joint_is_refused(tmp_path: Path):
    text = (
        '<robot><link name="a"/><link name="b"/><link name="c"/>'
        '<joint name="f" type="fixed"><parent link="a"/><child link="b"/></joint>'
        f'<joint name="m" type="revolute"><parent link="b"/><child link="c"/>{LIMIT}'
        '<mimic joint="f"/></joint></robot>'
    )
    assert "joint 'm': mimics 'f', which does not move" in mistake(tmp_path, text)


def test_a_circle_of_mimics_is_refused(tmp_path: Path):
    text = chain(("1", "a", "b"), ("2", "b", "c"), links="abc")
    head, _, tail = text.partition("</joint>")
    text = f'{head}<mimic joint="2"/></joint>' + tail.replace(
        "</joint>", '<mimic joint="1"/></joint>'
    )
    assert "mimics itself in a circle" in mistake(tmp_path, text)


def test_all_mistakes_are_reported_at_once(tmp_path: Path):
    text = two_links(
        '<limit lower="2" upper="1"/><axis xyz="0 0 0"/>', link=BOX.replace("1 1 1", "0 1 1")
    )
    assert len(mistake(tmp_path, text).splitlines()) == 3


@pytest.mark.parametrize(
    "prolog",
    [
        '<!DOCTYPE r [<!ENTITY a "x"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>',
        '<!DOCTYPE r [<!ENTITY b SYSTEM "file:///etc/passwd">]>',
        '<!DOCTYPE r SYSTEM "http://localhost:1/robot.dtd">',
        '<!DOCTYPE r [<!ENTITY % p SYSTEM "http://localhost:1/x"> %p;]>',
        "<!DOCTYPE robot>",
    ],
)
def test_entities_and_document_types_are_refused(tmp_path: Path, prolog: str):
    text = f'<?xml version="1.0"?>{prolog}<robot name="r"><link name="a"/></robot>'
    assert "declares entities or a document type" in mistake(tmp_path, text)


def test_a_hidden_document_type_in_another_encoding_is_refused(tmp_path: Path):
    text = '<?xml version="1.0" encoding="utf-16"?><!DOCTYPE r [<!ENTITY a "x">]><robot/>'
    assert "declares entities" in mistake(tmp_path, text.encode("utf-16"))


def test_an_included_file_is_not_read(tmp_path: Path):
    include = '<xi:include xmlns:xi="http://www.w3.org/2001/XInclude" href="/etc/passwd"/>'
    urdf = parse(tmp_path, f'<robot><link name="a"/>{include}</robot>')
    assert list(urdf.links) == ["a"]


def test_a_pipe_is_refused_unread(tmp_path: Path):
    os.mkfifo(tmp_path / "hand.urdf")
    with pytest.raises(GdgError, match="is no file"):
        read_urdf(tmp_path / "hand.urdf")


def test_a_huge_file_is_refused_unread(tmp_path: Path):
    path = tmp_path / "hand.urdf"
    with path.open("wb") as stream:
        stream.truncate(MAX_URDF_BYTES + 1)
    with pytest.raises(GdgError, match="larger than 5 MB"):
        read_urdf(path)


def test_too_many_links_or_shapes_are_refused(tmp_path: Path):
    links = "".join(f'<link name="{i}"/>' for i in range(501))
    assert "501 <link> elements" in mistake(tmp_path, f"<robot>{links}</robot>")
    assert "2001 <collision> elements" in mistake(tmp_path, two_links(link=BOX * 2001))


def test_deep_nesting_does_no_harm(tmp_path: Path):
    assert "has no <link>" in mistake(
        tmp_path, f"<robot>{'<a>' * 100_000}{'</a>' * 100_000}</robot>"
    )


def test_a_missing_file_is_named(tmp_path: Path):
    with pytest.raises(GdgError, match=r"lost\.urdf: cannot be read: No such file"):
        read_urdf(tmp_path / "lost.urdf")


@given(st.data())
def test_a_damaged_file_is_read_or_refused_but_never_crashes(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
):
    text = bytearray(GRIPPER.encode())
    for _ in range(data.draw(st.integers(1, 8))):
        at = data.draw(st.integers(0, len(text) - 1))
        text[at : at + data.draw(st.integers(0, 6))] = data.draw(st.binary(max_size=4))
    with contextlib.suppress(GdgError):
        parse(tmp_path_factory.getbasetemp(), bytes(text))


def test_the_bare_tree_written_for_other_parsers_is_the_same_tree(tmp_path: Path):
    odd = chain(("k&<\"'é", "a", "b"), links="ab").replace("k&<\"'é", "k&amp;&lt;&quot;'é")
    joint = odd.replace(
        LIMIT, f'{LIMIT}<origin xyz="1 2 3" rpy="0.1 -1.5707963267948966 3"/><axis xyz="1 2 2"/>'
    )
    first = parse(tmp_path, joint)
    second = parse(tmp_path, first.kinematics_xml())
    (name,) = first.joints
    assert name == "k&<\"'é"
    a, b = first.joints[name], second.joints[name]
    np.testing.assert_allclose(a.T_parent_child, b.T_parent_child, atol=1e-9)
    np.testing.assert_allclose(a.axis, b.axis)
    assert (a.lower, a.upper) == (b.lower, b.upper)


def test_the_makers_urdfs_are_read_as_yourdfpy_reads_them(real_hands: Path):
    for path in real_hands.glob("*/*.urdf"):
        ours = read_urdf(path)
        theirs = yourdfpy.URDF.load(str(path), build_scene_graph=False, load_meshes=False).robot
        assert list(ours.links) == [link.name for link in theirs.links]
        for joint in theirs.joints:
            mine = ours.joints[joint.name]
            origin = np.eye(4) if joint.origin is None else joint.origin
            np.testing.assert_allclose(mine.T_parent_child, origin, atol=1e-12)
            if mine.type == "revolute":
                assert (mine.lower, mine.upper) == (joint.limit.lower, joint.limit.upper)
