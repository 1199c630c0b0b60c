"""MultiDex files: the authors' are read as they mean them, and ours give the same grasps back."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from layout_datasets import assert_same_grasps, grasps_in, random_grasps
from scipy.spatial.transform import Rotation

from gdg.data.layouts.exporting import chosen_shards, dropped_fields, pairs_to_export
from gdg.data.layouts.foreign import PairToExport
from gdg.data.layouts.importing import import_grasps
from gdg.data.layouts.lookup import Lookup
from gdg.data.layouts.multidex import read_multidex, write_multidex
from gdg.data.layouts.pose_vectors import KNOWN_HANDS
from gdg.errors import GdgError
from gdg.hands.hand import Hand, load_hand


def authors_file(path: Path, hand: str, q: torch.Tensor, object_name: str = "mug") -> Path:
    """A file as the release of GenDexGrasp has them: joints have no names."""
    path.parent.mkdir(parents=True, exist_ok=True)
    info = {
        "robot_name": hand,
        "num_total": len(q),
        "num_upper_object": len(q),
        "num_per_object": {object_name: len(q)},
    }
    metadata = [(row.clone(), object_name, hand) for row in q]
    torch.save({"info": info, "metadata": metadata}, path)
    return path


def vectors(count: int, joints: int) -> tuple[torch.Tensor, np.ndarray]:
    """Random q vectors, and their rotations."""
    rotation = Rotation.random(count, random_state=0).as_matrix()
    columns = np.concatenate((rotation[:, :, 0], rotation[:, :, 1]), axis=1)
    rest = np.random.default_rng(0).uniform(size=(count, 3 + joints))
    q = np.concatenate((rest[:, :3], columns, rest[:, 3:]), axis=1)
    return torch.from_numpy(q.astype(np.float32)), rotation


def test_an_authors_file_of_a_known_hand_gets_names_and_root_link(tmp_path: Path) -> None:
    q, rotation = vectors(6, 8)
    authors_file(tmp_path / "barrett" / "barrett.pt", "barrett", q)
    (read,) = read_multidex(tmp_path)
    assert (read.hand, read.object_name) == ("barrett", "mug")
    assert read.joint_names == KNOWN_HANDS["barrett"].joints
    assert read.root_link == "bh_base_link"
    np.testing.assert_allclose(read.poses[:, :3, :3], rotation, atol=1e-6)
    np.testing.assert_allclose(read.poses[:, :3, 3], q[:, :3].numpy(), atol=1e-7)
    np.testing.assert_allclose(read.joints, q[:, 9:].numpy(), atol=1e-7)


def test_a_vector_places_the_hand_as_the_authors_reader_does(real_hands: Path) -> None:
    """World point = R p + t, R having the six numbers as columns (their HandModel)."""
    q, rotation = vectors(1, 16)
    hand = load_hand(real_hands / "allegro")
    pair = PairToExport(hand, random_grasps(hand, "mug", 3), "mug", 1.0, "", "")
    from gdg.data.layouts.pose_vectors import vector_of_pair

    written = vector_of_pair(pair).double().numpy()
    poses = pair.grasps.poses.double().numpy()
    np.testing.assert_allclose(written[:, 3:6], poses[:, :3, 0], atol=1e-6)
    np.testing.assert_allclose(written[:, 6:9], poses[:, :3, 1], atol=1e-6)
    assert rotation.shape == (1, 3, 3)
    assert q.shape == (1, 25)


def test_import_of_a_real_hand_drops_what_mimics(real_hands: Path, tmp_path: Path) -> None:
    q, _ = vectors(4, 8)
    file = authors_file(tmp_path / "barrett.pt", "barrett", q, "cube_small")
    lookup = Lookup(hands={"barrett": str(real_hands / "barrett")})
    report = import_grasps("multidex", read_multidex(file), lookup, tmp_path / "out")
    assert (report.pairs, report.grasps, report.skipped) == (1, 4, [])
    assert any("do not follow them on 'cube_small'" in note for note in report.notes)
    grasps = grasps_in(tmp_path / "out")["barrett", "cube_small"]
    column = 9 + KNOWN_HANDS["barrett"].joints.index("bh_j12_joint")
    ours = grasps.joint_names.index("bh_j12_joint")
    torch.testing.assert_close(grasps.joints[:, ours], q[:, column])
    assert grasps.root_link == "bh_base_link"


def test_a_known_hand_is_not_mistaken_for_a_bundled_one(tmp_path: Path) -> None:
    q, _ = vectors(1, 16)
    file = authors_file(tmp_path / "allegro.pt", "allegro", q, "cube_small")
    report = import_grasps("multidex", read_multidex(file), Lookup(), tmp_path / "out")
    assert report.pairs == 0
    assert len(report.skipped) == 1
    assert "--hand allegro=FOLDER" in report.skipped[0]


def test_an_unknown_hand_is_taken_in_the_order_of_its_chain(
    gripper: Hand, lookup: Lookup, tmp_path: Path
) -> None:
    q, _ = vectors(2, 2)
    q[:, 9:] *= 0.05
    file = authors_file(tmp_path / "two_jaws.pt", "two_jaws", q, "cube_small")
    report = import_grasps("multidex", read_multidex(file), lookup, tmp_path / "out")
    assert report.grasps == 2
    assert any("in the order of the chain" in note for note in report.notes)
    assert any("'base', the root link of" in note for note in report.notes)
    grasps = grasps_in(tmp_path / "out")["two_jaws", "cube_small"]
    torch.testing.assert_close(grasps.joints, q[:, 9:10])


def test_grasps_come_back_from_an_export(
    dataset: Callable[..., Path], lookup: Lookup, tmp_path: Path
) -> None:
    root = dataset("cube_small", "mug")
    pairs = pairs_to_export(chosen_shards(root), lookup)
    written = write_multidex(pairs, tmp_path / "multidex")
    assert [path.name for path in written] == ["two_jaws.pt", "robot_object_names.json"]
    names = json.loads(written[1].read_text())
    assert names == {"robot_list": ["two_jaws"], "object_list": ["cube_small", "mug"]}
    read = read_multidex(tmp_path / "multidex")
    report = import_grasps("multidex", read, lookup, tmp_path / "again")
    assert (report.pairs, report.grasps, report.notes) == (2, 8, [])
    before, after = grasps_in(root), grasps_in(tmp_path / "again")
    for key, grasps in before.items():
        assert_same_grasps(after[key], grasps.select(grasps.passed))


@pytest.mark.parametrize("name", ["barrett", "shadowhand"])
def test_grasps_of_hands_with_many_joints_come_back(name: str, tmp_path: Path) -> None:
    from gdg.hands.hand import find_hand

    hand = find_hand(name)
    grasps = random_grasps(hand, "cube_small", 5)
    pair = PairToExport(hand, grasps, "cube_small", 1.0, "", "")
    write_multidex([pair], tmp_path / "multidex")
    report = import_grasps(
        "multidex", read_multidex(tmp_path / "multidex"), Lookup(), tmp_path / "out"
    )
    assert report.skipped == []
    assert_same_grasps(grasps_in(tmp_path / "out")[name, "cube_small"], grasps)


def test_what_is_left_out_is_told(dataset: Callable[..., Path], lookup: Lookup) -> None:
    pairs = pairs_to_export(chosen_shards(dataset("cube_small")), lookup)
    told = dropped_fields(pairs)
    for word in ("verdicts", "drive targets", "energies", "the planner's status", "provenance"):
        assert word in told
    assert "contact points" not in told


def test_the_same_import_twice_adds_nothing(lookup: Lookup, tmp_path: Path) -> None:
    q, _ = vectors(2, 2)
    file = authors_file(tmp_path / "two_jaws.pt", "two_jaws", 0.01 * q, "cube_small")
    for _ in range(2):
        import_grasps("multidex", read_multidex(file), lookup, tmp_path / "out")
    assert len(list((tmp_path / "out").rglob("*.parquet"))) == 1


def test_pairs_that_are_not_found_are_listed_and_others_imported(
    lookup: Lookup, tmp_path: Path
) -> None:
    q, _ = vectors(1, 2)
    metadata = [(q[0], "cube_small", "two_jaws"), (q[0], "no_such_thing", "two_jaws")]
    torch.save({"info": {}, "metadata": metadata}, tmp_path / "two_jaws.pt")
    report = import_grasps("multidex", read_multidex(tmp_path), lookup, tmp_path / "out")
    assert report.pairs == 1
    assert len(report.skipped) == 1
    assert report.skipped[0].startswith("Unknown object 'no_such_thing'.")


def test_grasps_without_a_rotation_are_left_out_and_told(lookup: Lookup, tmp_path: Path) -> None:
    q, _ = vectors(3, 2)
    q[1, 3:9] = 0.0
    q[2, 9] = float("nan")
    file = authors_file(tmp_path / "two_jaws.pt", "two_jaws", q, "cube_small")
    report = import_grasps("multidex", read_multidex(file), lookup, tmp_path / "out")
    assert report.grasps == 1
    assert any(note.endswith("and were left out.") and "2 of 3" in note for note in report.notes)


@pytest.mark.parametrize(
    ("tree", "words"),
    [
        ([1, 2], "is no MultiDex file"),
        ({"info": {}}, "has no 'metadata'"),
        ({"metadata": {"a": 1}}, "'metadata' is no list"),
        ({"metadata": [(torch.zeros(20), "mug")]}, r"metadata\[0\] is no tuple"),
        ({"metadata": [(torch.zeros(2, 20), "mug", "hand")]}, r"q has the shape \(2, 20\)"),
        ({"metadata": [(torch.zeros(5), "mug", "hand")]}, r"q has the shape \(5,\)"),
    ],
)
def test_what_is_no_multidex_file_is_told(tmp_path: Path, tree: object, words: str) -> None:
    torch.save(tree, tmp_path / "hand.pt")
    with pytest.raises(GdgError, match=words):
        read_multidex(tmp_path / "hand.pt")


def test_an_export_needs_the_hand_that_the_grasps_are_of(dataset: Callable[..., Path]) -> None:
    root = dataset("cube_small")
    with pytest.raises(GdgError, match="--hand two_jaws=FOLDER"):
        pairs_to_export(chosen_shards(root), Lookup(hands={"two_jaws": "barrett"}))


@pytest.mark.parametrize("name", ["../cube_small", "/tmp/cube.stl", "cube.stl", "~/cube", ".x"])
def test_a_file_may_not_name_paths(lookup: Lookup, tmp_path: Path, name: str) -> None:
    q, _ = vectors(1, 2)
    file = authors_file(tmp_path / "two_jaws.pt", "two_jaws", q, name)
    report = import_grasps("multidex", read_multidex(file), lookup, tmp_path / "out")
    assert report.pairs == 0
    assert "may not say where to look" in report.skipped[0]


@pytest.mark.parametrize("name", ["bo\0wl", "\ud800", "a\nb"])
def test_names_that_can_not_be_printed_are_told(lookup: Lookup, tmp_path: Path, name: str) -> None:
    q, _ = vectors(1, 2)
    file = authors_file(tmp_path / "two_jaws.pt", "two_jaws", q, name)
    report = import_grasps("multidex", read_multidex(file), lookup, tmp_path / "out")
    (told,) = report.skipped
    assert "has characters that can't be printed" in told
    assert told.isprintable()


@pytest.mark.parametrize("name", ["../escaped", "/escaped", "a\\b", ".x", "", "a\0b"])
def test_an_export_never_leaves_its_folder(
    dataset: Callable[..., Path], lookup: Lookup, tmp_path: Path, name: str
) -> None:
    (pair,) = pairs_to_export(chosen_shards(dataset("mug")), lookup)
    hostile = replace(pair, grasps=replace(pair.grasps, hand=name))
    with pytest.raises(GdgError, match="its name can't be a file's name"):
        write_multidex([pair, hostile], tmp_path / "deep" / "out")
    assert not (tmp_path / "deep").exists()


@pytest.mark.parametrize(
    "change",
    [
        lambda q: q.to_sparse(), lambda q: q.to(torch.complex64), lambda q: q.to(torch.int64),
    ],
)  # fmt: skip
def test_a_vector_that_is_no_plain_tensor_is_told(tmp_path: Path, change: Any) -> None:
    q, _ = vectors(1, 2)
    torch.save({"metadata": [(change(q[0]), "mug", "jaws")]}, tmp_path / "jaws.pt")
    with pytest.raises(GdgError, match="q is no plain tensor of floating-point numbers"):
        read_multidex(tmp_path / "jaws.pt")


def test_a_vector_that_wants_a_gradient_is_read(tmp_path: Path) -> None:
    q, _ = vectors(1, 2)
    torch.save({"metadata": [(q[0].requires_grad_(), "mug", "jaws")]}, tmp_path / "jaws.pt")
    (read,) = read_multidex(tmp_path / "jaws.pt")
    np.testing.assert_allclose(read.joints[0], q[0, -2:].detach())
