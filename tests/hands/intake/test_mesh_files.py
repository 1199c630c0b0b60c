"""Meshes are found wherever a URDF means them, and nothing is read from anywhere else."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from descriptions import box, finger, mesh, write, write_mesh

from gdg.errors import GdgError
from gdg.geometry.mesh import load_mesh
from gdg.hands.intake import Intake, take_in
from gdg.hands.intake.mesh_files import MAX_PARENTS
from gdg.hands.urdf import read_urdf

URDF = "ws/src/acme_description/urdf/hand.urdf"


def taken(folder: Path, tip: str, packages: tuple[Path, ...] = ()) -> Intake:
    source = write(folder, finger(tip=tip), URDF)
    return take_in(source, folder / "new", "acme", package_paths=packages)


def mesh_names(intake: Intake) -> list[str]:
    tip = read_urdf(intake.urdf).links["tip"]
    return [shape.mesh for shape in (*tip.collisions, *tip.visuals)]


@pytest.mark.parametrize(
    ("name", "file"),
    [
        ("tip.stl", "urdf/tip.stl"),
        ("../meshes/tip.stl", "meshes/tip.stl"),
        ("package://acme_description/meshes/tip.stl", "meshes/tip.stl"),
        ("package://renamed/meshes/tip.stl", "meshes/tip.stl"),
        ("model://acme_description/meshes/tip.stl", "meshes/tip.stl"),
        ("file://$(find acme_description)/meshes/tip.stl", "meshes/tip.stl"),
        ("package://other/meshes/tip.stl", "../other/meshes/tip.stl"),
        ("package://named/meshes/tip.stl", "../by_xml/meshes/tip.stl"),
        ("/home/someone/ws/src/acme_description/meshes/tip.stl", "meshes/tip.stl"),
        ("file:///opt/ros/share/acme_description/meshes/tip.stl", "meshes/tip.stl"),
        ("C:\\work\\acme_description\\meshes\\tip.stl", "meshes/tip.stl"),
        ("nowhere/tip.stl", "meshes/tip.stl"),
        ("meshes/tip.OBJ", "meshes/tip.OBJ"),
    ],
)
def test_a_mesh_is_found_by_any_way_of_naming_it(tmp_path: Path, name: str, file: str):
    write(tmp_path, "<package><name>named</name></package>", "ws/src/by_xml/package.xml")
    ball = write_mesh(tmp_path / f"ball{Path(file).suffix.lower()}")
    target = tmp_path / "ws/src/acme_description" / file
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(ball, target)
    intake = taken(tmp_path, mesh(name))
    assert mesh_names(intake) == [f"meshes/{target.name}"]
    assert (tmp_path / "new/meshes" / target.name).read_bytes() == target.read_bytes()


def test_a_package_is_found_in_the_folders_given(tmp_path: Path):
    write_mesh(tmp_path / "elsewhere/other/meshes/tip.stl")
    write(tmp_path, finger(), "a/b/c/d/e/f/g/hand.urdf")
    source = write(
        tmp_path, finger(tip=mesh("package://other/meshes/tip.stl")), "a/b/c/d/e/f/g/hand.urdf"
    )
    for packages in (tmp_path / "elsewhere", tmp_path / "elsewhere/other"):
        intake = take_in(source, tmp_path / "new", "acme", package_paths=[packages])
        assert mesh_names(intake) == ["meshes/tip.stl"]
    with pytest.raises(GdgError, match="no such file"):
        take_in(source, tmp_path / "new", "acme")


def test_files_of_the_same_name_get_names_of_their_own(tmp_path: Path):
    for index, folder in enumerate(("collision", "visual", "visual/more")):
        write_mesh(
            tmp_path / f"ws/src/acme_description/urdf/{folder}/tip.stl", 0.03 + 0.001 * index
        )
    tip = mesh("collision/tip.stl") + mesh("visual/tip.stl", "visual")
    tip += mesh("visual/more/tip.stl", "visual") + mesh("visual/../visual/tip.stl", "visual")
    first, second, third, again = mesh_names(taken(tmp_path, tip))
    assert [first, second, third] == [f"meshes/{n}tip.stl" for n in ("collision_", "", "more_")]
    assert again == second


def test_a_visual_mesh_that_is_lost_or_broken_is_dropped(tmp_path: Path):
    write(tmp_path, "nonsense", "ws/src/acme_description/urdf/broken.stl")
    tip = box() + mesh("lost.stl", "visual") + mesh("broken.stl", "visual")
    intake = taken(tmp_path, tip + mesh("pretty.fbx", "visual"))
    assert mesh_names(intake) == [""]
    (said,) = intake.repairs
    assert said.startswith("Dropped visual meshes (for pictures only): link 'tip', mesh 'lost.stl'")
    assert "broken.stl" in said
    assert said.endswith("; and 1 more.")


def test_binary_gltf_is_written_as_stl(tmp_path: Path):
    write_mesh(tmp_path / "ws/src/acme_description/urdf/tip.glb", 0.04)
    intake = taken(tmp_path, mesh("tip.glb"))
    assert mesh_names(intake) == ["meshes/tip.stl"]
    assert load_mesh(tmp_path / "new/meshes/tip.stl").extents == pytest.approx([0.04] * 3, rel=0.01)


@pytest.mark.parametrize("content", [b"", b"glTF", b"glTF\x02\0\0\0" + b"\xff" * 40])
def test_broken_binary_gltf_is_refused(tmp_path: Path, content: bytes):
    write(tmp_path, content, "ws/src/acme_description/urdf/tip.glb")
    with pytest.raises(GdgError, match=r"tip\.glb: cannot be read as a mesh"):
        taken(tmp_path, mesh("tip.glb"))


def test_visual_shapes_stand_in_for_a_lost_collision_mesh(tmp_path: Path):
    write_mesh(tmp_path / "ws/src/acme_description/urdf/seen.stl")
    intake = taken(tmp_path, mesh("lost.stl") + mesh("seen.stl", "visual"))
    assert mesh_names(intake) == ["meshes/seen.stl", "meshes/seen.stl"]
    assert "Link 'tip': collision mesh not found or unreadable" in intake.repairs[0]


def test_a_lost_collision_mesh_without_a_stand_in_is_refused(tmp_path: Path):
    with pytest.raises(GdgError, match=r"link 'tip': collision mesh 'lost\.stl': no such file"):
        taken(tmp_path, mesh("lost.stl"))


def test_an_empty_collision_mesh_is_refused(tmp_path: Path):
    write(tmp_path, "", "ws/src/acme_description/urdf/empty.stl")
    with pytest.raises(GdgError, match=r"link 'tip': collision .*empty\.stl"):
        taken(tmp_path, mesh("empty.stl"))


def test_no_file_above_the_searched_folders_is_taken(tmp_path: Path):
    deep = "/".join("abcdefgh"[: MAX_PARENTS + 1])
    secret = write_mesh(tmp_path / "secret.stl")
    for name in (str(secret), "../" * (MAX_PARENTS + 1) + "secret.stl", f"file://{secret}"):
        source = write(tmp_path, finger(tip=mesh(name)), f"{deep}/hand.urdf")
        with pytest.raises(GdgError, match="no such file"):
            take_in(source, tmp_path / "new", "acme")
    assert not (tmp_path / "new").exists()


def test_a_link_out_of_the_searched_folders_is_not_followed(tmp_path: Path):
    deep = tmp_path / "/".join("abcdefgh"[: MAX_PARENTS + 1])
    deep.mkdir(parents=True)
    (deep / "tip.stl").symlink_to(write_mesh(tmp_path / "secret.stl"))
    source = write(deep, finger(tip=mesh("tip.stl")), "hand.urdf")
    with pytest.raises(GdgError, match="no such file"):
        take_in(source, tmp_path / "new", "acme")


def test_only_meshes_are_copied(tmp_path: Path):
    write(tmp_path, "secret", "ws/src/acme_description/urdf/id_rsa")
    with pytest.raises(GdgError, match=r"'id_rsa' is none of \.stl"):
        taken(tmp_path, mesh("id_rsa"))


def test_a_huge_mesh_is_refused_unread(tmp_path: Path):
    path = write_mesh(tmp_path / "ws/src/acme_description/urdf/huge.stl")
    with path.open("r+b") as stream:
        stream.truncate(200_000_001)
    with pytest.raises(GdgError, match="larger than 200 MB"):
        taken(tmp_path, mesh("huge.stl"))


def test_odd_letters_leave_no_trace_in_file_names(tmp_path: Path):
    write_mesh(tmp_path / "ws/src/acme_description/urdf/Köpf; rm.stl")
    assert mesh_names(taken(tmp_path, mesh("Köpf; rm.stl"))) == ["meshes/K_pf__rm.stl"]
