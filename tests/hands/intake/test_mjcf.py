"""MJCF becomes a URDF that moves as MuJoCo moves it; what a tree can't say is said in words."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
from descriptions import take, write, write_mesh
from hypothesis import given
from hypothesis import strategies as st
from kinematics import link_poses

from gdg.errors import GdgError
from gdg.hands.intake import Intake, take_in
from gdg.hands.urdf import Urdf, read_urdf

BOX = '<geom type="box" size="0.01 0.01 0.02"/>'


def mjcf(bodies: str, rest: str = "", compiler: str = 'angle="radian"') -> str:
    return (
        f'<mujoco model="made"><compiler {compiler}/><worldbody>{bodies}</worldbody>{rest}</mujoco>'
    )


def body(name: str, *inner: str, pos: str = "0 0 0.04", more: str = "") -> str:
    return f'<body name="{name}" pos="{pos}" {more}>{"".join(inner)}</body>'


def hinge(name: str, more: str = 'range="0 1.5"', axis: str = "0 1 0") -> str:
    return f'<joint name="{name}" axis="{axis}" {more}/>'


def gripper(tip: str = "", rest: str = "", first: str = 'range="0 1.5"') -> str:
    """A palm with a finger of two joints; ``tip`` goes into the tip."""
    tip = body("tip", hinge("j2"), tip or BOX)
    return mjcf(body("palm", BOX, body("proximal", hinge("j1", first), BOX, tip)), rest)


def taken(folder: Path, text: str, root: str | None = None) -> tuple[Intake, Urdf, str]:
    intake = take(folder, text, root)
    return intake, read_urdf(intake.urdf), "\n".join(intake.repairs)


def refusal(folder: Path, text: str, root: str | None = None) -> str:
    with pytest.raises(GdgError) as caught:
        take(folder, text, root)
    assert not (folder / "new").exists()
    return str(caught.value)


def assert_moves_alike(text: str, urdf: Urdf, seed: int = 0) -> None:
    """Every body is where its link is, in random postures, as seen from the root."""
    model = mujoco.MjModel.from_xml_string(text)
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    for _ in range(5):
        values = {}
        data.qpos[:] = model.qpos0
        for j in range(model.njnt):
            name = model.joint(j).name
            if name in urdf.joints:
                values[name] = data.qpos[model.jnt_qposadr[j]] = rng.uniform(-1, 1)
        mujoco.mj_kinematics(model, data)
        poses = link_poses(urdf, values)
        T_world_root = body_pose(model, data, urdf.root, moved=False)
        for index in range(1, model.nbody):
            name = model.body(index).name
            if name in poses:
                T_world_link = body_pose(model, data, name, moved=name != urdf.root)
                T_root_link = np.linalg.inv(T_world_root) @ T_world_link
                np.testing.assert_allclose(T_root_link, poses[name], atol=1e-6)


def body_pose(model: mujoco.MjModel, data: mujoco.MjData, name: str, moved: bool) -> np.ndarray:
    """Pose of a body, moved to the anchor of its last joint as a link is."""
    body = model.body(name)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = data.xmat[body.id].reshape(3, 3), data.xpos[body.id]
    last = int(body.jntadr[0] + body.jntnum[0] - 1)
    if moved and body.jntnum[0] and int(model.jnt_type[last]) == int(mujoco.mjtJoint.mjJNT_HINGE):
        T[:3, 3] += T[:3, :3] @ model.jnt_pos[last]
    return T


# -- the tree


def test_a_finger_is_taken_joint_by_joint(tmp_path: Path):
    intake, urdf, said = taken(tmp_path, gripper())
    assert list(urdf.links) == ["palm", "proximal", "tip"]
    assert [(j.name, j.type, j.lower, j.upper) for j in urdf.joints.values()] == [
        ("j1", "revolute", 0, 1.5), ("j2", "revolute", 0, 1.5),
    ]  # fmt: skip
    assert said == ""
    assert intake.actuated is None
    assert intake.source == "MJCF file 'hand.xml', robot 'made'"
    assert_moves_alike(gripper(), urdf)


NUMBER = st.floats(-1, 1).map(lambda value: round(value, 3))
VECTOR = st.tuples(NUMBER, NUMBER, NUMBER)
PLACE = VECTOR.map(lambda vector: tuple(round(0.1 * value, 4) for value in vector))


@st.composite
def trees(draw: st.DrawFn) -> str:
    """Bodies anywhere, with several joints of both kinds with anchors and references."""

    def words(vector: tuple[float, ...]) -> str:
        return " ".join(map(str, vector))

    text, count = "", 0
    for index in range(draw(st.integers(1, 4)), 0, -1):
        joints = ""
        for _ in range(draw(st.integers(0, 3))):
            axis = draw(VECTOR.filter(lambda v: math.hypot(*v) > 0.1))
            joints += (
                f'<joint name="j{count}" type="{draw(st.sampled_from(("hinge", "slide")))}" '
                f'axis="{words(axis)}" pos="{words(draw(PLACE))}" ref="{draw(NUMBER)}" '
                'range="-1 1" armature="0.1"/>'
            )
            count += 1
        quat = words(draw(st.tuples(st.just(1.0), NUMBER, NUMBER, NUMBER)))
        more = f'quat="{quat}"'
        text = body(f"b{index}", joints, BOX, text, pos=words(draw(PLACE)), more=more)
    return mjcf(body("root", BOX, text))


@given(trees())
def test_any_tree_moves_as_in_mujoco(tmp_path_factory: pytest.TempPathFactory, text: str):
    folder = tmp_path_factory.mktemp("tree")
    assert_moves_alike(text, taken(folder, text)[1])


def test_joints_of_one_body_become_a_chain_of_bare_links(tmp_path: Path):
    text = mjcf(body("palm", BOX, body("tip", hinge("a"), hinge("b", axis="1 0 0"), BOX)))
    _, urdf, _ = taken(tmp_path, text)
    assert list(urdf.links) == ["palm", "a_link", "tip"]
    assert urdf.links["a_link"].inertial is None
    assert urdf.links["a_link"].collisions == ()


def test_bodies_and_joints_without_names_get_some(tmp_path: Path):
    text = mjcf(f'<body name="body_2">{BOX}<body><joint range="0 1"/>{BOX}</body></body>')
    _, urdf, _ = taken(tmp_path, text)
    assert list(urdf.links) == ["body_2", "body_2_2"]
    assert list(urdf.joints) == ["body_2_2_joint"]


def test_angles_in_degrees_are_converted(tmp_path: Path):
    _, urdf, _ = taken(tmp_path, gripper(first='range="0 90"').replace("radian", "degree"))
    assert urdf.joints["j1"].upper == pytest.approx(math.pi / 2)


def test_small_ranges_without_a_unit_are_radians(tmp_path: Path):
    text = gripper().replace('<compiler angle="radian"/>', "")
    _, urdf, said = taken(tmp_path, text)
    assert urdf.joints["j1"].upper == pytest.approx(1.5)
    assert "The unit of angles is not stated; ranges of at most 1.5 mean radians." in said
    _, urdf, said = taken(tmp_path, text.replace("0 1.5", "0 90"))
    assert urdf.joints["j1"].upper == pytest.approx(math.pi / 2)
    assert said == ""


def test_a_hinge_without_a_range_turns_freely_and_a_slide_is_refused(tmp_path: Path):
    _, urdf, said = taken(tmp_path, gripper(first=""))
    assert urdf.joints["j1"].type == "continuous"
    assert "Joint 'j1': no limits; taken as turning freely" in said
    other = gripper(first='type="slide"')
    assert "joint 'j1' slides without limits" in refusal(tmp_path / "other", other)


def test_joints_that_move_the_whole_hand_are_dropped(tmp_path: Path):
    text = gripper().replace('pos="0 0 0.04" >', 'pos="0 0 0.04"><freejoint name="mount"/>', 1)
    _, urdf, said = taken(tmp_path, text)
    assert urdf.root == "palm"
    assert "Joint 'mount': moves the whole hand in the world; dropped." in said


def test_a_ball_joint_in_the_hand_is_refused(tmp_path: Path):
    text = gripper(first='type="ball"').replace('axis="0 1 0" type', "type")
    assert "joint 'j1' of body 'proximal' is a ball joint" in refusal(tmp_path, text)


def test_a_scene_around_the_hand_is_left_out(tmp_path: Path):
    scene = (
        '<geom type="plane" size="1 1 1"/><light/><camera name="c"/>'
        f'<body name="object"><freejoint/>{BOX}</body><body name="table">{BOX}</body>'
    )
    text = gripper().replace("<worldbody>", f"<worldbody>{scene}")
    _, urdf, said = taken(tmp_path, text)
    assert list(urdf.links) == ["palm", "proximal", "tip"]
    assert "Kept body 'palm' and what hangs on it; 2 other bodies were left out." in said


def test_fingers_that_hang_on_the_world_have_it_for_a_palm(tmp_path: Path):
    fingers = "".join(body(name, hinge(f"j_{name}"), BOX) for name in ("a", "b"))
    _, urdf, _ = taken(tmp_path, mjcf(BOX + fingers))
    assert (urdf.root, list(urdf.links)) == ("world", ["world", "a", "b"])
    assert len(urdf.links["world"].collisions) == 1


def test_two_hands_are_refused_unless_one_is_chosen(tmp_path: Path):
    hands = "".join(body(n, BOX, body(f"{n}_tip", hinge(f"{n}_j"), BOX)) for n in ("left", "right"))
    message = refusal(tmp_path, mjcf(hands))
    assert "several bodies could be the hand: left, right; choose one with --root" in message
    _, urdf, _ = taken(tmp_path, mjcf(hands), root="right")
    assert list(urdf.links) == ["right", "right_tip"]
    assert "no body 'rigth'. Did you mean 'right'?" in refusal(
        tmp_path / "other", mjcf(hands), root="rigth"
    )


# -- shapes


def test_primitives_keep_size_and_place(tmp_path: Path):
    geoms = (
        '<geom type="sphere" size="0.01" pos="1 0 0"/>'
        '<geom type="cylinder" size="0.01 0.03"/>'
        '<geom type="capsule" size="0.01 0.03" pos="0 0 0.1"/>'
    )
    _, urdf, _ = taken(tmp_path, gripper(tip=geoms + BOX))
    shapes = urdf.links["tip"].collisions
    assert [(s.kind, s.size) for s in shapes] == [
        ("sphere", (0.01,)), ("cylinder", (0.01, 0.06)), ("cylinder", (0.01, 0.06)),
        ("sphere", (0.01,)), ("sphere", (0.01,)), ("box", (0.02, 0.02, 0.04)),
    ]  # fmt: skip
    assert [s.T_link_shape[2, 3] for s in shapes[2:5]] == pytest.approx([0.1, 0.07, 0.13])


def test_an_ellipsoid_becomes_a_mesh(tmp_path: Path):
    intake, urdf, _ = taken(tmp_path, gripper(tip='<geom type="ellipsoid" size="0.01 0.02 0.03"/>'))
    (shape,) = urdf.links["tip"].collisions
    written = trimesh.load_mesh(intake.urdf.parent / shape.mesh)
    assert written.extents == pytest.approx([0.02, 0.04, 0.06], rel=0.01)


def test_meshes_lie_where_mujoco_puts_them(tmp_path: Path):
    made = trimesh.creation.box([0.01, 0.02, 0.05]).apply_translation([0.02, 0.01, 0.0])
    made.export(write(tmp_path, "", "source/stl/tip.stl"))
    text = gripper(
        tip='<geom type="mesh" mesh="tip" pos="0 0 0.01" euler="0 0 1"/>',
        rest='<asset><mesh file="tip.stl" scale="1 2 1"/></asset>',
    ).replace("<compiler", '<compiler meshdir="stl"')
    intake, urdf, _ = taken(tmp_path, text)
    (shape,) = urdf.links["tip"].collisions
    written = trimesh.load_mesh(intake.urdf.parent / shape.mesh).apply_transform(shape.T_link_shape)
    expected = made.copy().apply_scale([1, 2, 1])
    expected.apply_transform(trimesh.transformations.rotation_matrix(1, [0, 0, 1]))
    expected.apply_translation([0, 0, 0.01])
    np.testing.assert_allclose(written.bounds, expected.bounds, atol=1e-6)


def test_geoms_that_touch_nothing_are_visual(tmp_path: Path):
    seen = '<geom type="sphere" size="0.01" contype="0" conaffinity="0"{}/>'
    tip = seen.format("") + seen.format(' group="3"') + seen.format(' name="paired"') + BOX
    palm = BOX.replace("<geom", '<geom name="palm"')
    rest = '<contact><pair geom1="paired" geom2="palm"/></contact>'
    text = gripper(tip, rest).replace(BOX, palm, 1)
    _, urdf, _ = taken(tmp_path, text)
    assert [s.kind for s in urdf.links["tip"].visuals] == ["sphere"]
    assert [s.kind for s in urdf.links["tip"].collisions] == ["sphere", "sphere", "box"]


def test_mass_properties_are_mujocos(tmp_path: Path):
    inertial = '<inertial pos="0 0 0.01" mass="0.03" diaginertia="8e-6 7e-6 3e-6" euler="0 1 0"/>'
    _, urdf, said = taken(tmp_path, gripper(tip=inertial + BOX))
    found = urdf.links["tip"].inertial
    assert found is not None
    assert found.mass == pytest.approx(0.03)
    assert np.linalg.eigvalsh(found.inertia) == pytest.approx([3e-6, 7e-6, 8e-6])
    assert found.T_link_center[2, 3] == pytest.approx(0.01)
    assert said == ""


def test_bodies_without_mass_get_one_from_their_shapes(tmp_path: Path):
    text = gripper().replace("<geom", '<geom mass="0"')
    _, urdf, said = taken(tmp_path, text)
    assert urdf.links["tip"].mass == pytest.approx(0.016)
    assert "no mass given" in said


def test_a_lost_visual_mesh_is_dropped_and_a_lost_collision_mesh_refused(tmp_path: Path):
    lost = '<geom type="mesh" mesh="lost"{}/>'
    rest = '<asset><mesh name="lost" file="lost.stl"/></asset>'
    seen = lost.format(' contype="0" conaffinity="0"')
    _, urdf, said = taken(tmp_path, gripper(tip=seen + BOX, rest=rest))
    assert urdf.links["tip"].visuals == ()
    assert "Dropped visual meshes" in said
    message = refusal(tmp_path / "other", gripper(tip=lost.format(""), rest=rest))
    assert "link 'tip', mesh 'lost.stl': there is no such file" in message


# -- what the description says beside


def test_excluded_pairs_are_named(tmp_path: Path):
    rest = '<contact><exclude body1="palm" body2="tip"/></contact>'
    assert taken(tmp_path, gripper(rest=rest))[0].excluded == (("palm", "tip"),)


def test_what_mujoco_does_not_know_is_ignored_and_said(tmp_path: Path):
    text = gripper(rest='<default><geom/></default><contact frobs="1"/>')
    _, urdf, said = taken(tmp_path, text)
    assert "tip" in urdf.links
    assert "Ignored the attribute 'frobs' of <contact>, which MuJoCo does not know." in said


def test_what_mujoco_refuses_is_refused_in_its_words(tmp_path: Path):
    message = refusal(tmp_path, gripper(tip='<geom type="box" size="-1 1 1"/>'))
    assert "hand.xml: MuJoCo refuses it: " in message
    assert "size" in message


def test_mujoco_leaves_no_log_where_the_user_works(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    slides = '<joint type="slide" axis="1 0 0" range="0 1"/>' * 2  # a singular inertia
    taken(tmp_path, mjcf(body("palm", BOX, body("tip", slides, BOX))))
    assert list((tmp_path / "here").iterdir()) == []


def test_without_mujoco_the_command_that_installs_it_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    assert "pip install 'gdg[mujoco]'" in refusal(tmp_path, gripper())


# -- untrusted files


def test_includes_are_put_in_place(tmp_path: Path):
    write_mesh(tmp_path / "source/parts/stl/tip.stl")
    write(tmp_path, f"<mujocoinclude>{hinge('j2')}</mujocoinclude>", "source/parts/joint.xml")
    write(
        tmp_path,
        '<mujoco><compiler meshdir="parts/stl"/><asset><mesh file="tip.stl"/></asset></mujoco>',
        "source/parts/asset.xml",
    )
    tip = '<include file="parts/joint.xml"/><geom type="mesh" mesh="tip"/>'
    text = mjcf(body("palm", BOX, body("tip", tip)), '<include file="parts/asset.xml"/>')
    _, urdf, _ = taken(tmp_path, text)
    assert "j2" in urdf.joints
    assert urdf.links["tip"].collisions[0].mesh == "meshes/tip.stl"


@pytest.mark.parametrize(
    "tip",
    [
        '<include file="../../outside.xml"/>',
        '<include file="/etc/hosts.xml"/>',
        '<include file="link.xml"/>',
    ],
)
def test_includes_outside_are_refused(tmp_path: Path, tip: str):
    outside = write(tmp_path, f"<mujocoinclude>{hinge('j2')}</mujocoinclude>", "outside.xml")
    folder = tmp_path / "a" / "source"
    folder.mkdir(parents=True)
    (folder / "link.xml").symlink_to(outside)
    assert "lies outside" in refusal(tmp_path / "a", mjcf(body("palm", BOX, tip)))


def test_meshes_outside_are_refused(tmp_path: Path):
    write_mesh(tmp_path / "outside.stl")
    for file in ("../../outside.stl", str(tmp_path / "outside.stl")):
        rest = f'<asset><mesh name="m" file="{file}"/></asset>'
        text = gripper(tip='<geom type="mesh" mesh="m"/>', rest=rest)
        assert "lies outside" in refusal(tmp_path / "a", text)


def test_files_in_the_folders_given_are_read(tmp_path: Path):
    write_mesh(tmp_path / "elsewhere/tip.stl")
    rest = '<asset><mesh file="../../elsewhere/tip.stl"/></asset>'
    text = gripper(tip='<geom type="mesh" mesh="tip"/>', rest=rest)
    source = write(tmp_path, text, "a/source/hand.xml")
    with pytest.raises(GdgError, match=r"lies outside .*--packages"):
        take_in(source, tmp_path / "new", "acme")
    intake = take_in(source, tmp_path / "new", "acme", package_paths=[tmp_path / "elsewhere"])
    assert read_urdf(intake.urdf).links["tip"].collisions[0].mesh == "meshes/tip.stl"


@pytest.mark.parametrize(
    ("inner", "reason"),
    [
        ('<include file="hand.xml"/>', "includes 'hand.xml' twice"),
        ('<include file="lost.xml"/>', "include 'lost.xml': there is no such file"),
        ('<include file="id_rsa"/>', "is none of the kinds .xml"),
        ('<replicate count="1000">' + BOX + "</replicate>", "replicates parts"),
        ('<replicate count="100"><replicate count="50">' + BOX + "</replicate></replicate>",
         "replicates parts 5000 times"),
        (BOX * 2001, "2002 <geom> elements"),
        ('<attach model="m" prefix="a"/>', "joins other models with <attach>"),
    ],
)  # fmt: skip
def test_what_has_no_end_is_refused(tmp_path: Path, inner: str, reason: str):
    assert reason in refusal(tmp_path, mjcf(body("palm", BOX, inner)))


def test_what_could_be_made_huge_is_never_given_to_mujoco(tmp_path: Path):
    rest = (
        '<size memory="900G"/><option timestep="1"/><visual><quality shadowsize="999999"/></visual>'
        '<asset><texture name="t" type="2d" builtin="flat" width="99999" height="99999"/>'
        '<material name="m" texture="t"/>'
        '<hfield name="h" nrow="99999" ncol="99999" size="1 1 1 1"/>'
        '</asset><extension><plugin plugin="evil.so"/></extension>'
    )
    flex = '<flexcomp name="f" type="grid" count="999 999 999" spacing="1 1 1"/>'
    tip = '<geom type="hfield" hfield="h"/><geom type="box" size="0.01 0.01 0.02" material="m"/>'
    _, urdf, _ = taken(tmp_path, gripper(tip=tip + flex, rest=rest))
    assert [s.kind for s in urdf.links["tip"].collisions] == ["box"]


def test_a_huge_mesh_is_refused_unread(tmp_path: Path):
    path = write_mesh(tmp_path / "source/huge.stl")
    with path.open("r+b") as stream:
        stream.truncate(200_000_001)
    rest = '<asset><mesh file="huge.stl"/></asset>'
    with pytest.raises(GdgError, match="larger than 200 MB"):
        take_in(
            write(tmp_path, gripper(tip='<geom type="mesh" mesh="huge"/>', rest=rest),
                  "source/hand.xml"),
            tmp_path / "new", "acme",
        )  # fmt: skip
