"""Nothing that a lock or the catalogue holds out is trained on, under whatever name."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from dataset_samples import FACTS, sample_grasps
from gripper import write_gripper

from gdg.config import ComponentChoice
from gdg.data.dataset import shards, write_shard
from gdg.errors import GdgError, GdgErrors
from gdg.folders import HANDS, OBJECTS
from gdg.hands.hand import load_hand
from gdg.identity import body_hash, object_hash
from gdg.objects.spec import read_object_spec
from gdg.registry import get_registry
from gdg.splits import (
    HandSplit,
    LockedHand,
    LockedObject,
    ObjectSplit,
    SplitLock,
    load_split,
    save_split,
)
from gdg.training.job import TrainJob
from gdg.training.source import ItemSource
from gdg.training.split import choose_shards

HASHES = {name: f"{index:x}" * 64 for index, name in enumerate(("lemon", "orange", "vase", "cube"))}


def write(root: Path, hand: str, object_name: str, **facts: object) -> None:
    content = HASHES.get(object_name.rpartition("+")[2], "f" * 64)
    given = {**FACTS, "object_hash": content, "hand_hash": f"of {hand}", **facts}
    write_shard(root, "k", sample_grasps(2, hand=hand, object_name=object_name), given)


@pytest.fixture
def lock(tmp_path: Path) -> str:
    """Objects lemon and orange to train, cube to validate, vase to test; claw held out."""

    def entry(name: str) -> LockedObject:
        return LockedObject(name=name, hash=HASHES[name])

    path = tmp_path / "mine.lock.yaml"
    save_split(
        SplitLock(
            name="mine",
            objects=ObjectSplit(
                train=(entry("lemon"), entry("orange")),
                validation=(entry("cube"),),
                test=(entry("vase"),),
            ),
            hands=HandSplit(
                train=(LockedHand(name="jaws"),),
                held_out=(LockedHand(name="claw", hash="9" * 64),),
            ),
        ),
        path,
    )
    return str(path)


@pytest.fixture
def data(tmp_path: Path) -> Path:
    root = tmp_path / "data"
    for name in ("lemon", "contactdb+orange", "cube", "ycb+cube"):
        write(root, "jaws", name)
    return root


def test_the_lock_says_which_objects_validate(data: Path, lock: str):
    split = choose_shards(TrainJob(data=str(data), split=lock, val_fraction=0.5))
    assert split.objects("train") == ["contactdb+orange", "lemon"]
    assert split.objects("validation") == ["cube", "ycb+cube"]
    assert split.record() == {"split": "mine-v1", "split_sha256": load_split(lock).content_hash}
    assert split.held_out_hands() == ["claw"]


@pytest.mark.parametrize(
    ("name", "content"),
    [("vase", "f" * 64), ("contactdb+vase", "f" * 64), ("my_part", HASHES["vase"])],
)
def test_test_objects_of_the_lock_are_refused_under_any_name(
    data: Path, lock: str, name: str, content: str
):
    write(data, "jaws", name, object_hash=content)
    choose_shards(TrainJob(data=str(data)))
    with pytest.raises(
        GdgErrors, match=rf"'{name.replace('+', '.')}' is a test object of .*mine-v1"
    ):
        choose_shards(TrainJob(data=str(data), split=lock))


def test_held_out_hands_are_refused_by_name_and_by_content_unless_they_are_left_aside(
    data: Path, lock: str
):
    write(data, "claw", "lemon")
    write(data, "mine", "lemon", hand_hash="9" * 64)
    with pytest.raises(GdgErrors) as caught:
        choose_shards(TrainJob(data=str(data), split=lock))
    first, second = caught.value.messages
    assert "'claw' is the held-out hand of the split mine-v1" in first
    assert "'mine' is the held-out hand 'claw' under another name" in second
    with pytest.raises(GdgErrors, match="'mine' is the held-out hand 'claw'"):
        choose_shards(TrainJob(data=str(data), split=lock, exclude_hand="claw"))
    split = choose_shards(TrainJob(data=str(data), split=lock, exclude_hand=["claw", "mine"]))
    assert {info.hand for info in split.train} == {"jaws"}


def test_what_a_lock_does_not_know_is_refused_in_one_go(data: Path, lock: str):
    write(data, "tongs", "lemon")
    write(data, "jaws", "teapot")
    write(data, "jaws", "vase")
    with pytest.raises(GdgErrors) as caught:
        choose_shards(TrainJob(data=str(data), split=lock))
    text = "\n".join(caught.value.messages)
    assert len(caught.value.messages) == 3
    for part in (
        "'tongs' is a hand that is not in",
        "'teapot' is not in",
        "'vase' is a test object",
    ):
        assert part in text


def renamed_gripper(folder: Path, tmp_path: Path) -> Path:
    copy = tmp_path / "copies" / "mine"
    shutil.copytree(folder, copy)
    manifest = copy / "hand.yaml"
    manifest.write_text(manifest.read_text().replace("name: two_jaws", "name: mine"))
    return copy


def test_a_copy_of_a_held_out_hand_is_known_by_its_body(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    folder = write_gripper(tmp_path / "hands")
    copy = renamed_gripper(folder, tmp_path)
    original, same = load_hand(folder), load_hand(copy)
    assert original.content_hash != same.content_hash
    root = tmp_path / "data"
    for name in ("lemon", "orange"):
        facts = {"hand_hash": same.content_hash, "hand_path": str(copy)}
        write(root, "mine", name, **facts)
    # by a lock
    held_out = LockedHand(name="two_jaws", hash=original.content_hash, body=body_hash(original))
    path = tmp_path / "x.lock.yaml"
    objects = ObjectSplit(train=(LockedObject(name="lemon"), LockedObject(name="orange")))
    hands = HandSplit(train=(LockedHand(name="mine"),), held_out=(held_out,))
    save_split(SplitLock(name="x", objects=objects, hands=hands), path)
    with pytest.raises(
        GdgErrors, match="'mine' is the held-out hand 'two_jaws' under another name"
    ):
        choose_shards(TrainJob(data=str(root), split=str(path)))
    # and by exclude_hand
    monkeypatch.setenv("GDG_HANDS_PATH", str(tmp_path / "hands"))
    assert "two_jaws" in HANDS.all()
    with pytest.raises(
        GdgErrors, match="'mine' is the excluded hand 'two_jaws' under another name"
    ):
        choose_shards(TrainJob(data=str(root), exclude_hand="two_jaws"))


def test_an_excluded_hand_is_known_by_its_content_in_the_data(tmp_path: Path):
    for hand in ("claw", "copy", "jaws"):
        content = "f" * 64 if hand == "jaws" else "9" * 64
        for name in ("lemon", "orange"):
            write(tmp_path, hand, name, hand_hash=content)
    with pytest.raises(GdgErrors, match="'copy' is the excluded hand 'claw' under another name"):
        choose_shards(TrainJob(data=str(tmp_path), exclude_hand="claw"))


def test_a_lock_without_validation_objects_in_the_data_needs_keep_last(tmp_path: Path, lock: str):
    write(tmp_path / "d", "jaws", "lemon")
    with pytest.raises(GdgError, match="write keep=last"):
        choose_shards(TrainJob(data=str(tmp_path / "d"), split=lock))
    split = choose_shards(TrainJob(data=str(tmp_path / "d"), split=lock, keep="last"))
    assert (len(split.train), len(split.validation)) == (1, 0)
    write(tmp_path / "e", "jaws", "cube")
    with pytest.raises(GdgError, match="holds no train object"):
        choose_shards(TrainJob(data=str(tmp_path / "e"), split=lock))


def test_an_unknown_split_is_told(data: Path):
    with pytest.raises(GdgError, match="Did you mean 'paper'"):
        choose_shards(TrainJob(data=str(data), split="papre"))


def test_without_a_lock_the_meshes_of_one_object_stay_together(tmp_path: Path):
    for name in ("lemon", "ycb+lemon", "orange", "ycb+orange"):
        write(tmp_path, "jaws", name)
    for seed in range(4):
        split = choose_shards(TrainJob(data=str(tmp_path), val_fraction=0.5, seed=seed))
        assert len(split.objects("train")) == 2
        assert len({name.rpartition("+")[2] for name in split.objects("train")}) == 1


def test_an_excluded_object_is_not_learned_from_under_any_name(tmp_path: Path):
    for name, content in (("lemon", "a"), ("orange", "b"), ("dgn+orange@0.9", "c"), ("round", "d")):
        write(tmp_path, "jaws", name, object_hash=content * 64)
    job = TrainJob(data=str(tmp_path), exclude_object="orange", val_fraction=0, keep="last")
    assert choose_shards(job).objects("train") == ["lemon", "round"]
    write(tmp_path, "claw", "round", object_hash="b" * 64)
    with pytest.raises(GdgErrors, match="'round' is the excluded object 'orange' under another"):
        choose_shards(job)
    both = job.model_copy(update={"exclude_object": ("orange", "round")})
    assert choose_shards(both).objects("train") == ["lemon"]
    with pytest.raises(GdgError, match=r"no object 'ornge'.*Did you mean 'orange'"):
        choose_shards(job.model_copy(update={"exclude_object": ("ornge",)}))
    with pytest.raises(GdgError, match="without lemon, orange, round holds no grasps"):
        choose_shards(job.model_copy(update={"exclude_object": ("lemon", "orange", "round")}))


def test_copies_and_scales_of_test_objects_are_refused_without_a_lock(tmp_path: Path):
    folder = OBJECTS.all()["apple"].path
    copy = tmp_path / f"innocent{Path(read_object_spec(folder).mesh).suffix}"
    shutil.copy(folder / read_object_spec(folder).mesh, copy)
    for name, facts in (
        ("lemon", {}),
        ("innocent", {"object_hash": object_hash(str(copy))}),
        ("dgn+apple@0.9", {}),
    ):
        write(tmp_path / "data", "jaws", name, **{"object_hash": "e" * 64, **facts})
    with pytest.raises(GdgErrors) as caught:
        choose_shards(TrainJob(data=str(tmp_path / "data")))
    texts = caught.value.messages
    assert len(texts) == 2
    assert "'dgn+apple@0.9' is a test object" in texts[0]
    assert "'innocent' is a test object" in texts[1]


def test_an_object_is_known_at_each_of_its_scales(tmp_path: Path):
    for scale in (1.0, 0.9, 0.8):
        facts = {"object_hash": object_hash("cube_small", scale), "object_path": "cube_small"}
        write(tmp_path, "jaws", f"cube_small@{scale}", object_scale=scale, **facts)
    registry = get_registry()
    choices = []
    for kind, name in (("distance", "aligned"), ("hand-model", "pytorch-kinematics")):
        record = registry.find(kind, name)
        choices.append(ComponentChoice(record=record, options=record.options()))
    items = ItemSource(*choices)
    for info in [*shards(tmp_path), *shards(tmp_path)]:
        assert items._object_of(info).content_hash == info.object_hash
