"""Dataset shards: what is written is read back, and what is no shard is named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pyarrow.dataset
import pyarrow.parquet as pq
import pytest
import torch

from gdg.data.dataset import read_shard, shard_path, shards, write_shard
from gdg.data.grasps import GraspSet
from gdg.data.verdict import Verdict
from gdg.errors import GdgError

FACTS = {"hand_hash": "h" * 64, "object_hash": "o" * 64, "split": "train"}


def verdict(success: bool) -> Verdict:
    return Verdict(
        success=success,
        failure="" if success else "moved",
        displacement_m=(0.001,) * 6,
        rotation_rad=(0.0,) * 6,
        drift_m=0.0,
        contact_kept=(True,) * 6,
        penetration_start_mm=0.5,
        penetration_end_mm=0.1,
        free_displacement_m=0.25,
        shift_successes=(success,),
        protocol="dro-2024-v1",
        engine="none",
        refined=False,
        seconds=0.1,
    )


def grasps(count: int = 3) -> GraspSet:
    random = torch.Generator().manual_seed(0)
    return GraspSet(
        hand="barrett",
        object_name="contactdb+cube/odd name",
        joint_names=("a", "b"),
        root_link="palm",
        poses=torch.randn(count, 4, 4, generator=random),
        joints=torch.randn(count, 2, generator=random),
        targets=torch.randn(count, 2, generator=random),
        energies={"total": torch.rand(count, generator=random)},
        status=("converged",) * count,
        verdicts=tuple(verdict(index % 2 == 0) for index in range(count)),
        provenance={"seed": 1},
    )


def test_shard_round_trip_is_exact(tmp_path: Path) -> None:
    written = grasps()
    path = write_shard(tmp_path, "k1", written, {**FACTS, "object_scale": 0.001, "planner": "dfc"})
    read = read_shard(path)
    for name in ("poses", "joints", "targets"):
        assert torch.equal(getattr(read, name), getattr(written, name))
    assert torch.equal(read.energies["total"], written.energies["total"])
    assert read.verdicts == written.verdicts
    assert read.status == written.status
    assert (read.hand, read.object_name, read.joint_names, read.root_link) == (
        written.hand,
        written.object_name,
        written.joint_names,
        written.root_link,
    )
    assert read.provenance == {"seed": 1, "planner": "dfc"}


def test_optional_columns_may_be_absent(tmp_path: Path) -> None:
    bare = replace(grasps(), targets=None, energies={}, status=(), verdicts=())
    read = read_shard(write_shard(tmp_path, "k1", bare, FACTS))
    assert read.targets is None
    assert (read.energies, read.status, read.verdicts) == ({}, (), ())


def test_empty_shard_round_trip(tmp_path: Path) -> None:
    path = write_shard(tmp_path, "k1", grasps(0), FACTS)
    read = read_shard(path)
    assert len(read) == 0
    assert read.poses.shape == (0, 4, 4)
    assert read.joints.shape == (0, 2)
    assert shards(tmp_path)[0].count == 0


def test_listing_reads_every_fact_of_the_footers(tmp_path: Path) -> None:
    write_shard(tmp_path, "k1", grasps(), {**FACTS, "object_path": "cube.stl"})
    write_shard(tmp_path, "k2", replace(grasps(2), object_name="mug"), FACTS)
    first, second = shards(tmp_path)
    assert (first.key, first.object_name, first.count) == ("k1", "contactdb+cube/odd name", 3)
    assert (first.split, first.object_path, first.object_scale) == ("train", "cube.stl", 1.0)
    assert (second.key, second.object_name, second.count) == ("k2", "mug", 2)
    assert second.path == shard_path(tmp_path, "barrett", "mug", "k2")


def test_same_key_replaces_the_shard(tmp_path: Path) -> None:
    for count in (3, 1):
        write_shard(tmp_path, "k1", grasps(count), FACTS)
    assert [info.count for info in shards(tmp_path)] == [1]
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [shards(tmp_path)[0].path]


def test_dataset_is_readable_by_other_tools(tmp_path: Path) -> None:
    write_shard(tmp_path, "k1", grasps(), FACTS)
    write_shard(tmp_path, "k1", replace(grasps(2), hand="allegro"), FACTS)
    table = pyarrow.dataset.dataset(tmp_path, partitioning="hive").to_table()
    assert table.num_rows == 5
    assert set(table["hand"].to_pylist()) == {"barrett", "allegro"}
    assert table["success"].to_pylist().count(True) == 3


def test_files_that_are_no_shards_are_named(tmp_path: Path) -> None:
    path = write_shard(tmp_path, "k1", grasps(), FACTS)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(GdgError, match=r"part-k1\.parquet: is no readable dataset shard"):
        shards(tmp_path)
    with pytest.raises(GdgError, match=r"part-k1\.parquet: is no readable"):
        read_shard(path)
    pq.write_table(pyarrow.table({"a": [1]}), path)
    with pytest.raises(GdgError, match="schema is not 'gdg-dataset-1'"):
        shards(tmp_path)


def test_shard_with_damaged_rows_is_named(tmp_path: Path) -> None:
    path = write_shard(tmp_path, "k1", grasps(), FACTS)
    table = pq.ParquetFile(path).read()
    pq.write_table(table.drop_columns(["pose"]), path)
    with pytest.raises(GdgError, match=r"part-k1\.parquet: is no readable dataset shard.*pose"):
        read_shard(path)


def test_missing_facts_and_folders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(GdgError, match="lacks object_hash, split"):
        write_shard(tmp_path, "k1", grasps(), {"hand_hash": ""})
    with pytest.raises(GdgError, match="no such folder of grasps"):
        shards(tmp_path / "absent")
