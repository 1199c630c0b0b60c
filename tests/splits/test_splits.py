"""Locks say what may be learned from, by name and by content, and contradict nothing."""

from __future__ import annotations

from pathlib import Path

import pytest
from dataset_samples import FACTS, sample_grasps
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from gdg.data.dataset import shards, write_shard
from gdg.data.shards import ShardInfo
from gdg.errors import GdgError, GdgErrors
from gdg.folders import HANDS, OBJECTS
from gdg.hands.hand import load_hand
from gdg.identity import body_hash, object_hash
from gdg.objects.spec import read_object_spec
from gdg.splits import (
    FOLDER,
    HandSplit,
    LockedHand,
    LockedObject,
    ObjectSplit,
    SplitLock,
    bare_name,
    held_out_hand,
    load_split,
    save_split,
    split_names,
    where_is_object,
)
from gdg.splits.make import choose_validation, make_split

ONE, TWO, THREE = "1" * 64, "2" * 64, "3" * 64
LOCK = SplitLock(
    name="mine",
    objects=ObjectSplit(
        train=(LockedObject(name="ycb+plum", hash=ONE), LockedObject(name="plum", hash=TWO)),
        test=(LockedObject(name="apple", hash=THREE),),
    ),
    hands=HandSplit(
        train=(LockedHand(name="barrett"),),
        held_out=(LockedHand(name="shadowhand", hash=ONE, body=TWO),),
    ),
)


# -- lock files ---------------------------------------------------------------------------------


def test_a_lock_comes_back_from_its_file(tmp_path: Path):
    save_split(LOCK, tmp_path / "mine.lock.yaml")
    read = load_split(str(tmp_path / "mine.lock.yaml"))
    assert read == LOCK
    assert read.content_hash == LOCK.content_hash
    assert "- name: ycb+plum" in (tmp_path / "mine.lock.yaml").read_text()


def test_the_hash_of_a_lock_follows_its_content_alone(tmp_path: Path):
    path = tmp_path / "mine.lock.yaml"
    save_split(LOCK, path)
    path.write_text(f"# a comment\n{path.read_text()}")
    assert load_split(str(path)).content_hash == LOCK.content_hash
    assert LOCK.model_copy(update={"version": 2}).content_hash != LOCK.content_hash


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        ("format: gdg-split-1", "format: gdg-split-9", "format"),
        ("name: mine", "nam: mine", "there is no such option"),
        (ONE, "xyz", "hash"),
        ("name: apple", "name: contactdb+plum", "'plum' stands in both train and test"),
        (THREE, ONE, "stands in both train and test"),
        ("name: shadowhand", "name: barrett", "'barrett' stands in both train and held_out"),
    ],
)
def test_what_is_malformed_or_contradicts_itself_is_told(
    tmp_path: Path, old: str, new: str, part: str
):
    path = tmp_path / "mine.lock.yaml"
    save_split(LOCK, path)
    path.write_text(path.read_text().replace(old, new, 1 if old == ONE else -1))
    with pytest.raises(GdgError, match=part) as caught:
        load_split(str(path))
    assert str(path) in str(caught.value)


def test_unknown_locks_are_told_with_a_suggestion(tmp_path: Path):
    with pytest.raises(GdgError, match="Did you mean 'paper'"):
        load_split("papr")
    with pytest.raises(GdgError, match=r"lost\.yaml: cannot be read"):
        load_split(str(tmp_path / "lost.yaml"))


def test_objects_are_found_by_bare_name_and_by_content_and_test_wins():
    assert where_is_object(LOCK, "contactdb+plum", "") == "train"
    assert where_is_object(LOCK, "ycb+apple", "") == "test"
    assert where_is_object(LOCK, "plum", THREE) == "test"
    assert where_is_object(LOCK, "renamed", THREE) == "test"
    assert where_is_object(LOCK, "renamed", TWO) == "train"
    assert where_is_object(LOCK, "renamed", "") == ""


