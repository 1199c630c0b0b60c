"""Training items: arrays on disk, mapped into memory as they are needed, stacked into batches."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.utils.data import Dataset

from gdg.contact_maps import contact_values
from gdg.kinds.distance import Distance
from gdg.kinds.hand_model import HandModel
from gdg.kinds.trainable import BatchKind
from gdg.training.batches import AnyBatch, GraspBatch, MapBatch
from gdg.training.order import Step

#: Array files that stay open at once.
OPEN_FILES = 256

#: An array, or a ``.npy`` file that holds one.
Stored = np.ndarray | Path


@dataclass(frozen=True)
class ItemGroup:
    """The items of one hand on one object: those of a shard.

    Attributes:
        hand: the hand's name; no network sees it.
        object_name: the object's name.
        surface: the object's points and outward normals, (object_point, 6) float32, metres.
        count: number of items.
        values: contact values, (item, object_point), half precision; None where they are computed.
        q: pose vectors in the hand's declared joint order, (item, dof) float32; None where no one
            needs them.
    """

    hand: str
    object_name: str
    surface: Stored
    count: int
    values: Stored | None = None
    q: Stored | None = None


class Drawn(NamedTuple):
    """The items of a step, and the seed of their augmentation; None for validation."""

    items: AnyBatch
    seed: int | None


@dataclass(frozen=True)
class MapMaker:
    """Makes contact maps where none are stored.

    Attributes:
        distance: what they are made with.
        hands: the hands by name, on the CPU.
    """

    distance: Distance
    hands: Mapping[str, HandModel]

    def values(
        self, hand: str, surface: Float[Tensor, "object_point 6"], q: Float[Tensor, "grasp dof"]
    ) -> Float[Tensor, "grasp object_point"]:
        """Contact values, in the steps of half precision that stored ones come in."""
        points, normals = surface.split(3, dim=-1)
        model = self.hands[hand]
        made = contact_values(model, points.contiguous(), normals.contiguous(), q, self.distance)
        return made.half().float()


class ItemDataset(Dataset[Drawn]):
    """All items of several groups, read a step at a time.

    Args:
        groups: in the order of the indices.
        kind: of the batches.
        points: object points per item; all items of a step share one choice of points.
        maker: makes the maps of groups that have none.
    """

    def __init__(
        self,
        groups: Sequence[ItemGroup],
        kind: BatchKind,
        points: int,
        maker: MapMaker | None = None,
    ):
        self.groups = tuple(groups)
        self._ends = np.cumsum([group.count for group in self.groups], dtype=np.int64)
        self._kind, self._points, self._maker = kind, points, maker

    def __len__(self) -> int:
        return int(self._ends[-1]) if len(self._ends) else 0

    def __getitem__(self, index: int) -> Drawn:
        return self.__getitems__(Step(np.array([index]), None))

    def __getitems__(self, step: Step) -> Drawn:
        """The items of a step, in the order of its indices."""
        group_of = np.searchsorted(self._ends, step.indices, side="right")
        chosen = self._chosen_points(step)
        size = len(step.indices)
        surface = torch.empty(size, len(chosen), 6)
        values = torch.empty(size, len(chosen))
        q: list[Tensor] = [torch.empty(0)] * size
        for number in np.unique(group_of):
            group, where = self.groups[number], np.flatnonzero(group_of == number)
            rows = step.indices[where] - (self._ends[number] - group.count)
            own = torch.from_numpy(_read(group.surface, slice(None))[chosen])
            poses = None if group.q is None else torch.from_numpy(_read(group.q, rows))
            surface[torch.from_numpy(where)] = own
            values[torch.from_numpy(where)] = self._values(group, rows, chosen, own, poses)
            if self._kind == "grasps":
                assert poses is not None
                for place, pose in zip(where.tolist(), poses, strict=True):
                    q[place] = pose
        points, normals = surface.split(3, dim=-1)
        if self._kind == "maps":
            return Drawn(MapBatch(points, values, normals), step.seed)
        return Drawn(GraspBatch(points, normals, values, torch.stack(q)), step.seed)

    def _values(
        self,
        group: ItemGroup,
        rows: np.ndarray,
        chosen: np.ndarray,
        surface: Tensor,
        q: Tensor | None,
    ) -> Tensor:
        if group.values is not None:
            return torch.from_numpy(_read(group.values, rows)[:, chosen])
        assert self._maker is not None
        assert q is not None
        return self._maker.values(group.hand, surface, q)

    def _chosen_points(self, step: Step) -> np.ndarray:
        total = len(_opened(self.groups[0].surface))
        if step.seed is None or self._points >= total:
            return np.arange(total)
        random = np.random.default_rng(step.seed)
        return np.sort(random.choice(total, self._points, replace=False))


def as_drawn(step: Any) -> Drawn:
    """The collate function: the dataset gives whole steps already."""
    return step


def sorted_groups(groups: Sequence[ItemGroup]) -> list[ItemGroup]:
    """Groups of one hand, and in it of one object, next to each other."""
    return sorted(groups, key=lambda group: (group.hand, group.object_name))


def class_sizes(groups: Sequence[ItemGroup], balance: str) -> list[int]:
    """Items of each class that is to come equally often; of ``sorted_groups``."""
    sizes: dict[object, int] = {}
    for group in groups:
        of = {"none": "", "hands": group.hand, "pairs": (group.hand, group.object_name)}[balance]
        sizes[of] = sizes.get(of, 0) + group.count
    return list(sizes.values())


def _read(stored: Stored, rows: np.ndarray | slice) -> np.ndarray:
    """Some rows, in single precision."""
    return np.asarray(_opened(stored)[rows], np.float32)


def _opened(stored: Stored) -> np.ndarray:
    return stored if isinstance(stored, np.ndarray) else _mapped(stored)


@functools.lru_cache(maxsize=OPEN_FILES)
def _mapped(path: Path) -> np.ndarray:
    return np.load(path, mmap_mode="r", allow_pickle=False)
