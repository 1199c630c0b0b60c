"""Training: tiny runs end to end, resume, and no leak of test objects or held-out hands."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from gdg_plugins.generator_cvae.module import CvaeModule
from gdg_plugins.generator_cvae.weights import load_weights
from grasp_samples import make_verdict
from pydantic import ValidationError

from gdg.config import ComponentChoice
from gdg.data.dataset import write_shard
from gdg.data.grasps import GraspSet
from gdg.data.verdict import Verdict
from gdg.errors import GdgError
from gdg.hands.hand import find_hand
from gdg.objects.model import find_object
from gdg.registry import get_registry
from gdg.rotations import random_rotations
from gdg.splits import load_split
from gdg.training.fit import fit, read_checkpoint
from gdg.training.job import TrainJob
from gdg.training.maps import EpochShuffle, MapDataset, MapGroup
from gdg.training.source import MapSource, choose_shards, good_grasps
from gdg.training.train import run_training

FACTS = {"hand_hash": "h", "object_hash": "o", "split": "train"}
TINY = {"points": 64, "epochs": 2, "progress": False, "accelerator": "cpu"}


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Tensors this small only wait for each other's threads, for long on a busy machine."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def choices() -> dict[str, ComponentChoice]:
    found = {}
    for kind, name in (
        ("generator", "cvae"),
        ("distance", "aligned"),
        ("hand-model", "pytorch-kinematics"),
    ):
        record = get_registry().find(kind, name)
        found[kind.replace("-", "_")] = ComponentChoice(record=record, options=record.options())
    return found


def some_grasps(hand: str, object_name: str, count: int, seed: int = 0) -> GraspSet:
    """Barrett hands around the object, palm toward it."""
    random = torch.Generator().manual_seed(seed)
    poses = torch.eye(4).repeat(count, 1, 1)
    poses[:, :3, :3] = random_rotations(count, random)
    poses[:, :3, 3] = -0.08 * poses[:, :3, 2]
    return GraspSet(
        hand=hand,
        object_name=object_name,
        joint_names=find_hand("barrett").spec.joints,
        root_link="palm",
        poses=poses,
        joints=torch.rand(count, 4, generator=random),
    )


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three train objects with 12 barrett grasps each."""
    root, hand = tmp_path_factory.mktemp("synth"), find_hand("barrett")
    for seed, name in enumerate(("cube_small", "lemon", "orange")):
        obj = find_object(name)
        facts = {
            "hand_hash": hand.content_hash,
            "object_hash": obj.content_hash,
            "split": obj.split,
        }
        write_shard(root, "k", some_grasps("barrett", name, 12, seed), facts)
    return root


def synthetic_groups(count: int = 24) -> list[MapGroup]:
    """Maps by formula on random points: no hand, no object."""
    random = torch.Generator().manual_seed(0)
    points = 0.05 * torch.randn(128, 3, generator=random)
    directions = torch.nn.functional.normalize(torch.randn(count, 3, generator=random), dim=-1)
    values = torch.sigmoid(60 * directions @ points.T - 1).half().numpy()
    return [MapGroup("hand", "thing", points, values, count)]


# -- whole runs ------------------------------------------------------------------------------


