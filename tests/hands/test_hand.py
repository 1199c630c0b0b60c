"""Manifest, tree and geometry of a hand are checked against each other, and files stay inside."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from gripper import MANIFEST as MANIFEST_TEXT
from gripper import URDF as URDF_TEXT
from gripper import write_gripper

from gdg.errors import GdgError
from gdg.hands.geometry import HIDDEN_STEP_M, hand_spheres, hand_surface
from gdg.hands.hand import Hand, load_hand


def write(folder: Path, *, urdf: str = URDF_TEXT, manifest: str = MANIFEST_TEXT) -> Path:
    target = write_gripper(folder)
    (target / "two_jaws.urdf").write_text(urdf, encoding="utf-8")
    (target / "hand.yaml").write_text(manifest, encoding="utf-8")
    return target


def with_mesh(folder: Path, name: str, attributes: str = "", origin: str = "") -> Path:
    """The gripper with a mesh in place of its left jaw's box."""
    old = '<origin xyz="0 0.005 0.035"/><geometry><box size="0.03 0.01 0.06"/></geometry>'
    assert old in URDF_TEXT
    geometry = f'<geometry><mesh filename="{name}" {attributes}/></geometry>'
    return write(folder, urdf=URDF_TEXT.replace(old, origin + geometry))


def box(path: Path, *size: float, center: tuple[float, ...] = (0, 0, 0)) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    mesh = trimesh.creation.box(size)
    mesh.apply_translation(center)
    mesh.export(path)
    return path


def mistake(folder: Path) -> str:
    with pytest.raises(GdgError) as caught:
        load_hand(folder)
    return str(caught.value)


# -- manifest against tree ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("root_link: base", "root_link: bass",
         "root_link: link 'bass' is not in two_jaws.urdf. Did you mean 'base'?"),
        ("root_link: base", "root_link: palm",
         "root_link: 'palm' is not the root of the tree, which is 'base'"),
        ("{link: palm", "{link: plam", "palm.link: link 'plam' is not in two_jaws.urdf."),
        ("  left:", "  lefft:", "contact_regions.lefft: link 'lefft' is not in two_jaws.urdf."),
        ("joints: [close]", "joints: [clos]",
         "joints[0]: joint 'clos' is not in two_jaws.urdf. Did you mean 'close'?"),
        ("joints: [close]", "joints: [palm_fixed]", "joint 'palm_fixed' is a fixed joint"),
        ("joints: [close]", "joints: [close, close_right]",
         "joints[1]: joint 'close_right' mimics another one"),
        ("joints: [close]", "joints: [close, close]", "joints: a joint is listed twice."),
        ("open: {close: 0.0}", "open: {close: -0.1}",
         "open.close: -0.1 is outside the joint's limits [0, 0.05]."),
        ("closed: {close: 0.05}", "closed: {close: 50}", "closed.close: 50 is outside"),
        ("open: {close: 0.0}", "open: {shut: 0}", "open.shut: joint 'shut' is not in"),
        ("drives:", "drives:\n  joints: {cloze: {}}", "drives.joints.cloze: joint 'cloze' is not"),
        ("drives:", "allowed_self_contacts: [[left, rigth]]\ndrives:",
         "allowed_self_contacts[0]: link 'rigth' is not in two_jaws.urdf. Did you mean 'right'?"),
        ("urdf: two_jaws.urdf", "urdf: other.urdf", "urdf: there is no file 'other.urdf'"),
    ],
)  # fmt: skip
def test_a_wrong_reference_is_named(tmp_path: Path, old: str, new: str, reason: str):
    assert old in MANIFEST_TEXT
    folder = write(tmp_path, manifest=MANIFEST_TEXT.replace(old, new))
    message = mistake(folder)
    assert message.startswith(f"{folder / 'hand.yaml'}: ")
    assert reason in message


def test_all_wrong_references_are_reported_at_once(tmp_path: Path):
    text = MANIFEST_TEXT.replace("{link: palm", "{link: x").replace("open: {close", "open: {y")
    assert len(mistake(write(tmp_path, manifest=text)).splitlines()) == 2


