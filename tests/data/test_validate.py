"""Every kind of damage is found and named, and damaged files are set aside, never deleted."""

from __future__ import annotations

import json
import os
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch
from dataset_samples import FACTS, assert_same_grasps, sample_grasps, write_old_shard
from hypothesis import given
from hypothesis import strategies as st

from gdg.data.dataset import read_shard, shards, write_shard
from gdg.data.findings import FileFinding
from gdg.data.validate import check_dataset, set_aside


@pytest.fixture
def shard(tmp_path: Path) -> Path:
    return write_shard(tmp_path, "k1", sample_grasps(), FACTS)


def only(findings: list[FileFinding]) -> FileFinding:
    (finding,) = findings
    return finding


def rewrite(path: Path, change: Any) -> None:
    """Changes the table of a shard and leaves its metadata."""
    pq.write_table(change(pq.ParquetFile(path).read()), path)


def test_a_sound_dataset_has_no_findings(tmp_path: Path, shard: Path):
    write_shard(tmp_path, "k2", sample_grasps(0), {**FACTS, "reason": "none"})
    write_shard(tmp_path, "k3", sample_grasps(2, seed=1, parts=()), FACTS)
    write_old_shard(tmp_path, "k4", sample_grasps(2, seed=2, parts=("verdicts",)), FACTS)
    seen = []
    assert check_dataset(tmp_path, progress=lambda done, total: seen.append((done, total))) == []
    assert seen == [(1, 4), (2, 4), (3, 4), (4, 4)]


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_a_file_that_was_cut_off_is_found(tmp_path: Path, shard: Path, share: float):
    shard.write_bytes(shard.read_bytes()[: int(share * shard.stat().st_size)])
    finding = only(check_dataset(tmp_path))
    assert (finding.path, finding.severity, finding.damaged) == (shard, "error", True)
    assert "is no readable dataset shard" in str(finding)
    assert str(finding).count(str(shard)) == 1


@given(st.floats(0, 1, exclude_max=True), st.integers(0, 7))
def test_a_flipped_bit_is_found_or_changes_nothing(
    tmp_path_factory: pytest.TempPathFactory, where: float, bit: int
):
    root = tmp_path_factory.getbasetemp() / "rot"
    grasps = sample_grasps(20)
    path = write_shard(root, "k1", grasps, FACTS)
    content = bytearray(path.read_bytes())
    content[int(where * len(content))] ^= 1 << bit
    path.write_bytes(content)
    if not check_dataset(root):
        assert_same_grasps(read_shard(path), grasps)
        (info,) = shards(root)
        assert (info.hand_hash, info.object_hash) == (FACTS["hand_hash"], FACTS["object_hash"])


def test_values_and_facts_that_were_changed_are_found_by_the_checksum(tmp_path: Path, shard: Path):
    original = shard.read_bytes()

    def other_status(table: pa.Table) -> pa.Table:
        index = table.column_names.index("status")
        return table.set_column(index, "status", pa.array(["diverged"] * 3))

    def other_hash(table: pa.Table) -> pa.Table:
        metadata = dict(table.schema.metadata)
        metadata[b"gdg"] = metadata[b"gdg"].replace(b"a" * 64, b"c" * 64)
        return table.replace_schema_metadata(metadata)

    for change in (other_status, other_hash, lambda table: table.slice(1)):
        shard.write_bytes(original)
        rewrite(shard, change)
        assert "checksum" in only(check_dataset(tmp_path)).text


def test_poses_and_joints_that_are_impossible_are_found(tmp_path: Path):
    grasps = sample_grasps(4, parts=())
    mirrored, nan = grasps.poses.clone(), grasps.joints.clone()
    mirrored[1, :3, 0] *= -1
    mirrored[2, 0, 0] = torch.nan
    nan[3, 0] = torch.inf
    write_shard(tmp_path, "k1", replace(grasps, poses=mirrored, joints=nan), FACTS)
    poses, joints = check_dataset(tmp_path)
    assert "2 of 4 (the first is row 1) poses are not rigid" in poses.text
    assert "1 of 4 (the first is row 3) rows of joint values" in joints.text


