"""Items of shards: cached, streamed, made anew where damaged, refused where assets changed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from grasp_samples import make_verdict
from training_samples import FACTS, choices, some_grasps

from gdg.contact_maps import contact_maps_of_grasps
from gdg.data.dataset import read_shard, write_shard
from gdg.data.shards import ShardInfo, shards
from gdg.errors import GdgError
from gdg.hands.hand import find_hand
from gdg.objects.model import find_object
from gdg.training import source as source_module
from gdg.training.items import ItemDataset, ItemGroup
from gdg.training.order import Step
from gdg.training.source import ItemSource, good_grasps


@pytest.fixture
def own_cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setenv("GDG_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def source(kind: str = "maps", computed: bool = False) -> ItemSource:
    picked = choices()
    return ItemSource(picked["distance"], picked["hand_model"], kind, computed)  # type: ignore[arg-type]


def group_of(items: ItemSource, info: ShardInfo) -> ItemGroup:
    group = items.group(info)
    assert group is not None
    return group


def test_maps_are_cached_and_made_again_where_the_cache_is_damaged(
    dataset: Path, monkeypatch: pytest.MonkeyPatch, own_cache: Path
) -> None:
    info = shards(dataset)[0]
    whole = group_of(source(), info)
    assert isinstance(whole.values, Path)
    assert whole.values.is_relative_to(own_cache)
    expected = np.load(whole.values)
    assert (expected.dtype, expected.shape) == (np.float16, (12, 2048))
    # a chunk at a time, after the file was cut off
    whole.values.write_bytes(whole.values.read_bytes()[:500])
    monkeypatch.setattr(source_module, "CHUNK", 5)
    again = group_of(source(), info)
    assert (again.values, again.count) == (whole.values, 12)
    np.testing.assert_array_equal(np.load(whole.values), expected)
    # and not at all where it is sound
    monkeypatch.setattr(source_module, "good_grasps", None)
    group_of(source(), info)


def test_items_are_the_grasps_and_their_maps(dataset: Path) -> None:
    info, items = shards(dataset)[0], source("grasps")
    group, grasps = group_of(items, info), read_shard(info.path)
    hand, obj = items._hand(info), find_object(info.object_name)
    data = ItemDataset([group], "grasps", 2048)
    batch = data.__getitems__(Step(np.array([7, 2]), None)).items
    maps = contact_maps_of_grasps(hand, obj, grasps, items.distance)
    torch.testing.assert_close(batch.q, hand.q_of(grasps)[[7, 2]])
    torch.testing.assert_close(batch.values, maps.values[[7, 2]], atol=5e-4, rtol=0)
    assert torch.equal(batch.points[1], obj.points)
    assert torch.equal(batch.normals[1], obj.normals)


@pytest.mark.parametrize("kind", ["maps", "grasps"])
def test_computed_maps_equal_the_cached_ones(dataset: Path, kind: str) -> None:
    info, step = shards(dataset)[1], Step(np.array([3, 9, 4]), 5)
    cached, computed = source(kind), source(kind, computed=True)
    stored = ItemDataset([group_of(cached, info)], kind, 100)  # type: ignore[arg-type]
    group = group_of(computed, info)
    assert group.values is None
    made = ItemDataset([group], kind, 100, computed.maker())  # type: ignore[arg-type]
    for a, b in zip(stored.__getitems__(step).items, made.__getitems__(step).items, strict=True):
        torch.testing.assert_close(a, b, atol=1e-3, rtol=0)


def test_joints_are_matched_by_name(tmp_path: Path) -> None:
    hand, obj = find_hand("barrett"), find_object("lemon")
    grasps = some_grasps("barrett", "lemon", 4)
    turned = replace(
        grasps, joint_names=grasps.joint_names[::-1], joints=grasps.joints.flip(1).contiguous()
    )
    facts = {"hand_hash": hand.content_hash, "object_hash": obj.content_hash, "split": "train"}
    for key, stored in (("a", grasps), ("b", turned)):
        write_shard(tmp_path, key, stored, facts)
    items = source("grasps", computed=True)
    first, second = (np.load(group_of(items, info).q) for info in shards(tmp_path))  # type: ignore[arg-type]
    np.testing.assert_array_equal(first, second)


def test_only_grasps_that_passed_are_learned_from(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(source_module, "CHUNK", 2)
    grasps = some_grasps("barrett", "lemon", 5)
    verdicts = tuple(
        make_verdict(success, shift_successes=(success,), refined=False)
        for success in (True, False, False, True, True)
    )
    write_shard(tmp_path, "a", grasps, FACTS)
    write_shard(tmp_path, "b", replace(grasps, verdicts=verdicts), FACTS)
    untested, tested = shards(tmp_path)
    assert sum(map(len, good_grasps(untested))) == 5
    kept = torch.cat([part.joints for part in good_grasps(tested)])
    assert torch.equal(kept, grasps.joints[[0, 3, 4]])
    # of schema 1, whose footer doesn't tell
    kept = torch.cat([part.joints for part in good_grasps(replace(tested, version=1))])
    assert torch.equal(kept, grasps.joints[[0, 3, 4]])


def test_a_shard_without_good_grasps_gives_no_items(tmp_path: Path) -> None:
    hand, obj = find_hand("barrett"), find_object("lemon")
    failed = make_verdict(False, shift_successes=(False,), refined=False)
    grasps = replace(some_grasps("barrett", "lemon", 2), verdicts=(failed, failed))
    facts = {"hand_hash": hand.content_hash, "object_hash": obj.content_hash, "split": "train"}
    write_shard(tmp_path, "a", grasps, facts)
    assert source().group(shards(tmp_path)[0]) is None
    with pytest.raises(GdgError, match="none of its grasps passed"):
        source().groups(shards(tmp_path))


def test_changed_hand_or_object_is_refused(tmp_path: Path) -> None:
    content = find_object("lemon").content_hash
    grasps = some_grasps("barrett", "lemon", 2)
    write_shard(tmp_path / "a", "k", grasps, FACTS)
    write_shard(tmp_path / "b", "k", grasps, {**FACTS, "object_hash": content})
    for folder, what in (("a", "the object 'lemon'"), ("b", "the hand 'barrett'")):
        with pytest.raises(GdgError, match=f"another version of {what}"):
            source().group(shards(tmp_path / folder)[0])


def test_progress_is_told_and_objects_are_loaded_once(dataset: Path) -> None:
    calls: list[tuple[int, int]] = []
    groups = source().groups(shards(dataset), lambda done, total: calls.append((done, total)))
    assert calls == [(1, 3), (2, 3), (3, 3)]
    assert {group.object_name for group in groups} == {"cube_small", "lemon", "orange"}
