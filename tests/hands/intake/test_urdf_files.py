"""What other loaders let pass in a URDF is mended and said, or refused with the reason."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from descriptions import INERTIAL, LIMIT, box, finger, joint, link, robot, take, write
from kinematics import link_poses

from gdg.errors import GdgError
from gdg.hands.intake import take_in
from gdg.hands.urdf import Urdf, read_urdf


def taken(folder: Path, text: str, root: str | None = None) -> tuple[Urdf, str]:
    intake = take(folder, text, root)
    return read_urdf(intake.urdf), "\n".join(intake.repairs)


def refusal(folder: Path, text: str | bytes, root: str | None = None) -> str:
    with pytest.raises(GdgError) as caught:
        take(folder, text, root)
    assert not (folder / "new").exists()
    return str(caught.value)


def test_a_sound_description_is_taken_as_it_is(tmp_path: Path):
    intake = take(tmp_path, finger())
    assert intake.urdf == tmp_path / "new" / "acme.urdf"
    assert intake.repairs == ()
    assert intake.geometry == "collision"
    assert intake.actuated is None
    assert intake.licence is None
    assert intake.source == "URDF file 'hand.urdf', robot 'made'"
    urdf = read_urdf(intake.urdf)
    assert urdf.name == "acme"
    assert list(urdf.links) == ["palm", "proximal", "tip"]
    assert urdf.joints["j1"].effort == 5
    assert urdf.joints["j1"].velocity == 2


def test_limits_the_wrong_way_round_are_swapped(tmp_path: Path):
    urdf, said = taken(tmp_path, finger('<limit lower="1" upper="-0.5" effort="1" velocity="1"/>'))
    assert (urdf.joints["j2"].lower, urdf.joints["j2"].upper) == (-0.5, 1)
    assert "Joint 'j2': its limits were the wrong way round" in said


@pytest.mark.parametrize("inner", ["", "<limit effort='1' velocity='1'/>"])
def test_a_revolute_joint_without_limits_turns_freely(tmp_path: Path, inner: str):
    urdf, said = taken(tmp_path, finger(inner))
    assert urdf.joints["j2"].type == "continuous"
    assert urdf.joints["j2"].upper == pytest.approx(math.pi)
    assert "Joint 'j2': no limits; taken as turning freely" in said


def test_a_prismatic_joint_without_limits_is_refused(tmp_path: Path):
    assert "a prismatic joint needs <limit" in refusal(tmp_path, finger("", kind="prismatic"))


def test_a_mimic_joint_without_limits_gets_those_of_its_master(tmp_path: Path):
    urdf, said = taken(tmp_path, finger('<mimic joint="j1" multiplier="-2" offset="0.5"/>'))
    assert urdf.joints["j2"].lower == pytest.approx(-2.5)
    assert urdf.joints["j2"].upper == pytest.approx(0.5)
    assert "got those of the joint that it follows" in said


def test_limits_in_degrees_become_radians(tmp_path: Path):
    urdf, said = taken(tmp_path, finger('<limit lower="0" upper="90" effort="1" velocity="1"/>'))
    assert urdf.joints["j2"].upper == pytest.approx(math.pi / 2)
    assert "limits 0 and 90 taken as degrees" in said


def test_boundless_limits_mean_that_a_joint_turns_freely(tmp_path: Path):
    urdf, _ = taken(tmp_path, finger('<limit lower="-1e16" upper="1e16"/>'))
    assert urdf.joints["j2"].type == "continuous"


def test_an_effort_that_is_no_number_says_nothing(tmp_path: Path):
    urdf, _ = taken(tmp_path, finger('<limit lower="0" upper="1" effort="inf" velocity="inf"/>'))
    assert (urdf.joints["j2"].effort, urdf.joints["j2"].velocity) == (0, 0)


def test_a_mimic_of_a_joint_that_does_not_exist_is_refused_by_name(tmp_path: Path):
    text = finger(LIMIT + '<mimic joint="j11"/>')
    assert "joint 'j2': mimics 'j11', which does not exist. Did you mean" in refusal(tmp_path, text)


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_a_joint_that_places_the_hand_in_the_world_is_dropped(tmp_path: Path, kind: str):
    text = finger().replace(
        '<link name="palm">', link("world") + joint("mount", "world", "palm", "", kind)
        + '<link name="palm">',
    )  # fmt: skip
    urdf, said = taken(tmp_path, text)
    assert urdf.root == "palm"
    assert f"Dropped the {kind} joint 'mount' with link 'world'" in said


def test_a_floating_joint_inside_the_hand_is_refused(tmp_path: Path):
    text = finger("", kind="floating")
    assert "joint 'j2' is floating and inside the tree" in refusal(tmp_path, text)


def test_several_trees_are_refused_unless_one_is_chosen(tmp_path: Path):
    text = finger().replace("</robot>", link("table", box()) + "</robot>")
    assert "2 trees, with the roots palm, table; choose one with --root" in refusal(tmp_path, text)
    urdf, said = taken(tmp_path, text, root="palm")
    assert list(urdf.links) == ["palm", "proximal", "tip"]
    assert "1 other links" not in said
    assert "Kept link 'palm' and what hangs on it; one other link was cut off." in said


def test_a_bare_link_that_hangs_on_nothing_is_dropped(tmp_path: Path):
    urdf, said = taken(tmp_path, finger().replace("</robot>", link("frame") + "</robot>"))
    assert list(urdf.links) == ["palm", "proximal", "tip"]
    assert "Link 'frame': without shapes, hanging on nothing; dropped." in said


def arm_and_hand() -> str:
    arm = link("base", box()) + joint("shoulder", "base", "palm") + link("sensor", box())
    arm += joint("s", "base", "sensor", "", "fixed")
    follower = LIMIT + '<mimic joint="shoulder"/>'
    return finger(follower).replace("</robot>", arm + "</robot>")


def test_an_arm_is_cut_off_at_the_root_given(tmp_path: Path):
    urdf, said = taken(tmp_path, arm_and_hand(), root="palm")
    assert urdf.root == "palm"
    assert list(urdf.joints) == ["j1", "j2"]
    assert urdf.joints["j2"].mimic is None
    assert "2 other links were cut off" in said
    assert "Joint 'j2' followed joint 'shoulder', which was cut off" in said


def test_an_unknown_root_is_refused_with_the_nearest_name(tmp_path: Path):
    message = refusal(tmp_path, finger(), root="pam")
    assert "there is no link 'pam'. Did you mean 'palm'?" in message


def test_names_that_occur_twice_are_refused(tmp_path: Path):
    assert "link 'a' is defined twice" in refusal(tmp_path, robot(link("a", box()), link("a")))


def test_a_capsule_becomes_a_cylinder_and_two_spheres(tmp_path: Path):
    capsule = (
        '<collision><origin xyz="0 0.1 0" rpy="1.5707963267948966 0 0"/>'
        '<geometry><capsule radius="0.01" length="0.04"/></geometry></collision>'
    )
    urdf, said = taken(tmp_path, finger(tip=capsule))
    shapes = urdf.links["tip"].collisions
    assert [(s.kind, s.size) for s in shapes] == [
        ("cylinder", (0.01, 0.04)), ("sphere", (0.01,)), ("sphere", (0.01,)),
    ]  # fmt: skip
    ends = sorted(s.T_link_shape[1, 3] for s in shapes[1:])
    np.testing.assert_allclose(ends, [0.08, 0.12], atol=1e-9)
    np.testing.assert_allclose(shapes[0].T_link_shape[:3, 3], [0, 0.1, 0], atol=1e-9)
    assert "Link 'tip': a capsule became a cylinder and two spheres." in said


@pytest.mark.parametrize(
    ("shape", "reason"),
    [
        ("<collision/>", "Dropped a collision shape of link 'tip': its geometry is empty."),
        ("<visual><geometry><heightmap/></geometry></visual>", "its geometry is heightmap."),
        (box(size="0 0 0"), "Dropped a collision box of link 'tip': its size is zero."),
    ],
)
def test_a_shape_that_is_none_is_dropped(tmp_path: Path, shape: str, reason: str):
    urdf, said = taken(tmp_path, finger(tip=shape + box()))
    assert len(urdf.links["tip"].collisions) == 1
    assert reason in said


@pytest.mark.parametrize("mass", ["-1", "nan", "heavy"])
def test_an_inertial_of_no_numbers_is_as_good_as_none(tmp_path: Path, mass: str):
    inertial = INERTIAL.replace("0.02", mass)
    text = robot(link("a", box(), inertial), link("b", box(), INERTIAL), joint("j", "a", "b"))
    urdf, said = taken(tmp_path, text)
    assert urdf.links["a"].mass == pytest.approx(0.02)
    assert "Link 'a': no mass given" in said


def test_transmissions_name_the_driven_joints(tmp_path: Path):
    transmission = '<transmission name="t"><joint name="j1"/></transmission>'
    intake = take(tmp_path, finger().replace("</robot>", transmission + "</robot>"))
    assert intake.actuated == ("j1",)


def test_ros2_control_names_the_driven_joints_but_those_that_follow(tmp_path: Path):
    control = "".join(
        f'<joint name="{name}">{interface}</joint>'
        for name, interface in (
            ("j1", '<command_interface name="position"/>'),
            ("j2", '<command_interface name="position"/>'),
            ("j3", '<state_interface name="position"/>'),
        )
    )
    text = finger(LIMIT + '<mimic joint="j1"/>').replace(
        "</robot>", f"<ros2_control>{control}</ros2_control></robot>"
    )
    assert take(tmp_path, text).actuated == ("j1",)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ('<!DOCTYPE r [<!ENTITY a "x"><!ENTITY b "&a;&a;">]><robot/>', "declares entities"),
        ('<!DOCTYPE m [<!ENTITY a SYSTEM "file:///etc/passwd">]><mujoco/>', "declares entities"),
        ("<robot", "is no well-formed XML"),
        ("<sdf/>", "is an SDF file"),
        ("<urdf/>", "the outermost element is <urdf>"),
        (
            '<robot xmlns:xacro="http://ros.org/xacro"><xacro:include filename="a"/></robot>',
            "xacro FILE > hand.urdf",
        ),
        (robot(link("a")), "no link has a shape"),
        (robot(*(link(f"l{i}") for i in range(501))), "501 <link> elements"),
    ],
)
def test_what_is_no_hand_is_refused(tmp_path: Path, text: str, reason: str):
    assert reason in refusal(tmp_path, text)


def test_a_huge_file_is_refused_unread(tmp_path: Path):
    path = write(tmp_path, "")
    with path.open("wb") as stream:
        stream.truncate(6_000_000)
    with pytest.raises(GdgError, match="larger than 5 MB"):
        take_in(path, tmp_path / "new", "acme")


def test_extensions_without_a_declared_prefix_do_not_matter(tmp_path: Path):
    extension = '<drake:group name="a" drake:note="b: c"><drake:member link="tip"/></drake:group>'
    urdf, said = taken(tmp_path, finger().replace("</robot>", extension + "</robot>"))
    assert list(urdf.links) == ["palm", "proximal", "tip"]
    assert said == ""
    xacro = "<robot><xacro:include filename='a'/></robot>"
    assert "xacro FILE > hand.urdf" in refusal(tmp_path / "other", xacro)


def test_a_missing_file_is_named(tmp_path: Path):
    with pytest.raises(GdgError, match=r"lost\.urdf: cannot be read"):
        take_in(tmp_path / "lost.urdf", tmp_path / "new", "acme")


def test_the_makers_hands_keep_their_kinematics(real_hands: Path, tmp_path: Path):
    geometry = {}
    rng = np.random.default_rng(0)
    for source in sorted(real_hands.glob("*/*.urdf")):
        intake = take_in(source, tmp_path / source.stem, source.stem)
        before, after = read_urdf(source), read_urdf(intake.urdf)
        values = {
            name: rng.uniform(j.lower, j.upper)
            for name, j in before.joints.items()
            if j.type != "fixed"
        }
        poses = link_poses(after, values)
        for name, T_root_link in link_poses(before, values).items():
            np.testing.assert_allclose(T_root_link, poses[name], atol=1e-9)
        geometry[source.stem] = intake.geometry
        for name in {s.mesh for k in after.links.values() for s in (*k.visuals, *k.collisions)}:
            assert not name or (intake.urdf.parent / name).is_file()
    assert geometry.pop("shadowhand") == "visual"
    assert set(geometry.values()) == {"collision"}


def test_a_joint_without_range_becomes_fixed_where_it_stands(tmp_path: Path):
    before = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
    stiff = '<limit lower="0.4" upper="0.4" effort="1" velocity="1"/>'
    free, _ = taken(tmp_path / "free", finger(before))
    urdf, said = taken(tmp_path / "stiff", finger(stiff))
    assert urdf.joints["j2"].type == "fixed"
    assert "Joint 'j2': its limits leave it no range; it is fixed now." in said
    values = {"j1": 0.3, "j2": 0.4}
    np.testing.assert_allclose(
        link_poses(urdf, values)["tip"], link_poses(free, values)["tip"], atol=1e-9
    )


def test_a_slide_without_range_becomes_fixed_where_it_stands(tmp_path: Path):
    stiff = '<limit lower="0.01" upper="0.01" effort="1" velocity="1"/>'
    urdf, _ = taken(tmp_path, finger(stiff, kind="prismatic"))
    np.testing.assert_allclose(urdf.joints["j2"].T_parent_child[:3, 3], [0, 0.01, 0.05])


def test_a_follower_without_range_gets_that_of_what_it_follows(tmp_path: Path):
    stiff = '<limit lower="0" upper="0"/><mimic joint="j1" multiplier="2"/>'
    urdf, said = taken(tmp_path, finger(stiff))
    assert (urdf.joints["j2"].lower, urdf.joints["j2"].upper) == (0, 3)
    assert "Joint 'j2': no limits; got those of the joint that it follows" in said


def test_a_joint_that_others_follow_is_not_fixed(tmp_path: Path):
    text = finger(LIMIT + '<mimic joint="j1"/>').replace('upper="1.5"', 'upper="0"', 1)
    urdf, _ = taken(tmp_path, text)
    assert urdf.joints["j1"].type == "revolute"