def test_run_writes_weights_card_and_logs_and_refuses_to_overwrite(
    dataset: Path, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    job = TrainJob(data=str(dataset), out=str(out), val_fraction=0.34, batch=8, **TINY)
    weights = load_weights(str(run_training(job, choices())))
    weights.network()
    known = weights.provenance
    assert weights.distance == "aligned/release"
    assert known["hands"] == ["barrett"]
    assert sorted(known["train_objects"] + known["validation_objects"]) == [
        "cube_small",
        "lemon",
        "orange",
    ]
    assert len(known["validation_objects"]) == 1
    assert (known["train_maps"], known["validation_maps"]) == (24, 12)
    assert 0 < known["val_recon"] < 1
    assert (known["split"], known["split_sha256"]) == ("none", "")
    card = (out / "model_card.md").read_text()
    assert known["validation_objects"][0] in card
    assert f"{known['val_recon']:.4f}" in card
    assert (out / "checkpoints" / "last.ckpt").is_file()
    assert "val_recon" in (out / "logs" / "version_0" / "metrics.csv").read_text()
    with pytest.raises(GdgError, match="holds a training run"):
        run_training(job, choices())
    with pytest.raises(GdgError, match="begun with other values of learning_rate"):
        run_training(job.model_copy(update={"resume": True, "learning_rate": 0.1}), choices())


def test_run_with_a_lock_takes_its_validation_objects_and_records_it(tmp_path: Path) -> None:
    data, hand = tmp_path / "data", find_hand("barrett")
    for name in ("lemon", "mustard_bottle"):
        facts = {"hand_hash": hand.content_hash, "split": "train"}
        content = find_object(name).content_hash
        write_shard(data, "k", some_grasps("barrett", name, 8), {**facts, "object_hash": content})
    tiny = {**TINY, "epochs": 1}
    job = TrainJob(
        data=str(data), out=str(tmp_path / "run"), split="paper-without-allegro", batch=4, **tiny
    )
    known = load_weights(str(run_training(job, choices()))).provenance
    assert (known["train_objects"], known["validation_objects"]) == (["lemon"], ["mustard_bottle"])
    assert known["held_out_hands"] == ["allegro", "allegro_right"]
    assert known["split"] == "paper-without-allegro-v1"
    assert known["split_sha256"] == load_split("paper-without-allegro").content_hash
    assert known["split_sha256"] in (tmp_path / "run" / "model_card.md").read_text()


def test_resumed_run_equals_an_uninterrupted_one(tmp_path: Path) -> None:
    groups = synthetic_groups()

    def run(folder: str, epochs: int, resume: bool = False) -> dict[str, torch.Tensor]:
        job = TrainJob(
            data="-",
            keep="last",
            val_fraction=0,
            batch=8,
            resume=resume,
            **{**TINY, "epochs": epochs},
        )
        module = CvaeModule(learning_rate=1e-3, seed=0)
        return fit(module, groups, [], job, tmp_path / folder).module.state_dict()

    whole = run("whole", 3)
    run("parts", 2)
    resumed = run("parts", 3, resume=True)
    assert read_checkpoint(tmp_path / "parts" / "checkpoints" / "last.ckpt")["epoch"] == 2
    for name, tensor in whole.items():
        torch.testing.assert_close(resumed[name], tensor, rtol=1e-4, atol=1e-5)
    again = run("other", 3, resume=True)
    torch.testing.assert_close(
        again["network.encoder.mean.bias"], whole["network.encoder.mean.bias"]
    )


def test_best_epoch_is_kept_and_its_error_reported(tmp_path: Path) -> None:
    groups = synthetic_groups()
    job = TrainJob(data="-", batch=8, **{**TINY, "epochs": 3})
    fitted = fit(CvaeModule(1e-3, 0), groups, groups, job, tmp_path)
    rows = (tmp_path / "logs" / "version_0" / "metrics.csv").read_text().splitlines()
    column = rows[0].split(",").index("val_recon")
    errors = [float(row.split(",")[column]) for row in rows[1:] if row.split(",")[column]]
    assert len(errors) == 3
    assert fitted.val_recon == pytest.approx(min(errors), rel=1e-5)
    assert fitted.epoch == int(np.argmin(errors))


def test_best_needs_validation_and_learners_only(dataset: Path, tmp_path: Path) -> None:
    job = TrainJob(data=str(dataset), out=str(tmp_path / "a"), val_fraction=0, **TINY)
    with pytest.raises(GdgError, match="keep=best needs validation"):
        run_training(job, choices())
    record = get_registry().find("generator", "oracle")
    oracle = ComponentChoice(record=record, options=record.options(grasps="x"))
    with pytest.raises(GdgError, match="nothing to train"):
        run_training(job, {**choices(), "generator": oracle})


def test_checkpoint_with_code_is_refused(tmp_path: Path) -> None:
    torch.save({"state_dict": {}, "hook": Path("x")}, tmp_path / "last.ckpt")
    with pytest.raises(GdgError, match="more than plain values"):
        read_checkpoint(tmp_path / "last.ckpt")


# -- what may be learned from ----------------------------------------------------------------


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


def test_changed_hand_or_object_is_refused(tmp_path: Path) -> None:
    obj = find_object("lemon")
    picked = choices()
    write(tmp_path / "a", "barrett", "lemon")
    write(tmp_path / "b", "barrett", "lemon", object_hash=obj.content_hash)
    for folder, what in (("a", "the object 'lemon'"), ("b", "the hand 'barrett'")):
        job = TrainJob(data=str(tmp_path / folder), val_fraction=0, keep="last")
        source = MapSource(picked["distance"], picked["hand_model"])
        with pytest.raises(GdgError, match=f"another version of {what}"):
            source.group(choose_shards(job).train[0])


def test_maps_are_cached_and_made_again_where_the_cache_is_damaged(
    dataset: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("GDG_CACHE", str(tmp_path))
    picked = choices()
    (info, *_) = choose_shards(TrainJob(data=str(dataset), val_fraction=0, keep="last")).train
    whole = MapSource(picked["distance"], picked["hand_model"]).group(info)
    assert whole is not None
    assert isinstance(whole.values, Path)
    expected = np.load(whole.values)
    assert (expected.dtype, expected.shape) == (np.float16, (12, 2048))
    # a chunk at a time, after the file was cut off
    whole.values.write_bytes(whole.values.read_bytes()[:500])
    monkeypatch.setattr("gdg.training.source.CHUNK", 5)
    again = MapSource(picked["distance"], picked["hand_model"]).group(info)
    assert again is not None
    assert (again.values, again.count) == (whole.values, 12)
    np.testing.assert_array_equal(np.load(whole.values), expected)
    # and not at all where it is sound
    monkeypatch.setattr("gdg.training.source.contact_maps_of_grasps", None)
    assert MapSource(picked["distance"], picked["hand_model"]).group(info) is not None


def verdict(success: bool) -> Verdict:
    return make_verdict(success, shift_successes=(success,), refined=False)


def test_only_grasps_that_passed_are_learned_from() -> None:
    grasps = some_grasps("barrett", "lemon", 3)
    assert len(good_grasps(grasps)) == 3
    judged = replace(grasps, verdicts=(verdict(True), verdict(False), verdict(True)))
    assert torch.equal(good_grasps(judged).joints, grasps.joints[[0, 2]])


# -- data ------------------------------------------------------------------------------------


def test_dataset_gives_the_maps_of_the_indices(tmp_path: Path) -> None:
    first, second = synthetic_groups(5)[0], synthetic_groups(3)[0]
    path = tmp_path / "maps.npy"
    assert isinstance(second.values, np.ndarray)
    np.save(path, second.values + np.float16(0.25))
    data = MapDataset([first, replace(second, values=path)], points=128, seed=0)
    assert len(data) == 8
    batch = data.__getitems__([6, 0, 4])
    assert isinstance(first.values, np.ndarray)
    expected = np.stack((second.values[1] + np.float16(0.25), first.values[0], first.values[4]))
    np.testing.assert_array_equal(batch.values.numpy(), expected.astype(np.float32))
    assert torch.equal(batch.points[0], second.points)


def test_subsampled_points_keep_their_values() -> None:
    group = synthetic_groups(6)[0]
    data = MapDataset([group], points=16, seed=0)
    batch, other = data.__getitems__([0, 3]), data.__getitems__([1, 3])
    assert batch.points.shape == (2, 16, 3)
    columns = (group.points[:, None] == batch.points[0][None]).all(-1).int().argmax(0).numpy()
    assert isinstance(group.values, np.ndarray)
    np.testing.assert_array_equal(batch.values[1].numpy(), group.values[3, columns])
    assert not torch.equal(batch.points[0], other.points[0])
    assert torch.equal(batch.points, data.__getitems__([0, 3]).points)


def test_order_follows_seed_and_epoch() -> None:
    sampler = EpochShuffle(range(20), seed=1)
    first = list(sampler)
    assert sorted(first) == list(range(20))
    sampler.set_epoch(1)
    assert list(sampler) != first
    sampler.set_epoch(0)
    assert list(sampler) == first


def test_job_reads_one_hand_or_a_list_and_refuses_typos() -> None:
    assert TrainJob(data="x", exclude_hand="a").exclude_hand == ("a",)
    assert TrainJob(data="x", exclude_hand=["a", "b"]).exclude_hand == ("a", "b")
    assert json.loads(TrainJob(data="x").model_dump_json())["exclude_hand"] == []
    with pytest.raises(ValidationError):
        TrainJob(data="x", epoch=3)  # type: ignore[call-arg]
