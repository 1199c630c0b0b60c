"""CMapDataset files: maps, grasps, point clouds and split, both ways; D(R,O)'s lists are read."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import build_model
from layout_datasets import assert_same_grasps, grasps_in
from scipy.spatial.transform import Rotation

from gdg.contact_maps import contact_map_of
from gdg.data.dataset import shards
from gdg.data.layouts.cmap import read_cmap, write_cmap
from gdg.data.layouts.exporting import chosen_shards, contact_maps_for, pairs_to_export
from gdg.data.layouts.importing import import_grasps
from gdg.data.layouts.lookup import Lookup
from gdg.data.layouts.pose_vectors import KNOWN_HANDS
from gdg.errors import GdgError
from gdg.kinds.distance import Distance
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.registry import get_registry


@pytest.fixture
def distance() -> Distance:
    record = get_registry().find("distance", "aligned")
    return record.load()(record.options())


@pytest.fixture
def exported(
    dataset: Callable[..., Path], lookup: Lookup, distance: Distance, tmp_path: Path
) -> Path:
    """A dataset of two objects, exported to ``cmap``."""
    pairs = pairs_to_export(chosen_shards(dataset("cube_small", "banana")), lookup)
    maps = contact_maps_for(distance, build_model, lookup)
    write_cmap(pairs, tmp_path / "cmap", maps, distance.label)
    return tmp_path / "cmap"


def test_grasps_come_back_from_an_export(exported: Path, lookup: Lookup, tmp_path: Path) -> None:
    report = import_grasps("cmap", read_cmap(exported), lookup, tmp_path / "again")
    assert (report.pairs, report.grasps, report.skipped) == (2, 8, [])
    before, after = grasps_in(tmp_path / "dataset"), grasps_in(tmp_path / "again")
    for key, grasps in before.items():
        assert_same_grasps(after[key], grasps.select(grasps.passed))


def test_an_export_has_the_shapes_of_the_published_files(
    exported: Path, gripper_model: HandModel, cube: ObjectModel, distance: Distance, tmp_path: Path
) -> None:
    tree = torch.load(exported / "cmap_dataset.pt", weights_only=True)
    clouds = torch.load(exported / "object_point_clouds.pt", weights_only=True)
    assert sorted(clouds) == ["banana", "cube_small"]
    assert clouds["cube_small"].shape == (2048, 3)
    values, q, object_name, hand = tree["metadata"][4]
    assert (object_name, hand) == ("cube_small", "two_jaws")
    assert torch.cat((clouds[object_name], values), dim=1).shape == (2048, 4)
    assert tree["info"]["two_jaws"]["num_per_object"] == {"cube_small": 4, "banana": 4}
    assert tree["info"]["cmap_func"] == distance.label
    split = json.loads((exported / "split_train_validate_objects.json").read_text())
    assert split == {"train": ["banana", "cube_small"], "validate": []}
    grasps = grasps_in(tmp_path / "dataset")["two_jaws", "cube_small"]
    first = grasps.select(grasps.passed[:1])
    expected = contact_map_of(gripper_model, cube, gripper_model.q_of(first), distance)
    torch.testing.assert_close(values[:, 0], expected.values[0])
    assert len(q) == 9 + 2


def test_validation_objects_become_test_objects(
    exported: Path, lookup: Lookup, tmp_path: Path
) -> None:
    split = {"train": ["banana"], "validate": ["cube_small"]}
    (exported / "split_train_validate_objects.json").write_text(json.dumps(split))
    import_grasps("cmap", read_cmap(exported / "cmap_dataset.pt"), lookup, tmp_path / "again")
    found = {info.object_name: info.split for info in shards(tmp_path / "again")}
    assert found == {"cube_small": "test", "banana": "train"}


def test_an_export_refuses_an_object_that_has_changed(
    dataset: Callable[..., Path], lookup: Lookup, distance: Distance, tmp_path: Path
) -> None:
    pairs = pairs_to_export(chosen_shards(dataset("cube_small")), lookup)
    lookup.objects["cube_small"] = "banana"
    maps = contact_maps_for(distance, build_model, lookup)
    with pytest.raises(GdgError, match="another version"):
        write_cmap(pairs, tmp_path / "cmap", maps, distance.label)
    assert not (tmp_path / "cmap").exists()


@pytest.mark.parametrize("with_map", [False, True])
def test_lists_of_dro_hold_angles_about_moving_axes(tmp_path: Path, with_map: bool) -> None:
    rng = np.random.default_rng(0)
    q = rng.uniform(-1, 1, (3, 6 + 24)).astype(np.float32)
    rows = [(torch.from_numpy(row), "ycb+pear", "shadowhand") for row in q]
    metadata = [(torch.zeros(2048, 1), *row) for row in rows] if with_map else rows
    torch.save({"info": {}, "metadata": metadata}, tmp_path / "cmap_dataset.pt")
    (read,) = read_cmap(tmp_path)
    assert read.joint_names == KNOWN_HANDS["shadowhand"].joints
    rotation = Rotation.from_euler("XYZ", q[:, 3:6].astype(np.float64)).as_matrix()
    np.testing.assert_allclose(read.poses[:, :3, :3], rotation, atol=1e-6)
    np.testing.assert_allclose(read.joints, q[:, 6:], atol=1e-7)


@pytest.mark.parametrize("text", ["[", "[1]", '{"train": 3}', "null", "\x00"])
def test_a_broken_split_file_is_told(exported: Path, text: str) -> None:
    (exported / "split_train_validate_objects.json").write_text(text)
    with pytest.raises(GdgError, match="is no list of train and validate objects"):
        read_cmap(exported)


def test_what_is_no_cmap_dataset_is_told(tmp_path: Path) -> None:
    torch.save({"metadata": [(torch.zeros(3), "a", "b", 3)]}, tmp_path / "cmap_dataset.pt")
    with pytest.raises(GdgError, match=r"metadata\[0\] is no tuple of a contact map"):
        read_cmap(tmp_path)


@pytest.mark.parametrize("metadata", [[5], [None], [[]], ["abcd"]])
def test_metadata_that_is_none_is_told(tmp_path: Path, metadata: list[object]) -> None:
    torch.save({"metadata": metadata}, tmp_path / "cmap_dataset.pt")
    with pytest.raises(GdgError, match=r"metadata\[0\] is no tuple"):
        read_cmap(tmp_path)
