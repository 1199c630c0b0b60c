"""Mesh files are untrusted; sampling is even, repeatable and outward."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from gdg.errors import GdgError
from gdg.geometry.mesh import (
    MAX_FACES,
    MAX_MESH_BYTES,
    MESH_SUFFIXES,
    close_gaps,
    farthest_points,
    inside_convex,
    load_mesh,
    sample_surface,
)

CUBE = trimesh.creation.box((0.1, 0.1, 0.1))
STL_DTYPE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("flags", "<u2")])


def exported(suffix: str) -> bytes:
    data = CUBE.export(file_type=suffix[1:])
    return data.encode() if isinstance(data, str) else data


def stl(corners: np.ndarray) -> bytes:
    faces = np.zeros(len(corners), STL_DTYPE)
    faces["corners"] = corners
    return b"\0" * 80 + np.uint32(len(corners)).tobytes() + faces.tobytes()


def write(folder: Path, name: str, data: bytes | str) -> Path:
    path = folder / name
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    return path


def mistake(path: Path) -> str:
    with pytest.raises(GdgError) as caught:
        load_mesh(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("suffix", MESH_SUFFIXES)
def test_every_format_gives_the_same_closed_mesh(tmp_path: Path, suffix: str):
    mesh = load_mesh(write(tmp_path, f"cube{suffix}", exported(suffix)))
    assert mesh.is_watertight
    assert len(mesh.vertices) == 8
    assert mesh.volume == pytest.approx(1e-3, rel=1e-5)


def test_upper_case_suffixes_are_fine(tmp_path: Path):
    assert load_mesh(write(tmp_path, "CUBE.STL", exported(".stl"))).is_watertight


@pytest.mark.parametrize("suffix", MESH_SUFFIXES)
@given(data=st.binary(max_size=400))
def test_random_bytes_are_refused_but_never_crash(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, data: bytes
):
    path = write(tmp_path_factory.getbasetemp(), f"random{suffix}", data)
    mistake(path)


@pytest.mark.parametrize("suffix", MESH_SUFFIXES)
@settings(max_examples=100)
@given(data=st.data())
def test_a_damaged_file_is_read_or_refused_but_never_crashes(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, data: st.DataObject
):
    content = bytearray(exported(suffix))
    for _ in range(data.draw(st.integers(1, 6))):
        at = data.draw(st.integers(0, len(content) - 1))
        new = st.binary(max_size=4) | st.sampled_from([b"nan ", b"1e999 ", b"-1 ", b"99999999 "])
        content[at : at + data.draw(st.integers(0, 4))] = data.draw(new)
    with contextlib.suppress(GdgError):
        load_mesh(write(tmp_path_factory.getbasetemp(), f"damaged{suffix}", bytes(content)))


@pytest.mark.parametrize("suffix", MESH_SUFFIXES)
def test_a_truncated_file_is_refused_or_still_a_mesh(tmp_path: Path, suffix: str):
    content = exported(suffix)
    assert mistake(write(tmp_path, f"empty{suffix}", b""))
    for share in (0.1, 0.5, 0.9):
        with contextlib.suppress(GdgError):
            load_mesh(write(tmp_path, f"cut{suffix}", content[: int(share * len(content))]))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e30])
def test_a_vertex_that_is_not_finite_is_refused_not_dropped(tmp_path: Path, value: float):
    corners = CUBE.triangles.copy()
    corners[3, 1, 2] = value
    assert "not finite" in mistake(write(tmp_path, "nan.stl", stl(corners)))


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("part.step", "x", "not a mesh format that gdg reads"),
        ("part.glb", "x", "not a mesh format that gdg reads"),
        ("part", "x", "not a mesh format that gdg reads"),
        ("points.obj", "v 0 0 0\nv 1 0 0\n", "mesh"),
        ("point.obj", "v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n", "has no area"),
        ("line.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "has no area"),
        ("wrong.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "mesh"),
        ("flat.obj", "v 1\nv 2\nv 3\nf 1 2 3\n", "mesh"),
        ("big.off", "OFF\n99999999999 99999999999 0\n0 0 0\n", "cannot be read"),
        ("big.ply", "ply\nformat binary_little_endian 1.0\nelement vertex 99999999999\n"
         "property float x\nproperty float y\nproperty float z\nelement face 1\n"
         "property list uchar int vertex_indices\nend_header\n", "mesh"),
        ("big.stl", b"\0" * 80 + b"\xff\xff\xff\xff" + b"\0" * 100, "mesh"),
        ("wide.ply", "ply\nformat ascii 1.0\nelement face 1\nproperty list uint int i\n"
         "end_header\n4294967295 1\n", "mesh"),
    ],
)  # fmt: skip
def test_what_is_no_mesh_is_refused(tmp_path: Path, name: str, content: bytes | str, reason: str):
    assert reason in mistake(write(tmp_path, name, content))


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path):
    assert "no such mesh file" in mistake(tmp_path / "lost.stl")
    (tmp_path / "folder.stl").mkdir()
    assert "no such mesh file" in mistake(tmp_path / "folder.stl")


def test_two_million_faces_are_refused(tmp_path: Path):
    corners = np.tile(CUBE.triangles.astype(np.float32), (2_000_004 // 12, 1, 1))
    message = mistake(write(tmp_path, "many.stl", stl(corners)))
    assert f"more than {MAX_FACES:,}" in message


def test_a_huge_file_is_refused_unread(tmp_path: Path):
    path = tmp_path / "huge.stl"
    with path.open("wb") as stream:
        stream.truncate(MAX_MESH_BYTES + 1)
    assert "larger than 200 MB" in mistake(path)


def test_materials_and_textures_outside_are_not_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    text = "mtllib ../../../etc/passwd\nmtllib /etc/shadow\nusemtl x\n" + exported(".obj").decode()
    path = write(tmp_path, "cube.obj", text)
    opened: list[str] = []
    real = io.open

    def watched(file: object, *args: object, **kwargs: object) -> object:
        opened.append(str(file))
        return real(file, *args, **kwargs)

    monkeypatch.setattr("builtins.open", watched)
    assert load_mesh(path).is_watertight
    assert [name for name in opened if "etc" in name] == []


def test_vertices_are_merged_across_texture_seams(tmp_path: Path):
    faces = ["1/1 3/2 2/3", "1/2 2/1 4/3", "2/2 3/3 4/1", "1/3 4/2 3/1"]
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 1\nvt 0 1\n"
    text += "".join(f"f {face}\n" for face in faces)
    mesh = load_mesh(write(tmp_path, "seams.obj", text))
    assert mesh.is_watertight
    assert len(mesh.vertices) == 4


def test_collada_entities_are_refused_and_its_unit_is_applied(tmp_path: Path):
    text = exported(".dae").decode()
    entities = f'<!DOCTYPE a [<!ENTITY x "y">]>{text}'
    assert "declares entities" in mistake(write(tmp_path, "bomb.dae", entities))
    unit = text.replace("<up_axis>", '<unit name="millimeter" meter="0.001"/><up_axis>')
    assert unit != text
    mesh = load_mesh(write(tmp_path, "mm.dae", unit))
    np.testing.assert_allclose(mesh.extents, 1e-4, rtol=1e-5)


def test_several_bodies_in_one_file_become_one_mesh(tmp_path: Path):
    other = CUBE.copy()
    other.apply_translation((1, 0, 0))
    data = trimesh.Scene([CUBE, other]).export(file_type="obj")
    assert load_mesh(write(tmp_path, "two.obj", data)).volume == pytest.approx(2e-3, rel=1e-5)


# -- sampling -------------------------------------------------------------------------------


def test_samples_lie_on_the_surface_with_outward_normals_and_are_repeatable():
    points, normals = sample_surface(CUBE, 500, seed=3)
    again, _ = sample_surface(CUBE, 500, seed=3)
    np.testing.assert_array_equal(points, again)
    np.testing.assert_allclose(np.abs(points).max(-1), 0.05, atol=1e-9)
    np.testing.assert_allclose((points * normals).sum(-1), 0.05, atol=1e-9)
    assert not np.array_equal(points, sample_surface(CUBE, 500, seed=4)[0])


def test_farthest_points_cover_a_cloud_evenly():
    cloud = np.stack(np.meshgrid(*[np.linspace(0, 1, 30)] * 2), -1).reshape(-1, 2)
    chosen = cloud[farthest_points(cloud, 25)]
    gaps = np.linalg.norm(chosen[:, None] - chosen[None], axis=-1) + 9 * np.eye(25)
    reach = np.linalg.norm(cloud[:, None] - chosen[None], axis=-1).min(1)
    assert gaps.min() >= reach.max() - 1e-9
    assert reach.max() < 0.25


def test_farthest_points_never_repeat_and_take_all_when_few():
    cloud = np.random.default_rng(0).normal(size=(20, 3))
    assert sorted(farthest_points(cloud, 50)) == list(range(20))
    assert farthest_points(cloud, 5)[0] == 0
    assert len(farthest_points(cloud, 0)) == 0
    assert len(farthest_points(cloud[:0], 5)) == 0


def test_inside_convex_is_exact_to_its_margin():
    points = np.array([[0.0, 0, 0], [0.049, 0, 0], [0.0505, 0, 0], [0.2, 0.2, 0.2]])
    assert inside_convex(CUBE, points, margin=0.0).tolist() == [True, True, False, False]
    assert inside_convex(CUBE, points, margin=0.002).tolist() == [True, False, False, False]


# -- gaps -----------------------------------------------------------------------------------


def test_a_closed_mesh_has_no_gaps():
    closed, area = close_gaps(CUBE)
    assert closed is CUBE
    assert area == 0.0


def test_a_gap_is_closed_flat_with_its_area():
    open_cube = CUBE.copy()
    open_cube.update_faces(CUBE.face_normals[:, 2] < 0.5)
    closed, area = close_gaps(open_cube)
    assert closed.is_watertight
    assert closed.is_winding_consistent
    assert closed.volume == pytest.approx(1e-3)
    assert area == pytest.approx(0.01)


def test_several_gaps_are_closed_one_by_one():
    tube = CUBE.copy()
    tube.update_faces(np.abs(CUBE.face_normals[:, 2]) < 0.5)
    closed, area = close_gaps(tube)
    assert closed.is_watertight
    assert closed.volume == pytest.approx(1e-3)
    assert area == pytest.approx(0.02)


def test_cubes_that_share_an_edge_have_no_gap():
    other = CUBE.copy()
    other.apply_translation((0.1, 0.1, 0))
    both = trimesh.util.concatenate([CUBE, other])
    both = trimesh.Trimesh(both.vertices.round(9), both.faces, process=True)
    assert not both.is_watertight
    assert close_gaps(both)[1] == 0.0
