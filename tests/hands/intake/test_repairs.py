"""Units, mass properties and the choice of geometry, each repaired once and said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from descriptions import INERTIAL, box, finger, joint, link, mesh, robot, take, write, write_mesh

from gdg.errors import GdgError
from gdg.hands.geometry import link_parts
from gdg.hands.intake import Intake, take_in
from gdg.hands.urdf import Link, read_urdf


def links(intake: Intake) -> dict[str, Link]:
    return read_urdf(intake.urdf).links


def said(intake: Intake) -> str:
    return "\n".join(intake.repairs)


# -- units


def test_a_mesh_in_millimetres_gets_a_scale(tmp_path: Path):
    write_mesh(tmp_path / "source/tip.stl", 30.0)
    intake = take(tmp_path, finger(tip=mesh("tip.stl")))
    assert links(intake)["tip"].collisions[0].size == pytest.approx((1e-3,) * 3)
    assert "Mesh 'meshes/tip.stl' was in millimetres: scale 0.001 written." in said(intake)
    (part,) = (p for p in link_parts(read_urdf(intake.urdf), tmp_path / "new", "collision")
               if p.link == "tip")  # fmt: skip
    assert part.mesh.extents.max() == pytest.approx(0.03, rel=0.01)


def test_a_mesh_in_centimetres_is_told_by_the_distance_of_the_joints(tmp_path: Path):
    write_mesh(tmp_path / "source/tip.stl", 6.0)
    intake = take(tmp_path, finger(tip=mesh("tip.stl")))
    assert links(intake)["tip"].collisions[0].size == pytest.approx((1e-2,) * 3)
    assert "in centimetres: scale 0.01" in said(intake)


def test_a_scale_that_is_right_is_kept(tmp_path: Path):
    write_mesh(tmp_path / "source/tip.stl", 30.0)
    intake = take(tmp_path, finger(tip=mesh("tip.stl", scale="0.001 -0.001 0.001")))
    assert links(intake)["tip"].collisions[0].size == (0.001, -0.001, 0.001)
    assert intake.repairs == ()


def test_meshes_that_were_scaled_down_twice_are_scaled_up(tmp_path: Path):
    write_mesh(tmp_path / "source/tip.stl", 0.03)
    shape = mesh("tip.stl", scale="0.001")
    text = robot(link("a", shape), link("b", shape), joint("j", "a", "b"))
    intake = take(tmp_path, text)
    assert links(intake)["a"].collisions[0].size == pytest.approx((1.0,) * 3)
    assert "scaled down twice" in said(intake)


def test_a_description_in_millimetres_becomes_metres(tmp_path: Path):
    write_mesh(tmp_path / "source/tip.stl", 30.0)
    inertial = '<inertial><origin xyz="0 0 25"/><mass value="0.02"/></inertial>'
    slide = '<limit lower="0" upper="20" effort="1" velocity="1"/>'
    text = robot(
        link("a", box(size="20 20 50", origin='<origin xyz="0 0 25"/>'), inertial),
        link("b", box(size="20 20 50")),
        link("c", mesh("tip.stl")),
        joint("j", "a", "b", z=50),
        joint("k", "b", "c", slide, "prismatic", z=50),
    )
    intake = take(tmp_path, text)
    urdf = read_urdf(intake.urdf)
    assert urdf.links["a"].collisions[0].size == pytest.approx((0.02, 0.02, 0.05))
    assert urdf.links["a"].collisions[0].T_link_shape[2, 3] == pytest.approx(0.025)
    assert urdf.links["c"].collisions[0].size == pytest.approx((1e-3,) * 3)
    assert urdf.joints["j"].T_parent_child[2, 3] == pytest.approx(0.05)
    assert urdf.joints["k"].upper == pytest.approx(0.02)
    assert urdf.joints["j"].upper == pytest.approx(1.5)
    assert "All lengths of the description were in millimetres" in said(intake)


def test_a_hand_of_impossible_size_is_refused(tmp_path: Path):
    with pytest.raises(GdgError, match=r"would be 0\.2 mm long; a hand is 3 cm to 1\.2 m"):
        take(tmp_path, robot(link("a", box(size="0.0001 0.0001 0.0002"))))


def test_a_hand_with_an_arm_is_told_how_to_cut_it_off(tmp_path: Path):
    text = robot(link("a", box()), link("b", box()), joint("j", "a", "b", z=1.4))
    assert "it is 1.45 m long. If it has an arm, cut that off with --root" in said(
        take(tmp_path, text)
    )
    assert "only 10 mm long" in said(take(tmp_path, robot(link("a", box(size="0.01 0.01 0.01")))))


# -- mass properties


def one_link(inertial: str) -> str:
    palm, tip = link("palm", box(), INERTIAL), link("tip", box(), inertial)
    return robot(palm, tip, joint("j", "palm", "tip"))


INERTIA = '<inertia ixx="{0}" iyy="{1}" izz="{2}" ixy="0" ixz="0" iyz="0"/>'
BOX_INERTIA = np.diag([0.05**2 + 0.02**2, 0.05**2 + 0.02**2, 2 * 0.02**2]) / 12


@pytest.mark.parametrize("inertial", ["", "<inertial><mass value='0'/></inertial>"])
def test_a_missing_mass_is_computed_from_the_shapes(tmp_path: Path, inertial: str):
    intake = take(tmp_path, one_link(inertial))
    computed = links(intake)["tip"].inertial
    assert computed is not None
    assert computed.mass == pytest.approx(0.02)
    np.testing.assert_allclose(computed.inertia, 0.02 * BOX_INERTIA, rtol=1e-6, atol=1e-15)
    assert "Link 'tip': no mass given; computed from the shapes at 1000 kg/m³." in said(intake)


@pytest.mark.parametrize("mass", [1.0, 1e-4])
def test_an_impossible_mass_is_replaced(tmp_path: Path, mass: float):
    inertial = f"<inertial><mass value='{mass}'/>{INERTIA.format(1e-3, 1e-3, 1e-3)}</inertial>"
    intake = take(tmp_path, one_link(inertial))
    assert links(intake)["tip"].mass == pytest.approx(0.02)
    assert "Link 'tip': mass impossible for the size" in said(intake)


def test_a_mass_is_kept_where_only_the_inertia_is_no_number(tmp_path: Path):
    inertial = f"<inertial><mass value='0.04'/>{INERTIA.format('nan', 1e-6, 'x')}</inertial>"
    computed = links(take(tmp_path, one_link(inertial)))["tip"].inertial
    assert computed is not None
    assert computed.mass == pytest.approx(0.04)
    np.testing.assert_allclose(computed.inertia, 0.04 * BOX_INERTIA, rtol=1e-6, atol=1e-15)


@pytest.mark.parametrize(
    ("moments", "origin"),
    [
        ((0, 0, 0), ""),
        ((-1e-6, 1e-6, 1e-6), ""),
        ((1e-6, 1e-6, 9e-6), ""),
        ((4e-6, 4e-6, 8.3e-6), ""),
        ((1, 1, 1), ""),
        ((1e-12, 1e-12, 1e-12), ""),
        ((4e-6, 4e-6, 4e-6), '<origin xyz="0.3 0 0"/>'),
    ],
)
def test_an_impossible_inertia_is_computed_for_the_mass(
    tmp_path: Path, moments: tuple[float, float, float], origin: str
):
    inertial = f"<inertial>{origin}<mass value='0.04'/>{INERTIA.format(*moments)}</inertial>"
    intake = take(tmp_path, one_link(inertial))
    computed = links(intake)["tip"].inertial
    assert computed is not None
    assert computed.mass == pytest.approx(0.04)
    np.testing.assert_allclose(computed.inertia, 0.04 * BOX_INERTIA, rtol=1e-6, atol=1e-15)
    assert "Link 'tip': inertia impossible for mass and size" in said(intake)


def test_mass_properties_of_several_shapes_are_joined(tmp_path: Path):
    ends = [box(size="0.02 0.02 0.02", origin=f'<origin xyz="0 0 {z}"/>') for z in (-0.05, 0.05)]
    intake = take(tmp_path, robot(link("a", *ends)))
    computed = links(intake)["a"].inertial
    assert computed is not None
    assert computed.mass == pytest.approx(0.016)
    own = 0.016 * 0.02**2 / 6
    np.testing.assert_allclose(np.diag(computed.inertia)[:2], own + 0.016 * 0.05**2, rtol=1e-6)
    np.testing.assert_allclose(computed.inertia[2, 2], own, rtol=1e-6)


def test_an_open_sheet_has_a_mass_all_the_same(tmp_path: Path):
    sheet = trimesh.Trimesh([[0, 0, 0], [0.05, 0, 0], [0, 0.05, 0]], [[0, 1, 2]])
    sheet.export(write(tmp_path, "", "source/sheet.stl"))
    intake = take(tmp_path, robot(link("a", box()), link("b", mesh("sheet.stl")),
                                  joint("j", "a", "b")))  # fmt: skip
    assert links(intake)["b"].mass > 0


def test_links_without_shapes_keep_what_is_possible(tmp_path: Path):
    text = robot(
        link("a", box(), INERTIAL),
        link("b", INERTIAL),
        link("c", "<inertial><mass value='1'/></inertial>"),
        joint("j", "a", "b"),
        joint("k", "b", "c"),
    )
    found = links(take(tmp_path, text))
    assert found["b"].mass == 0.02
    assert found["c"].inertial is None


# -- which shapes count


def test_a_hand_without_collision_shapes_is_its_visual_shapes(tmp_path: Path):
    visual = box("visual")
    text = robot(link("a", visual), link("b", visual), joint("j", "a", "b"))
    intake = take(tmp_path, text)
    assert intake.geometry == "visual"
    assert "No collision shapes: the visual shapes are used instead." in said(intake)


def four_links(*parts: str) -> str:
    bodies = [link(f"l{i}", part, INERTIAL) for i, part in enumerate(parts)]
    joints = [joint(f"j{i}", f"l{i}", f"l{i + 1}") for i in range(len(parts) - 1)]
    return robot(*bodies, *joints)


def test_a_link_without_collision_shapes_gets_its_visual_ones(tmp_path: Path):
    both = box() + box("visual")
    intake = take(tmp_path, four_links(both, both, both, box("visual")))
    assert intake.geometry == "collision"
    assert len(links(intake)["l3"].collisions) == 1
    assert "Link 'l3': no collision shapes; got the visual ones." in said(intake)


def test_a_cover_that_its_body_fills_needs_no_collision_shape(tmp_path: Path):
    both, cover = box() + box("visual"), link("cover", box("visual", size="0.01 0.01 0.01"))
    text = four_links(both, both).replace("</robot>", cover + "</robot>")
    fixed = joint("f", "l1", "cover", "", "fixed", z=0.0)
    intake = take(tmp_path, text.replace("</robot>", fixed + "</robot>"))
    assert links(intake)["cover"].collisions == ()
    assert intake.repairs[-1].startswith("Link 'cover': no mass given")


def test_placeholders_far_inside_the_visual_surface_are_not_used(tmp_path: Path):
    dot = box(size="0.004 0.004 0.004") + box("visual")
    intake = take(tmp_path, four_links(box(), dot, dot, dot))
    assert intake.geometry == "visual"
    assert "Links 'l1', 'l2', 'l3': collision shapes far inside the visual surface" in said(intake)
    assert "Link 'l0': no visual shapes; got the collision ones." in said(intake)
    assert len(links(intake)["l0"].visuals) == 1


def test_coarser_collision_shapes_are_used(tmp_path: Path):
    good = box(size="0.022 0.022 0.052") + box("visual")
    intake = take(tmp_path, four_links(good, good, good))
    assert (intake.geometry, intake.repairs) == ("collision", ())


# -- meshes


def test_a_fine_mesh_is_thinned(tmp_path: Path):
    write_mesh(tmp_path / "source/tip.stl", 0.03, subdivisions=7)
    intake = take(tmp_path, finger(tip=mesh("tip.stl")))
    assert "Mesh 'tip.stl': 327,680 faces thinned to " in said(intake)
    kept = trimesh.load_mesh(tmp_path / "new/meshes/tip.stl")
    assert 40_000 < len(kept.faces) < 60_000
    assert kept.extents == pytest.approx([0.03] * 3, rel=1e-3)


def test_a_mesh_that_loading_will_cut_is_named(tmp_path: Path):
    bent = trimesh.util.concatenate(
        [
            trimesh.creation.box([0.02, 0.02, 0.06]),
            trimesh.creation.box([0.06, 0.02, 0.02]).apply_translation([0.02, 0, 0.04]),
        ]
    )
    bent.export(write(tmp_path, "", "source/bent.stl"))
    intake = take(tmp_path, finger(tip=mesh("bent.stl")))
    assert "Link 'tip': mesh is not convex; gdg will cut it into convex parts." in said(intake)


# -- where it comes from


def test_author_and_licence_are_noted(tmp_path: Path):
    comment = "<!-- =====\n Copyright 2020 Acme Ltd,  licensed under MIT \n===== -->"
    source = write(tmp_path, comment + finger(), "acme/urdf/hand.urdf")
    write(
        tmp_path,
        "Permission is hereby granted, free of charge, to any person ...\n"
        "The above copyright notice and this permission notice shall be included ...",
        "acme/LICENSE.txt",
    )
    intake = take_in(source, tmp_path / "new", "acme")
    assert intake.licence == "MIT (LICENSE.txt)"
    assert intake.source == (
        "URDF file 'hand.urdf', robot 'made'; its comment: Copyright 2020 Acme Ltd, licensed "
        "under MIT"
    )


def test_an_unknown_licence_is_quoted(tmp_path: Path):
    source = write(tmp_path, finger(), "acme/hand.urdf")
    write(tmp_path, "You may look\nat it.", "acme/COPYING")
    assert take_in(source, tmp_path / "new", "acme").licence == "COPYING: You may look at it."
