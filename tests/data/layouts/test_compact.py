"""The compact file: small, and it gives every valid grasp back with its verdict's summary."""

from __future__ import annotations

import json
import math
import random
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch
from layout_datasets import assert_same_grasps, grasps_in, random_grasps, with_verdicts

from gdg.data.dataset import ShardInfo, shards, write_shard
from gdg.data.layouts.compact import (
    METADATA_KEY,
    Group,
    read_compact,
    with_checksum,
    write_compact,
)
from gdg.data.layouts.exporting import chosen_shards, pairs_to_export, valid_grasps
from gdg.data.layouts.lookup import Lookup
from gdg.data.scene import TableScene
from gdg.data.table import Table
from gdg.errors import GdgError
from gdg.hands.hand import Hand, find_hand


def export(root: Path, path: Path) -> Path:
    write_compact(path, [(info, valid_grasps(info)) for info in chosen_shards(root)])
    return path


def test_valid_grasps_come_back(dataset: Callable[..., Path], tmp_path: Path) -> None:
    root = dataset("cube_small", "mug")
    stored = read_compact(export(root, tmp_path / "all.parquet"))
    groups = stored.groups()
    assert list(groups) == [
        Group("two_jaws", name, "dro-2024-v1", True) for name in ("cube_small", "mug")
    ]
    for group, rows in groups.items():
        found = stored.grasps(group, rows)
        before = grasps_in(root)[group.hand, group.object_name]
        assert_same_grasps(found, before.select(before.passed))


def test_facts_of_hands_objects_and_seeds_come_back(
    dataset: Callable[..., Path], gripper: Hand, tmp_path: Path
) -> None:
    root = dataset("cube_small", "mug")
    stored = read_compact(export(root, tmp_path / "all.parquet"))
    assert stored.hands["two_jaws"].content_hash == gripper.content_hash
    by_name = {info.object_name: info for info in shards(root)}
    assert stored.objects["mug"].content_hash == by_name["mug"].object_hash
    group = Group("two_jaws", "mug", "dro-2024-v1", True)
    provenance = stored.grasps(group, stored.groups()[group]).provenance
    assert provenance["seeds"] == [101]
    assert provenance["components"] == {"planner": {"name": "made-up"}}


def test_a_verdict_keeps_its_summary(dataset: Callable[..., Path], tmp_path: Path) -> None:
    root = dataset("cube_small")
    stored = read_compact(export(root, tmp_path / "all.parquet"))
    ((group, rows),) = stored.groups().items()
    verdict = stored.grasps(group, rows).verdicts[0]
    before = grasps_in(root)["two_jaws", "cube_small"].verdicts[1]
    for name in (
        "success",
        "failure",
        "protocol",
        "engine",
        "refined",
        "shift_successes",
        "trials",
    ):
        assert getattr(verdict, name) == getattr(before, name)
    assert verdict.penetration_start_mm == pytest.approx(before.penetration_start_mm)
    assert verdict.success_rate == before.success_rate
    assert verdict.stable == before.stable
    assert all(math.isnan(value) for value in verdict.displacement_m)


TABLES = [
    TableScene(Table((0.0, 0.0, 1.0), -0.02), 0, 0.5),
    TableScene(Table((0.0, 0.6, 0.8), -0.03), 1, 0.25),
]


def test_the_table_under_an_object_comes_back(gripper: Hand, tmp_path: Path) -> None:
    grasps = with_verdicts(random_grasps(gripper, "mug", 3), 0, "tabletop-lift-v2")
    info = info_of(gripper, "mug")
    scenes = [None, *TABLES, TABLES[0]]
    write_compact(tmp_path / "all.parquet", [(info, replace(grasps, scene=s)) for s in scenes])
    stored = read_compact(tmp_path / "all.parquet")
    found = {stored.grasps(g, rows).scene: len(rows) for g, rows in stored.groups().items()}
    assert found == {None: 3, TABLES[0]: 6, TABLES[1]: 3}


def test_files_without_a_table_are_as_they_were_before_there_were_any(
    dataset: Callable[..., Path], tmp_path: Path
) -> None:
    with pq.ParquetFile(export(dataset("cube_small"), tmp_path / "all.parquet")) as stored:
        assert "scene" not in stored.schema_arrow.names
        assert "scenes" not in json.loads((stored.schema_arrow.metadata or {})[METADATA_KEY])


@pytest.mark.parametrize("scenes", [{}, {"a": {"name": "shelf"}}, {"a": 3}, 7])
def test_scenes_that_are_none_are_refused(gripper: Hand, tmp_path: Path, scenes: Any) -> None:
    grasps = replace(random_grasps(gripper, "mug", 3), scene=TABLES[0])
    path = tmp_path / "all.parquet"
    write_compact(path, [(info_of(gripper, "mug"), grasps)])
    table = pq.read_table(path)
    header = json.loads((table.schema.metadata or {})[METADATA_KEY])
    header["scenes"] = scenes
    pq.write_table(with_checksum(table, json.dumps(header).encode()), path)
    with pytest.raises(GdgError, match="is no readable compact file"):
        read_compact(path)


