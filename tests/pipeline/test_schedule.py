"""What is read back of earlier runs: counts of the rows that are there, and no nonsense."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from dataset_samples import FACTS, sample_grasps

from gdg.data.dataset import write_shard
from gdg.pipeline.counts import ShardCounts
from gdg.pipeline.schedule import read_counts
from gdg.pipeline.synth_record import SynthRecord

COUNTS = ShardCounts(candidates=20, planned=10, tested=8, passed=7).as_dict()


def test_what_passed_is_counted_by_the_rows(tmp_path: Path):
    some = read_counts(write_shard(tmp_path, "k1", sample_grasps(3), {**FACTS, **COUNTS}))
    none = read_counts(write_shard(tmp_path, "k2", sample_grasps(0), {**FACTS, **COUNTS}))
    assert some is not None
    assert none is not None
    assert (some.passed, some.tested, none.passed) == (2, 8, 0)


@pytest.mark.parametrize(
    "wrong", [{"candidates": "x"}, {"rejected": None}, {"failed": {"a": []}}, {"tested": None}]
)
def test_counts_of_another_shape_are_none(tmp_path: Path, wrong: dict):
    path = write_shard(tmp_path, "k", sample_grasps(1), {**FACTS, **COUNTS, **wrong})
    assert read_counts(path) is None


def test_a_shard_without_counts_has_none(tmp_path: Path):
    assert read_counts(write_shard(tmp_path, "k", sample_grasps(1), FACTS)) is None


@pytest.mark.parametrize("pairs", [5, None, [{}], [5], {"a": 1}, [{"key": []}]])
def test_a_record_that_cant_be_understood_is_none(tmp_path: Path, pairs: object):
    path = tmp_path / "synth.json"
    path.write_text(json.dumps({"schema": "gdg-synth-1", "pairs": pairs}))
    SynthRecord(tmp_path, {}).save([], now=True)
    assert json.loads(path.read_text())["pairs"] == []


def test_pairs_of_a_sound_record_stay_with_all_they_tell(tmp_path: Path):
    pair = {"hand": "a", "object": "b", "key": "c", "timed_out": 3, "timeout_s": 5, "more": [1]}
    path = tmp_path / "synth.json"
    path.write_text(json.dumps({"schema": "gdg-synth-1", "pairs": [pair]}))
    SynthRecord(tmp_path, {}).save([], now=True)
    assert json.loads(path.read_text())["pairs"] == [pair]


@pytest.mark.parametrize("text", ["", "[]", "5", "[" * 100_000, '{"schema": "other"}'])
def test_another_file_is_no_record(tmp_path: Path, text: str):
    (tmp_path / "synth.json").write_text(text)
    SynthRecord(tmp_path, {}).save([], now=True)