def test_a_misspelt_joint_is_one_mistake_though_postures_name_the_right_one(tmp_path: Path):
    text = MANIFEST_TEXT.replace("joints: [close]", "joints: [clos]")
    assert len(mistake(write(tmp_path, manifest=text)).splitlines()) == 1


def test_a_posture_of_another_joint_is_told_beside_a_misspelt_one(tmp_path: Path):
    wrist = (
        '<link name="arm"/><joint name="wrist" type="revolute"><parent link="arm"/>'
        '<child link="base"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
    )
    text = MANIFEST_TEXT.replace("joints: [close]", "joints: [clos]")
    text = text.replace("open: {close: 0.0}", "open: {close: 0.0, wrist: 0.0}")
    text = text.replace("root_link: base", "root_link: arm")
    urdf = URDF_TEXT.replace("</robot>", wrist)
    first, second = mistake(write(tmp_path, urdf=urdf, manifest=text)).splitlines()
    assert "joints[0]: joint 'clos' is not in" in first
    assert "open.wrist: joint 'wrist' is not among the actuated joints" in second


def test_a_missing_folder_is_named(tmp_path: Path):
    assert "cannot be read" in mistake(tmp_path / "lost")


def test_a_urdf_that_is_a_link_out_of_the_folder_is_refused(tmp_path: Path):
    folder = write(tmp_path)
    (folder / "two_jaws.urdf").rename(tmp_path / "outside.urdf")
    (folder / "two_jaws.urdf").symlink_to(tmp_path / "outside.urdf")
    assert "lies outside the folder" in mistake(folder)


def test_a_link_in_a_circle_is_refused(tmp_path: Path):
    folder = write(tmp_path)
    (folder / "two_jaws.urdf").unlink()
    (folder / "two_jaws.urdf").symlink_to("two_jaws.urdf")
    assert "there is no file" in mistake(folder)


# -- meshes ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", ["../outside.stl", "meshes/../../outside.stl", "package://two_jaws/../../outside.stl"]
)
def test_a_mesh_outside_the_folder_is_refused(tmp_path: Path, name: str):
    box(tmp_path / "outside.stl", 0.01, 0.01, 0.01)
    assert "lies outside the hand's folder" in mistake(with_mesh(tmp_path, name))


def test_an_absolute_path_outside_the_folder_is_refused(tmp_path: Path):
    path = box(tmp_path / "outside.stl", 0.01, 0.01, 0.01)
    assert "lies outside the hand's folder" in mistake(with_mesh(tmp_path, str(path)))


def test_a_mesh_that_is_a_link_out_of_the_folder_is_refused(tmp_path: Path):
    folder = with_mesh(tmp_path, "jaw.stl")
    (folder / "jaw.stl").symlink_to(box(tmp_path / "outside.stl", 0.01, 0.01, 0.01))
    assert "lies outside the hand's folder" in mistake(folder)


@pytest.mark.parametrize(
    "name", ["file:///etc/passwd", "http://localhost:1/a.stl", "model://a.stl"]
)
def test_a_mesh_address_is_refused(tmp_path: Path, name: str):
    assert f"link 'left': mesh '{name}' is no path inside" in mistake(with_mesh(tmp_path, name))


@pytest.mark.parametrize("name", ["lost.stl", "package://two_jaws/lost.stl", "x" * 3000, "."])
def test_a_missing_mesh_is_named(tmp_path: Path, name: str):
    message = mistake(with_mesh(tmp_path, name))
    assert "link 'left': there is no mesh file" in message
    assert len(message) < 1000


@pytest.mark.parametrize(
    ("name", "file"),
    [
        ("meshes/jaw.stl", "meshes/jaw.stl"),
        ("package://two_jaws/meshes/jaw.stl", "meshes/jaw.stl"),
        ("package://two_jaws/meshes/jaw.stl", "two_jaws/meshes/jaw.stl"),
    ],
)
def test_a_mesh_inside_the_folder_is_found(tmp_path: Path, name: str, file: str):
    folder = with_mesh(tmp_path, name)
    box(folder / file, 0.03, 0.01, 0.06)
    assert any(part.kind == "hull" for part in load_hand(folder).parts)


