"""A union has every grasp once, whatever the order and however often it was interrupted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from dataset_samples import (
    FACTS,
    assert_same_grasps,
    sample_grasps,
    sample_verdict,
    write_old_shard,
)
from hypothesis import given
from hypothesis import strategies as st

import gdg.data.merge as merging
from gdg.data.dataset import read_shard, shards, stream_grasps, write_shard
from gdg.data.merge import MERGED_FROM, merge_datasets
from gdg.data.validate import check_dataset
from gdg.errors import GdgError, GdgErrors

POOL = sample_grasps(8)


def rows(root: Path) -> set[tuple[float, ...]]:
    found = [tuple(row.tolist()) for batch in stream_grasps(root) for row in batch.joints]
    assert len(found) == len(set(found)), "a grasp stands twice"
    return set(found)


def test_a_union_has_the_shards_of_all_byte_by_byte(tmp_path: Path):
    a, b, out = (tmp_path / name for name in ("a", "b", "out"))
    first = write_shard(a, "k1", sample_grasps(3, seed=1), FACTS)
    second = write_shard(b, "k1", sample_grasps(3, object_name="mug", seed=2), FACTS)
    write_shard(b, "k2", sample_grasps(0), {**FACTS, "reason": "none"})
    merged = merge_datasets([a, b], out)
    assert (merged.shards, merged.grasps, merged.dropped) == (3, 6, 0)
    assert (out / first.relative_to(a)).read_bytes() == first.read_bytes()
    assert (out / second.relative_to(b)).read_bytes() == second.read_bytes()
    assert [info.reason for info in shards(out) if not info.count] == ["none"]
    assert check_dataset(out) == []


def test_the_same_shard_is_taken_once_even_if_its_timings_differ(tmp_path: Path):
    grasps = sample_grasps(3)
    slower = tuple(replace(verdict, seconds=9.0) for verdict in grasps.verdicts)
    for name, made in (("a", grasps), ("b", replace(grasps, verdicts=slower))):
        write_shard(tmp_path / name, "k1", made, FACTS)
    merged = merge_datasets([tmp_path / "a", tmp_path / "b"], tmp_path / "out")
    assert (merged.shards, merged.repeated, merged.dropped) == (1, 1, 0)


def test_the_same_key_with_other_grasps_is_an_error_that_names_both(tmp_path: Path):
    a, b, out = (tmp_path / name for name in ("a", "b", "out"))
    first, second = (write_shard(a, f"k{i}", sample_grasps(3, seed=i), FACTS) for i in (1, 2))
    other = write_shard(b, "k1", sample_grasps(3, seed=3), FACTS)
    failed = replace(sample_grasps(3, seed=2), verdicts=(sample_verdict(False),) * 3)
    judged = write_shard(b, "k2", failed, FACTS)
    broken = write_shard(b, "k3", sample_grasps(3, seed=4), FACTS)
    broken.write_bytes(b"")
    with pytest.raises(GdgErrors) as caught:
        merge_datasets([a, b], out)
    messages = caught.value.messages
    assert len(messages) == 3
    assert str(first) in messages[0]
    assert str(other) in messages[0]
    assert str(second) in messages[1]
    assert str(judged) in messages[1]
    assert str(broken) in messages[2]
    assert not out.exists()


def test_duplicates_are_dropped_and_the_rest_keeps_all_that_belongs_to_it(tmp_path: Path):
    a, b, out = (tmp_path / name for name in ("a", "b", "out"))
    write_shard(a, "k1", POOL.select(range(4)), FACTS)
    write_shard(b, "k2", POOL.select([3, 4, 5, 0]), {**FACTS, "object_scale": 0.5})
    write_shard(b, "k3", POOL.select([1, 2]), FACTS)
    merged = merge_datasets([a, b], out)
    assert (merged.shards, merged.grasps, merged.dropped) == (3, 6, 4)
    _, second, third = shards(out)
    assert_same_grasps(read_shard(second.path), POOL.select([4, 5]))
    assert (second.object_scale, second.hand_hash) == (0.5, FACTS["hand_hash"])
    assert (third.count, third.reason) == (0, "all its grasps stand in other shards")
    assert check_dataset(out) == []


def test_shards_of_the_first_schema_are_written_anew(tmp_path: Path):
    grasps = sample_grasps(3, parts=("targets", "verdicts"))
    write_old_shard(tmp_path / "a", "k1", grasps, FACTS)
    write_shard(tmp_path / "b", "k1", grasps, FACTS)
    out = tmp_path / "out"
    merged = merge_datasets([tmp_path / "a", tmp_path / "b"], out)
    assert (merged.shards, merged.repeated) == (1, 1)
    (info,) = shards(out)
    assert (info.version, info.provenance["seed"]) == (2, 1)
    assert_same_grasps(read_shard(info.path), grasps)
    assert merge_datasets([tmp_path / "a"], out).present == 1


@given(st.lists(st.lists(st.integers(0, 7), unique=True), min_size=1, max_size=5), st.randoms())
def test_a_union_does_not_depend_on_where_it_was_interrupted(
    tmp_path_factory: pytest.TempPathFactory, shares: list[list[int]], random
):
    root = tmp_path_factory.mktemp("merge")
    for number, share in enumerate(shares):
        write_shard(root / f"in{number % 2}", f"k{number}", POOL.select(share), FACTS)
    inputs = [path for path in (root / "in0", root / "in1") if path.is_dir()]
    whole = merge_datasets(inputs, root / "whole")
    expected = {tuple(POOL.joints[index].tolist()) for share in shares for index in share}
    assert rows(root / "whole") == expected
    stop = random.randrange(len(shares))

    def interrupt(done: int, total: int) -> None:
        if done > stop:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        merge_datasets(inputs, root / "parts", interrupt)
    merged = merge_datasets(inputs, root / "parts")
    assert merged.shards == whole.shards - stop - 1
    assert rows(root / "parts") == expected
    assert [i.content for i in shards(root / "parts")] == [
        i.content for i in shards(root / "whole")
    ]
    assert merge_datasets(inputs, root / "parts").shards == 0
    # and once more with the union among the inputs
    assert merge_datasets([root / "whole", *inputs], root / "whole").shards == 0


def test_damage_inside_of_a_shard_is_told_and_nothing_of_it_copied(tmp_path: Path):
    path = write_shard(tmp_path / "a", "k1", sample_grasps(50), FACTS)
    content = bytearray(path.read_bytes())
    content[100] ^= 1
    path.write_bytes(content)
    with pytest.raises(GdgError, match=r"part-k1\.parquet: is no readable"):
        merge_datasets([tmp_path / "a"], tmp_path / "out")
    assert not list((tmp_path / "out").rglob("*.parquet"))


def test_a_full_disk_leaves_no_half_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    write_shard(tmp_path / "a", "k1", sample_grasps(), FACTS)

    def full(source: Path, target: Path) -> None:
        target.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(merging.shutil, "copyfile", full)
    with pytest.raises(OSError, match="No space"):
        merge_datasets([tmp_path / "a"], tmp_path / "out")
    assert [path for path in (tmp_path / "out").rglob("*") if path.is_file()] == []


def test_the_origin_of_a_shard_that_lost_grasps_is_remembered(tmp_path: Path):
    write_shard(tmp_path / "a", "k1", POOL.select([0]), FACTS)
    path = write_shard(tmp_path / "b", "k2", POOL.select([0, 1]), FACTS)
    (source,) = shards(tmp_path / "b")
    assert source.path == path
    merge_datasets([tmp_path / "a", tmp_path / "b"], tmp_path / "out")
    assert shards(tmp_path / "out")[1].provenance[MERGED_FROM] == source.content


def test_a_shard_that_lost_grasps_does_not_stand_for_the_whole_one(tmp_path: Path):
    x, y, union = (tmp_path / name for name in ("x", "y", "union"))
    write_shard(x, "x", POOL.select(range(5)), FACTS)
    write_shard(y, "y", POOL.select(range(2, 8)), FACTS)
    merge_datasets([x, y], union)
    # the shard with the other copies of what the second one lost is gone
    next(union.rglob("part-x.parquet")).unlink()
    expected = rows(y)
    assert len(rows(union)) == 3
    for name, inputs in (("first", [union, y]), ("last", [y, union])):
        merged = merge_datasets(inputs, tmp_path / name)
        assert (merged.shards, merged.repeated, merged.grasps) == (1, 1, 6)
        assert rows(tmp_path / name) == expected
    merged = merge_datasets([y], union)
    assert (merged.shards, merged.grasps, merged.dropped) == (1, 3, 3)
    assert rows(union) == expected
    assert (merge_datasets([y], union).present, merge_datasets([x, y], union).shards) == (1, 1)
    assert check_dataset(union) == []


def test_what_two_merges_left_of_one_shard_is_united(tmp_path: Path):
    for name, dropped in (("a", [0, 1]), ("b", [6, 7])):
        write_shard(tmp_path / name / "in", "first", POOL.select(dropped), FACTS)
        write_shard(tmp_path / name / "in", "whole", POOL, FACTS)
        # the inputs of one folder come in the order of their paths
        merge_datasets([tmp_path / name / "in"], tmp_path / name / "out")
        next((tmp_path / name / "out").rglob("part-first.parquet")).unlink()
    inputs = [tmp_path / name / "out" for name in ("a", "b")]
    assert merge_datasets(inputs, tmp_path / "out").grasps == 8
    assert rows(tmp_path / "out") == {tuple(row.tolist()) for row in POOL.joints}
    again = merge_datasets(inputs, tmp_path / "out")
    assert (again.shards, again.present) == (0, 2)
    assert check_dataset(tmp_path / "out") == []


@pytest.mark.parametrize("write", [write_shard, write_old_shard])
def test_of_equal_grasps_the_tested_ones_stay(tmp_path: Path, write):
    write(tmp_path / "a", "k1", replace(POOL, verdicts=()), FACTS)
    write(tmp_path / "b", "k2", POOL.select(range(3)), FACTS)
    merge_datasets([tmp_path / "a", tmp_path / "b"], tmp_path / "out")
    counts = {info.key: (info.count, info.passed) for info in shards(tmp_path / "out")}
    assert counts == {"k1": (5, None), "k2": (3, 2)}


def test_the_counts_of_a_shard_that_lost_grasps_are_made_anew(tmp_path: Path):
    write_shard(tmp_path / "in", "k1", POOL.select(range(4)), FACTS)
    counts = {"candidates": 30, "planned": 20, "tested": 16, "passed": 4}
    write_shard(tmp_path / "in", "k2", POOL, {**FACTS, **counts})
    merge_datasets([tmp_path / "in"], tmp_path / "out")
    info = shards(tmp_path / "out")[1]
    left = {name: info.provenance[name] for name in counts}
    assert left == {"candidates": 26, "planned": 16, "tested": 12, "passed": 2}
    assert info.passed == 2
