"""Sums over footers equal sums over grasps."""

from __future__ import annotations

from pathlib import Path

import pytest
from dataset_samples import FACTS, sample_grasps, write_old_shard

from gdg.data.dataset import write_shard
from gdg.data.info import dataset_info


@pytest.fixture
def root(tmp_path: Path) -> Path:
    counts = {"tested": 8, "passed": 2}
    write_shard(tmp_path, "k1", sample_grasps(3, seed=1), {**FACTS, **counts})
    write_shard(tmp_path, "k2", sample_grasps(3, seed=2), {**FACTS, "tested": 2, "passed": 2})
    write_shard(tmp_path, "k1", sample_grasps(0, hand="b"), {**FACTS, "reason": "too large"})
    test = {**FACTS, "split": "test"}
    write_shard(tmp_path, "k1", sample_grasps(2, hand="b", object_name="mug", parts=()), test)
    write_old_shard(tmp_path, "k9", sample_grasps(4, hand="c", parts=("verdicts",)), FACTS)
    return tmp_path


def test_sums_per_hand_object_and_in_all(root: Path):
    found = dataset_info(root)
    total = found.total()
    assert (total.grasps, total.passed, total.shards) == (12, 6, 5)
    assert total.splits == {"train", "test"}
    assert total.versions == {1, 2}
    assert total.seeds == {1}
    assert total.bytes == sum(path.stat().st_size for path in root.rglob("*.parquet"))
    assert {name: sums.grasps for name, sums in found.by_hand().items()} == {
        "claw": 6,
        "b": 2,
        "c": 4,
    }
    assert {name: sums.grasps for name, sums in found.by_object().items()} == {"cube": 10, "mug": 2}
    assert found.pairs["b", "cube"].reasons == {"too large"}


def test_the_success_rate_counts_what_was_tested_but_not_stored(root: Path):
    found = dataset_info(root)
    assert found.pairs["claw", "cube"].success_rate == pytest.approx(4 / 10)
    assert found.pairs["c", "cube"].success_rate == pytest.approx(2 / 4)
    assert found.pairs["b", "mug"].success_rate is None


def test_means_are_of_the_grasps_that_passed(root: Path):
    grasps = [sample_grasps(3, seed=seed) for seed in (1, 2)]
    chosen = [float(g.metrics["epsilon"][index]) for g in grasps for index in (0, 2)]
    pair = dataset_info(root).pairs["claw", "cube"]
    assert pair.mean("metric_epsilon") == pytest.approx(sum(chosen) / 4)
    assert pair.mean("penetration_start_mm") == pytest.approx(0.5)
    assert pair.mean("metric_volume") is None


def test_files_that_are_no_shards_are_listed_and_the_others_counted(root: Path):
    broken = write_shard(root, "k7", sample_grasps(), FACTS)
    broken.write_bytes(b"")
    found = dataset_info(root)
    assert found.total().grasps == 12
    assert len(found.unreadable) == 1
    assert str(broken) in found.unreadable[0]


def test_an_empty_folder_has_no_grasps(tmp_path: Path):
    assert dataset_info(tmp_path).total().as_dict()["grasps"] == 0