def test_what_is_exported_to_other_layouts_is_not_on_a_table(
    gripper: Hand, lookup: Lookup, tmp_path: Path
) -> None:
    facts = {"hand_hash": gripper.content_hash, "object_hash": "o", "split": ""}
    for name in ("mug", "cup"):
        placed = replace(random_grasps(gripper, name, 2), scene=TABLES[0])
        write_shard(tmp_path, name, placed, {**facts, "hand_path": str(gripper.folder)})
    with pytest.raises(GdgError, match=r"objects on a table.* write --layout compact") as caught:
        pairs_to_export(chosen_shards(tmp_path), lookup)
    assert len(str(caught.value).splitlines()) == 1


def test_untested_grasps_stay_untested(dataset: Callable[..., Path], tmp_path: Path) -> None:
    root = dataset("cube_small", tested=False)
    stored = read_compact(export(root, tmp_path / "all.parquet"))
    ((group, rows),) = stored.groups().items()
    assert group.protocol == ""
    assert stored.grasps(group, rows).verdicts == ()
    assert len(rows) == 5


def info_of(hand: Hand, object_name: str, object_hash: str = "o") -> ShardInfo:
    return ShardInfo(
        path=Path("part-k.parquet"), key="k", hand=hand.name, object_name=object_name,
        hand_hash=hand.content_hash, object_hash=object_hash, split="train",
        joint_names=hand.spec.joints, root_link=hand.spec.root_link,
    )  # fmt: skip


def test_hands_of_different_joints_share_a_file_of_under_a_hundred_bytes_a_grasp(
    tmp_path: Path,
) -> None:
    hands = [find_hand(name) for name in ("barrett", "shadowhand")]
    sets = [
        (info_of(hand, name), with_verdicts(random_grasps(hand, name, 300, seed), 0, "dro-2024-v1"))
        for hand in hands
        for seed, name in enumerate(("mug", "apple"))
    ]
    path = tmp_path / "all.parquet"
    assert write_compact(path, sets) == 1200
    assert path.stat().st_size < 100 * 1200
    stored = read_compact(path)
    for info, grasps in sets:
        group = Group(info.hand, info.object_name, "dro-2024-v1", True)
        assert_same_grasps(stored.grasps(group, stored.groups()[group]), grasps)


def test_grasps_under_different_protocols_are_told_apart(gripper: Hand, tmp_path: Path) -> None:
    first = with_verdicts(random_grasps(gripper, "mug", 2), 0, "dro-2024-v1")
    second = with_verdicts(random_grasps(gripper, "mug", 3, 1), 0, "graspqp-2025-v1")
    path = tmp_path / "all.parquet"
    write_compact(path, [(info_of(gripper, "mug"), first), (info_of(gripper, "mug"), second)])
    counts = {group.protocol: len(rows) for group, rows in read_compact(path).groups().items()}
    assert counts == {"dro-2024-v1": 2, "graspqp-2025-v1": 3}


def test_two_versions_of_an_object_are_refused(gripper: Hand, tmp_path: Path) -> None:
    grasps = random_grasps(gripper, "mug", 1)
    sets = [(info_of(gripper, "mug", key), grasps) for key in ("a", "b")]
    with pytest.raises(GdgError, match="two versions of the object 'mug'"):
        write_compact(tmp_path / "all.parquet", sets)
    assert list(tmp_path.iterdir()) == []


def test_a_dataset_without_valid_grasps_is_refused(gripper: Hand, tmp_path: Path) -> None:
    grasps = with_verdicts(random_grasps(gripper, "mug", 2), failing=2)
    with pytest.raises(GdgError, match="nothing to export"):
        write_compact(
            tmp_path / "all.parquet", [(info_of(gripper, "mug"), grasps.select(grasps.passed))]
        )


def test_rotations_are_unit_quaternions(gripper: Hand, tmp_path: Path) -> None:
    grasps = random_grasps(gripper, "mug", 50)
    path = tmp_path / "all.parquet"
    write_compact(path, [(info_of(gripper, "mug"), grasps)])
    table = pq.read_table(path)
    quaternions = np.stack([table[name].to_numpy() for name in ("qw", "qx", "qy", "qz")], axis=-1)
    np.testing.assert_allclose(np.linalg.norm(quaternions, axis=1), 1.0, atol=1e-6)
    assert quaternions.dtype == np.float32


def test_what_is_no_compact_file_is_told(
    dataset: Callable[..., Path], gripper: Hand, tmp_path: Path
) -> None:
    (tmp_path / "a.parquet").write_bytes(b"PAR1 no more")
    pq.write_table(pa.table({"x": [1]}), tmp_path / "b.parquet")
    facts = {"hand_hash": "h", "object_hash": "o", "split": ""}
    shard = write_shard(tmp_path / "shards", "k", random_grasps(gripper, "mug", 1), facts)
    for path in (tmp_path / "a.parquet", tmp_path / "b.parquet", shard):
        with pytest.raises(GdgError, match="is no readable compact file"):
            read_compact(path)


