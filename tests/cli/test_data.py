"""``gdg data info | validate | merge | split``: what they print, and how they end."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from command_line import refused
from dataset_samples import FACTS, sample_grasps

from gdg.data.dataset import shards, write_shard
from gdg.splits import load_split


@pytest.fixture
def root(tmp_path: Path) -> Path:
    folder = tmp_path / "grasps"
    write_shard(folder, "k1", sample_grasps(), FACTS)
    none = {**FACTS, "reason": "the object is larger than the hand"}
    none["object_hash"] = "d" * 64
    write_shard(folder, "k1", sample_grasps(0, object_name="house [x]"), none)
    for name in ("mug", "ycb+plum"):
        facts = {**FACTS, "object_hash": f"{len(name)}" * 64}
        write_shard(folder, "k1", sample_grasps(2, object_name=name, seed=len(name)), facts)
    return folder


def test_the_group_lists_its_commands_without_importing_them(run):
    outcome = run("data", "--help")
    assert outcome.code == 0
    for name in ("info", "validate", "merge", "split"):
        assert name in outcome.out


def test_info_shows_counts_and_why_there_are_none(run, root: Path):
    outcome = run("data", "info", root)
    assert (outcome.code, outcome.err) == (0, "")
    assert "7" in next(line for line in outcome.out.splitlines() if "1 in all" in line)
    assert "mean epsilon" in outcome.out
    assert "claw · house [x] has none: the object is larger than the hand" in outcome.out
    assert "claw · ycb+plum" in run("data", "info", root, "--pairs").out


def test_info_gives_every_figure_as_json(run, root: Path):
    tree = json.loads(run("data", "info", root, "--json").out)
    assert (tree["total"]["grasps"], tree["total"]["shards"]) == (7, 4)
    assert tree["hands"]["claw"]["splits"] == ["train"]
    assert set(tree["objects"]) == {"cube", "house [x]", "mug", "ycb+plum"}
    assert tree["pairs"][0]["means"]["metric_epsilon"] > 0


def test_info_names_what_it_cannot_read(run, root: Path):
    shards(root)[0].path.write_bytes(b"")
    outcome = run("data", "info", root)
    assert outcome.code == 0
    assert "part-k1.parquet" in outcome.err
    assert "gdg data validate" in outcome.err
    refused(run("data", "info", root / "absent"), "no such folder of grasps")


def test_validate_ends_with_zero_where_there_are_only_warnings(run, root: Path):
    outcome = run("data", "validate", root)
    assert outcome.code == 0, outcome.out
    assert "hand 'claw' is not found here" in outcome.out
    quiet = run("data", "validate", root, "--no-assets")
    assert quiet.out == f"{root}: 4 files, no mistake found\n"


def test_validate_names_what_is_damaged_and_sets_it_aside_on_request(run, root: Path):
    victim = shards(root)[0].path
    victim.write_bytes(victim.read_bytes()[:-9])
    outcome = run("data", "validate", root, "--no-assets")
    assert outcome.code == 2
    assert f"error: {victim}: is no readable dataset shard" in outcome.out
    assert "--remove" in outcome.out
    assert victim.is_file()
    outcome = run("data", "validate", root, "--no-assets", "--remove")
    assert outcome.code == 2
    assert f"moved: {root / '.corrupt'}" in outcome.out
    assert not victim.exists()
    assert run("data", "validate", root, "--no-assets").code == 0


def test_merge_says_what_it_wrote(run, root: Path, tmp_path: Path):
    other = tmp_path / "other"
    write_shard(other, "k2", sample_grasps(), FACTS)
    outcome = run("data", "merge", root, other, "--out", tmp_path / "all")
    assert (outcome.code, outcome.err) == (0, "")
    assert "5 shards with 7 grasps written; 3 duplicate grasps dropped" in outcome.out
    again = run("data", "merge", root, other, "--out", tmp_path / "all")
    assert "0 shards with 0 grasps written, 5 shards there already" in again.out


def test_merge_refuses_two_contents_under_one_key(run, root: Path, tmp_path: Path):
    other = tmp_path / "other"
    write_shard(other, "k1", sample_grasps(4, seed=7), FACTS)
    refused(run("data", "merge", root, other, "--out", tmp_path / "all"), str(other), str(root))
    refused(run("data", "merge", root, "absent", "--out", "x"), "absent", "no such folder")


def test_split_writes_a_lock_that_is_read_back(run, root: Path, tmp_path: Path):
    words = ("data", "split", root, "--out", tmp_path / "mine.lock.yaml", "--validation", "0.4")
    outcome = run(*words)
    assert (outcome.code, outcome.err) == (0, "")
    lock = load_split(str(tmp_path / "mine.lock.yaml"))
    assert lock.name == "mine"
    assert len(lock.objects.validation) == 1
    assert "mug" in {entry.name for entry in lock.objects.test}
    text = (tmp_path / "mine.lock.yaml").read_bytes()
    run(*words)
    assert (tmp_path / "mine.lock.yaml").read_bytes() == text


def test_split_tells_mistakes(run, root: Path):
    out = ("--out", "x.lock.yaml")
    refused(run("data", "split", root, *out, "--held-out-hand", "clav"), "Did you mean 'claw'?")
    refused(run("data", "split", root, *out, "--held-out-hand", "claw"), "none is left to train on")
    refused(run("data", "split", root, *out, "--validation", "0.9"), "leaves none to train on")
    assert run("data", "split", root, *out, "--validation", "1").code == 2
