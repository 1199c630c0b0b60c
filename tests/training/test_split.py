"""Which shards are learned from and which choose the epoch."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from training_samples import FACTS, some_grasps

from gdg.data.dataset import write_shard
from gdg.errors import GdgError
from gdg.hands.hand import find_hand
from gdg.training.job import TrainJob
from gdg.training.split import choose_shards


def write(root: Path, hand: str, object_name: str, **facts: Any) -> None:
    write_shard(root, "k", some_grasps(hand, object_name, 2), {**FACTS, **facts})


def test_test_objects_are_refused_however_they_are_named(tmp_path: Path) -> None:
    write(tmp_path / "a", "barrett", "my_part", split="test")
    write(tmp_path / "b", "barrett", "apple", split="")
    write(tmp_path / "c", "barrett", "contactdb+apple", split="train")
    for name in "abc":
        with pytest.raises(GdgError, match="is a test object"):
            choose_shards(TrainJob(data=str(tmp_path / name)))


def test_held_out_hand_is_never_chosen(tmp_path: Path) -> None:
    for hand in ("barrett", "allegro", "mine"):
        for name in ("lemon", "orange"):
            write(tmp_path, hand, name, hand_hash=f"of {hand}")
    split = choose_shards(TrainJob(data=str(tmp_path), exclude_hand="allegro", val_fraction=0.5))
    assert {info.hand for info in (*split.train, *split.validation)} == {"barrett", "mine"}
    with pytest.raises(GdgError, match=r"no hand 'alegro'.*Did you mean 'allegro'"):
        choose_shards(TrainJob(data=str(tmp_path), exclude_hand=["alegro"]))
    with pytest.raises(GdgError, match="holds no grasps"):
        choose_shards(TrainJob(data=str(tmp_path), exclude_hand=["barrett", "allegro", "mine"]))


def test_validation_objects_are_train_objects_that_training_never_sees(tmp_path: Path) -> None:
    names = {"lemon", "orange", "cube_small", "hammer", "peach"}
    for name in names:
        write(tmp_path, "barrett", name)
    splits = [
        choose_shards(TrainJob(data=str(tmp_path), val_fraction=0.4, seed=seed))
        for seed in range(4)
    ]
    for split in splits:
        assert len(split.objects("validation")) == 2
        assert set(split.objects("train")) == names - set(split.objects("validation"))
    assert len({tuple(split.objects("validation")) for split in splits}) > 1
    with pytest.raises(GdgError, match="leaves none to train"):
        choose_shards(TrainJob(data=str(tmp_path / "hand=barrett" / "object=hammer")))


def test_only_the_hand_that_is_trained_for_is_chosen(tmp_path: Path) -> None:
    barrett = find_hand("barrett")
    for hand, content in (("barrett", barrett.content_hash), ("mine", "of mine")):
        for name in ("lemon", "orange"):
            write(tmp_path, hand, name, hand_hash=content)
    job = TrainJob(data=str(tmp_path), val_fraction=0.5)
    split = choose_shards(job, barrett)
    assert {info.hand for info in (*split.train, *split.validation)} == {"barrett"}
    with pytest.raises(GdgError, match="no grasps of hand 'allegro'; it has: barrett, mine"):
        choose_shards(job, find_hand("allegro"))
    with pytest.raises(GdgError, match="'barrett' is the hand to be trained for"):
        choose_shards(job.model_copy(update={"exclude_hand": ("barrett",)}), barrett)


def test_hands_of_one_name_are_not_mixed(tmp_path: Path) -> None:
    barrett = find_hand("barrett")
    write(tmp_path, "barrett", "lemon", hand_hash=barrett.content_hash)
    write(tmp_path, "barrett", "orange", hand_hash="of another", object_hash="other")
    job = TrainJob(data=str(tmp_path), val_fraction=0.5)
    with pytest.raises(GdgError, match=r"lemon/.* and .*orange/.* different hands, both named"):
        choose_shards(job)
    with pytest.raises(GdgError, match=r"orange/.* of another hand 'barrett' than .*write hand="):
        choose_shards(job, barrett)
    one = job.model_copy(update={"exclude_object": ("orange",), "val_fraction": 0, "keep": "last"})
    assert choose_shards(one, barrett).objects("train") == ["lemon"]