def rewrite(path: Path, table: pa.Table, **header: Any) -> None:
    """Writes a file anew with a right checksum, and other entries of its header."""
    stored = json.loads((table.schema.metadata or {})[METADATA_KEY])
    pq.write_table(with_checksum(table, json.dumps({**stored, **header}).encode()), path)


@pytest.fixture
def small(gripper: Hand, tmp_path: Path) -> Path:
    """A compact file of four tested grasps."""
    path = tmp_path / "all.parquet"
    grasps = with_verdicts(random_grasps(gripper, "mug", 4), 0)
    write_compact(path, [(info_of(gripper, "mug"), grasps)])
    return path


@pytest.mark.parametrize(
    ("name", "values", "words"),
    [
        ("joints", None, "'joints' is missing"),
        ("protocol", None, "'protocol' is missing"),
        ("joints", pa.array([None] * 4, pa.list_(pa.float32())), "'joints' lacks values"),
        ("joints", pa.array([[0.1, math.nan]] * 4, pa.list_(pa.float32())), "not finite"),
        ("qw", pa.array([math.nan] * 4, pa.float32()), "'qw' has values that are not finite"),
        ("qw", pa.array([7.0] * 4, pa.float32()), "not of length 1"),
        ("x", pa.array(["a"] * 4), "'x' is string, not float"),
        ("trials_run", pa.array([None] * 4, pa.int8()), "'trials_run' lacks values"),
    ],
)
def test_columns_that_are_wrong_are_told(
    small: Path, name: str, values: pa.Array | None, words: str
) -> None:
    table = pq.read_table(small)
    place = table.column_names.index(name)
    changed = table.drop([name]) if values is None else table.set_column(place, name, values)
    rewrite(small, changed)
    with pytest.raises(GdgError, match=words):
        read_compact(small)


@pytest.mark.parametrize(
    "header",
    [
        {"recipes": [1]},
        {"recipes": {"a": 1}},
        {"objects": {"mug": ["o", "x", ""]}},
        {"objects": {"mug": ["o", -1.0, ""]}},
        {"objects": {"mug": ["o", 1.0, ["test"]]}},
        {"objects": []},
        {"hands": {"two_jaws": ["h", 5, "root"]}},
        {"hands": {"two_jaws": 5}},
    ],
)
def test_facts_that_are_wrong_are_told(small: Path, header: dict[str, Any]) -> None:
    rewrite(small, pq.read_table(small), **header)
    with pytest.raises(GdgError, match="is no readable compact file"):
        read_compact(small)


def test_joints_of_other_rows_do_not_make_up_for_missing_ones(small: Path) -> None:
    table = pq.read_table(small)
    place = table.column_names.index("joints")
    uneven = pa.array([[0.1] * n for n in (3, 1, 2, 2)], pa.list_(pa.float32()))
    rewrite(small, table.set_column(place, "joints", uneven))
    stored = read_compact(small)
    ((group, rows),) = stored.groups().items()
    with pytest.raises(GdgError, match="lack joint values"):
        stored.grasps(group, rows)


def test_a_file_without_a_checksum_is_refused(small: Path) -> None:
    table = pq.read_table(small)
    header = {METADATA_KEY: (table.schema.metadata or {})[METADATA_KEY]}
    pq.write_table(table.replace_schema_metadata(header), small)
    with pytest.raises(GdgError, match="it has no checksum; export it anew"):
        read_compact(small)


def test_no_bit_of_a_file_changes_unnoticed(small: Path) -> None:
    data, before = small.read_bytes(), read_compact(small)
    chance = random.Random(0)
    for _ in range(200):
        flipped = bytearray(data)
        flipped[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
        small.write_bytes(flipped)
        try:
            read = read_compact(small)
        except GdgError:
            continue
        assert read.table.equals(before.table)
        assert (read.hands, read.objects) == (before.hands, before.objects)


def test_rows_that_lack_joints_are_told(gripper: Hand, tmp_path: Path) -> None:
    path = tmp_path / "all.parquet"
    write_compact(path, [(info_of(gripper, "mug"), random_grasps(gripper, "mug", 2))])
    table = pq.read_table(path)
    place = table.column_names.index("joints")
    short = pa.array([[0.1], []], pa.list_(pa.float32()))
    rewrite(path, table.set_column(place, "joints", short))
    stored = read_compact(path)
    ((group, rows),) = stored.groups().items()
    with pytest.raises(GdgError, match="lack joint values"):
        stored.grasps(group, rows)


def test_the_order_of_grasps_is_that_of_the_dataset(gripper: Hand, tmp_path: Path) -> None:
    sets = [random_grasps(gripper, "mug", 3, seed) for seed in range(3)]
    path = tmp_path / "all.parquet"
    write_compact(path, [(info_of(gripper, "mug"), grasps) for grasps in sets])
    stored = read_compact(path)
    ((group, rows),) = stored.groups().items()
    whole = replace(
        sets[0],
        energies={},
        status=(),
        poses=torch.cat([grasps.poses for grasps in sets]),
        joints=torch.cat([grasps.joints for grasps in sets]),
    )
    assert_same_grasps(stored.grasps(group, rows), whole)
