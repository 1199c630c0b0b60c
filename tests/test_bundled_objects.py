"""The bundled objects are what their manifests and the objects' README promise."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from gdg.objects.spec import MANIFEST, read_object_spec

ROOT = Path(__file__).resolve().parents[1]
OBJECTS = ROOT / "objects"
NAMES = sorted(manifest.parent.name for manifest in OBJECTS.glob(f"*/{MANIFEST}"))
THIN_SHELLS = {"bowl", "cup", "mug", "wine_glass"}
# Kinds that the GenDexGrasp paper tests on; bundled ones must not be learned from.
PAPER_TEST = {
    "apple", "baseball", "camera", "cylinder_medium", "door_knob", "pear", "potted_meat_can",
    "rubber_duck", "tomato_soup_can", "water_bottle",
}  # fmt: skip


def _mesh(name: str) -> trimesh.Trimesh:
    return trimesh.load_mesh(OBJECTS / name / read_object_spec(OBJECTS / name).mesh)


def test_there_are_enough_objects_of_both_splits():
    splits = [read_object_spec(OBJECTS / name).split for name in NAMES]
    assert splits.count("train") >= 15
    assert splits.count("test") >= 5


def test_kinds_that_the_paper_tests_on_are_test_objects():
    test = {name for name in NAMES if read_object_spec(OBJECTS / name).split == "test"}
    assert set(NAMES) & PAPER_TEST <= test


@pytest.mark.parametrize("name", NAMES)
def test_manifest_is_valid_and_names_its_folder(name: str):
    spec = read_object_spec(OBJECTS / name)
    assert spec.name == name
    assert spec.mesh == f"{name}.stl"
    assert spec.title
    assert spec.licence == "Apache-2.0"
    assert (spec.thin_shell is not None) == (name in THIN_SHELLS)


@pytest.mark.parametrize("name", NAMES)
def test_mesh_is_one_closed_body_of_plausible_size(name: str):
    mesh = _mesh(name)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.body_count == 1
    assert mesh.volume > 0
    assert mesh.extents.min() >= 0.010
    assert mesh.extents.max() <= 0.300
    assert len(mesh.faces) <= 6000
    assert (OBJECTS / name / f"{name}.stl").stat().st_size <= 300_000


@pytest.mark.parametrize("name", NAMES)
def test_area_centroid_is_at_the_origin(name: str):
    mesh = _mesh(name)
    centroid = np.average(mesh.triangles_center, axis=0, weights=mesh.area_faces)
    np.testing.assert_allclose(centroid, 0, atol=1e-4)


@pytest.mark.parametrize("name", NAMES)
def test_surface_does_not_run_through_itself(name: str):
    mesh = _mesh(name)
    step = 2e-6 * mesh.face_normals  # less than the narrowest slivers that booleans leave
    assert mesh.contains(mesh.triangles_center - step).all()
    assert not mesh.contains(mesh.triangles_center + step).any()


@pytest.mark.parametrize("name", sorted(THIN_SHELLS))
def test_wall_is_as_thick_as_the_manifest_says(name: str):
    mesh, wall = _mesh(name), read_object_spec(OBJECTS / name).thin_shell
    inward = -mesh.face_normals
    starts = mesh.triangles_center + 1e-6 * inward
    hits, rays, _ = mesh.ray.intersects_location(starts, inward, multiple_hits=False)
    thickness = np.linalg.norm(hits - starts[rays], axis=1)
    assert np.median(thickness) == pytest.approx(wall, rel=0.15)


def test_the_script_writes_the_bundled_bytes_again(tmp_path: Path):
    names = ["cup", "foam_brick", "mug"]
    script = ROOT / "tools" / "make_objects.py"
    subprocess.run([sys.executable, str(script), "--out", str(tmp_path), *names], check=True)
    for name in names:
        for file in (MANIFEST, f"{name}.stl"):
            assert (tmp_path / name / file).read_bytes() == (OBJECTS / name / file).read_bytes()


def test_readme_lists_every_object():
    readme = (OBJECTS / "README.md").read_text(encoding="utf-8")
    listed = [line.split("|")[1].strip() for line in readme.splitlines() if line.startswith("| ")]
    assert sorted(listed[1:]) == NAMES