def test_a_shard_under_another_name_is_found(tmp_path: Path, shard: Path):
    moved = shard.parent.with_name("object=mug") / "part-k9.parquet"
    moved.parent.mkdir()
    shard.rename(moved)
    texts = [finding.text for finding in check_dataset(tmp_path)]
    assert "object 'cube', but its folder says 'mug'" in texts[0]
    assert "was written as part-k1.parquet" in texts[1]
    moved.rename(tmp_path / "part-k1.parquet")
    texts = [finding.text for finding in check_dataset(tmp_path)]
    assert len(texts) == 2
    assert "no folder hand=…" in texts[0]


def test_duplicates_within_and_across_shards_are_found(tmp_path: Path, shard: Path):
    doubled = sample_grasps(5, seed=1).select([0, 1, 2, 1])
    inside = write_shard(tmp_path, "k2", doubled, FACTS)
    across = write_shard(tmp_path, "k3", sample_grasps(2, seed=5), FACTS)
    again = write_shard(tmp_path, "k4", sample_grasps().select([0, 2]), FACTS)
    first, second = check_dataset(tmp_path)
    assert (first.path, first.damaged) == (inside, False)
    assert "1 of its 4 grasps stand in the same file already" in first.text
    assert (second.path, second.damaged) == (again, False)
    assert f"2 of its 2 grasps stand in {shard} already" in second.text
    assert across.is_file()


def test_an_id_that_is_not_that_of_its_grasp_is_found(tmp_path: Path):
    path = write_old_shard(tmp_path, "k1", sample_grasps(2, parts=()), FACTS)
    rewrite(path, lambda table: table.append_column("grasp_id", pa.array(["00" * 16] * 2)))
    assert "2 of 2 (the first is row 0) grasp_ids" in only(check_dataset(tmp_path)).text


def test_what_a_killed_run_left_over_is_a_warning(tmp_path: Path, shard: Path):
    left = shard.parent / ".part-k2.parquet.abcd_f9h.parquet"
    left.write_bytes(b"half")
    # it may belong to a run that goes on
    assert check_dataset(tmp_path) == []
    long_ago = time.time() - 3600
    os.utime(left, (long_ago, long_ago))
    finding = only(check_dataset(tmp_path))
    assert (finding.path, finding.severity) == (left, "warning")
    assert set_aside(tmp_path, [finding]) == [tmp_path / ".corrupt" / left.relative_to(tmp_path)]
    assert check_dataset(tmp_path) == []


def test_damaged_shards_are_set_aside_and_kept(tmp_path: Path, shard: Path):
    sound = write_shard(tmp_path, "k2", sample_grasps(seed=1), FACTS)
    for content in (b"first", b"second"):
        shard.write_bytes(content)
        (moved,) = set_aside(tmp_path, check_dataset(tmp_path))
        assert moved.read_bytes() == content
    assert not shard.exists()
    assert sound.is_file()
    assert check_dataset(tmp_path) == []
    assert len(list((tmp_path / ".corrupt").rglob("part-k1*"))) == 2


def test_all_mistakes_are_told_at_once(tmp_path: Path, shard: Path):
    for key in ("k2", "k3"):
        write_shard(tmp_path, key, sample_grasps(seed=3), FACTS)
    shard.write_bytes(b"")
    findings = check_dataset(tmp_path)
    assert [finding.path.name for finding in findings] == ["part-k1.parquet", "part-k3.parquet"]


def test_the_checks_of_hands_and_objects_see_every_readable_shard(tmp_path: Path, shard: Path):
    write_shard(tmp_path, "k2", sample_grasps(2, seed=1), FACTS).write_bytes(b"")
    seen = []

    def more(info, grasps):
        seen.append((info.key, len(grasps)))
        return [FileFinding("warning", info.path, "odd")]

    findings = check_dataset(tmp_path, more)
    assert seen == [("k1", 3)]
    assert [finding.severity for finding in findings] == ["warning", "error"]


def test_a_header_of_another_shape_is_found(tmp_path: Path, shard: Path):
    for header in ([], {}, {"schema": "gdg-dataset-2"}, {"schema": "gdg-dataset-2", "hand": 1}):
        text = json.dumps(header).encode()
        rewrite(shard, lambda table, text=text: table.replace_schema_metadata({b"gdg": text}))
        assert only(check_dataset(tmp_path)).damaged
