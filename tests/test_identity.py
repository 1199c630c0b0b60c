"""What is found now is told apart from what grasps were made with, by content."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
import trimesh
from gripper import URDF, write_gripper

from gdg.errors import GdgError
from gdg.folders import HANDS, OBJECTS
from gdg.geometry.convex import Decomposition
from gdg.hands.hand import find_hand, load_hand
from gdg.identity import Assets, body_hash, object_hash
from gdg.objects.model import find_object


@pytest.mark.parametrize("name", ["cube_small", "mug"])
def test_the_hash_of_an_object_is_that_of_its_model(name: str):
    assert object_hash(name) == find_object(name).content_hash


def test_the_hash_of_a_mesh_file_follows_scale_and_not_name(tmp_path: Path):
    mesh = OBJECTS.find("cube_small").path / "cube_small.stl"
    copy = shutil.copy(mesh, tmp_path / "contactdb+thing.stl")
    assert object_hash(str(copy)) == object_hash("cube_small")
    assert object_hash(str(copy), 2.0) == find_object(str(copy), 2.0).content_hash
    assert object_hash(str(copy), 2.0) != object_hash(str(copy))
    with pytest.raises(GdgError, match="Did you mean 'cube_small'"):
        object_hash("cube_smal")


def test_a_body_is_the_same_under_other_names(tmp_path: Path):
    folder = write_gripper(tmp_path)
    before = load_hand(folder)
    for file in ("hand.yaml", "two_jaws.urdf"):
        text = (folder / file).read_text()
        (folder / file).write_text(
            text.replace("name: two_jaws", "name: x").replace("left", "links")
        )
    after = load_hand(folder)
    assert after.content_hash != before.content_hash
    assert after.link_names != before.link_names
    assert body_hash(after) == body_hash(before)


def test_another_joint_limit_or_shape_is_another_body(tmp_path: Path):
    folder = write_gripper(tmp_path)
    before, urdf = body_hash(load_hand(folder)), (folder / "two_jaws.urdf").read_text()
    for attribute in ("upper", "size"):
        found = re.search(rf'{attribute}="([0-9.]+)', urdf)
        assert found is not None
        other = f'{attribute}="{1.1 * float(found[1]):g}'
        (folder / "two_jaws.urdf").write_text(urdf.replace(found[0], other, 1))
        assert body_hash(load_hand(folder)) != before


def test_a_body_does_not_depend_on_how_meshes_are_cut(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    folder = write_gripper(tmp_path)
    urdf = URDF.replace('<box size="0.04 0.14 0.02"/>', '<mesh filename="ring.stl"/>')
    (folder / "two_jaws.urdf").write_text(urdf)
    trimesh.creation.annulus(0.01, 0.02, 0.01).export(folder / "ring.stl")
    fine = load_hand(folder)
    monkeypatch.setattr("gdg.hands.geometry.DECOMPOSITION", Decomposition(1.0, 1))
    coarse = load_hand(folder)
    assert len(coarse.parts) < len(fine.parts)
    assert body_hash(coarse) == body_hash(fine)


def test_the_bundled_hands_have_bodies_of_their_own():
    names = [name for name, folder in HANDS.all().items() if folder.tier == "bundled"]
    assert len({body_hash(find_hand(name)) for name in names}) == len(names)


def test_assets_that_are_not_found_are_none():
    assets = Assets()
    assert assets.hand("nobody") is None
    assert assets.object_hash("nothing") is None
    assert assets.hand("barrett") is assets.hand("barrett")
