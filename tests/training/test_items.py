"""Batches of items: the right rows, one choice of points, arrays or files."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from training_samples import synthetic_groups, tiny_job

from gdg.training.batches import GraspBatch, MapBatch
from gdg.training.data import TrainingData
from gdg.training.items import ItemDataset
from gdg.training.order import Step


def step(*indices: int, seed: int | None = None) -> Step:
    return Step(np.array(indices), seed)


def test_dataset_gives_the_items_of_the_indices(tmp_path: Path) -> None:
    first, second = synthetic_groups(5, 3)
    path = tmp_path / "maps.npy"
    np.save(path, second.values)
    data = ItemDataset([first, replace(second, values=path)], "grasps", points=128)
    assert len(data) == 8
    batch = data.__getitems__(step(6, 0, 4)).items
    assert isinstance(batch, GraspBatch)
    for row, (group, item) in enumerate(((second, 1), (first, 0), (first, 4))):
        np.testing.assert_array_equal(batch.values[row], group.values[item].astype(np.float32))
        np.testing.assert_array_equal(batch.q[row], group.q[item])
        np.testing.assert_array_equal(batch.points[row], group.surface[:, :3])
        np.testing.assert_array_equal(batch.normals[row], group.surface[:, 3:])
    maps = ItemDataset([first], "maps", points=128).__getitems__(step(1)).items
    assert isinstance(maps, MapBatch)


def test_subsampled_points_keep_their_values() -> None:
    group = synthetic_groups(6)[0]
    data = ItemDataset([group], "maps", points=16)
    batch, other = (data.__getitems__(step(0, 3, seed=seed)).items for seed in (1, 2))
    assert batch.points.shape == (2, 16, 3)
    whole = torch.from_numpy(group.surface[:, :3])
    columns = (whole[:, None] == batch.points[0][None]).all(-1).int().argmax(0).numpy()
    np.testing.assert_array_equal(batch.values[1], group.values[3, columns].astype(np.float32))
    assert not torch.equal(batch.points[0], other.points[0])
    assert torch.equal(batch.points, data.__getitems__(step(0, 3, seed=1)).items.points)
    assert data.__getitems__(step(0)).items.points.shape == (1, 128, 3), "all for validation"


def test_training_steps_are_augmented_and_validation_is_not() -> None:
    groups = synthetic_groups(10)
    data = TrainingData(groups, groups, tiny_job(augment={"jitter_m": 0.01}), "maps")
    drawn = next(iter(data.train_dataloader()))
    varied = data.on_after_batch_transfer(drawn, 0)
    assert 0.005 < (varied.points - drawn.items.points).std() < 0.02
    again = data.on_after_batch_transfer(drawn, 0)
    assert torch.equal(varied.points, again.points)
    checked = next(iter(data.val_dataloader()))
    assert data.on_after_batch_transfer(checked, 0) is checked.items


def test_reading_processes_give_the_same_steps() -> None:
    groups = synthetic_groups(40)
    alone = TrainingData(groups, [], tiny_job(), "maps").train_dataloader()
    helped = TrainingData(groups, [], tiny_job(workers=2), "maps").train_dataloader()
    for a, b in zip(alone, helped, strict=True):
        assert a.seed == b.seed
        assert torch.equal(a.items.values, b.items.values)


def test_dataset_can_be_sent_to_a_spawned_process() -> None:
    data = ItemDataset(synthetic_groups(4), "maps", 16)
    copy = pickle.loads(pickle.dumps(data))
    wanted = step(2, seed=1)
    assert torch.equal(
        copy.__getitems__(wanted).items.values, data.__getitems__(wanted).items.values
    )
