"""A header that anyone may have written is one clear sentence, never a traceback."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from dataset_samples import FACTS, sample_grasps

from gdg.data.dataset import write_shard
from gdg.data.header import parse_header
from gdg.data.info import dataset_info
from gdg.data.merge import merge_datasets
from gdg.data.shards import METADATA_KEY, read_info
from gdg.data.validate import check_dataset
from gdg.errors import GdgError

MALFORMED = [
    ("key", "../../evil"), ("key", ".hidden"), ("key", ""), ("key", "a" * 65), ("key", 5),
    ("key", "a\n"), ("hand", None), ("hand", 5), ("hand", ""), ("hand", ".."), ("hand", "a/b"),
    ("hand", "\ud800"), ("hand", "a\x1b[2J"), ("object", "a\\b"), ("object", "../x"),
    ("provenance", None), ("provenance", []), ("joint_names", [["a"]]), ("joint_names", "ab"),
    ("hand_path", ["x"]), ("object_scale", "1"), ("object_scale", 0), ("object_scale", True),
    ("split", None), ("root_link", {}), ("reason", 3), ("parts", 3), ("content", None),
    ("summary", None), ("summary", {"passed": "many"}), ("summary", {"passed": -1}),
    ("summary", {"measured": {"a": 5}}), ("summary", {"measured": {"a": ["x", 1.0]}}),
]  # fmt: skip


@pytest.fixture
def shard(tmp_path: Path) -> Path:
    return write_shard(tmp_path / "in", "k1", sample_grasps(2), FACTS)


def change(path: Path, **entries: Any) -> None:
    table = pq.ParquetFile(path).read()
    header = json.loads(table.schema.metadata[METADATA_KEY])
    text = json.dumps({**header, **entries}).encode()
    pq.write_table(table.replace_schema_metadata({METADATA_KEY: text}), path)


@pytest.mark.parametrize(("name", "value"), MALFORMED)
def test_an_entry_that_is_not_what_it_must_be_is_told(shard: Path, name: str, value: Any):
    change(shard, **{name: value})
    with pytest.raises(GdgError) as caught:
        read_info(shard)
    assert f"{shard}: is no readable dataset shard: " in str(caught.value)
    str(caught.value).encode()
    assert len(dataset_info(shard.parent).unreadable) == 1
    (finding,) = check_dataset(shard.parent)
    assert finding.damaged


@pytest.mark.parametrize("key", ["../../evil", "/tmp/evil", "a/b", ".hidden"])
def test_no_key_leads_out_of_the_output_folder(shard: Path, tmp_path: Path, key: str):
    change(shard, key=key)
    before = set(tmp_path.rglob("*"))
    with pytest.raises(GdgError, match="key: must be 1 to 64 letters"):
        merge_datasets([shard.parent], tmp_path / "a" / "b" / "out")
    assert set(tmp_path.rglob("*")) == before
    with pytest.raises(GdgError, match="key: must be 1 to 64 letters"):
        write_shard(tmp_path / "a" / "b" / "out", key, sample_grasps(1), FACTS)
    assert set(tmp_path.rglob("*")) == before


def test_counts_in_the_provenance_may_be_anything(shard: Path):
    for value in (None, "5", [1], {}, 1.5, -3):
        change(shard, provenance={"tested": 4, "passed": value, "seed": value})
        assert dataset_info(shard.parent).total().tested_passed == 0


@pytest.mark.parametrize("text", [b"null", b"[]", b"{}", b'{"schema": 5}', b'{"schema": "x"}'])
def test_another_header_is_told(text: bytes):
    with pytest.raises(ValueError, match="its schema is not 'gdg-dataset-2'"):
        parse_header(text)


@pytest.mark.parametrize("text", [b"", b"{", b"\xff", b"[" * 100_000, b'{"hand": "\\ud800"}'])
def test_what_is_no_header_is_told(text: bytes):
    with pytest.raises(ValueError, match="its header can't be read"):
        parse_header(text)
