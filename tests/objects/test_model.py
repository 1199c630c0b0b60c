"""Objects are checked, mended where that is safe, refused with a reason, and the same each time."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from gdg.errors import GdgError
from gdg.objects.model import SURFACE_POINTS, ObjectModel, find_object, load_object


def box(*size: float, at: tuple[float, float, float] = (0, 0, 0)) -> trimesh.Trimesh:
    mesh = trimesh.creation.box(size)
    mesh.apply_translation(at)
    return mesh


def load(folder: Path, mesh: trimesh.Trimesh, **options: float) -> ObjectModel:
    mesh.export(folder / "thing.stl")
    return load_object(folder / "thing.stl", "thing", **options)


def mistake(folder: Path, mesh: trimesh.Trimesh, **options: float) -> str:
    with pytest.raises(GdgError) as caught:
        load(folder, mesh, **options)
    return str(caught.value)


@pytest.fixture(scope="module")
def brick(tmp_path_factory: pytest.TempPathFactory) -> ObjectModel:
    return load(tmp_path_factory.mktemp("brick"), box(0.06, 0.04, 0.02, at=(0.01, 0, 0)))


def test_mass_properties_of_a_brick_are_exact(brick: ObjectModel):
    assert brick.volume == pytest.approx(0.06 * 0.04 * 0.02, rel=1e-5)
    np.testing.assert_allclose(brick.center_of_mass, [0.01, 0, 0], atol=1e-7)
    a, b, c = 0.06, 0.04, 0.02
    expected = brick.volume / 12 * np.diag([b * b + c * c, a * a + c * c, a * a + b * b])
    np.testing.assert_allclose(brick.inertia, expected, atol=1e-12)
    assert brick.radius == pytest.approx(math.hypot(0.04, 0.02, 0.01), rel=1e-5)


def test_surface_points_lie_on_the_surface_with_outward_unit_normals(brick: ObjectModel):
    assert brick.points.shape == brick.normals.shape == (SURFACE_POINTS, 3)
    local = (brick.points - torch.tensor([0.01, 0, 0])) / torch.tensor([0.03, 0.02, 0.01])
    torch.testing.assert_close(local.abs().amax(-1), torch.ones(SURFACE_POINTS), atol=1e-4, rtol=0)
    torch.testing.assert_close(brick.normals.norm(dim=-1), torch.ones(SURFACE_POINTS))
    assert (brick.sdf.distance(brick.points + 0.003 * brick.normals) > 0.002).all()
    assert (brick.sdf.distance(brick.points - 0.003 * brick.normals) < 0).all()
    assert brick.sdf.distance(brick.points).abs().max() < brick.sdf.spacing


def test_points_and_hash_are_the_same_each_time(tmp_path: Path, brick: ObjectModel):
    again = load(tmp_path, box(0.06, 0.04, 0.02, at=(0.01, 0, 0)))
    assert torch.equal(again.points, brick.points)
    assert again.content_hash == brick.content_hash
    other = load(tmp_path, box(0.06, 0.04, 0.021, at=(0.01, 0, 0)))
    assert other.content_hash != brick.content_hash


def test_points_are_the_same_without_the_cache(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, brick: ObjectModel
):
    monkeypatch.setenv("GDG_CACHE", str(tmp_path / "cache"))
    again = load(tmp_path, box(0.06, 0.04, 0.02, at=(0.01, 0, 0)))
    assert torch.equal(again.points, brick.points)
    assert torch.equal(again.sdf.values, brick.sdf.values)


def test_the_cache_is_used_and_a_damaged_one_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("GDG_CACHE", str(tmp_path / "cache"))
    first = load(tmp_path, box(0.03, 0.03, 0.03))
    (file,) = (tmp_path / "cache" / "object").iterdir()
    whole = file.read_bytes()
    written = file.stat().st_mtime_ns
    load(tmp_path, box(0.03, 0.03, 0.03))
    assert file.stat().st_mtime_ns == written
    file.write_bytes(whole[: len(whole) // 2])
    again = load(tmp_path, box(0.03, 0.03, 0.03))
    assert torch.equal(first.points, again.points)
    assert len(file.read_bytes()) == len(whole)


def test_the_surface_holds_no_points_inside_the_object(tmp_path: Path):
    nested = trimesh.util.concatenate([box(0.05, 0.05, 0.05), box(0.03, 0.03, 0.03)])
    thing = load(tmp_path, nested)
    torch.testing.assert_close(
        thing.points.abs().amax(-1), torch.full((SURFACE_POINTS,), 0.025), atol=1e-5, rtol=0
    )


# -- sizes and units ------------------------------------------------------------------------


def test_an_object_in_millimetres_gets_a_hint(tmp_path: Path):
    message = mistake(tmp_path, box(60, 40, 20))
    assert "60 m long" in message
    assert "object_scale=0.001" in message
    assert load(tmp_path, box(60, 40, 20), scale=0.001).volume == pytest.approx(4.8e-5, rel=1e-5)


def test_a_wardrobe_gets_no_hint_of_millimetres(tmp_path: Path):
    message = mistake(tmp_path, box(2, 1, 1))
    assert "more than the 1 m" in message
    assert "millimetres" not in message


def test_a_crumb_is_refused(tmp_path: Path):
    assert "only 0.003 m long" in mistake(tmp_path, box(0.003, 0.002, 0.002))


@pytest.mark.parametrize("scale", [0.0, -1.0, math.nan, math.inf])
def test_a_scale_must_be_a_positive_number(tmp_path: Path, scale: float):
    assert "must be a positive number" in mistake(tmp_path, box(0.05, 0.05, 0.05), scale=scale)


# -- faults of meshes -----------------------------------------------------------------------


def without(mesh: trimesh.Trimesh, faces: np.ndarray) -> trimesh.Trimesh:
    mesh = mesh.copy()
    mesh.update_faces(~faces)
    return mesh


def test_a_box_without_lid_is_refused(tmp_path: Path):
    lidless = box(0.05, 0.05, 0.05)
    message = mistake(tmp_path, without(lidless, lidless.face_normals[:, 2] > 0.5))
    assert "is not watertight: 17% of its surface is missing" in message


def test_half_a_sphere_a_sheet_and_a_double_sheet_are_refused(tmp_path: Path):
    ball = trimesh.creation.icosphere(3, 0.04)
    assert "not watertight" in mistake(tmp_path, without(ball, ball.triangles_center[:, 2] > 0))
    corners = [[0, 0, 0], [0.05, 0, 0], [0.05, 0.05, 0], [0, 0.05, 0]]
    for faces in ([[0, 1, 2], [0, 2, 3]], [[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]]):
        assert "not watertight" in mistake(tmp_path, trimesh.Trimesh(corners, faces, process=False))


def test_a_small_gap_is_closed_and_said(tmp_path: Path):
    mesh = box(0.05, 0.05, 0.05).subdivide().subdivide()
    thing = load(tmp_path, without(mesh, np.arange(len(mesh.faces)) == 5))
    assert thing.notes == ("its gaps, 0.5% of its surface, were closed by flat caps",)
    assert thing.mesh.is_watertight
    assert thing.volume == pytest.approx(0.05**3, rel=1e-5)
    assert thing.sdf.distance(torch.zeros(1, 3))[0] == pytest.approx(-0.025, abs=1e-3)


def test_an_inside_out_mesh_is_turned_around_and_said(tmp_path: Path, brick: ObjectModel):
    mesh = box(0.06, 0.04, 0.02, at=(0.01, 0, 0))
    mesh.invert()
    thing = load(tmp_path, mesh)
    assert thing.notes == ("its faces pointed inward and were turned around",)
    assert thing.volume == pytest.approx(brick.volume)
    assert (thing.sdf.distance(thing.points + 0.003 * thing.normals) > 0.002).all()


def test_faces_of_mixed_direction_are_turned_outward_and_said(tmp_path: Path):
    mesh = box(0.05, 0.05, 0.05).subdivide()
    faces = mesh.faces.copy()
    faces[::3] = faces[::3, ::-1]
    thing = load(tmp_path, trimesh.Trimesh(mesh.vertices, faces, process=False))
    assert thing.notes == ("some of its faces pointed inward and were turned around",)
    assert thing.volume == pytest.approx(0.05**3, rel=1e-4)


def test_overlapping_bodies_are_one_object(tmp_path: Path):
    pair = trimesh.util.concatenate([box(0.05, 0.05, 0.05), box(0.05, 0.05, 0.05, at=(0.03, 0, 0))])
    thing = load(tmp_path, pair)
    assert thing.volume == pytest.approx(0.08 * 0.05 * 0.05, rel=0.01)
    np.testing.assert_allclose(thing.center_of_mass, [0.015, 0, 0], atol=2e-4)
    assert (thing.points[:, 0].min(), thing.points[:, 0].max()) == pytest.approx((-0.025, 0.055))
    assert (thing.sdf.distance(thing.points + 0.003 * thing.normals) > 0).all()
    (part,) = thing.convex_parts
    assert part.volume == pytest.approx(0.08 * 0.05 * 0.05, rel=0.02)


def test_a_self_crossing_mesh_is_refused_with_the_reason(tmp_path: Path):
    mesh = box(0.05, 0.05, 0.05)
    vertices = mesh.vertices.copy()
    vertices[vertices[:, 2] > 0, :2] *= -1
    bow_tie = trimesh.Trimesh(vertices, mesh.faces, process=False)
    assert "encloses nothing" in mistake(tmp_path, bow_tie)


def test_a_hollow_object_keeps_its_cavity(tmp_path: Path):
    hollow = box(0.03, 0.03, 0.03)
    hollow.invert()
    thing = load(tmp_path, trimesh.util.concatenate([box(0.05, 0.05, 0.05), hollow]))
    assert thing.notes == ()
    assert thing.volume == pytest.approx(0.05**3 - 0.03**3, rel=0.01)
    assert thing.sdf.distance(torch.zeros(1, 3))[0] > 0.01


# -- finding --------------------------------------------------------------------------------


def test_a_bundled_object_and_a_bare_mesh_are_found(tmp_path: Path):
    mug = find_object("mug")
    assert mug.name == "mug"
    assert mug.split in ("train", "test")
    box(0.05, 0.05, 0.05).export(tmp_path / "part.stl")
    part = find_object(str(tmp_path / "part.stl"))
    assert (part.name, part.split) == ("part", "")


def manifest(folder: Path, mesh: str) -> Path:
    folder.mkdir()
    (folder / "object.yaml").write_text(
        f"name: thing\nmesh: {mesh}\nsplit: test\nsource: tests\nlicence: Apache-2.0\n"
    )
    return folder


def test_an_object_folder_is_read(tmp_path: Path):
    folder = manifest(tmp_path / "thing", "thing.stl")
    box(0.05, 0.05, 0.05).export(folder / "thing.stl")
    assert find_object(str(folder)).split == "test"


def test_a_mesh_outside_the_folder_is_refused(tmp_path: Path):
    box(0.05, 0.05, 0.05).export(tmp_path / "outside.stl")
    folder = manifest(tmp_path / "thing", "thing.stl")
    (folder / "thing.stl").symlink_to(tmp_path / "outside.stl")
    with pytest.raises(GdgError, match="lies outside the folder"):
        find_object(str(folder))


def test_every_mistake_in_a_manifest_is_named(tmp_path: Path):
    folder = manifest(tmp_path / "thing", "../outside.stl\nthick: 3")
    with pytest.raises(GdgError) as caught:
        find_object(str(folder))
    assert "mesh: must be a path inside the folder" in str(caught.value)
    assert "thick: there is no such option" in str(caught.value)


def test_all_tensors_move_to_the_device(brick: ObjectModel):
    moved = brick.to(torch.device("meta"))
    for tensor in (
        moved.points, moved.normals, moved.sdf.values, moved.sdf.origin, moved.center_of_mass,
        moved.inertia,
    ):  # fmt: skip
        assert tensor.device.type == "meta"