def test_held_out_hands_are_found_by_name_content_and_body():
    for name, content, body in (("shadowhand", "", ""), ("x", ONE, ""), ("x", "", TWO)):
        found = held_out_hand(LOCK, name, content, body)
        assert found is not None
        assert found.name == "shadowhand"
    assert held_out_hand(LOCK, "barrett", THREE, THREE) is None


# -- made from a dataset ------------------------------------------------------------------------


class NoAssets:
    """Finds nothing, in no time."""

    def hand(self, given: str) -> None: ...

    def hand_of(self, origin: object) -> None: ...

    def object_hash(self, given: str, scale: float = 1.0) -> None: ...


def infos(root: Path, hands: list[str], objects: dict[str, str], **facts: str) -> list[ShardInfo]:
    for hand in hands:
        for name, content in objects.items():
            given = {**FACTS, "object_hash": content, **facts}
            write_shard(root, "k", sample_grasps(1, hand=hand, object_name=name), given)
    return shards(root)


def test_catalogue_test_objects_are_always_test_objects(tmp_path: Path):
    objects = {"contactdb+apple": ONE, "renamed": ONE, "lemon": TWO, "orange": THREE}
    lock = make_split(infos(tmp_path, ["claw"], objects), "x", assets=NoAssets())  # type: ignore[arg-type]
    tests = {entry.name for entry in lock.objects.test}
    assert {"contactdb+apple", "renamed", "apple", "camera"} <= tests
    assert not tests & {"lemon", "orange"}


def test_a_split_that_the_dataset_records_is_kept(tmp_path: Path):
    infos(tmp_path, ["claw"], {"lemon": ONE}, split="test")
    found = infos(tmp_path, ["claw"], {"orange": TWO, "peach": THREE})
    lock = make_split(found, "x", assets=NoAssets())  # type: ignore[arg-type]
    assert "lemon" in {entry.name for entry in lock.objects.test}


def lock_of(found: list[ShardInfo], share: float, seed: int) -> SplitLock | None:
    """The lock, or None where equal meshes leave too few objects."""
    try:
        return make_split(found, "x", validation=share, seed=seed, assets=NoAssets())  # type: ignore[arg-type]
    except GdgError:
        return None


@settings(max_examples=20)
@given(
    st.sets(
        st.sampled_from(["a", "b", "x+a", "y+b", "c", "d", "z+e", "contactdb+pear"]), min_size=4
    ),
    st.floats(0, 0.5),
    st.integers(0, 3),
)
def test_a_split_is_a_partition_that_keeps_the_meshes_of_an_object_together(
    names: set[str], share: float, seed: int
):
    contents = {name: f"{index // 2:x}" * 64 for index, name in enumerate(sorted(names))}
    found = [
        ShardInfo(Path(), "k", "claw", name, ONE, contents[name], "", (), "") for name in names
    ]
    lock = lock_of(found, share, seed)
    assume(lock is not None)
    assert lock is not None
    parts = [lock.objects.train, lock.objects.validation, lock.objects.test]
    listed = [entry.name for part in parts for entry in part]
    assert len(listed) == len(set(listed))
    assert names <= set(listed)
    bare = [{bare_name(entry.name) for entry in part} for part in parts]
    assert sum(map(len, bare)) == len(set.union(*bare))
    again = lock_of(found[::-1], share, seed)
    assert again is not None
    assert again.content_hash == lock.content_hash


def test_seeds_choose_other_validation_objects():
    names = [f"object {index}" for index in range(20)]
    chosen = {frozenset(choose_validation(names, 0.1, seed)) for seed in range(5)}
    assert {len(part) for part in chosen} == {2}
    assert len(chosen) > 1


def test_held_out_hands_are_listed_with_all_their_contents(tmp_path: Path):
    objects = {"lemon": ONE, "orange": TWO}
    infos(tmp_path, ["barrett"], objects, hand_hash=THREE)
    found = infos(tmp_path, ["claw"], objects)
    lock = make_split(found, "x", held_out=["barrett"], validation=0)
    assert [entry.name for entry in lock.hands.train] == ["claw"]
    # another version in the dataset, and the one found here
    assert {entry.hash for entry in lock.hands.held_out} == {
        THREE,
        load_hand(HANDS.find("barrett").path).content_hash,
    }
    with pytest.raises(GdgErrors, match="Did you mean 'claw'"):
        make_split(found, "x", held_out=["clav"])
    found = infos(tmp_path, ["copy"], objects)
    with pytest.raises(GdgErrors, match="'copy' is the held-out hand 'claw' under another name"):
        make_split(found, "x", held_out=["claw"], validation=0)


