"""Dataset shards: what is written is read back, by others too, and what is no shard is told."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pyarrow.dataset
import pyarrow.parquet as pq
import pytest
import torch
from dataset_samples import (
    FACTS,
    assert_same_grasps,
    sample_contacts,
    sample_grasps,
    sample_verdict,
    write_old_shard,
)
from hypothesis import given
from hypothesis import strategies as st

from gdg.data.dataset import read_shard, shard_path, shards, stream_grasps, write_shard
from gdg.data.grasps import GraspSet
from gdg.errors import GdgError

ODD_NAME = "contactdb+cube, odd name"
PARTS = ("targets", "status", "contacts", "verdicts", "figures")


def ids(path: Path) -> list[str]:
    return pq.ParquetFile(path).read()["grasp_id"].to_pylist()


# -- one shard ----------------------------------------------------------------------------------


@pytest.mark.parametrize("parts", [PARTS, (), ("contacts",), ("verdicts",)])
def test_what_is_written_is_read_back(tmp_path: Path, parts: tuple[str, ...]):
    written = sample_grasps(object_name=ODD_NAME, parts=parts)
    path = write_shard(tmp_path, "k1", written, {**FACTS, "object_scale": 0.001, "planner": "dfc"})
    read = read_shard(path)
    assert_same_grasps(read, written)
    assert read.provenance == {"seed": 1, "planner": "dfc"}


finite = st.floats(-10, 10, width=32)
any_number = st.floats(width=32)


@given(st.data(), st.integers(0, 5), st.integers(1, 4), st.sets(st.sampled_from(PARTS)))
def test_grasps_of_any_size_with_any_parts_come_back(
    tmp_path_factory: pytest.TempPathFactory,
    data: st.DataObject,
    count: int,
    joints: int,
    parts: set[str],
):
    grasps = sample_grasps(count, joints=joints, parts=[*parts - {"contacts", "figures"}])
    numbers = st.lists(any_number, min_size=count, max_size=count)
    if "figures" in parts:
        names = data.draw(st.lists(st.text("abc_é ", min_size=1), max_size=3, unique=True))
        columns = {name: torch.tensor(data.draw(numbers)) for name in names}
        grasps = replace(grasps, energies=columns, metrics=columns)
    if "contacts" in parts:
        counts = data.draw(st.lists(st.integers(0, 3), min_size=count, max_size=count))
        grasps = replace(grasps, contacts=sample_contacts(counts, torch.Generator()))
    if "status" in parts and count:
        texts = st.lists(st.text(max_size=4), min_size=count, max_size=count)
        grasps = replace(grasps, status=tuple(data.draw(texts)))
    folder = tmp_path_factory.getbasetemp() / "any"
    read = read_shard(write_shard(folder, "k", grasps, FACTS))
    assert_same_grasps(read, grasps)


def test_a_pair_that_gave_nothing_says_why(tmp_path: Path):
    path = write_shard(tmp_path, "k1", sample_grasps(0), {**FACTS, "reason": "too large"})
    read = read_shard(path)
    assert (len(read), read.poses.shape, read.joints.shape) == (0, (0, 4, 4), (0, 2))
    (info,) = shards(tmp_path)
    assert (info.count, info.reason, info.passed) == (0, "too large", None)


def test_figures_that_are_not_finite_come_back_and_do_not_spoil_the_means(tmp_path: Path):
    grasps = replace(
        sample_grasps(3, parts=("verdicts",), every_nth_passes=1),
        metrics={"epsilon": torch.tensor([math.nan, 1.0, 3.0])},
        provenance={"loss": math.inf},
    )
    path = write_shard(tmp_path, "k1", grasps, FACTS)
    assert read_shard(path).metrics["epsilon"].isnan().tolist() == [True, False, False]
    (info,) = shards(tmp_path)
    assert info.measured["metric_epsilon"] == (2, 4.0)
    assert info.provenance == {"loss": None}


def test_the_footer_says_all_that_a_listing_needs(tmp_path: Path):
    write_shard(
        tmp_path, "k1", sample_grasps(object_name=ODD_NAME), {**FACTS, "object_path": "cube.stl"}
    )
    write_shard(tmp_path, "k2", sample_grasps(2, object_name="mug", parts=()), FACTS)
    first, second = shards(tmp_path)
    assert (first.key, first.object_name, first.count) == ("k1", ODD_NAME, 3)
    assert (first.split, first.object_path, first.object_scale) == ("train", "cube.stl", 1.0)
    assert (first.passed, first.version) == (2, 2)
    assert first.measured["penetration_end_mm"] == (2, 0.5)
    assert (second.key, second.object_name, second.count) == ("k2", "mug", 2)
    assert second.path == shard_path(tmp_path, "claw", "mug", "k2")
    assert second.passed is None


def test_the_same_key_replaces_the_shard(tmp_path: Path):
    for count in (3, 1):
        write_shard(tmp_path, "k1", sample_grasps(count), FACTS)
    assert [info.count for info in shards(tmp_path)] == [1]
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [shards(tmp_path)[0].path]


def test_a_grasp_has_the_same_id_wherever_it_stands(tmp_path: Path):
    grasps = sample_grasps(4)
    first = ids(write_shard(tmp_path / "a", "k1", grasps, FACTS))
    bare = replace(grasps.select([2, 0]), targets=None, verdicts=(), hand="other")
    assert ids(write_shard(tmp_path / "b", "k2", bare, FACTS)) == [first[2], first[0]]
    assert len(set(first)) == 4
    other_hand = ids(write_shard(tmp_path / "c", "k1", grasps, {**FACTS, "hand_hash": "c" * 64}))
    assert not set(first) & set(other_hand)
    moved = replace(grasps, joints=grasps.joints + 1e-6)
    assert not set(first) & set(ids(write_shard(tmp_path / "d", "k1", moved, FACTS)))


def test_shards_of_the_first_schema_are_still_read(tmp_path: Path):
    written = sample_grasps(parts=("targets", "status", "verdicts"))
    written = replace(written, energies={"total": torch.tensor([1.0, math.nan, 2.0])})
    path = write_old_shard(tmp_path, "k1", written, FACTS)
    assert_same_grasps(read_shard(path), written)
    (info,) = shards(tmp_path)
    assert (info.version, info.key, info.count, info.passed) == (1, "k1", 3, None)
    bare = sample_grasps(parts=())
    assert_same_grasps(read_shard(write_old_shard(tmp_path, "k2", bare, FACTS)), bare)
    assert len(list(stream_grasps(tmp_path, success=True))) == 1


# -- files that are none ------------------------------------------------------------------------


def test_files_that_are_no_shards_are_named(tmp_path: Path):
    path = write_shard(tmp_path, "k1", sample_grasps(), FACTS)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(GdgError, match=r"part-k1\.parquet: is no readable dataset shard"):
        shards(tmp_path)
    with pytest.raises(GdgError, match=r"part-k1\.parquet: is no readable"):
        read_shard(path)
    pq.write_table(pyarrow.table({"a": [1]}), path)
    with pytest.raises(GdgError, match="schema is not 'gdg-dataset-2'"):
        shards(tmp_path)


@pytest.mark.parametrize("column", ["pose", "joints", "targets", "contact_points"])
def test_a_shard_that_lacks_a_column_is_named(tmp_path: Path, column: str):
    path = write_shard(tmp_path, "k1", sample_grasps(), FACTS)
    table = pq.ParquetFile(path).read()
    spoilt = table.set_column(
        table.column_names.index(column), column, pyarrow.nulls(3, table[column].type)
    )
    pq.write_table(spoilt, path)
    with pytest.raises(GdgError, match=rf"part-k1\.parquet: is no readable.*{column}"):
        read_shard(path)


def test_hidden_files_and_folders_are_no_part_of_a_dataset(tmp_path: Path):
    path = write_shard(tmp_path, "k1", sample_grasps(), FACTS)
    (path.parent / ".part-k2.parquet.abcdefgh.parquet").write_bytes(b"half")
    (tmp_path / ".corrupt").mkdir()
    (tmp_path / ".corrupt" / "part-k3.parquet").write_bytes(b"half")
    assert [info.key for info in shards(tmp_path)] == ["k1"]
    assert pyarrow.dataset.dataset(tmp_path, partitioning="hive").count_rows() == 3


def test_missing_facts_and_folders_are_refused(tmp_path: Path):
    with pytest.raises(GdgError, match="lacks object_hash, split"):
        write_shard(tmp_path, "k1", sample_grasps(), {"hand_hash": ""})
    with pytest.raises(GdgError, match="no such folder of grasps"):
        shards(tmp_path / "absent")


# -- whole datasets -----------------------------------------------------------------------------


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    """Hands of two and three joints; the first shard of all is empty, the last of schema 1."""
    root = tmp_path / "data"
    write_shard(root, "k0", sample_grasps(0, hand="a", parts=()), {**FACTS, "reason": "none"})
    write_shard(root, "k1", sample_grasps(5, hand="a", object_name="mug"), FACTS)
    test = {**FACTS, "split": "test"}
    write_shard(root, "k1", sample_grasps(4, hand="b", joints=3, object_name="apple"), test)
    write_shard(root, "k2", sample_grasps(2, hand="b", joints=3, parts=()), FACTS)
    write_old_shard(root, "k3", sample_grasps(3, hand="c", parts=("verdicts",)), FACTS)
    return root


def test_a_dataset_is_readable_by_other_tools(dataset: Path):
    table = pyarrow.dataset.dataset(dataset, partitioning="hive").to_table()
    assert table.num_rows == 14
    assert set(table["hand"].to_pylist()) == {"a", "b", "c"}
    assert set(table["object"].to_pylist()) == {"cube", "mug", "apple"}
    assert table["success"].to_pylist().count(True) == 3 + 2 + 2
    assert {len(row) for row in table["joints"].to_pylist()} == {2, 3}
    chosen = pyarrow.dataset.dataset(dataset, partitioning="hive").to_table(
        columns=["grasp_id", "contact_links"], filter=pyarrow.dataset.field("hand") == "a"
    )
    assert len(set(chosen["grasp_id"].to_pylist())) == 5
    assert chosen["contact_links"].to_pylist()[2] == ["fingér tip", "thumb"]


def test_a_stream_gives_every_grasp_once_in_batches(dataset: Path):
    batches = list(stream_grasps(dataset, batch=2))
    assert max(map(len, batches)) <= 2
    assert sum(map(len, batches)) == 14
    whole = [read_shard(info.path) for info in shards(dataset) if info.count]
    streamed = torch.cat([batch.joints.flatten() for batch in batches])
    assert torch.equal(streamed, torch.cat([grasps.joints.flatten() for grasps in whole]))
    contacts = [batch.contacts for batch in batches if batch.hand == "a"]
    assert sum(int(c.counts.sum()) for c in contacts if c is not None) == 0 + 1 + 2 + 0 + 1


def names(batches: list[GraspSet]) -> set[tuple[str, str]]:
    return {(batch.hand, batch.object_name) for batch in batches}


def test_a_stream_is_filtered_by_hand_object_split_and_success(dataset: Path):
    assert names(list(stream_grasps(dataset, hands=["b"]))) == {("b", "apple"), ("b", "cube")}
    assert names(list(stream_grasps(dataset, objects=["mug"]))) == {("a", "mug")}
    assert names(list(stream_grasps(dataset, splits=["test"]))) == {("b", "apple")}
    passed = list(stream_grasps(dataset, success=True))
    assert sum(map(len, passed)) == 7
    assert all(verdict == sample_verdict(True) for batch in passed for verdict in batch.verdicts)
    failed = list(stream_grasps(dataset, success=False))
    assert sum(map(len, failed)) == 14 - 7 - 2
    bare = list(stream_grasps(dataset, success=True, verdicts=False))
    assert sum(map(len, bare)) == 7
    assert not any(batch.verdicts for batch in bare)


def test_a_damaged_page_is_noticed_by_a_stream(tmp_path: Path):
    path = write_shard(tmp_path, "k1", sample_grasps(200, parts=()), FACTS)
    column = pq.read_metadata(path).row_group(0).column(1)
    content = bytearray(path.read_bytes())
    content[column.data_page_offset + column.total_compressed_size // 2] ^= 1
    path.write_bytes(content)
    with pytest.raises(GdgError, match=r"part-k1\.parquet: is no readable"):
        list(stream_grasps(tmp_path))


def test_listing_a_dataset_imports_no_torch():
    code = "import sys, gdg.data.info; assert 'torch' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