def test_the_usual_layout_of_ros_packages_is_understood(tmp_path: Path):
    folder = with_mesh(tmp_path, "package://two_jaws/meshes/jaw.stl")
    (folder / "urdf").mkdir()
    (folder / "two_jaws.urdf").rename(folder / "urdf" / "hand.urdf")
    text = MANIFEST_TEXT.replace("two_jaws.urdf", "urdf/hand.urdf")
    (folder / "hand.yaml").write_text(text)
    box(folder / "meshes" / "jaw.stl", 0.03, 0.01, 0.06)
    assert load_hand(folder)


def test_a_mesh_in_millimetres_gets_a_hint(tmp_path: Path):
    folder = with_mesh(tmp_path, "jaw.stl")
    box(folder / "jaw.stl", 300, 10, 2600)
    message = mistake(folder)
    assert "link 'left': mesh 'jaw.stl' is 2.6e+03 m long" in message
    assert 'scale="0.001 0.001 0.001"' in message


def test_a_primitive_in_millimetres_gets_a_hint(tmp_path: Path):
    text = URDF_TEXT.replace("0.03 0.01 0.06", "30 10 60")
    assert "link 'left': box is 60 m long" in mistake(write(tmp_path, urdf=text))


def test_a_damaged_mesh_is_named(tmp_path: Path):
    folder = with_mesh(tmp_path, "jaw.stl")
    (folder / "jaw.stl").write_bytes(b"solid nothing")
    assert "jaw.stl" in mistake(folder)


def test_a_flat_mesh_is_named_with_its_link(tmp_path: Path):
    folder = with_mesh(tmp_path, "sheet.obj")
    (folder / "sheet.obj").write_text("v 0 0 0\nv .1 0 0\nv .1 .1 0\nf 1 2 3\nf 3 2 1\n")
    assert "link 'left': mesh 'sheet.obj': the mesh encloses no volume" in mistake(folder)


def test_scale_and_origin_of_a_mesh_are_applied_in_that_order(tmp_path: Path):
    origin = '<origin xyz="0.1 0 0" rpy="0 0 1.5707963267948966"/>'
    folder = with_mesh(tmp_path, "jaw.stl", 'scale="0.001 -0.002 0.001"', origin)
    box(folder / "jaw.stl", 20, 10, 60, center=(10, 5, 30))
    (part,) = [part for part in load_hand(folder).parts if part.link == "left"]
    # scaled: x 0 to 0.02, y -0.02 to 0, z 0 to 0.06; then turned (x to y, y to -x) and shifted
    np.testing.assert_allclose(part.mesh.bounds, [[0.1, 0, 0], [0.12, 0.02, 0.06]], atol=1e-6)
    assert part.mesh.volume == pytest.approx(0.02 * 0.02 * 0.06, rel=1e-4)


def test_visual_shapes_are_the_geometry_only_where_the_manifest_says_so(tmp_path: Path):
    visual = '<visual><geometry><sphere radius="0.01"/></geometry></visual>'
    urdf = URDF_TEXT.replace('<link name="left">', f'<link name="left">{visual}')
    assert all(part.kind == "box" for part in load_hand(write(tmp_path, urdf=urdf)).parts)
    text = MANIFEST_TEXT.replace("title:", "geometry: visual\ntitle:")
    (part,) = load_hand(write(tmp_path, urdf=urdf, manifest=text)).parts
    assert part.kind == "sphere"
    message = mistake(write(tmp_path, manifest=text))
    assert "no link has visual shapes" in message


# -- the one geometry -----------------------------------------------------------------------


def test_every_shape_of_a_link_is_a_part(gripper: Hand):
    assert [part.link for part in gripper.parts] == ["base", "palm", "left", "right"]
    np.testing.assert_allclose(
        gripper.parts[2].mesh.bounds, [[-0.015, 0, 0.005], [0.015, 0.01, 0.065]], atol=1e-12
    )


