"""Contact maps as training data: groups on disk, batches in memory."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence, Sized
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.utils.data import Dataset, Sampler

#: Map files that stay open at once.
OPEN_FILES = 256


class MapBatch(NamedTuple):
    """Items of one step: object points (metres, object frame) and their contact values."""

    points: Float[Tensor, "batch object_point 3"]
    values: Float[Tensor, "batch object_point"]


@dataclass(frozen=True)
class MapGroup:
    """The maps of one hand on one object.

    Attributes:
        hand: the hand's name; the network never sees it.
        object_name: the object's name.
        points: the object's surface points, metres.
        values: contact values, half precision: an array, or a ``.npy`` file that is mapped into
            memory as needed.
        count: number of maps.
    """

    hand: str
    object_name: str
    points: Float[Tensor, "object_point 3"]
    values: np.ndarray | Path
    count: int

    def rows(self, indices: np.ndarray) -> np.ndarray:
        """The maps at the given indices, (map, object_point) float32."""
        stored = self.values if isinstance(self.values, np.ndarray) else _open(self.values)
        return np.asarray(stored[indices], np.float32)


class MapDataset(Dataset[MapBatch]):
    """All maps of several groups, read a batch at a time.

    Args:
        groups: in the order of the indices.
        points: object points per item.
        seed: decides, together with a batch's indices, which points it gets.
    """

    def __init__(self, groups: Sequence[MapGroup], points: int, seed: int):
        self.groups = tuple(groups)
        self._ends = np.cumsum([group.count for group in self.groups])
        self._points = points
        self._seed = seed

    def __len__(self) -> int:
        return int(self._ends[-1]) if len(self._ends) else 0

    def __getitem__(self, index: int) -> MapBatch:
        return self.__getitems__([index])

    def __getitems__(self, indices: Sequence[int]) -> MapBatch:
        """The batch of some indices, in their order; all items share one choice of points."""
        wanted = np.asarray(indices)
        group_of = np.searchsorted(self._ends, wanted, side="right")
        chosen = self._chosen_points(wanted)
        values = np.empty((len(wanted), len(chosen)), np.float32)
        points = torch.empty(len(wanted), len(chosen), 3)
        for number in np.unique(group_of):
            group, where = self.groups[number], np.flatnonzero(group_of == number)
            start = self._ends[number] - group.count
            values[where] = group.rows(wanted[where] - start)[:, chosen]
            points[torch.from_numpy(where)] = group.points[torch.from_numpy(chosen)]
        return MapBatch(points, torch.from_numpy(values))

    def _chosen_points(self, indices: np.ndarray) -> np.ndarray:
        total = len(self.groups[0].points)
        if self._points >= total:
            return np.arange(total)
        # the indices differ from step to step and epoch to epoch, and so do the points
        random = np.random.default_rng([self._seed, *indices.tolist()])
        return np.sort(random.choice(total, self._points, replace=False))


def as_batch(batch: Any) -> MapBatch:
    """The collate function: the dataset gives whole batches already."""
    return batch


class EpochShuffle(Sampler[int]):
    """Every index once, in an order that seed and epoch decide, also after a resume.

    Lightning calls ``set_epoch`` before each epoch.

    Args:
        data: what is shuffled.
        seed: of all orders.
    """

    def __init__(self, data: Sized, seed: int):
        self._data = data
        self._seed = seed
        self._epoch = 0

    def set_epoch(self, epoch: int) -> None:
        """Chooses the order of an epoch, counted from 0."""
        self._epoch = epoch

    def __len__(self) -> int:
        return len(self._data)

    def __iter__(self) -> Iterator[int]:
        random = np.random.default_rng([self._seed, self._epoch])
        return iter(random.permutation(len(self._data)).tolist())


@functools.lru_cache(maxsize=OPEN_FILES)
def _open(path: Path) -> np.ndarray:
    return np.load(path, mmap_mode="r", allow_pickle=False)