def test_a_mesh_under_two_names_is_one_object(tmp_path: Path):
    found = infos(tmp_path, ["claw"], {"a": ONE, "b": ONE, "x+b": TWO, "c": THREE})
    for seed in range(3):
        lock = make_split(found, "x", validation=0.5, seed=seed, assets=NoAssets())  # type: ignore[arg-type]
        assert {entry.name for entry in lock.objects.validation} in ({"a", "b", "x+b"}, {"c"})


def test_a_name_that_is_none_is_told(tmp_path: Path):
    found = infos(tmp_path, ["claw"], {"lemon": ONE, "orange": TWO})
    with pytest.raises(GdgErrors, match="split: name: "):
        make_split(found, "My Lock", assets=NoAssets())  # type: ignore[arg-type]


# -- bundled locks ------------------------------------------------------------------------------


def test_every_one_of_the_five_hands_has_a_lock_that_holds_it_out():
    hands = ("allegro", "barrett", "ezgripper", "robotiq_3finger", "shadowhand")
    assert split_names() == sorted(["paper", *(f"paper-without-{hand}" for hand in hands)])
    whole = load_split("paper")
    assert whole.hands.held_out == ()
    for hand in hands:
        lock = load_split(f"paper-without-{hand}")
        assert hand in {entry.name for entry in lock.hands.held_out}
        assert {*lock.hands.train, *lock.hands.held_out} == set(whole.hands.train)
        assert lock.objects == whole.objects


def test_the_paper_has_48_train_and_10_test_objects():
    objects = load_split("paper").objects
    published = [
        [entry.name for entry in part if "+" in entry.name]
        for part in (objects.train, objects.validation, objects.test)
    ]
    assert (len(published[0]) + len(published[1]), len(published[2])) == (48, 10)
    assert len({bare_name(entry.name) for entry in objects.validation}) == 5
    assert all(entry.hash for part in (objects.train, objects.test) for entry in part)


STALE = "run tools/make_split_locks.py, which writes the locks"


def test_bundled_locks_have_the_contents_of_the_bundled_hands():
    listed = {entry.name: entry for entry in load_split("paper").hands.train}
    bundled = {folder.name: folder for folder in HANDS.all().values() if folder.tier == "bundled"}
    assert listed.keys() == bundled.keys(), STALE
    for name, folder in bundled.items():
        hand = load_hand(folder.path)
        entry = LockedHand(name=name, hash=hand.content_hash, body=body_hash(hand))
        assert listed[name] == entry, STALE


def test_bundled_locks_have_the_contents_of_the_bundled_objects():
    lock = load_split("paper")
    names = set()
    for folder in OBJECTS.all().values():
        if folder.tier == "bundled":
            spec, content = read_object_spec(folder.path), object_hash(str(folder.path))
            where = where_is_object(lock, "?", content)
            assert {"validation": "train"}.get(where, where) == spec.split, STALE
            names.add(spec.name)
    parts = (lock.objects.train, lock.objects.validation, lock.objects.test)
    assert {entry.name for part in parts for entry in part if "+" not in entry.name} == names, STALE


def test_bundled_locks_stand_as_they_are_written(tmp_path: Path):
    for name in split_names():
        save_split(load_split(name), tmp_path / "lock.yaml")
        bundled = FOLDER / f"{name}.lock.yaml"
        assert (tmp_path / "lock.yaml").read_text() == bundled.read_text(), STALE


def test_a_name_counts_without_dataset_and_scale():
    for name in ("apple", "ycb+apple", "apple@0.9", "ycb+apple@0.9"):
        assert bare_name(name) == "apple"
    assert bare_name("@home") == "@home"