def union_depth(hand: Hand, link: str, points: np.ndarray) -> np.ndarray:
    """How deep points lie in the nearest part of a link, metres; negative outside."""
    depths = []
    for part in (part for part in hand.parts if part.link == link):
        normals = part.mesh.face_normals
        offsets = np.einsum("ij,ij->i", normals, part.mesh.triangles[:, 0])
        depths.append(-(points @ normals.T - offsets).max(-1))
    return np.max(depths, axis=0)


def assert_surface_is_the_outside(hand: Hand, count: int) -> None:
    surface = hand_surface(hand.urdf, hand.parts, count, seed=0)
    assert len(surface.points) == len(surface.normals) == len(surface.link_index) == count
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=-1), 1, atol=1e-5)
    for index, link in enumerate(hand.link_names):
        points = surface.points[surface.link_index == index].astype(np.float64)
        normals = surface.normals[surface.link_index == index]
        if len(points):
            depth = union_depth(hand, link, points)
            assert depth.min() > -2e-5, link
            assert depth.max() < HIDDEN_STEP_M + 2e-5, link
            # at a sharp edge a step inward may leave through the other face
            assert union_depth(hand, link, points - 1e-4 * normals).min() > -5e-5, link
            assert union_depth(hand, link, points + HIDDEN_STEP_M * normals).max() < 2e-6, link


def test_surface_points_lie_on_the_union_with_normals_outward(gripper: Hand):
    assert_surface_is_the_outside(gripper, 400)


@pytest.mark.parametrize(
    "name", ["ezgripper", "barrett", "robotiq_3finger", "allegro", "shadowhand"]
)
def test_surface_points_of_real_hands_lie_on_the_union(real_hands: Path, name: str):
    assert_surface_is_the_outside(load_hand(real_hands / name), 800)


def test_surface_points_cover_every_shape_and_are_the_same_each_time(gripper: Hand):
    first = hand_surface(gripper.urdf, gripper.parts, 300, seed=0)
    again = hand_surface(gripper.urdf, gripper.parts, 300, seed=0)
    assert set(first.link_index) == {0, 1, 2, 3}
    np.testing.assert_array_equal(first.points, again.points)


def test_points_inside_a_neighbouring_shape_are_left_out(tmp_path: Path):
    inner = (
        '<collision><origin xyz="0 0 -0.02"/>'
        '<geometry><box size="0.01 0.02 0.01"/></geometry></collision>'
    )
    hand = load_hand(
        write(tmp_path, urdf=URDF_TEXT.replace('<link name="base">', f'<link name="base">{inner}'))
    )
    surface = hand_surface(hand.urdf, hand.parts, 300, seed=0)
    assert_surface_is_the_outside(hand, 300)
    base = surface.points[surface.link_index == 0]
    assert np.abs(base[:, 0]).max() == pytest.approx(0.02, abs=1e-6)


def test_faces_where_the_parts_of_a_mesh_meet_carry_no_points(tmp_path: Path):
    folder = with_mesh(tmp_path, "ell.stl")
    ell = trimesh.util.concatenate(
        [trimesh.creation.box((0.03, 0.01, 0.06)), trimesh.creation.box((0.03, 0.05, 0.01))]
    )
    trimesh.boolean.union(ell.split(), engine="manifold").export(folder / "ell.stl")
    hand = load_hand(folder)
    assert sum(part.link == "left" for part in hand.parts) > 1
    assert_surface_is_the_outside(hand, 600)


def test_spheres_lie_inside_their_parts(gripper: Hand):
    spheres = hand_spheres(gripper.urdf, gripper.parts)
    assert set(spheres.link_index) == {0, 1, 2, 3}
    for index, link in enumerate(gripper.link_names):
        own = spheres.link_index == index
        depth = union_depth(gripper, link, spheres.centers[own].astype(np.float64))
        assert (depth >= spheres.radii[own] - 1e-6).all()


