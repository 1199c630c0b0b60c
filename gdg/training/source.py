"""Which grasps a training run may see, and their contact maps.

Test objects never enter: not by the split that a shard records, nor by the split that its object
has now, nor by a test object's name under another path.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from gdg.cache import cache_directory, content_hash
from gdg.config import ComponentChoice
from gdg.contact_maps import contact_maps_of_grasps
from gdg.data.atomic import atomic_path
from gdg.data.dataset import ShardInfo, read_shard, shards
from gdg.data.grasps import GraspSet
from gdg.errors import GdgError, did_you_mean, raise_if_any
from gdg.folders import HANDS, OBJECTS
from gdg.hands.hand import find_hand
from gdg.kinds.distance import Distance
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel, find_object
from gdg.objects.spec import read_object_spec
from gdg.training.job import TrainJob
from gdg.training.maps import MapGroup

TEST = "test"


@dataclass(frozen=True)
class Split:
    """Shards to train on, and shards of other train objects to choose the best epoch by."""

    train: tuple[ShardInfo, ...]
    validation: tuple[ShardInfo, ...]

    def objects(self, which: str) -> list[str]:
        """Object names of ``train`` or ``validation``, sorted."""
        return sorted({info.object_name for info in getattr(self, which)})


def choose_shards(job: TrainJob) -> Split:
    """The shards of the allowed hands, divided by object.

    Raises:
        GdgError: no data, a test object among them, an unknown hand excluded, or too few objects
            to hold some out.
    """
    found = [info for info in shards(Path(job.data).expanduser()) if info.count]
    refuse_test_objects(found)
    hands = {info.hand for info in found}
    for hand in job.exclude_hand:
        known = hands | set(HANDS.all())
        if hand not in known:
            raise GdgError(f"exclude_hand: there is no hand '{hand}'.{did_you_mean(hand, known)}")
    allowed = [info for info in found if info.hand not in job.exclude_hand]
    if not allowed:
        without = f" without {', '.join(job.exclude_hand)}" if job.exclude_hand else ""
        raise GdgError(f"data: {job.data}{without} holds no grasps.")
    held_out = _validation_objects(sorted({info.object_name for info in allowed}), job)
    return Split(
        tuple(info for info in allowed if info.object_name not in held_out),
        tuple(info for info in allowed if info.object_name in held_out),
    )


def refuse_test_objects(found: Sequence[ShardInfo]) -> None:
    """Raises if any shard's object belongs to a test split.

    Raises:
        GdgError: naming each such object and one of its shards.
    """
    names = _test_object_names()
    leaks = {
        info.object_name: info.path
        for info in found
        if info.split == TEST or _bare(info.object_name) in names
    }
    raise_if_any(
        [
            f"data: {path}: '{name}' is a test object, and training on it would spoil every test "
            f"on it; remove its folder from the data."
            for name, path in sorted(leaks.items())
        ]
    )


def _bare(object_name: str) -> str:
    """``apple`` of ``contactdb+apple``."""
    return object_name.rpartition("+")[2]


def _test_object_names() -> set[str]:
    folders = [found.path for found in OBJECTS.all().values() if found.path.is_dir()]
    return {_bare(spec.name) for spec in map(read_object_spec, folders) if spec.split == TEST}


def _validation_objects(objects: list[str], job: TrainJob) -> set[str]:
    if job.val_fraction == 0:
        if job.keep == "best":
            raise GdgError("keep=best needs validation objects; write keep=last or a val_fraction.")
        return set()
    count = max(1, round(job.val_fraction * len(objects)))
    if count >= len(objects):
        raise GdgError(
            f"val_fraction: {job.val_fraction:g} of {len(objects)} object(s) leaves none to train "
            f"on; give data of more objects, or val_fraction=0 with keep=last."
        )
    order = np.random.default_rng(job.seed).permutation(len(objects))
    return {objects[index] for index in order[:count]}


class MapSource:
    """Computes the contact maps of shards, once: they are cached by the content they follow from.

    Args:
        distance: what the maps are made with.
        hand_model: the component that places the hands.
    """

    def __init__(self, distance: ComponentChoice, hand_model: ComponentChoice):
        self._recipe = "\n".join(
            f"{choice.record.version} {sorted(choice.as_tree().items())}"
            for choice in (distance, hand_model)
        )
        self.distance: Distance = distance.record.load()(distance.options)
        self._hand_model = hand_model
        self._hands: dict[str, HandModel] = {}
        self._objects: dict[str, ObjectModel] = {}
        #: Content hashes of the shards that were read, by path.
        self.shard_hashes: dict[Path, str] = {}

    def group(self, info: ShardInfo) -> MapGroup | None:
        """The maps of a shard's good grasps; None where it has none.

        Good are those that a simulation passed, or all where none was run.

        Raises:
            GdgError: the shard can't be read, or its hand or object are not what they were.
        """
        obj, path = self._object(info), self._cache_path(info)
        if not path.is_file():
            grasps = good_grasps(read_shard(info.path))
            values = np.empty((0, len(obj.points)), np.float16)
            if len(grasps):
                maps = contact_maps_of_grasps(self._hand(info), obj, grasps, self.distance)
                values = maps.values.half().numpy()
            with atomic_path(path) as temporary, temporary.open("wb") as stream:
                np.save(stream, values)
        count = len(np.load(path, mmap_mode="r", allow_pickle=False))
        if not count:
            return None
        return MapGroup(info.hand, info.object_name, obj.points, path, count)

    def _cache_path(self, info: ShardInfo) -> Path:
        shard_hash = content_hash(info.path.read_bytes())
        self.shard_hashes[info.path] = shard_hash
        parts = ("maps-1", shard_hash, info.hand_hash, info.object_hash, self._recipe)
        return cache_directory() / "maps" / f"{content_hash(*parts)}.npy"

    def _hand(self, info: ShardInfo) -> HandModel:
        given = info.hand_path or info.hand
        if given not in self._hands:
            hand = find_hand(given)
            choice = self._hand_model
            model = choice.record.load()(choice.options, hand, torch.device("cpu"))
            self._hands[given] = model
        model = self._hands[given]
        if model.hand.content_hash != info.hand_hash:
            raise GdgError(
                f"{info.path}: its grasps were made with another version of the hand "
                f"'{info.hand}' than {model.hand.folder}; synthesise them anew."
            )
        return model

    def _object(self, info: ShardInfo) -> ObjectModel:
        given = info.object_path or info.object_name
        if given not in self._objects:
            obj = find_object(given, scale=info.object_scale)
            if obj.split == TEST:
                raise GdgError(f"data: {info.path}: '{obj.name}' is a test object.")
            self._objects[given] = obj
        obj = self._objects[given]
        if obj.content_hash != info.object_hash:
            raise GdgError(
                f"{info.path}: its grasps were made with another version of the object "
                f"'{info.object_name}' than {obj.path}; synthesise them anew."
            )
        return obj


def good_grasps(grasps: GraspSet) -> GraspSet:
    """The grasps that passed their simulation, or all where none was run."""
    return grasps.select(grasps.passed) if grasps.verdicts else grasps