def test_the_content_hash_changes_with_manifest_tree_and_geometry(tmp_path: Path):
    base = load_hand(write(tmp_path)).content_hash
    assert load_hand(write(tmp_path)).content_hash == base
    moved = URDF_TEXT.replace("0 0.005 0.035", "0 0.005 0.036")
    assert load_hand(write(tmp_path, urdf=moved)).content_hash != base
    renamed = MANIFEST_TEXT.replace("Two parallel jaws", "Jaws")
    assert load_hand(write(tmp_path, manifest=renamed)).content_hash != base
    folder = with_mesh(tmp_path, "jaw.stl")
    box(folder / "jaw.stl", 0.03, 0.01, 0.06)
    first = load_hand(folder).content_hash
    box(folder / "jaw.stl", 0.03, 0.01, 0.05)
    assert load_hand(folder).content_hash != first


# -- coupling and postures ------------------------------------------------------------------

CHAIN = """<robot name="chain">
<link name="a"><collision><geometry><sphere radius="0.01"/></geometry></collision></link>
<link name="b"/><link name="c"/><link name="d"/><link name="e"/>
<joint name="follower" type="revolute"><parent link="c"/><child link="d"/>
  <limit lower="-9" upper="9"/><mimic joint="leader" multiplier="-2" offset="0.5"/></joint>
<joint name="passive" type="revolute"><parent link="d"/><child link="e"/>
  <limit lower="0.3" upper="1"/></joint>
<joint name="leader" type="revolute"><parent link="b"/><child link="c"/>
  <limit lower="-9" upper="9"/><mimic joint="motor" multiplier="3" offset="-1"/></joint>
<joint name="motor" type="continuous"><parent link="a"/><child link="b"/></joint>
</robot>"""
CHAIN_MANIFEST = """name: chain
urdf: two_jaws.urdf
root_link: a
palm: {link: a, normal: [0, 0, 1], center: [0, 0, 0.01]}
joints: [motor]
contact_regions: {}
provenance: {source: written for the tests, licence: Apache-2.0}
"""


def test_chains_of_mimics_are_multiplied_out_and_passive_joints_rest(tmp_path: Path):
    hand = load_hand(write(tmp_path, urdf=CHAIN, manifest=CHAIN_MANIFEST))
    assert [joint.name for joint in hand.moving_joints] == [
        "motor",
        "leader",
        "follower",
        "passive",
    ]
    matrix, offset = hand.coupling
    np.testing.assert_allclose(matrix[:, 0], [1, 3, -6, 0])
    np.testing.assert_allclose(offset, [0, -1, 2.5, 0.3])


def test_a_mimic_of_a_passive_joint_follows_its_rest(tmp_path: Path):
    manifest = CHAIN_MANIFEST.replace("[motor]", "[passive]")
    matrix, offset = load_hand(write(tmp_path, urdf=CHAIN, manifest=manifest)).coupling
    np.testing.assert_allclose(matrix[:, 0], [0, 0, 0, 1])
    np.testing.assert_allclose(offset, [0, -1, 2.5, 0])


def test_joints_left_out_of_a_posture_rest_in_mid_range(tmp_path: Path):
    text = MANIFEST_TEXT.replace("open: {close: 0.0}\n", "")
    hand = load_hand(write(tmp_path, manifest=text))
    np.testing.assert_allclose(hand.posture("open"), [0.025])
    np.testing.assert_allclose(hand.posture("closed"), [0.05])


def test_links_joined_by_fixed_joints_are_one_body_and_neighbours_may_touch(gripper: Hand):
    assert gripper.link_names == ("base", "palm", "left", "right")
    assert gripper.bodies == (0, 0, 1, 2)
    expected = np.zeros((4, 4), bool)
    expected[2, 3] = expected[3, 2] = True
    np.testing.assert_array_equal(gripper.may_collide(), expected)


def test_allowed_self_contacts_are_left_out(tmp_path: Path):
    text = MANIFEST_TEXT.replace("drives:", "allowed_self_contacts: [[right, left]]\ndrives:")
    assert not load_hand(write(tmp_path, manifest=text)).may_collide().any()
